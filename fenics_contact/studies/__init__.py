"""Studies: sweeps of a case over its parameters, kept as CSV, and the charts drawn from it; docs/studies.md shows how.

python3 -m fenics_contact.studies NAME [--quick]        # --help: which there are
"""

from fenics_contact.studies.charts import answer, work_precision
from fenics_contact.studies.fit import Fit, fit
from fenics_contact.studies.runner import Study, expand, grid, metrics, read
from fenics_contact.studies.stability import stability_map
from fenics_contact.studies.sweep import curves, failures

__all__ = [
    "Fit",
    "Study",
    "answer",
    "curves",
    "expand",
    "failures",
    "fit",
    "grid",
    "metrics",
    "read",
    "stability_map",
    "work_precision",
]
