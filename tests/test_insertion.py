"""Blocks of nodes into the matrix, wherever their rows and columns belong, against a dense sum."""

import numpy as np
import pytest
from mpi4py import MPI
from petsc4py import PETSc
from test_block_operator import tangent

from fenics_contact import compat
from fenics_contact.assembly.blocks import Blocks, insert

COMM = MPI.COMM_WORLD
pytestmark = pytest.mark.parallel


@pytest.fixture(scope="module")
def system():
    """Of two blocks whose contact couples them."""
    system = tangent(2)
    assert system.couplings.patterns == 2  # the second one holds the contact's
    return system


def dense(matrix):
    """The whole matrix, on each rank."""
    first, end = matrix.getOwnershipRange()
    offsets, columns, values = matrix.getValuesCSR()
    rows = np.zeros((matrix.getSize()[0], matrix.getSize()[1]))
    rows[np.repeat(np.arange(first, end), np.diff(offsets)), columns] = values
    return COMM.allreduce(rows)


def coupled(system):
    """Global rows and columns (n,) of all blocks of the matrix, of all ranks."""
    system.matrix.zeroEntries()
    first, end = system.matrix.getOwnershipRange()
    offsets, columns, _ = system.matrix.getValuesCSR()
    rows = np.repeat(np.arange(first, end), np.diff(offsets))
    whole = np.unique(np.column_stack([rows, columns]) // 3, axis=0)
    return np.concatenate(COMM.allgather(whole)).T.astype(np.int64)


def check(system, blocks, rows, columns, values):
    """Inserted twice, the matrix holds twice the sum of all ranks' blocks (n, 3, 3) at their global rows and columns."""
    total = system.matrix.getSize()[0] // 3
    expected = np.zeros((total, 3, total, 3))
    np.add.at(expected.transpose(0, 2, 1, 3), (rows, columns), 2.0 * values)
    expected = COMM.allreduce(expected.reshape(3 * total, 3 * total))
    system.matrix.zeroEntries()
    for _ in range(2):
        insert(blocks, system.matrix, None)
    system.matrix.assemble()
    assert np.abs(dense(system.matrix) - expected).max() < 1e-14 * np.abs(expected).max()


def numbers(*shape):
    return np.random.default_rng(COMM.rank).standard_normal(shape)


def test_pairs_of_any_rank(system):
    """Each rank's rows and columns are all ranks', some many times, in no order."""
    rows, columns = coupled(system)
    chosen = np.random.default_rng(10 + COMM.rank).integers(len(rows), size=3000)
    rows, columns, values = rows[chosen], columns[chosen], numbers(3000, 3, 3)
    check(system, Blocks(pairs=(rows, columns, values)), rows, columns, values)


def test_pairs_of_local_nodes(system):
    """Owned ones and ghosts, of the same cell."""
    nodes = compat.cell_dofs(system.space).astype(np.int64)
    rows, columns = np.repeat(nodes, 8, axis=1).ravel(), np.tile(nodes, 8).ravel()
    values, of = numbers(len(rows), 3, 3), compat.global_blocks(system.space)
    check(system, Blocks(pairs=(rows, columns, values), whole=False), of[rows], of[columns], values)


def test_matrices_of_cells(system):
    """Those of a rank's cells, ghosts among their nodes."""
    nodes = compat.cell_dofs(system.space)
    n, of = len(nodes), compat.global_blocks(system.space)
    values = numbers(n, 24, 24)
    rows, columns = of[np.repeat(nodes, 8, axis=1)].ravel(), of[np.tile(nodes, 8)].ravel()
    by_pairs = values.reshape(n, 8, 3, 8, 3).transpose(0, 1, 3, 2, 4).reshape(-1, 3, 3)
    check(system, Blocks(cells=(nodes, values)), rows, columns, by_pairs)


def test_a_block_without_a_place_is_an_error(system):
    """Nothing is lost in silence: nodes of one rank, or of two, that the matrix does not couple."""
    total, (first, end) = system.matrix.getSize()[0] // 3, (n // 3 for n in system.matrix.getOwnershipRange())
    known = set(zip(*coupled(system), strict=True))
    for candidates in (range(first, end), range(total)):
        row, column = next((i, j) for i in range(first, end) for j in reversed(candidates) if (i, j) not in known)
        with pytest.raises(PETSc.Error):
            insert(Blocks(pairs=(np.array([row]), np.array([column]), np.ones((1, 3, 3)))), system.matrix, None)
