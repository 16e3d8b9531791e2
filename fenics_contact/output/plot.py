"""From a scene and its system's state to a drawing: the field's values, the tools where they are, the view, the mirrors."""

from collections.abc import Sequence
from dataclasses import replace

import numpy as np
from mpi4py import MPI

from fenics_contact.output.colours import colours
from fenics_contact.output.fields import Fields
from fenics_contact.output.layers import unit
from fenics_contact.output.pictures import Drawing, Neighbourhood
from fenics_contact.output.render import pyvista_works
from fenics_contact.output.skin import AXES, DrawnSkin, look, mirrored, normals, skin, symmetry_planes, tool_tiles
from fenics_contact.output.views import Angles, choose, slice_axis, upright
from fenics_contact.scene.scene import Scene
from fenics_contact.types import Floats
from fenics_contact.values import SceneError, finite, shown

FROM_BELOW = 0.1  # sine of the angle below the horizon from which on the picture says so
AROUND = 0.15  # of the bodies' largest length: how far about them tools are drawn
FAR = 2.5  # of it: how far from them a wall may be that they face, for the picture to go as far
IN_PLANE = 1e-3  # of it: what ends no farther from a plane of symmetry ends in it
FACING = 0.5  # cosine of the angle between an axis and the normals of surface and wall from which on they face each other


def drawing(
    fields: Fields,
    field: str | None = None,
    mirror: str = "",
    view: str | Angles | None = None,
    box: Neighbourhood | None = None,
) -> Drawing | None:
    """The model at the state of its fields, up to date, on rank 0; None on the others. Collective.

    field, mirror, view as for `Result.plot`; box: in which tools are drawn at least, on rank 0: that of the drawing before,
    in a film, whose tools then stay. SceneError, on all ranks, for an unknown field, one that the scene does not have, and
    a mirror where no symmetry is.
    """
    scene, system = fields.scene, fields.system
    planes = symmetry_planes(scene, system)
    _refuse(mirror, view, planes)
    seen = look(fields, field or ("contact_pressure" if scene.contacts else "displacement"))
    body, least = skin(fields, seen), fields.least_pressure()
    frame = upright(_weight(scene))
    touches = system.comm.allreduce(int((fields.of(seen.contact).pressure.x.array > least).any())) > 0
    if body is None:
        return None
    if seen.on_contact and seen.kind == "amount":  # what presses by round-off touches as little
        body = replace(body, values=np.where(body.values <= least, 0.0, body.values))
    tint = colours(seen.label, seen.kind, seen.on_contact, body.values)
    points, across = body.x.reshape(-1, 3), slice_axis(body)
    low, high = _neighbourhood(points, planes, across)
    reach = FAR * float(np.max(np.ptp(points, axis=0)))
    met = [contact.master for contact in scene.contacts if seen.contact in ("", contact.name)]
    on_axis = scene.section is not None and scene.section.axisymmetric
    edge = np.array([0.0 if on_axis else -np.inf, -np.inf, -np.inf])  # there is nothing beyond an axis
    about = tool_tiles(scene, system.state.tools, np.maximum(low - reach, edge), high + reach)
    about = [tiles for tool, tiles in zip(scene.tools, about, strict=True) if any(tool is master for master in met)]
    ends = [end for end in _open_ends(points, planes) if end[0] != across]
    low, high = _up_to_walls(body, about, (low, high), ends)
    low = np.maximum(low, edge)
    if box is not None:
        low, high = np.minimum(low, box[0]), np.maximum(high, box[1])
    tiles = tool_tiles(scene, system.state.tools, low, high)
    body, tiles = mirrored(body, tiles, {axis: planes[axis] for axis in sorted(map(AXES.index, mirror))})
    # bodies whose own surfaces carry nothing of a contact field would hide those that do
    carries = np.bincount(body.body[body.slave], minlength=len(scene.bodies)) > 0
    hidden = ~carries if seen.on_contact else np.zeros(len(scene.bodies), dtype=bool)
    chosen = choose(body, ~hidden[body.body], view, frame)
    title = f"{system.stages.name}, " if system.stages.name else ""
    title += f"t = {system.state.t:.4g}" + (", seen from below" if chosen.towards @ frame[2] < -FROM_BELOW else "")
    title += ", nothing touches" if seen.on_contact and not touches else ""
    absent = [tool for tool, one in zip(scene.tools, tiles, strict=True) if not len(one)]
    far = [tool.name for tool in absent if any(tool is master for master in met)]
    title += f", beyond the picture: {', '.join(far)}" if far else ""
    return Drawing(body, tiles, chosen, tint, hidden, title, scene.units.length, (low, high))


def _weight(scene: Scene) -> Floats:
    """Sum of the body forces (3,), at t = 1, that are the same everywhere. Collective."""
    forces = [load.path(1.0) for load in scene.loads if load.word == "body_force"]
    return np.sum([np.zeros(3), *(force for force in forces if np.shape(force) == (3,))], axis=0)


def refuse_limits(limits: Sequence[float] | None) -> None:
    """SceneError for limits of colours that are not two rising numbers."""
    if limits is not None and not np.ptp(finite(limits, "limits", (2,))) == limits[1] - limits[0] > 0.0:
        raise SceneError(f"limits = {shown(limits)} of the colours must rise: (least, largest)")


def _open_ends(points: Floats, planes: dict[int, float]) -> list[tuple[int, int]]:
    """(axis, -1 or 1) of the ends of the bodies that do not lie in a plane of symmetry."""
    low, high = points.min(axis=0), points.max(axis=0)
    near = IN_PLANE * float(np.max(high - low))  # a ring does not reach the axis that it is symmetric about
    closed = {
        (axis, sign)
        for axis, place in planes.items()
        for sign, end in ((-1, low[axis]), (1, high[axis]))
        if abs(end - place) <= near
    }
    return [(axis, sign) for axis in range(3) for sign in (-1, 1) if (axis, sign) not in closed]


def _neighbourhood(points: Floats, planes: dict[int, float], across: int | None) -> Neighbourhood:
    """Box about the bodies in which tools are drawn: up to planes of symmetry; all that crosses a slice."""
    low, high = points.min(axis=0), points.max(axis=0)
    size, is_open = float(np.max(high - low)), _open_ends(points, planes)
    near = np.array([[AROUND * size if (axis, sign) in is_open else 0.0 for axis in range(3)] for sign in (-1, 1)])
    if across is not None:
        near[:, across] = size
    return low - near[0], high + near[1]


def _up_to_walls(body: DrawnSkin, tools: list[Floats], box: Neighbourhood, ends: list[tuple[int, int]]) -> Neighbourhood:
    """A box (3,), (3,) about the bodies, extended up to the nearest wall of each tool that a slave surface faces along an
    axis, either way, and to the nearest place of a tool of which they face none.

    tools: tiles (n, 4, 3) of each, as far as they count; ends: (axis, -1 or 1) at which the box may be extended.
    """
    (low, high), points, out = box, body.x.reshape(-1, 3), unit(normals(body.x[body.slave]))
    least, most = points.min(axis=0), points.max(axis=0)
    margin = AROUND * float(np.max(most - least))
    wide_low, wide_high = low.copy(), high.copy()
    looking = [(axis, sign) for axis, sign in ends if (sign * out[:, axis] > FACING).any()]
    for tiles in tools:
        middle, normal = tiles.mean(axis=1), unit(normals(tiles))
        beside = (tiles.max(axis=1) >= least) & (tiles.min(axis=1) <= most)  # (n, 3): overlaps the bodies along the axis
        off = np.maximum(np.maximum(least - middle, middle - most), 0.0)
        places = []
        for axis, sign in looking:
            faced = beside[:, np.arange(3) != axis].all(axis=1) & (sign * normal[:, axis] < -FACING)
            there = np.flatnonzero(faced & (sign * (middle - (most if sign > 0 else least))[:, axis] > 0.0))
            places += [middle[there[np.argmin(off[there, axis])]]] if len(there) else []
        if len(tiles) and not places and not beside.all(axis=1).any():
            places += [middle[np.argmin(np.linalg.norm(off, axis=1))]]
        for place in places:
            for axis, sign in ends:
                if sign < 0 and place[axis] < low[axis]:
                    wide_low[axis] = min(wide_low[axis], place[axis] - margin)
                elif sign > 0 and place[axis] > high[axis]:
                    wide_high[axis] = max(wide_high[axis], place[axis] + margin)
    return wide_low, wide_high


def _refuse(mirror: str, view: str | Angles | None, planes: dict[int, float]) -> None:
    known = {AXES[axis] for axis in planes}
    if not isinstance(mirror, str) or not set(mirror) <= known or len(set(mirror)) < len(mirror):
        there = f"there are planes normal to {', '.join(sorted(known))}" if known else "there are none"
        raise SceneError(
            f"mirror = {mirror!r}: give the axes of planes of symmetry, flat ends of the bodies held along their normal "
            f"alone; {there}"
        )
    angles = isinstance(view, tuple | list) and len(view) == 2 and np.all(np.isfinite(np.array(view, dtype=float)))
    if view is not None and not angles and view not in list(AXES):
        raise SceneError(f"view = {view!r}: give 'x', 'y', 'z' or (elevation, azimuth) in degrees")


def refuse_backend(backend: str | None, comm: MPI.Comm) -> None:
    """SceneError, on all ranks, for a backend that is unknown or does not work here. Collective."""
    if backend not in (None, "matplotlib", "pyvista"):
        raise SceneError(f"backend = {backend!r}: give 'matplotlib' or 'pyvista', or nothing for the latter where it works")
    if backend == "pyvista" and not comm.bcast(comm.rank == 0 and pyvista_works()):
        raise SceneError(
            "backend = 'pyvista': it is not installed, or cannot draw here without a display; install python3-pyvista "
            "(Debian 13, or pip's pyvista with a vtk of 9.4 or newer), start the run under xvfb-run, or leave backend out"
        )
