"""Studies: sweeps of a case over its parameters, kept as CSV, and the charts drawn from it."""

from fenics_contact.studies.charts import stability_map, work_precision
from fenics_contact.studies.runner import Study, grid, metrics

__all__ = ["Study", "grid", "metrics", "stability_map", "work_precision"]
