"""Runs cases of a study: `python -m fenics_contact.studies.worker TASK`, or `-` for a task on each line of its input.

TASK: '[file, function, arguments, outputs, repeats, answer]' in JSON; `answer` is the file for the list of metrics.
"""

import importlib.util
import json
import os
import sys
import time
from typing import Any

from mpi4py import MPI

from fenics_contact.studies.runner import row_of


def run(file: str, name: str, arguments: dict[str, Any], outputs: list[str], repeats: int, answer: str) -> None:
    """Metrics of a case's repeats, as a list in JSON, into the file `answer`: as many as converge, and a refusal as one."""
    spec = importlib.util.spec_from_file_location("study_case", file)
    if spec is None or spec.loader is None:
        raise ValueError(f"{file} is no Python file")
    module = importlib.util.module_from_spec(spec)
    sys.modules["study_case"] = module
    spec.loader.exec_module(module)
    found: list[dict[str, Any]] = []
    try:
        while len(found) < repeats and all(one["converged"] for one in found):
            wall, busy = time.perf_counter(), time.process_time()
            found.append(row_of(getattr(module, name)(**arguments), outputs))
            found[-1]["busy"] = (time.process_time() - busy) / (time.perf_counter() - wall)
    except ValueError as refusal:  # a scene refused before it starts is an answer too
        found.append({"converged": False, "verdict": f"refused: {refusal}"})
    except SystemExit as end:  # of a case that requires its run to converge
        found.append({"converged": False, "verdict": str(end)})
    if MPI.COMM_WORLD.rank == 0:
        with open(f"{answer}.part", "w") as out:
            json.dump(found, out, default=float)
        os.replace(f"{answer}.part", answer)  # whole or not at all


if __name__ == "__main__":
    for task in sys.stdin if sys.argv[1] == "-" else sys.argv[1:]:
        run(*json.loads(task))
