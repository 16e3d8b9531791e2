"""Supports of a scene, from what the user stated of its surfaces."""

from fenics_contact import compat
from fenics_contact.assembly.numbering import node_keys
from fenics_contact.assembly.supports import Supports
from fenics_contact.functions import AtPoints
from fenics_contact.values import SceneError


def supports_of(mesh, space, statements):
    """Supports from statements (surface groups, axis 0 ... 2, value), checked. Collective.

    value: a number ramped with t [length], or a function value(X, t) -> (n,).
    """
    X, keys = space.tabulate_dof_coordinates(), node_keys(space)
    entries, names = [], []
    for group, axis, value in statements:
        blocks = compat.locate_blocks(space, mesh.facets(*group))
        name = f"{'+'.join(group)} along {'xyz'[axis]}"
        if callable(value):
            value = AtPoints(mesh.comm, f"prescribed displacement of {name}", value, keys[blocks], X[blocks])
        entries.append((3 * blocks + axis, value))
        names.append(name)
    supports = Supports(entries, 3 * space.dofmap.index_map.size_local, names)
    conflicts = [c for c in mesh.comm.allgather(supports.conflict) if c]
    if conflicts:
        raise SceneError(f"supports contradict each other where they meet: {conflicts[0][0]} and {conflicts[0][1]}")
    return supports
