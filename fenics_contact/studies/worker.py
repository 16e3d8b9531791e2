"""Runs cases of a study: `python -m fenics_contact.studies.worker TASK`, or `-` for a task on each line of its input.

TASK: '[file, function, arguments, outputs, repeats, answer]' in JSON; `answer` is the file for the list of metrics. Of
several processes each that fails writes why, for the others may wait for it: who has started them ends them all.
"""

import importlib.util
import json
import os
import sys
import time
from collections.abc import Callable
from typing import Any

from mpi4py import MPI

from fenics_contact.agreement import Lost
from fenics_contact.studies.runner import WHY, row_of
from fenics_contact.uncaught import last_words


def run(file: str, name: str, arguments: dict[str, Any], outputs: list[str], repeats: int, answer: str) -> None:
    """Metrics of a case's repeats, as a list in JSON, into the file `answer`: as many as converge, and a refusal as one. Of
    another error the words, into a file beside it. Collective."""
    found: list[dict[str, Any]] = []
    comm, successful = MPI.COMM_WORLD, False
    try:
        case = _case(file, name)
        while len(found) < repeats and all(one["converged"] for one in found):
            wall, busy = time.perf_counter(), time.process_time()
            row = row_of(case(**arguments), outputs)
            row["busy"] = (time.process_time() - busy) / (time.perf_counter() - wall)
            found.append(json.loads(json.dumps(row, default=float)))
        comm.Barrier()  # no row of one process stands where another one has failed
        successful = True
    except Lost:  # another one says why
        raise
    except ValueError as refusal:  # a scene refused before it starts is an answer too
        found.append({"converged": False, "verdict": f"refused: {refusal}"})
    except SystemExit as end:  # of a case that requires its run to converge
        found.append({"converged": False, "verdict": str(end)})
    except Exception as error:
        _write(f"{answer}{WHY}", last_words(error))
        raise
    if comm.rank == 0 or not successful:
        _write(answer, json.dumps(found))


def _case(file: str, name: str) -> Callable[..., Any]:
    spec = importlib.util.spec_from_file_location("study_case", file)
    if spec is None or spec.loader is None:
        raise ValueError(f"{file} is no Python file")
    module = importlib.util.module_from_spec(spec)
    sys.modules["study_case"] = module
    spec.loader.exec_module(module)
    return getattr(module, name)


def _write(path: str, text: str) -> None:
    """Whole or not at all, by whichever process."""
    part = f"{path}.{MPI.COMM_WORLD.rank}"
    with open(part, "w") as out:
        out.write(text)
    os.replace(part, path)


if __name__ == "__main__":
    for task in sys.stdin if sys.argv[1] == "-" else sys.argv[1:]:
        run(*json.loads(task))
