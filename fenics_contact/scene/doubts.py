"""What is to be said of statements that can be meant, but seldom are, and of what a scene leaves out."""

from collections.abc import Sequence
from typing import TYPE_CHECKING

import numpy as np
from mpi4py import MPI

from fenics_contact import compat
from fenics_contact.assembly.finding import spot
from fenics_contact.assembly.system import System
from fenics_contact.contact.repeats import Repeats
from fenics_contact.contact.tools import MeshedTool, RigidTool, Tool, cut_shapes
from fenics_contact.meetings import Mismatch
from fenics_contact.scene.functions import whole
from fenics_contact.scene.stage import ARC_LENGTH, Stage
from fenics_contact.scene.statements import StatedLoad, called
from fenics_contact.scene.symmetry import tilting
from fenics_contact.solid.materials import young
from fenics_contact.types import Ints

if TYPE_CHECKING:  # which asks for them
    from fenics_contact.scene.scene import Scene

HEAVIEST = 10.0  # times Young's modulus: a load on a surface under which no rubber keeps its shape
ALONG_AXIS = 1e-9  # of a load: what of it may be across an axis, being round-off
ROUGHEST = 5.0  # friction that rubber hardly has
ASKED = np.linspace(0.0, 1.0, 24)  # shares of a stage at which loads are asked for; waves are not zero at all of them
ALONG = (
    "is not the same all along z: what it stands for is its cut by the plane, endless along z; say so by a rigid_cylinder "
    "along z, a rigid_plane, a rigid_extrusion or a rigid_curve, or take a scene in space"
)
AROUND = (
    "beside the axis y, or across it, is no body of revolution about that: what it stands for is the ring that its cut "
    "by the plane makes all the way round; say so by a rigid_torus or a rigid_cylinder along z, or put it on the axis"
)


def doubts(scene: "Scene", system: System, stated: Sequence[Stage], loads: Sequence[StatedLoad]) -> list[str]:
    """All of them; loads: those of the stages, too, but of fluids that contact keeps out. Collective."""
    return [
        *_folded(scene),
        *_left_out(scene),
        *_slits(scene),
        *_tiny(scene, system),
        *_cut(scene),
        *_unmet(scene),
        *_materials(scene),
        *_frictions(scene),
        *_penalties(system),
        *_images(scene, system),
        *tilting(scene, system, len(stated)),
        *_pressed(scene, system, [load for load in loads if load.group and not load.shape]),
        *_idle(scene, system, len(stated), loads),
        *_across(scene, system, stated, [load for load in loads if load.shape and load.nodes is None]),
        *_heavy(scene, system, stated, [load for load in loads if load.group]),
    ]


def _materials(scene: "Scene") -> list[str]:
    """Of bodies that grow thicker where they are drawn."""
    ratios = {body.group: body.material.bulk_modulus / body.material.shear_modulus for body in scene.bodies}
    return [
        f"body '{name}': K / mu = {ratio:.3g} is a Poisson's ratio of {(3 * ratio - 2) / (6 * ratio + 2):.2f}: drawn, it "
        "grows thicker; see that K and mu, and their units, are not mixed up"
        for name, ratio in ratios.items()
        if ratio < 2 / 3
    ]


def _frictions(scene: "Scene") -> list[str]:
    """Of coefficients that are likely to be meant in per cent."""
    return [
        f"contact '{one.name}': friction = {one.friction.mu:g} is a coefficient, and not in per cent"
        for one in scene.contacts
        if one.friction.mu > ROUGHEST
    ]


def _penalties(system: System) -> list[str]:
    """Of penalties far from the stiffness of the bodies. Collective."""
    found = [(contact.name, contact.findings.misstated(system.state)) for contact in system.contact_terms]
    return [f"contact '{name}': {one.reason}; {one.remedy}" for name, one in found if one]


def _images(scene: "Scene", system: System) -> list[str]:
    """Of contacts of one surface with tools that pairs put on one another, and that do not press it alike. Collective."""
    pairs, found = system.supports.pairs, dict[tuple[str, ...], str]()
    stated = {one.name: (one.slave, one.penalty, one.points, one.penetration) for one in scene.contacts}
    for both in Repeats(system, pairs).links if pairs else ():
        one, other = both[:2]
        (slave, *first), (second_slave, *second) = stated[one.name], stated[other.name]
        # directions of friction are turned with a tool
        laws = [law | {"along": None} if isinstance(law := each.friction_stated, dict) else law for each in both[:2]]
        if slave == second_slave and (first != second or laws[0] != laws[1]):
            names = tuple(sorted((one.name, other.name)))
            found[names] = (
                f"contacts '{names[0]}' and '{names[1]}' are with tools that a pair of faces puts on each other, and on the "
                "whole they are one; state friction=, penalty=, points= and penetration= alike"
            )
    return list(found.values())


def _pressed(scene: "Scene", system: System, pressures: Sequence[StatedLoad]) -> list[str]:
    """Of pressures that go on under a contact that has closed. Collective."""
    found, mesh = dict[tuple[str, str], str](), scene.mesh
    for load in pressures:
        name, facets = "+".join(load.group or ()), mesh.facets(*(load.group or ()))
        for one in scene.contacts:
            sides = [side for side in (one.slave, one.master) if not isinstance(side, Tool)]
            both = np.intersect1d(facets, np.concatenate([mesh.facets(*side) for side in sides]))
            if mesh.comm.allreduce(len(both)) and _acts(system, load, compat.locate_blocks(scene.space, both)):
                found[name, one.name] = (
                    f"pressure on '{name}' goes on beneath contact '{one.name}' where that closes: a fluid, "
                    'which is kept out there, is stated with where="open"'
                )
    return list(found.values())


def _acts(system: System, load: StatedLoad, nodes: Ints) -> bool:
    """Whether a load is ever more than none at some nodes, local ones. Collective."""
    for i in range(len(system.stages)):
        with system.stages.foreseen(i):
            for share in ASKED:
                values = load.path(system.stages.time(share))
                values = values if load.nodes is None else values[np.isin(load.nodes, nodes)]
                if system.comm.allreduce(bool(values.any()), op=MPI.LOR):
                    return True
    return False


def _idle(scene: "Scene", system: System, stages: int, loads: Sequence[StatedLoad]) -> list[str]:
    """Of loads on surfaces that supports, or hubs that are led, hold all over, in every direction. Collective."""
    found, owned = dict[str, tuple[str, ...]](), scene.space.dofmap.index_map.size_local
    ties, free = system.supports.ties, np.zeros(len(system.tools), dtype=bool)
    for i in range(stages):
        with system.stages.foreseen(i):
            free |= system.tools.free.any(axis=1)
    moving = np.concatenate([np.empty(0, dtype=np.int64), *[ties.of(int(i)) for i in np.flatnonzero(free)]])
    for load in loads:
        if load.group:
            nodes = scene.mesh.nodes(scene.space, *load.group)
            moves = bool(system.supports.free(nodes[nodes < owned]).any() or np.isin(nodes, moving).any())
            if not system.comm.allreduce(moves, op=MPI.LOR):
                found[called(load.word, load.group)] = load.group
    return [f"{name} moves nothing: supports hold all nodes of that surface in every direction" for name in found]


def _across(scene: "Scene", system: System, stated: Sequence[Stage], loads: Sequence[StatedLoad]) -> list[str]:
    """Of loads, each in one direction, across the axis of a cyclic pair, about which what repeats is turned. Collective."""
    found, axes = dict[str, str](), [(pair.what, pair.axis) for pair in scene.pairs if pair.axis is not None]
    for i in range(len(stated)) if axes else ():
        with system.stages.foreseen(i):
            for load in loads:
                force = whole(load.path, system.stages.time(1.0))
                for pair, axis in axes:
                    if np.linalg.norm(force - (force @ axis) * axis) > ALONG_AXIS * np.linalg.norm(force):
                        found[called(load.word, load.group)] = pair
    return [
        f"{name} acts across the axis of the {pair}: it is turned with each sector, so that round the axis it adds up to "
        "nothing; of weight, or of any force in one direction on the whole, model the whole"
        for name, pair in found.items()
    ]


def _heavy(scene: "Scene", system: System, stated: Sequence[Stage], loads: Sequence[StatedLoad]) -> list[str]:
    """Of loads on surfaces, and forces on tools, that no body of such a stiffness bears. Collective."""
    modulus, stages, found = max(young(body.material) for body in scene.bodies), system.stages, dict[str, float]()
    area = {one.name: system.comm.allreduce(float(one.surface.area.sum())) for one in system.contact_terms}
    for i, stage in enumerate(stated):
        if stage.method == ARC_LENGTH:  # which ends at a share of a load that has no meaning of its own
            continue
        with stages.foreseen(i):
            t = stages.time(1.0)
            for load in loads:
                name = called(load.word, load.group)
                found[name] = max(found.get(name, 0.0), np.abs(whole(load.path, t)).max() / load.over)
            for tool, force in zip(system.tools.names, system.tools.forces(t), strict=True):
                over = sum(area[one.name] for one in system.contact_terms if one.master_name == tool)
                if over > 0.0:
                    name = f"the push of tool '{tool}' over all of its contacts' area"
                    found[name] = max(found.get(name, 0.0), np.abs(force[:3]).max() / over)
    return [
        f"{name} comes to {value:.2g} {scene.units.pressure}, {value / modulus:.0e} times Young's modulus of all bodies: "
        "are loads, moduli and lengths in the same units?"
        for name, value in found.items()
        if value > HEAVIEST * modulus
    ]


def _unmet(scene: "Scene") -> list[str]:
    """What is to be said of bodies that touch or overlap as drawn where no contact of bodies is stated for them."""
    stated = {name for one in scene.contacts if isinstance(one.master, tuple) for name in (*one.slave, *one.master)}
    left: dict[tuple[str, ...], list[Mismatch]] = {}
    for found in scene.mesh.touching:
        if not stated & set(found.surfaces[0]):
            left.setdefault(tuple(sorted(found.volumes)), []).append(found)
    notes = []
    for (one, other), meetings in left.items():
        count, names = sum(found.count for found in meetings), f"body '{one}' touches or overlaps '{other}'"
        names = names if one != other else f"parts of body '{one}' touch or overlap"
        first = spot(np.array(meetings[0].place))
        beside = any(stated & set(found.surfaces[0]) for found in scene.mesh.touching if {one, other} == set(found.volumes))
        ends = " (with overlaps as drawn at a contact of both, faces at its ends are counted here)" if beside else ""
        notes.append(
            f"{names} without a contact there: {count} faces of cells, the first at {first}, lie on or in cells that do not "
            f"have all of their nodes{ends}; they come apart or pass through each other. State a contact between their "
            "surfaces, bond them with gmsh.model.occ.fragment before meshing, so that all nodes are common, or draw them "
            "with a gap"
        )
    return notes


def _folded(scene: "Scene") -> list[str]:
    """What is to be said of bodies with cells that are inside out at a node as drawn."""
    notes = []
    for found in scene.mesh.folded:
        cells = f"{found.count} cells are" if found.count > 1 else "1 cell is"
        remedy = "cells of a more even shape mend"
        if found.curved:
            remedy = 'gmsh.model.mesh.optimize("HighOrder") after setOrder(2), or finer cells there, mend'
        notes.append(
            f"body '{found.body}': {cells} inside out as drawn at a corner or on an edge, at worst element {found.element} "
            f"at {spot(np.array(found.place))}, where its Jacobian is {found.worst:.2g} of its mean: no quadrature point "
            f"lies there, and the run goes on, but what is told of that place means little; {remedy} that"
        )
    return notes


def _left_out(scene: "Scene") -> list[str]:
    """What is to be said of tools' files: facets without an area, which are no part of the tool."""
    tools = {one.master.name: one.master.left_out for one in scene.contacts if isinstance(one.master, MeshedTool)}
    return [
        f"tool '{name}': {count} facets of its file, without area, are left out" for name, count in tools.items() if count
    ]


def _slits(scene: "Scene") -> list[str]:
    """What is to be said of meshed tools whose facets nearly meet, where averages ask what lies beyond their edges."""
    notes = []
    for one in scene.contacts:
        if isinstance(one.master, MeshedTool) and (found := one.master.slits) and one.points == "averages":
            notes.append(
                f"contact '{one.name}': facets of tool '{one.master.name}' nearly meet and do not: {found.told}; along such "
                "a seam the force may be far too small; where no gap is meant mesh the patches together, with common "
                'corners, or take points="nodes"'
            )
    return notes


def _tiny(scene: "Scene", system: System) -> list[str]:
    """What is to be said of meshed tools that are smaller than a cell of what they are to press."""
    heights, notes = {contact.name: contact.surface.cell_height for contact in system.contact_terms}, []
    for one in scene.contacts:
        if isinstance(one.master, MeshedTool) and (size := np.ptp(one.master.X, axis=0).max()) < heights[one.name]:
            notes.append(
                f"contact '{one.name}': tool '{one.master.name}' is {size:.3g} long, less than a cell of what it presses, "
                f"{heights[one.name]:.3g}: see that both are in the same units, or mesh the place with cells of a quarter "
                "of what touches"
            )
    return notes


def _cut(scene: "Scene") -> list[str]:
    """What is to be said of tools that are no bodies of a plane scene's kind, and of which it has the cut by its plane."""
    if scene.section is None:
        return []
    way = AROUND if scene.section.axisymmetric else ALONG
    tools = [tool for tool in scene.tools if isinstance(tool, RigidTool)]
    return [f"tool '{tool.name}': a {what} {way}" for tool in tools for what in cut_shapes(tool, scene.section)]
