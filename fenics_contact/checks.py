"""What a scene must fulfil before work starts: refusals that name the thing and the remedy, the same on all ranks."""

import numpy as np

from fenics_contact import compat

AXES = {"x": 0, "y": 1, "z": 2}


class SceneError(ValueError):
    """The scene cannot be computed as stated; the message names the thing and the remedy. Raised on all ranks."""


def refuse_inside(mesh, facets, what):
    """A load acts on outer surfaces only. Collective."""
    domain = mesh.domain
    mine = facets[facets < domain.topology.index_map(2).size_local]
    inside = mesh.comm.allreduce(int((~np.isin(mine, compat.exterior_facets(domain))).sum()))
    if inside:
        raise SceneError(
            f"{what}: {inside} of its facets lie inside the material; name an outer surface, or draw the "
            "bodies on both sides as separate volumes"
        )


def refuse_loose(holds, state, comm):
    """Nothing may be free to translate that neither a support nor a contact holds; bodies sharing nodes are bonded."""
    for i, axes in holds.loose(lambda contact: contact.held_axes(state, comm)).items():
        raise SceneError(
            f"nothing holds body '{holds.bodies[i][0]}' along {', '.join(axes)}: fix a surface, use a symmetry plane, or "
            "add a contact that holds it; bodies that hold only each other are loose together"
        )


def bonded_bodies(scene):
    """Groups of bodies that share nodes: (names, local nodes) of each."""
    tags, groups = scene.mesh.cell_tags, []
    for body in scene.bodies:
        cells = tags.indices[tags.values == scene.mesh.volume_tag(body.group)]
        names, blocks = body.group, _nodes_of(scene.space, cells)
        for group in list(groups):
            if scene.mesh.comm.allreduce(len(np.intersect1d(group[1], blocks))):
                groups.remove(group)
                names, blocks = f"{group[0]}, {names}", np.union1d(group[1], blocks)
        groups.append((names, blocks))
    return groups


def _nodes_of(space, cells):
    """Local nodes of cells, also where the cells themselves are another rank's."""
    touched = compat.Function(space)
    touched.x.array[3 * compat.cell_dofs(space)[cells]] = 1.0
    compat.sum_to_owners(touched)
    compat.copy_to_ghosts(touched)
    return np.flatnonzero(touched.x.array[::3] > 0.0)


def refuse_behind(system):
    """The slave surface must lie on the outer side of a meshed tool, by the majority of its points. Collective."""
    for contact in system.contacts:
        share = contact.back_share(system.state, system.comm)
        if share > 0.5:
            raise SceneError(
                f"contact '{contact.name}': the normals of '{contact.master_name}' point away from the slave surface, whose "
                f"points see its back ({share:.0%} of them); its facets must be counter-clockwise seen from the body: use "
                "rigid_surface(..., flip=True)"
            )


def refuse_deep_start(scene, system):
    """Nothing may overlap by more than a cell at the start, nor a tool reach nodes behind its slave surface."""
    X = scene.space.tabulate_dof_coordinates()
    for contact, statement in zip(system.contacts, scene.contacts, strict=True):
        slave = np.zeros(len(X), dtype=bool)
        slave[compat.locate_blocks(scene.space, scene.mesh.facets(*statement.slave))] = True
        overlap = contact.excessive_overlap(system.state, X, slave, scene.mesh.comm)
        if overlap > 0.0:
            raise SceneError(
                f"contact '{contact.name}': the master '{contact.master_name}' starts {overlap:.3g} inside the body, "
                f"where a cell is {contact.surface.cell_height:.3g} high; move its starting place outwards, or name all "
                "surfaces it meets as slaves"
            )


def finite(value, what, shape):
    value = np.asarray(value, dtype=float)
    if value.shape != shape or not np.all(np.isfinite(value)):
        raise SceneError(f"{what} must be {'three finite numbers' if shape else 'one finite number'}, not {value}")
    return value
