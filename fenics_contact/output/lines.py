"""A contact along a line: its nodal values where a plane cuts the slave surface, in order, and the widths of its zones."""

from collections.abc import Callable, Mapping

import numpy as np

from fenics_contact.output.columns import AXES
from fenics_contact.output.slave_nodes import RANK_OF_STATUS, STATUS_OF_RANK, SlaveNodes
from fenics_contact.output.units import Units
from fenics_contact.types import Array, Floats
from fenics_contact.values import SceneError

ON_PLANE = 1e-9  # of the surface's size: nodes so near to the plane lie on it
APART = 1.234567e-7  # of that size: points nearer to one another are one

Along = str | Callable[[Floats], Floats]
Table = dict[str, Array]


def line(surface: SlaveNodes, along: Along, cut: Mapping[str, float] | None, units: Units) -> Table:
    """Columns of the slave surface's points in rising order, on all ranks. Collective.

    along: "x", "y" or "z", or a function of the reference positions X (n, 3) -> (n,), that orders them; cut: {axis: value},
    the plane of the undeformed body whose cut with the surface's facets is taken; None: all corners of its facets.
    SceneError, on all ranks, for another axis, and where the plane misses the surface.
    """
    values = _values(surface)
    local = values[np.unique(surface.skin.corners)] if cut is None else _cut(surface, values, cut)
    rows = np.concatenate(surface.comm.allgather(local))
    if not len(rows):
        raise SceneError(f"cut = {cut} misses the slave surface of contact '{surface.contact.name}'")
    size = np.ptp(rows[:, :3], axis=0).max()
    _, first = np.unique(np.floor(rows[:, :3] / max(APART * size, 1e-300) + 0.3), axis=0, return_index=True)
    rows = rows[first]
    rows = rows[np.argsort(_order(rows[:, :3], along), kind="stable")]
    steps = np.linalg.norm(np.diff(rows[:, 3:6], axis=0), axis=1)
    names = [f"{axis}_reference_{units.length}" for axis in AXES] + [f"{axis}_{units.length}" for axis in AXES]
    names += [f"pressure_{units.pressure}", *(f"friction_{axis}_{units.pressure}" for axis in AXES)]
    names += [f"gap_{units.length}", f"slip_{units.length}"]
    table = {name: rows[:, i] for i, name in enumerate(names)}
    table["status"] = STATUS_OF_RANK[rows[:, len(names)].astype(int)]
    return {f"arc_{units.length}": np.concatenate([[0.0], np.cumsum(steps)])} | table


def _order(X: Floats, along: Along) -> Floats:
    if callable(along):
        return np.asarray(along(X), dtype=float)
    if along not in list(AXES):
        raise SceneError(f"along = {along!r} must be 'x', 'y', 'z', or a function of the reference positions X (n, 3)")
    return X[:, AXES.index(along)]


def _values(surface: SlaveNodes) -> Floats:
    """Reference and current position, pressure, friction, gap, slip and rank of the status (n, 13) of all local nodes."""
    at, x = surface.at_state(), surface.positions()
    columns = [surface.reference(), x, at.pressure, at.friction, at.gap, at.slip, RANK_OF_STATUS[at.status]]
    return np.column_stack(columns)


def _cut(surface: SlaveNodes, values: Floats, cut: Mapping[str, float]) -> Floats:
    """Values where the edges of this rank's facets meet the plane, and of the nodes on it."""
    if len(cut) != 1 or next(iter(cut)) not in list(AXES):
        raise SceneError(f'cut = {cut} must be one axis and its value, like {{"z": 0.0}}')
    (axis, value), corners = next(iter(cut.items())), surface.skin.corners
    away = values[:, AXES.index(axis)] - value
    away[np.abs(away) <= ON_PLANE * np.ptp(values[:, :3], axis=0).max(initial=0.0)] = 0.0
    nodes = np.unique(corners)
    starts, ends = corners.ravel(), np.roll(corners, -1, axis=1).ravel()
    crossing = away[starts] * away[ends] < 0.0
    below, above = starts[crossing], ends[crossing]
    share = (away[below] / (away[below] - away[above]))[:, None]
    between = (1.0 - share) * values[below] + share * values[above]
    between[:, -1] = np.maximum(values[below, -1], values[above, -1])
    return np.concatenate([values[nodes[away[nodes] == 0.0]], between])


def zones(table: Table, units: Units) -> Floats:
    """Starts and ends (n, 2) along the arc [length] of the parts of a line that are in contact.

    An end lies where the squares of the last two pressures point to zero, as sqrt(a^2 - x^2) does, no farther than the next
    point; a part of one point ends midway.
    """
    s, p = table[f"arc_{units.length}"], np.maximum(table[f"pressure_{units.pressure}"], 0.0)
    closed = np.concatenate([[False], p > 0.0, [False]])
    first, last = np.flatnonzero(closed[1:] & ~closed[:-1]), np.flatnonzero(closed[:-1] & ~closed[1:]) - 1
    found = [(_end(s, p, a, b, -1), _end(s, p, b, a, 1)) for a, b in zip(first, last, strict=True)]
    return np.array(found).reshape(-1, 2)


def _end(s: Floats, p: Floats, i: int, other: int, way: int) -> float:
    """Where contact ends behind point i, the last one on this way."""
    beyond = i + way
    if not 0 <= beyond < len(s):
        return float(s[i])
    if i == other:
        return float(0.5 * (s[i] + s[beyond]))
    fall = p[i - way] ** 2 - p[i] ** 2
    reach = abs(s[beyond] - s[i])
    ahead = min(p[i] ** 2 / fall * abs(s[i] - s[i - way]), reach) if fall > 0.0 else 0.5 * reach
    return float(s[i] + way * ahead)
