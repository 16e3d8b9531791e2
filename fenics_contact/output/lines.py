"""A contact along a line: its nodal values where a plane cuts the slave surface, in order, and the widths of its zones."""

from collections.abc import Callable, Mapping

import numpy as np

from fenics_contact.assembly.size import extremes
from fenics_contact.output.chains import along_sides, chains, cut_facets, together
from fenics_contact.output.columns import AXES
from fenics_contact.output.slave_nodes import RANK_OF_STATUS, STATUS_OF_RANK, SlaveNodes
from fenics_contact.types import Array, Floats
from fenics_contact.units import Units
from fenics_contact.values import SceneError, finite, shown

ON_PLANE = 1e-9  # of the surface's size: nodes so near to the plane lie on it

Along = str | Callable[[Floats], Floats]
Table = dict[str, Array]


def line(surface: SlaveNodes, along: Along, cut: Mapping[str, float] | None, units: Units) -> Table:
    """Columns of the points where a plane cuts the slave surface's facets, on all ranks. Collective.

    Neighbours are those of one facet; where the cut is in parts these come one after the other, each a `chain`, and arc, the
    way along the deformed line, leaves out the jumps. along: "x", "y" or "z", or a function of the reference positions X
    (n, 3) -> (n,): a chain starts where that is least; cut: {axis: value}, the plane of the undeformed body; None, for
    surfaces one facet wide: their lower side, and in a plane scene all of it. SceneError, on all ranks, for another axis, a
    plane that misses the surface, and for a surface that is no line.
    """
    values, corners = _values(surface), surface.rings
    if surface.skin.section is not None:
        if cut is not None:
            raise SceneError(f"cut = {cut}: in a plane scene the slave surface is a line itself; leave it out")
        found, size = along_sides(surface.keys()[corners]), surface.extent
    else:
        axis, value, size = _plane(surface, cut)
        away = values[:, axis] - value
        away[np.abs(away) <= ON_PLANE * size] = 0.0
        found = cut_facets(surface.keys()[corners], away[corners])
    rows, joined = together(surface.comm, found, _between(surface, values, found.ends, found.share))
    if not len(joined):
        within, of = surface.comm.allreduce(found.flat), f"the slave surface of contact '{surface.contact.name}'"
        where = f"holds facets of {of} and cuts none; take one across it" if within else f"misses {of}"
        raise SceneError(f"cut = {cut}: the plane {where}")
    parts = chains(joined, _order(rows[:, :3], along, size))
    steps = [np.append(0.0, np.linalg.norm(np.diff(rows[part, 3:6], axis=0), axis=1)) for part in parts]
    chain = np.repeat(np.arange(len(parts)), [len(part) for part in parts])
    rows = rows[np.concatenate(parts)]
    names = [f"{axis}_reference_{units.length}" for axis in AXES] + [f"{axis}_{units.length}" for axis in AXES]
    names += [f"pressure_{units.pressure}", *(f"friction_{axis}_{units.pressure}" for axis in AXES)]
    names += [f"gap_{units.length}", f"slip_{units.length}"]
    table = {name: rows[:, i] for i, name in enumerate(names)}
    table["status"] = STATUS_OF_RANK[rows[:, len(names)].astype(int)]
    return {f"arc_{units.length}": np.cumsum(np.concatenate(steps)), "chain": chain} | table


def _plane(surface: SlaveNodes, cut: Mapping[str, float] | None) -> tuple[int, float, float]:
    """Axis and place of the plane, and size of the slave surface [length]. Collective."""
    comm, X = surface.comm, surface.reference[surface.skin.corners]
    low, high = extremes(comm, X.reshape(-1, 3))
    size = float(np.max(high - low))
    if cut is not None:
        if len(cut) != 1 or next(iter(cut)) not in list(AXES):
            raise SceneError(f'cut = {cut} must be one axis and its value, like {{"z": 0.0}}')
        ((letter, value),) = cut.items()
        return AXES.index(letter), float(finite(value, f"cut: {letter}")), size
    inside = np.minimum(X - low, high - X).max(axis=(0, 1), initial=0.0)
    thinnest = (high - low - np.ptp(X, axis=1)).max(axis=0, initial=0.0)
    wide = np.max(comm.allgather(np.maximum(inside, thinnest)), axis=0) > ON_PLANE * size
    wide |= high - low <= ON_PLANE * size
    if wide.all():
        letter = AXES[int(np.argmin(np.where(high - low > ON_PLANE * size, high - low, np.inf)))]
        middle = np.where(np.abs(low + high) > ON_PLANE * size, 0.5 * (low + high), 0.0)
        raise SceneError(
            f"contact '{surface.contact.name}': its slave surface is more than one facet wide, no line; give the plane that "
            f'cuts it, cut={{"{letter}": {middle[AXES.index(letter)]:.6g}}} for instance'
        )
    axis = int(np.argmin(np.where(wide, np.inf, high - low)))
    return axis, float(low[axis]), size


def _order(X: Floats, along: Along, size: float) -> Floats:
    """What orders the points at X (n, 3); SceneError where it does not."""
    if callable(along):
        order = np.asarray(along(X.copy()), dtype=float)
        if order.shape != (len(X),) or not np.isfinite(order).all():
            raise SceneError(
                f"along must be a function of positions X (n, 3) that gives one finite number for each, an array of shape "
                f"(n,); for n = {len(X)} it gave shape {order.shape}{'' if np.isfinite(order).all() else ' and NaN or inf'}"
            )
        size = float(np.abs(order).max())
    elif along not in list(AXES):
        raise SceneError(f"along = {shown(along)} must be 'x', 'y', 'z', or a function of the reference positions X (n, 3)")
    else:
        order = X[:, AXES.index(along)]
    if np.ptp(order) <= ON_PLANE * size:
        raise SceneError(f"along = {shown(along)} is the same at all points of the line; give what tells its two ends apart")
    return order


def _values(surface: SlaveNodes) -> Floats:
    """Reference and current position, pressure, friction, gap, slip and rank of the status (n, 13) of all local nodes."""
    at, x = surface.at_state(), surface.positions()
    columns = [surface.reference, x, at.pressure, at.friction, at.gap, at.slip, RANK_OF_STATUS[at.status]]
    return np.column_stack(columns)


def _between(surface: SlaveNodes, values: Floats, ends: Array, share: Floats) -> Floats:
    """Values between the nodes with keys (n, 2), a share (n,) of the way from the first to the second."""
    nodes = np.unique(surface.rings)
    keys = surface.keys()[nodes]
    order = np.argsort(keys)
    first, second = (values[nodes[order[np.searchsorted(keys[order], ends[:, i])]]] for i in (0, 1))
    out = (1.0 - share)[:, None] * first + share[:, None] * second
    out[:, -1] = np.maximum(first[:, -1], second[:, -1])
    return out


def zones(table: Table, units: Units, least: float = 0.0) -> Floats:
    """Starts and ends (n, 2) along the arc [length] of the parts of a line that are in contact, chain by chain.

    least: pressures up to it are round-off. An end lies where the squares of the last two pressures point to zero, as
    sqrt(a^2 - x^2) does, no farther than the next point; a part of one point ends midway.
    """
    arc, pressure, chain = table[f"arc_{units.length}"], table[f"pressure_{units.pressure}"], table["chain"]
    found: list[tuple[float, float]] = []
    for part in (chain == number for number in np.unique(chain)):
        s, p = arc[part], np.where(pressure[part] > least, pressure[part], 0.0)
        closed = np.concatenate([[False], p > 0.0, [False]])
        first, last = np.flatnonzero(closed[1:] & ~closed[:-1]), np.flatnonzero(closed[:-1] & ~closed[1:]) - 1
        found += [(_end(s, p, a, b, -1), _end(s, p, b, a, 1)) for a, b in zip(first, last, strict=True)]
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
