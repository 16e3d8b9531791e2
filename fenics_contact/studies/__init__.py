"""Studies: sweeps of a case over its parameters, kept as CSV, and the charts drawn from it.

    python3 -m fenics_contact.studies NAME [--quick]        # sphere, tubes, punch, cylinder, hertz, maps, economy

The same on a scene of one's own, in a script whose top level holds the case:

    def case(cells, steps, penalty):
        scene, tool = my_scene(cells, penalty)
        result = solve(scene, move={tool: (0, 0, -1)}, steps=steps, progress=False)
        force = -result.history[-1]["top_force_z_N"]
        return metrics(result, error=abs(force / 145.0 - 1), value=force)

    if __name__ == "__main__":  # every run imports this file in a process of its own
        base = {"cells": 8, "steps": 10, "penalty": 100.0}
        panels = {"mesh": {"cells": {"cells": [4, 8, 16]}}, "solver": {"steps": {"steps": [1, 4, 10]}}}
        rows = read(Study("mine", case, expand(base, panels), repeats=3).run("results"))
        work_precision("results/mine.png", rows, base, panels, parameters=list(base))
        print(answer(rows, base, panels, list(base)))
"""

from fenics_contact.studies.charts import answer, work_precision
from fenics_contact.studies.runner import Study, expand, grid, metrics, read
from fenics_contact.studies.stability import stability_map

__all__ = ["Study", "answer", "expand", "grid", "metrics", "read", "stability_map", "work_precision"]
