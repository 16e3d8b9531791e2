"""Addition of element forces and couplings into arrays of local dofs, three per node."""

from numba import njit

from fenics_contact.types import Array, Floats


@njit(cache=True)
def scatter_forces(elements: Array, nodes: Array, force: Floats, out: Floats) -> None:
    """out[3 node + c] += force[e, i, c] over the listed elements; nodes (ne, k), force (ne, k, 3), out (dofs,)."""
    for e in elements:
        for i in range(nodes.shape[1]):
            for c in range(3):
                out[3 * nodes[e, i] + c] += force[e, i, c]


@njit(cache=True)
def scatter_border(nodes: Array, columns: Floats, rows: Floats, column: Floats, row: Floats) -> None:
    """Couplings of nodes (n,) with a tool's travel: column[d, dof] += dR_dof/dq_d, row[c, dof] += dR_c/du_dof, (3, dofs).

    columns (n, 3, 3): rates of the nodes' forces with the travel; rows (n, 3, 3): of the tool's force with the nodes.
    """
    for i in range(len(nodes)):
        for c in range(3):
            for d in range(3):
                column[d, 3 * nodes[i] + c] += columns[i, c, d]
                row[c, 3 * nodes[i] + d] += rows[i, c, d]
