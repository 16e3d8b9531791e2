"""The types that signatures name: arrays by their entries, and what comes from libraries without types of their own."""

from typing import Any, TypeAlias

import numpy as np
from numpy.typing import NDArray

Floats = NDArray[np.float64]
Ints = NDArray[np.int32]  # numbers of nodes, cells and facets as dolfinx gives them, status codes
Ints64 = NDArray[np.int64]  # numbers that kernels count with, global numbers, keys that no partition changes
Bools = NDArray[np.bool_]
Array = NDArray[Any]  # entries of either kind

# Places of the slave points on their master, in terms of the master alone: arrays with a row per point
Anchors = tuple[Array, ...]

# dolfinx, UFL and PETSc have no types that a checker could read: these say which of their objects is meant.
Mesh: TypeAlias = Any
Space: TypeAlias = Any
Function: TypeAlias = Any
Constant: TypeAlias = Any
Tags: TypeAlias = Any  # of dolfinx: mesh tags
Form: TypeAlias = Any  # of UFL, or compiled
Expr: TypeAlias = Any  # of UFL
Measure: TypeAlias = Any
Mat: TypeAlias = Any
Vec: TypeAlias = Any
Solver: TypeAlias = Any  # of PETSc: KSP
