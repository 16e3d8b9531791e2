"""The surface of a rigid tool as facets, for files and pictures: a meshed tool's own, an analytic one cut into facets."""

import numpy as np

from fenics_contact.assembly.pose import Pose
from fenics_contact.contact.tools import Hub, MeshedTool, RigidTool, Tool, parts_of
from fenics_contact.kernels import rigid_profiles, rigid_shapes
from fenics_contact.types import Floats, Ints64

SAG = 2e-3  # of `size`: how far a facet may cut below a round surface in a file
FEWEST, MOST = 6, 48  # facets per quarter of a turn
FLAT = 8  # facets along a straight line: pictures sort them by their distance from the eye

# directions in its frame that a tool has no end along
ENDLESS = {rigid_shapes.PLANE: [0, 1], rigid_shapes.CYLINDER: [2], rigid_shapes.EXTRUSION: [1]}

Facets = tuple[Floats, Ints64]


def tool_surface(tool: Tool, size: float, about: Floats | None = None, pose: Pose | None = None, sag: float = SAG) -> Facets:
    """Points (n, 3) [length] of a tool's surface, where it is, and facets (m, 4), rows of points.

    Facets are counter-clockwise seen from outside the tool; a triangle repeats its third point. Every point lies on the
    tool, a hub has its own alone; facets cut below its round parts by `sag` of `size` at most, as far as MOST of them do.
    size: of the bodies [length]: side of the square that stands for a plane, length of a cylinder, and of a cone's side;
    about (3,): the place nearest to which an endless plane or cylinder is cut out where it is, by default the tool's own;
    pose: by default that of the start.
    """
    if isinstance(tool, MeshedTool):
        points, facets = tool.X, tool.nodes
    elif isinstance(tool, RigidTool):
        near = None if about is None else np.asarray(about, dtype=np.float64)
        near = near if near is None or pose is None else pose.before(near)
        points, facets = _joined([_part(part, size, near, sag) for part in parts_of(tool)])
    elif isinstance(tool, Hub):
        points, facets = tool.point[None], np.empty((0, 4), dtype=np.int64)
    else:
        raise TypeError(f"no surface is known of a {type(tool).__name__}")
    return points if pose is None else pose.placed(points), facets


def _part(tool: RigidTool, size: float, near: Floats | None, sag: float) -> Facets:
    """Surface of one shape where it starts; near (3,): the place about which an endless one is cut out."""
    centre = np.zeros(3) if near is None else (near - tool.origin) @ tool.axes
    points, facets = _in_frame(tool, size, centre, sag * size)
    return points @ tool.axes.T + tool.origin, facets


def _joined(surfaces: list[Facets]) -> Facets:
    before = np.cumsum([0, *(len(points) for points, _ in surfaces)])
    facets = [facets + start for (_, facets), start in zip(surfaces, before, strict=False)]
    return np.concatenate([points for points, _ in surfaces]), np.concatenate(facets)


def piece(tool: Tool, size: float, rest: Floats, about: Floats, pose: Pose) -> tuple[float, Floats]:
    """Size and place (3,) of the part of an endless tool to draw in every state of a run: the same one of the tool, that
    about the bodies at rest, twice as large, three times, ... where they have gone along it.

    size: of the part at first, of which the bodies take two thirds; rest, about (3,): middle of the bodies at rest and now
    [length].
    """
    gone, way = 0.0, pose.before(about) - rest  # as the tool sees it
    for part in parts_of(tool) if isinstance(tool, RigidTool) else ():
        along = part.axes.T @ way
        gone = max(gone, float(np.abs(along[ENDLESS.get(part.kind, [])]).max(initial=0.0)))
    times = np.ceil(max(gone - size / 6.0, 0.0) / (0.5 * size))
    return size * (1.0 + times), pose.placed(rest)


def _in_frame(tool: RigidTool, size: float, centre: Floats, sag: float) -> Facets:
    """Surface in the tool's frame, of endless shapes the part about `centre` (3,)."""
    if tool.kind == rigid_shapes.PLANE:
        side = np.linspace(-size / 2, size / 2, FLAT + 1)
        x, y = np.meshgrid(centre[0] + side, centre[1] + side, indexing="ij")
        return np.column_stack([x.ravel(), y.ravel(), np.zeros(x.size)]), _grid(*x.shape)
    if tool.kind == rigid_shapes.BOX:
        fillet = tool.shape[3]
        return _rounded_box(tool.shape[:3] - fillet, fillet, _quarter(fillet, sag))
    if tool.kind in (rigid_shapes.SPHERE, rigid_shapes.CYLINDER):
        return _round(tool.kind, tool.shape[0], size, centre, sag)
    if tool.kind == rigid_shapes.CONE:
        return _cone(tool.shape, size, sag)
    if tool.kind == rigid_shapes.TORUS:
        ring, tube = tool.shape
        angle = np.linspace(2 * np.pi, 0.0, 4 * _quarter(tube, sag) + 1)
        return _turned(ring + tube * np.cos(angle), tube * np.sin(angle), _quarter(ring + tube, sag))
    if tool.kind in (rigid_shapes.EXTRUSION, rigid_shapes.REVOLUTION):
        line = profile_line(tool.shape.reshape(-1, rigid_profiles.PIECE), size, sag)
        if tool.kind == rigid_shapes.REVOLUTION:
            radius, height = line[line[:, 0] >= 0.0].T
            return _turned(radius, height, _quarter(radius.max(), sag))
        y = centre[1] + np.linspace(-size / 2, size / 2, FLAT + 1)
        p, z = (np.repeat(values, len(y)) for values in line.T)
        return np.column_stack([p, np.tile(y, len(line)), z]), _grid(len(line), len(y))
    raise ValueError(f"no surface is known of the rigid shape with code {tool.kind}")


def _round(kind: int, radius: float, size: float, centre: Floats, sag: float) -> Facets:
    """Ball or cylinder; with a radius below zero its hollow."""
    quarter = _quarter(abs(radius), sag)
    if kind == rigid_shapes.SPHERE:
        points, facets = _rounded_box(np.zeros(3), abs(radius), quarter)
    else:
        height = centre[2] + np.linspace(size / 2, -size / 2, FLAT + 1)
        points, facets = _turned(np.full(FLAT + 1, abs(radius)), height, quarter)
    return points, facets if radius > 0.0 else np.ascontiguousarray(facets[:, ::-1])


def _cone(shape: Floats, size: float, sag: float) -> Facets:
    """Cone about -z, of a tip's radius and the cosine and sine of its half-angle."""
    tip, c, s, _ = shape
    around = _quarter(tip + size * s, sag)
    tilt = np.linspace(0.0, np.arctan2(c, s), around + 1 if tip > 0.0 else 1)  # of the tip's normal against the axis
    down = np.linspace(0.0, size, FLAT + 1)[1:]  # along the side
    radius = np.append(tip * np.sin(tilt), tip * c + down * s)
    height = np.append(tip * np.cos(tilt), tip * s - down * c) - tip
    return _turned(radius, height, around)


def profile_line(pieces: Floats, size: float, sag: float) -> Floats:
    """Points (n, 2) of a profile on its way, lines without end as long as `size` beyond their last corner."""
    line = []
    for code, *numbers in pieces:
        place, direction, (extent, radius) = np.array(numbers[:2]), np.array(numbers[2:4]), numbers[4:]
        if code >= rigid_profiles.ARC:
            half, side = np.arccos(extent), 1.0 if code == rigid_profiles.ARC else -1.0
            count = (
                2 * int(np.ceil(2 * _quarter(radius, sag) * half / np.pi)) if radius > 0.0 else 0
            )  # its middle is a point
            turn = side * np.linspace(half, -half, count + 1) if count else np.zeros(1)
            across = np.array([-direction[1], direction[0]])
            line.append(place + radius * (np.cos(turn)[:, None] * direction + np.sin(turn)[:, None] * across))
        else:
            start = -size if code in (rigid_profiles.NO_START, rigid_profiles.NO_ENDS) else 0.0
            end = extent + (size if code >= rigid_profiles.NO_END else 0.0)
            stations = np.linspace(start, end, FLAT + 1)
            if start < 0.0 <= extent:
                stations = np.unique(np.append(stations, 0.0))
            line.append(place + stations[:, None] * direction)
    points = np.concatenate(line)
    if pieces[0, 0] in (rigid_profiles.ARC, rigid_profiles.HOLLOW, rigid_profiles.LINE):  # closed
        points = np.vstack([points, points[:1]])
    new = np.linalg.norm(np.diff(points, axis=0), axis=1) > 1e-9 * np.abs(points).max()
    return points[np.append(True, new)]


def _quarter(radius: float, sag: float) -> int:
    """Facets per quarter of a turn that sink `sag` [length] into a ball of this radius, half of it by either direction."""
    angle = np.sqrt(4.0 * sag / radius) if radius > 0.0 else np.pi
    return int(np.clip(np.ceil(np.pi / 2 / angle), FEWEST, MOST))


def _grid(rows: int, columns: int) -> Ints64:
    """Quadrilaterals (m, 4) between the points of a grid numbered row by row."""
    first = (np.arange(rows - 1)[:, None] * columns + np.arange(columns - 1)).ravel().astype(np.int64)
    return np.column_stack([first, first + columns, first + columns + 1, first + 1])


def _rounded_box(flat: Floats, fillet: float, quarter: int) -> Facets:
    """All points at the distance `fillet` from a box of half sizes flat (3,): a ball where these are zero."""
    sides = []
    for axis in range(3):
        others = [(axis + 1) % 3, (axis + 2) % 3]
        (p, slope_p), (q, slope_q) = (_stations(flat[other], fillet, quarter) for other in others)
        shape = (2, len(p), len(q))
        sign = np.array([1.0, -1.0])[:, None, None]
        inner, outward = np.empty((*shape, 3)), np.empty((*shape, 3))
        for target, values in ((inner, (flat[axis] * sign, p[:, None], q)), (outward, (sign, slope_p[:, None], slope_q))):
            for place, value in zip((axis, *others), values, strict=True):
                target[..., place] = value
        outward /= np.linalg.norm(outward, axis=3, keepdims=True)
        points = inner + fillet * outward
        upper = _grid(len(p), len(q))
        sides += [(points[0].reshape(-1, 3), upper), (points[1].reshape(-1, 3), upper[:, ::-1])]
    return _joined(sides)


def _stations(flat: float, fillet: float, quarter: int) -> tuple[Floats, Floats]:
    """Along one direction of a side: places on the box within, and slopes of the normal, half a quarter turn at each end."""
    bent = np.tan(np.linspace(0.0, np.pi / 4, -(-quarter // 2) + 1))[1:] if fillet > 0.0 else np.empty(0)
    straight = np.linspace(-flat, flat, FLAT + 1) if flat > 0.0 else np.zeros(1)
    places = np.concatenate([np.full(len(bent), -flat), straight, np.full(len(bent), flat)])
    return places, np.concatenate([-bent[::-1], np.zeros(len(straight)), bent])


def _turned(radius: Floats, height: Floats, quarter: int) -> Facets:
    """Surface of revolution about z of a line from top to bottom: radius (n,), height (n,)."""
    angle = np.linspace(0.0, 2 * np.pi, 4 * quarter + 1)
    r = radius[:, None]
    z = np.broadcast_to(height[:, None], (len(radius), len(angle)))
    points = np.stack([r * np.cos(angle), r * np.sin(angle), z], axis=-1)
    facets = _grid(len(radius), len(angle))
    if radius[0] == 0.0:
        at_apex = slice(len(angle) - 1)
        facets[at_apex, 3] = facets[at_apex, 2]  # both upper points are the apex
    if radius[-1] == 0.0:
        at_end = slice(len(facets) - len(angle) + 1, len(facets))
        facets[at_end, 2] = facets[at_end, 3]  # both lower points are the end
    return points.reshape(-1, 3), facets
