"""Every difference between dolfinx 0.5, 0.9 and newer, chosen once at import by what the library can do."""

import inspect
import logging
import platform
from collections.abc import Callable, Iterator
from contextlib import contextmanager
from functools import cache
from pathlib import Path
from typing import Any, TypeAlias

import _cffi_backend
import basix
import cffi
import dolfinx
import dolfinx.fem.petsc as fem_petsc
import dolfinx.mesh as dolfinx_mesh
import ffcx.compiler
import numba
import numpy as np
import petsc4py
from dolfinx import fem
from mpi4py import MPI
from ufl.algorithms.map_integrands import map_integrand_dags
from ufl.corealg.multifunction import MultiFunction

from fenics_contact import blas, form_files
from fenics_contact.types import Array, Expr, Floats, Form, Ints, Ints64, Mat, Mesh, Space, Tags, Vec

try:
    from dolfinx.io import gmsh as gmsh_reader  # 0.10 and newer
except ImportError:
    from dolfinx.io import gmshio as gmsh_reader

FACETS = {"hexahedron": 6, "tetrahedron": 4, "quadrilateral": 4, "triangle": 3}  # of a cell

Function: TypeAlias = fem.Function
Constant: TypeAlias = fem.Constant

# A NaN must survive as NaN: solvers recognise an inverted element by it.
_C_FLAGS = ["-O3", "-march=native", "-ffast-math", "-fno-finite-math-only"]
_FFI = _cffi_backend.FFI()  # as those of compiled modules: one of `cffi.FFI` loads a parser of C for its first cast
_JIT_NAME = "jit_options" if "jit_options" in inspect.signature(fem.form).parameters else "jit_params"
_HAS_FUNCTIONSPACE = hasattr(fem, "functionspace")
_HAS_PETSC_VEC = not hasattr(fem.Function, "vector")
_ADD = (dolfinx.la.InsertMode if hasattr(dolfinx.la, "InsertMode") else dolfinx.la.ScatterMode).add
_HAS_INTERPROCESS = hasattr(getattr(dolfinx_mesh, "Topology", None), "interprocess_facets")
_HAS_DOFMAPS = hasattr(getattr(dolfinx_mesh, "Geometry", None), "dofmaps")

form_files.by_name()


def lagrange_space(mesh: Mesh, degree: int, shape: tuple[int, ...] = ()) -> Space:
    """Continuous Lagrange space of scalars or, with shape (3,), of vectors."""
    return _space(mesh, "Lagrange", degree, shape)


def constant_space(mesh: Mesh, shape: tuple[int, ...] = ()) -> Space:
    """One value (scalar, vector or tensor of `shape`) per cell."""
    return _space(mesh, "DG", 0, shape)


def _space(mesh: Mesh, family: str, degree: int, shape: tuple[int, ...]) -> Space:
    with _quiet():
        if _HAS_FUNCTIONSPACE:
            return fem.functionspace(mesh, (family, degree, tuple(shape)) if shape else (family, degree))
        if len(shape) == 1:
            return fem.VectorFunctionSpace(mesh, (family, degree), dim=shape[0])
        if shape:
            return fem.TensorFunctionSpace(mesh, (family, degree), shape=shape)
        return fem.FunctionSpace(mesh, (family, degree))


class _NumbersApart(MultiFunction):
    """Real numbers of an expression as Constants, one for each value; exponents stay what they are."""

    def __init__(self, domain: Any) -> None:
        super().__init__()
        self._domain, self._constants = domain, dict[float, Constant]()

    expr = MultiFunction.reuse_if_untouched

    def float_value(self, number: Expr) -> Constant:
        return self._constants.setdefault(float(number), fem.Constant(self._domain, float(number)))

    def power(self, whole: Expr, base: Expr, _: Expr) -> Expr:
        return whole if base is whole.ufl_operands[0] else whole._ufl_expr_reconstruct_(base, whole.ufl_operands[1])


def numbers_apart(form: Form) -> Form:
    """A UFL form whose moduli are handed over when it is evaluated: laws of one kind are one compiled code."""
    return map_integrand_dags(_NumbersApart(form.ufl_domain()), form)


def compile_form(form: Form, treated: Callable[[str], str] | None = None, version: str = "") -> Form:
    """UFL form -> compiled form, with flags that let the C compiler vectorise. Collective.

    treated: what becomes of FFCx's C source before it is compiled; where the compiler refuses that it gets the source as it
    is. version: of this function, for the cache.
    """
    if treated is None:
        return _compiled(form, _C_FLAGS)
    generate = ffcx.compiler.compile_ufl_objects

    def generated(*arguments: Any, **named: Any) -> tuple[Any, ...]:
        first, second = generate(*arguments, **named)
        if isinstance(second, str):
            return first, treated(second)
        header, source = first  # 0.10 and newer
        return (header, treated(source)), second

    ffcx.compiler.compile_ufl_objects = generated  # FFCx offers no other way in
    try:
        return _compiled(form, [*_C_FLAGS, f"-DFENICS_CONTACT={version}"])
    except (cffi.VerificationError, RuntimeError):  # on one process, on several
        pass
    finally:
        ffcx.compiler.compile_ufl_objects = generate
    return _compiled(form, _C_FLAGS)


def _compiled(form: Form, flags: list[str]) -> Form:
    with _quiet():
        return fem.form(numbers_apart(form), **{_JIT_NAME: {"cffi_extra_compile_args": flags}})


def cell_kernels(compiled_form: Form) -> list[tuple[int, tuple[Any, int], Ints]] | None:
    """Of each integral of a form on cells alone: address of the kernel that `treated` has put in the place of the one in
    single precision, key of its coefficients in `packed`, owned cells. None where there are other integrals or none such."""
    known, ufcx = _of_library(compiled_form), compiled_form.ufcx_form
    kinds = list(known.integral_types)
    if [kind.name for kind in kinds] != ["cell"]:
        return None
    if hasattr(ufcx, "form_integrals"):
        count, integrals, numbers = ufcx.form_integral_offsets[1], ufcx.form_integrals, ufcx.form_integral_ids
    else:
        count, integrals, numbers = ufcx.num_integrals(0), ufcx.integrals(0), ufcx.integral_ids(0)
    if not hasattr(known, "integral_ids"):  # 0.10 and newer count the integrals
        numbers = range(count)
    addresses = [int(_FFI.cast("uintptr_t", integrals[i].tabulate_tensor_float32)) for i in range(count)]
    if not all(addresses):
        return None
    keys = [(kinds[0], numbers[i]) for i in range(count)]
    cells = [np.array(known.domains(*key), dtype=np.int32) for key in keys]
    return list(zip(addresses, keys, cells, strict=True))


def packed(compiled_form: Form) -> tuple[Floats, dict[tuple[Any, int], Floats]]:
    """Values of a form's constants, and by integral its coefficients (cells, dofs in a cell)."""
    known = _of_library(compiled_form)
    return np.array(dolfinx.cpp.fem.pack_constants(known)), dolfinx.cpp.fem.pack_coefficients(known)


def _of_library(compiled_form: Form) -> Any:
    return compiled_form._cpp_object if hasattr(compiled_form, "_cpp_object") else compiled_form


def on_cells_and_others(form: Form) -> list[Form]:
    """A UFL form as one of its integrals over cells and one of the others, if there are such."""
    of_cells = [integral for integral in form.integrals() if integral.integral_type() == "cell"]
    others = [integral for integral in form.integrals() if integral.integral_type() != "cell"]
    return [type(form)(part) for part in (of_cells, others) if part]


@contextmanager
def _quiet() -> Iterator[None]:
    """Keep the compiler's command lines out of the user's terminal."""
    before = logging.root.manager.disable
    logging.disable(logging.INFO)
    try:
        yield
    finally:
        logging.disable(before)


def create_matrix(compiled_form: Form) -> Mat:
    """PETSc matrix with the pattern of a form alone."""
    return fem_petsc.create_matrix(compiled_form)


def block_pattern(compiled_form: Form, space: Space) -> tuple[Ints64, Ints64]:
    """Pattern of a bilinear form on a space of blocks of three: offsets of the owned rows, global block columns, int64."""
    matrix = create_matrix(compiled_form)
    assemble_matrix(matrix, compiled_form)
    matrix.assemble()
    offsets, columns, _ = matrix.getValuesCSR()
    matrix.destroy()
    lengths = np.diff(offsets)
    first_of_block = np.repeat(np.arange(len(lengths)) % 3 == 0, lengths)
    of_rows = columns[first_of_block][::3] // 3  # whole blocks: three columns each, in rising order
    return np.concatenate([[0], np.cumsum(lengths[::3] // 3)]).astype(np.int64), of_rows.astype(np.int64)


def cell_map(mesh: Mesh) -> Any:
    """Index map of the cells: size_local of this rank's own, which come first, num_ghosts, size_global."""
    return mesh.topology.index_map(mesh.topology.dim)


def original_cells(mesh: Mesh) -> Ints64:
    """Number in the gmsh model's order of every local cell: the same on any number of ranks."""
    return np.asarray(mesh.topology.original_cell_index)


def assemble_matrix(matrix: Mat, compiled_form: Form) -> None:
    """Add the form to a PETSc matrix; the caller finalises it."""
    fem_petsc.assemble_matrix(matrix, compiled_form)


def assemble_vector(array: Floats, compiled_form: Form) -> None:
    """Add the form to a local array (owned and ghost dofs), without exchange between ranks."""
    fem.assemble_vector(array, compiled_form)


def assemble_scalar(compiled_form: Form) -> float:
    """The form's integral over this rank's cells or facets."""
    return float(fem.assemble_scalar(compiled_form))


def node_values(space: Space, size: int = 1) -> Any:
    """So many numbers at each local node of a space, zero, flat in `array`, for `sum_to_owners` and `copy_to_ghosts`."""
    return dolfinx.la.vector(space.dofmap.index_map, size)


def sum_to_owners(values: Any) -> None:
    """Add what ranks wrote into the ghosts of a Function, or of node_values, to the owners' values. Collective."""
    getattr(values, "x", values).scatter_reverse(_ADD)


def copy_to_ghosts(values: Any) -> None:
    """Give every ghost of a Function, or of node_values, its owner's value. Collective."""
    getattr(values, "x", values).scatter_forward()


def petsc_vector(function: Function) -> Vec:
    """Ghosted PETSc vector that shares memory with a Function; it lives on the communicator of the Function's space."""
    return function.x.petsc_vec if _HAS_PETSC_VEC else function.vector


def mesh_from_gmsh(
    model: Any, comm: MPI.Comm, rank: int, dim: int = 3, owners: Ints64 | None = None
) -> tuple[Mesh, Tags, Tags]:
    """gmsh model on one rank -> (mesh, cell tags, facet tags) on all.

    dim: of its cells; owners (cells,) on that rank: the rank of each cell, in the order of the volume groups' tags, where
    dolfinx is not to choose; whole bodies, for no cell is a ghost then.
    """
    if owners is None:
        data = gmsh_reader.model_to_mesh(model, comm, rank, gdim=dim)
    elif "partitioner" in inspect.signature(gmsh_reader.model_to_mesh).parameters:
        data = gmsh_reader.model_to_mesh(model, comm, rank, gdim=dim, partitioner=_partitioner(owners))
    else:  # 0.5: the reader calls what it knows as create_mesh
        create = gmsh_reader.create_mesh
        gmsh_reader.create_mesh = lambda *arguments: create(*arguments, partitioner=_partitioner(owners))
        try:
            data = gmsh_reader.model_to_mesh(model, comm, rank, gdim=dim)
        finally:
            gmsh_reader.create_mesh = create
    mesh, cell_tags, facet_tags = data[:3]
    if facet_tags is None:  # 0.10 and newer, of a model without surface groups
        none = np.empty(0, dtype=np.int32)
        facet_tags = dolfinx_mesh.meshtags(mesh, dim - 1, none, none)
    return mesh, cell_tags, facet_tags


def _partitioner(owners: Array) -> Callable[..., Any]:
    """What dolfinx calls, with arguments that differ by version, for the ranks of the cells that it read on this rank."""
    destinations = np.ascontiguousarray(owners, dtype=np.int32).reshape(-1, 1)
    return lambda *_: dolfinx.cpp.graph.AdjacencyList_int32(destinations)


def geometry_dofmap(mesh: Mesh) -> Ints:
    """(cells, nodes per cell) array of geometry nodes."""
    dofmap = mesh.geometry.dofmaps[0] if _HAS_DOFMAPS else mesh.geometry.dofmap
    if isinstance(dofmap, np.ndarray):
        return dofmap
    return dofmap.array.reshape(-1, mesh.geometry.cmap.create_dof_layout().num_dofs)  # a rank may have no cells


def cell_dofs(space: Space) -> Ints:
    """(cells, block dofs per cell) array of a space's local block numbers."""
    dofs = space.dofmap.list
    return dofs if isinstance(dofs, np.ndarray) else dofs.array.reshape(-1, space.dofmap.dof_layout.num_dofs)


def facet_closure_dofs(space: Space, facet: int) -> Ints:
    """Cell-local block dofs on the closure of the cell's facet number `facet`."""
    return np.asarray(space.dofmap.dof_layout.entity_closure_dofs(space.mesh.topology.dim - 1, facet), dtype=np.int32)


def cell_name(mesh: Mesh) -> str:
    """'hexahedron', 'tetrahedron', ..."""
    topology = mesh.topology
    return str(topology.cell_type if hasattr(topology, "cell_type") else topology.cell_types[0]).split(".")[-1]


@cache
def basix_element(cell: str, degree: int) -> Any:
    """The scalar Lagrange element whose dofs dolfinx numbers."""
    kind = getattr(basix.CellType, cell)
    return basix.create_element(basix.ElementFamily.P, kind, degree, basix.LagrangeVariant.gll_warped)


def tabulate(element: Any, derivatives: int, points: Floats) -> Floats:
    """Values of the basis (and derivatives) at points: (1 + 3 d, points, dofs)."""
    return element.tabulate(derivatives, points)[..., 0]


def global_blocks(space: Space) -> Ints64:
    """Global block number of every local (owned, then ghost) block dof."""
    index_map = space.dofmap.index_map
    return index_map.local_to_global(np.arange(index_map.size_local + index_map.num_ghosts, dtype=np.int32))


def locate_blocks(space: Space, entities: Array, dim: int | None = None) -> Ints:
    """Local block dofs on facets, or on other entities of a dimension, ghosts included on every rank that sees them."""
    topology = space.mesh.topology
    dim = topology.dim - 1 if dim is None else dim
    topology.create_connectivity(dim, topology.dim)
    return fem.locate_dofs_topological(space, dim, np.asarray(entities, dtype=np.int32))


def source_vertices(mesh: Mesh) -> Ints64:
    """Number in the gmsh model's order of every local vertex, ghosts included."""
    mesh.topology.create_connectivity(mesh.topology.dim, 0)
    vertices = mesh.topology.connectivity(mesh.topology.dim, 0)
    vertices = vertices.array.reshape(-1, len(basix.geometry(getattr(basix.CellType, cell_name(mesh)))))
    out = np.full(mesh.topology.index_map(0).size_local + mesh.topology.index_map(0).num_ghosts, -1, dtype=np.int64)
    out[vertices] = np.asarray(mesh.geometry.input_global_indices)[geometry_dofmap(mesh)[:, : vertices.shape[1]]]
    return out


def edge_vertices(mesh: Mesh) -> Ints:
    """Local vertices (edges, 2) of every local edge."""
    mesh.topology.create_entities(1)
    mesh.topology.create_connectivity(1, 0)
    return mesh.topology.connectivity(1, 0).array.reshape(-1, 2)


def cell_evaluator(mesh: Mesh, ufl_expression: Expr, points: Floats | list[float]) -> Callable[..., Floats]:
    """Function (cells=all owned) -> (cells, points * size) of a UFL expression at reference points, on the current state."""
    with _quiet():
        expression = fem.Expression(ufl_expression, np.atleast_2d(points))
    owned = np.arange(cell_map(mesh).size_local, dtype=np.int32)
    with_mesh = "mesh" in inspect.signature(expression.eval).parameters

    def evaluate(cells: Ints = owned) -> Floats:
        values = expression.eval(mesh, cells) if with_mesh else expression.eval(cells)
        return values.reshape(len(cells), int(np.prod(values.shape[1:])))  # newer ones keep points and components apart

    return evaluate


def exterior_facets(mesh: Mesh) -> Ints:
    """Owned facets with a cell on one side only, on any rank."""
    return np.asarray(dolfinx_mesh.exterior_facet_indices(mesh.topology))


def cells_of_exterior_facets(mesh: Mesh, facets: Ints | None = None) -> tuple[Ints, Ints64]:
    """Owned cells behind exterior facets (all, or those among `facets`), and each facet's number in its cell."""
    dim = mesh.topology.dim
    facet_cells, cell_facets = mesh.topology.connectivity(dim - 1, dim), mesh.topology.connectivity(dim, dim - 1)
    if facets is None:
        facets = np.arange(facet_cells.num_nodes)
        if _HAS_INTERPROCESS:  # without ghost cells the faces between ranks have one cell on either
            facets = np.setdiff1d(facets, mesh.topology.interprocess_facets())
    offsets = facet_cells.offsets
    facets = facets[offsets[facets + 1] - offsets[facets] == 1]
    cells = facet_cells.array[offsets[facets]]
    mine = cells < cell_map(mesh).size_local
    facets, cells = facets[mine], cells[mine]
    per_cell = cell_facets.array.reshape(-1, FACETS[cell_name(mesh)])
    return cells, np.argmax(per_cell[cells] == facets[:, None], axis=1)


def degree(space: Space) -> int:
    """Polynomial degree of a Lagrange space."""
    element = space.ufl_element()
    return element.degree() if callable(element.degree) else element.degree


def kernels_folder(kernel: Any) -> Path:
    """Where Numba keeps a compiled kernel."""
    return Path(kernel.stats.cache_path)


def forms_folder() -> Path:
    """Where FFCx keeps compiled forms."""
    settings = dolfinx.jit.get_options() if _JIT_NAME == "jit_options" else dolfinx.jit.get_parameters()
    return Path(settings["cache_dir"])


def versions() -> dict[str, str]:
    """Versions of what a result and its time depend on, for summaries."""
    modules = {"dolfinx": dolfinx, "petsc4py": petsc4py, "numba": numba, "numpy": np}
    known = {name: module.__version__ for name, module in modules.items()}
    return known | {"python": platform.python_version(), "blas": blas.told()}
