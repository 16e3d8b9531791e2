"""Forms on cells, evaluated for several cells at once: FFCx's kernels with vectors for numbers, a cell in each lane.

As Sun et al. (2020, doi:10.1177/1094342020945005): a cell's own loops are too short and too different for a compiler to fill
vectors with, but all cells do the same. `lanes.h` has the vectors and the loop over cells.
"""

import ctypes
import re
from collections.abc import Mapping, Sequence
from copy import copy
from functools import partial
from pathlib import Path
from typing import Any
from zlib import crc32

import numpy as np

from fenics_contact import compat
from fenics_contact.types import Bools, Floats, Form, Ints, Space

_HEADER = Path(__file__).with_suffix(".h").read_text()
_VERSION = crc32((_HEADER + Path(__file__).read_text()).encode())  # FFCx caches what older ones have made
_KERNEL = re.compile(
    r"void tabulate_tensor_(\w+)\([^)]*\)\s*\{(.*?)\}(?=\s+(?:static )?(?:bool|ufcx_integral)\b)", re.DOTALL
)
_COEFFICIENTS = re.compile(r"int original_coefficient_position\w*\[\d+\] = \{([\d, ]*)\}")
_CALLED = re.compile(r"\b([a-z_]\w*)\(")
_BY_LANE = {"sqrt", "log", "exp", "fabs", "sin", "cos", "pow"}
_ASSIGNMENT = re.compile(r"^( *(?:(?:const )?lanes \w+|\w+(?:\[[^\]]*\])+) = )([^{};]+);", re.MULTILINE)
_NUMBER = re.compile(r"(?<!static const )\bdouble\b")
_LOOPS = re.compile(  # over the rows and columns of a square matrix, in either order
    r"(for \(int ([ij]) = 0; \2 < (\d+); \+\+\2\)\s*\{\s*for \(int ([ij]) = 0; \4 )< \3"
    r"(; \+\+\4\)\s*\{\s*A\[[^ij]*([ij]))"
)
_WITH_LANES = """
static void lanes_{name}(lanes* restrict A, const lanes* restrict w, const double* restrict c,
                         const lanes* restrict coordinate_dofs)
{{
{body}
}}
static int add_{name}(int64_t n, int64_t weights, const int32_t* cells, const double* w, const double* c,
                      const double* x, const int32_t* geometry, const int32_t* places, double* out)
{{
  if (n == 0 || weights == WEIGHTS)
    lanes_add(lanes_{name}, n, cells, w, c, x, geometry, places, out);
  return n == 0 || weights == WEIGHTS;
}}
"""
_ADD = ctypes.CFUNCTYPE(ctypes.c_int, ctypes.c_int64, ctypes.c_int64, *[ctypes.c_void_p] * 7)
_Part = tuple[Any, Any, Bools | slice, Ints]  # kernel, key of its coefficients, which of their rows, its cells


class Lanes:
    """A linear or bilinear form, `compiled`, evaluated for several cells at once; not `usable`, so that only dolfinx can
    assemble it, where it has parts on facets or what FFCx wrote cannot be treated.

    symmetric: a bilinear one is, and half of a cell's matrix need not be computed. Collective.
    """

    def __init__(self, form: Form, symmetric: bool = False) -> None:
        spaces = [argument.ufl_function_space() for argument in form.arguments()]
        self._mesh = spaces[0].mesh
        self._geometry = np.ascontiguousarray(compat.geometry_dofmap(self._mesh))
        nodes = [_nodes_and_size(space) for space in spaces] + [(1, 1)]
        sizes = {"ROWS": nodes[0][0], "HIGH": nodes[0][1], "COLUMNS": nodes[1][0], "WIDE": nodes[1][1]}
        weights = [int(np.prod(_nodes_and_size(weight.ufl_function_space()))) for weight in form.coefficients()]
        change = partial(treated, sizes=sizes | {"NODES": self._geometry.shape[1]}, weights=weights, symmetric=symmetric)
        self.compiled = compat.compile_form(form, change, f"{_VERSION}{'S' * symmetric}")
        kernels = compat.cell_kernels(self.compiled)
        self.usable = kernels is not None
        self._parts: list[_Part] = [(_ADD(address), key, slice(None), cells) for address, key, cells in kernels or ()]

    def on(self, chosen: Bools) -> "Lanes":
        """The same on those of its cells where chosen, by local number, is true."""
        part = copy(self)
        part._parts = [(add, key, chosen[cells], cells[chosen[cells]]) for add, key, _, cells in self._parts]
        return part

    @property
    def cells(self) -> Ints:
        """Local numbers of its cells (n,), in the order of `add`; one of several integrals comes with each."""
        return np.concatenate([cells for *_, cells in self._parts] or [np.empty(0, dtype=np.int32)])

    def add(self, places: Ints, out: Floats) -> None:
        """Add all cells' vectors or matrices, at the present coefficients, to blocks of `out`, those of matrices by columns.

        places (n, nodes) or (n, nodes, nodes): number of each block, in the order of `cells`. ValueError for other places.
        """
        if len(places) != sum(len(cells) for *_, cells in self._parts):
            raise ValueError(f"places {places.shape} are not those of the form's cells")
        constants, weights = compat.packed(self.compiled)
        x, start = np.ascontiguousarray(self._mesh.geometry.x), 0
        for add, key, rows, cells in self._parts:
            here, start = np.ascontiguousarray(places[start : start + len(cells)]), start + len(cells)
            w = np.ascontiguousarray(weights[key][rows] if weights[key].size else weights[key])
            arrays = cells, w, constants, x, self._geometry, here, out
            if not add(len(cells), w.shape[1], *(array.ctypes.data for array in arrays)):
                raise RuntimeError("dolfinx packs other coefficients than the kernel expects")


def _nodes_and_size(space: Space) -> tuple[int, int]:
    """Nodes of a cell, and dofs of each."""
    return compat.cell_dofs(space).shape[1], space.dofmap.index_map_bs


def treated(source: str, sizes: Mapping[str, int], weights: Sequence[int], symmetric: bool) -> str:
    """FFCx's C source with kernels for lanes in place of its own, or as it is where one of them cannot be treated.

    sizes: what lanes.h asks for, but WEIGHTS and HALF; weights: of each of the form's coefficients, dofs in a cell.
    """
    source = source.replace("  .tabulate_tensor_float32 = NULL,\n", "")
    kernels, used = list(_KERNEL.finditer(source)), _COEFFICIENTS.search(source)
    bodies = [kernel[2] for kernel in kernels]
    if not bodies or not all(_treatable(body) for body in bodies):
        return source
    halves = [_half(body) for body in bodies]
    half = halves[0][0] if symmetric and len({kind for kind, _ in halves}) == 1 else 0
    count = sum(weights[int(number)] for number in used[1].split(",")) if used else 0
    names = {**sizes, "WEIGHTS": count, "HALF": half}
    before = "".join(f"#define {name} {value}\n" for name, value in names.items()) + _HEADER
    for kernel, (_, halved) in reversed(list(zip(kernels, halves, strict=True))):
        name, begin, end = kernel[1], *kernel.span(2)
        body = _by_lane(halved if half else kernel[2])
        source = f"{source[:begin]}\n  lanes_of_one(lanes_{name}, A, w, c, coordinate_dofs);\n{source[end:]}"
        source = f"{source[:kernel.start()]}{_WITH_LANES.format(name=name, body=body)}{source[kernel.start():]}"
        own = f".tabulate_tensor_float64 = tabulate_tensor_{name},"
        source = source.replace(own, f"{own}\n  .tabulate_tensor_float32 = (void*)add_{name},")
    first = kernels[0].start()
    return f"{source[:first]}{before}{source[first:]}"


def _treatable(body: str) -> bool:
    """Whether it does the same for all cells, with functions that are known."""
    cellwise = not re.search(r"entity_local_index|quadrature_permutation|\?", body)
    return cellwise and set(_CALLED.findall(body)) <= _BY_LANE | {"for"}


def _half(body: str) -> tuple[int, str]:
    """HALF of lanes.h, and the kernel without one half of the matrix."""
    loops = list(_LOOPS.finditer(body))
    kinds = {1 if loop[2] == loop[6] else 2 for loop in loops}
    if len(kinds) != 1 or len(loops) != len(re.findall(r"\{\s*A\[", body)):
        return 0, body
    return kinds.pop(), _LOOPS.sub(r"\1<= \2\5", body)


def _by_lane(body: str) -> str:
    """A kernel with lanes for numbers, but tables and constants; what is assigned may be a number only."""
    body = _NUMBER.sub("lanes", body)
    body = _ASSIGNMENT.sub(r"\1ALL(\2);", body)
    return re.sub(r"\b(" + "|".join(_BY_LANE) + r")\(", r"lanes_\1(", body)
