"""Runs one case of a study: `python -m fenics_contact.studies.worker '[file, function, arguments, repeats, answer]'`."""

import importlib.util
import json
import sys

from mpi4py import MPI


def main():
    file, name, arguments, repeats, answer = json.loads(sys.argv[1])
    spec = importlib.util.spec_from_file_location("study_case", file)
    module = importlib.util.module_from_spec(spec)
    sys.modules["study_case"] = module
    spec.loader.exec_module(module)
    found = []
    try:
        while len(found) < repeats and all(one["converged"] for one in found):
            found.append(getattr(module, name)(**arguments))
    except ValueError as refusal:  # a scene refused before it starts is an answer too
        found.append({"converged": False, "verdict": f"refused: {refusal}"})
    if MPI.COMM_WORLD.rank == 0:
        with open(answer, "w") as file:
            json.dump(found, file, default=float)


if __name__ == "__main__":
    main()
