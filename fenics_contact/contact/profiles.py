"""Rigid tools from a profile of lines and arcs, drawn along an axis or turned about it: a groove with its radii, a ring."""

from collections.abc import Sequence

import numpy as np

from fenics_contact.contact.tools import RigidTool, axes_along
from fenics_contact.kernels import rigid_profiles as kernel
from fenics_contact.kernels import rigid_shapes
from fenics_contact.types import Floats
from fenics_contact.values import SceneError, finite, positive, shown

Corner = Sequence[float]  # (p, z) or (p, z, fillet)
ROUNDED = 1e-9  # of a profile's size: known no better, fillets may take up the whole of a line
ENDLESS = 1e6  # sizes of a profile: where lines without end are looked at last


def rigid_extrusion(
    profile: Sequence[Corner],
    origin: Sequence[float] | Floats = (0.0, 0.0, 0.0),
    along: Sequence[float] | Floats = (0.0, 1.0, 0.0),
    up: Sequence[float] | Floats = (0.0, 0.0, 1.0),
    closed: bool = False,
    name: str = "profile",
) -> RigidTool:
    """A profile drawn along an axis without end: the tool is on the right as one goes from point to point.

    profile: corners (p, z) or (p, z, fillet) of straight lines [length], z from the origin in the direction `up`, p in that
    of along x up; fillet: radius of the arc in the place of the corner, 0 where none is given. A corner that points into
    the tool needs one. The first and the last line have no end unless the profile is closed.
    """
    third, second = axes_along(up, f"{name}: up")[:, 2], axes_along(along, f"{name}: along")[:, 2]
    if abs(second @ third) > ROUNDED:
        raise SceneError(f"{name}: along and up must be perpendicular, not {shown(along)} and {shown(up)}")
    corners, fillets = _corners(profile, closed, name)
    _refuse_crossing(corners, closed, (False, False), name)
    pieces, edge_kind = _pieces(corners, fillets, closed, name)
    axes, place = np.column_stack([np.cross(second, third), second, third]), finite(origin, f"{name}: origin", (3,))
    return RigidTool(name, rigid_shapes.EXTRUSION, pieces, axes, place, float(np.abs(corners).max()), edge_kind)


def rigid_revolution(
    profile: Sequence[Corner],
    origin: Sequence[float] | Floats = (0.0, 0.0, 0.0),
    axis: Sequence[float] | Floats = (0.0, 0.0, 1.0),
    closed: bool = False,
    name: str = "turned profile",
) -> RigidTool:
    """A profile turned about the axis through the origin: the tool is on the right as one goes from point to point.

    profile: corners (r, z) or (r, z, fillet) as of `rigid_extrusion`, r from the axis and z along it [length]. A profile may
    start and end on the axis; a tip there needs a fillet. Other open ends go on without end, and not to the axis.
    """
    corners, fillets = _corners(profile, closed, name)
    on_axis, size = corners[:, 0] == 0.0, float(np.abs(corners).max())
    if corners[:, 0].min() < 0.0:
        raise SceneError(f"{name}: r = {corners[:, 0].min():g} lies beyond the axis; give distances from it, r >= 0")
    if on_axis[1:-1].any() or (closed and on_axis.any()):
        raise SceneError(f"{name}: only the ends of an open profile may lie on the axis; end it where it gets there")
    for end, beside in ((0, 1), (-1, -2)):
        if not (closed or on_axis[end]) and corners[end, 0] < corners[beside, 0] - ROUNDED * size:
            raise SceneError(f"{name}: its line at r, z = {corners[end]} goes on to the axis; let the profile end there")
    _refuse_crossing(corners, closed, (bool(on_axis[0]), bool(on_axis[-1])), name)
    # by the image of its line a tip is a corner like any other
    first, last = (corners[i : i + 1] * [-1.0, 1.0] for i in (1, len(corners) - 2))
    before, behind = int(on_axis[0]), int(on_axis[-1])
    whole = np.concatenate([first[:before], corners, last[:behind]])
    pieces, edge_kind = _pieces(whole, np.pad(fillets, (before, behind)), closed, name, turned=True)
    axes, place = axes_along(axis, f"{name}: axis"), finite(origin, f"{name}: origin", (3,))
    return RigidTool(name, rigid_shapes.REVOLUTION, pieces, axes, place, size, edge_kind)


def _corners(profile: Sequence[Corner], closed: bool, name: str) -> tuple[Floats, Floats]:
    """Corners (n, 2) and fillets (n,) of a profile as stated [length]."""
    least = 3 if closed else 2
    if not isinstance(profile, list | tuple | np.ndarray) or len(profile) < least:
        raise SceneError(f"{name}: profile = {shown(profile)} must be at least {least} corners (p, z) or (p, z, fillet)")
    rows = []
    for i, point in enumerate(profile):
        what = f"{name}: point {i + 1}"
        if not isinstance(point, list | tuple | np.ndarray) or len(point) not in (2, 3):
            raise SceneError(f"{what} = {shown(point)} must be (p, z) or (p, z, fillet)")
        corner = finite(point[:2], what, (2,))
        rows.append([*corner, float(positive(point[2], f"{what}: fillet", zero=True)) if len(point) == 3 else 0.0])
    out = np.array(rows)
    _, length = _lines(out[:, :2], closed)
    if (length <= ROUNDED * np.abs(out[:, :2]).max()).any():
        raise SceneError(f"{name}: two points in a row are the same, {out[int(length.argmin()), :2]}; leave one out")
    return out[:, :2], out[:, 2]


def _lines(corners: Floats, closed: bool) -> tuple[Floats, Floats]:
    """Unit directions (m, 2) and lengths (m,) of the lines between corners."""
    steps = np.diff(corners, axis=0, append=corners[:1] if closed else np.empty((0, 2)))
    length = np.linalg.norm(steps, axis=1)
    return steps / np.where(length > 0.0, length, 1.0)[:, None], length


def _refuse_crossing(corners: Floats, closed: bool, ends: tuple[bool, bool], name: str) -> None:
    """No two lines may meet but in the corner they share. ends: whether the first, the last line ends in its point."""
    direction, length = _lines(corners, closed)
    far = ENDLESS * np.abs(corners).max()
    start, end = corners[: len(length)].copy(), corners[: len(length)] + length[:, None] * direction
    if not closed:
        start[0] -= 0.0 if ends[0] else far * direction[0]
        end[-1] += 0.0 if ends[1] else far * direction[-1]

    def side(i: int, point: Floats) -> float:
        return float(np.sign(np.cross(direction[i], point - start[i])))

    for i in range(len(length)):
        for j in range(i + 2, len(length) - (1 if closed and i == 0 else 0)):
            apart = side(i, start[j]) * side(i, end[j]) > 0.0 or side(j, start[i]) * side(j, end[i]) > 0.0
            low, high = np.minimum(start, end)[[i, j]], np.maximum(start, end)[[i, j]]  # collinear ones may be apart too
            if not apart and (low.max(axis=0) <= high.min(axis=0)).all():
                raise SceneError(f"{name}: its lines from {corners[i]} and from {corners[j]} cross; move a point")


def _pieces(corners: Floats, fillets: Floats, closed: bool, name: str, turned: bool = False) -> tuple[Floats, str]:
    """The pieces of a profile on their way, as kernels/rigid_profiles.py takes them, and what is said of its edges."""
    direction, length = _lines(corners, closed)
    if not closed and (fillets[0] > 0.0 or fillets[-1] > 0.0):
        raise SceneError(f"{name}: the ends of an open profile are no corners and take no fillet; add a point beyond them")
    arcs: list[list[Floats]] = [[] for _ in corners]
    cut = np.zeros(len(corners) + 1)
    for i in range(0 if closed else 1, len(corners) - (0 if closed else 1)):
        tip = turned and corners[i, 0] == 0.0
        arcs[i], cut[i] = _arc(corners[i], fillets[i], direction[i - 1], direction[i], tip, name)
    cut[-1] = cut[0]
    left = length - cut[: len(length)] - cut[1 : len(length) + 1]
    if (left < -ROUNDED * length).any():
        at = corners[int((left / length).argmin())]
        raise SceneError(f"{name}: the fillets of the line from {at} do not fit on it; make them smaller")
    start = corners[: len(length)] + cut[: len(length), None] * direction
    lines = np.column_stack([np.full(len(length), kernel.LINE), start, direction, np.maximum(left, 0.0), 0.0 * left])
    if not closed:
        lines[0, 0] += kernel.NO_START
        lines[-1, 0] += kernel.NO_END
    pieces = np.concatenate([np.array([*arc, line]) for arc, line in zip(arcs, lines, strict=False)])
    return pieces.ravel(), "sharp corners" if (pieces[pieces[:, 0] == kernel.ARC, 6] == 0.0).any() else "none"


def _arc(corner: Floats, fillet: float, before: Floats, behind: Floats, tip: bool, name: str) -> tuple[list[Floats], float]:
    """The arc in the place of a corner between two directions, in a list, and what it takes off both lines [length]."""
    turn = np.arctan2(np.cross(before, behind), before @ behind)  # above zero to the left, where the corner points inwards
    if abs(turn) < ROUNDED:
        return [], 0.0
    half = 0.5 * abs(turn)
    if half > 0.5 * np.pi - ROUNDED:
        raise SceneError(f"{name}: the profile turns back at {corner}; give the tool some width there")
    if fillet == 0.0 and tip:
        raise SceneError(f"{name}: its tip at {corner} on the axis needs a fillet, (0, z, fillet), or use rigid_cone")
    if fillet == 0.0 and turn > 0.0:
        raise SceneError(
            f"{name}: the corner at {corner} points into the tool; there one of its two sides alone would hold a point: "
            "give it a fillet, or state two tools, one for each side"
        )
    side = 1.0 if turn < 0.0 else -1.0
    middle = side * np.array([-before[1] - behind[1], before[0] + behind[0]]) / (2.0 * np.cos(half))
    code = kernel.ARC if turn < 0.0 else kernel.HOLLOW
    centre = corner - fillet / np.cos(half) * middle
    return [np.array([code, *centre, *middle, np.cos(half), fillet])], float(fillet * np.tan(half))
