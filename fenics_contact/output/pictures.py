"""Pictures of a model: deformed bodies coloured by a field, tools around them, a slice in its plane, all else in space."""

from dataclasses import dataclass, replace
from pathlib import Path
from typing import TYPE_CHECKING, Any

import numpy as np

from fenics_contact.output.colours import TOOL, Colours
from fenics_contact.output.late import agg, collections, figures, patches, paths
from fenics_contact.output.layers import layers, mean, unit
from fenics_contact.output.raster import rasterised
from fenics_contact.output.render import pyvista_works, rendered
from fenics_contact.output.skin import AXES, FLAT, DrawnSkin, normals, quarters
from fenics_contact.output.views import Camera, slice_axis
from fenics_contact.types import Array, Bools, Floats
from fenics_contact.values import SceneError

if TYPE_CHECKING:
    from matplotlib.figure import Figure

WIDTH, LETTERS = 6.3, 9.0  # inches (16 cm, a page's width), points
TALLEST, FLATTEST = 5.0, 1.3  # inches, of what is drawn
BAND = 0.02  # of the picture's size: thickness of a tool's wall in a slice
STRIPE = 0.008  # of the picture's size: thickness of the band of a contact field in a slice
SPIKE = 0.05  # of the picture's size: height of the largest value drawn off a slave surface
DEEPEST = 0.4  # of the bodies' thickness: that height at most
PIECES = 6  # of a line of a slice's slave surface: each has one colour
UNSEEN, MANY = 1 / 64, 20_000  # of the colours: no more within a tile of a slice's side; tiles that are cut no further
DOTS = 200  # per inch of what is saved
LONGEST = 5.3  # inches, of an image in space as it is laid out

Box = tuple[Floats, Floats]  # least and largest places (2,)
Neighbourhood = tuple[Floats, Floats]  # least and largest places (3,)


@dataclass(frozen=True)
class Drawing:
    """A model at one state, ready to draw on any axes.

    body: facets with the field; tools: tiles (n, 4, 3) of each [length]; hidden (bodies,): seen through, for the field is
    behind them; length: the unit's name; box: in which tools are drawn; backend: "matplotlib" or "pyvista", which draws in
    space alone, None: the latter where it works; dots: to the inch of an image in space.
    """

    body: DrawnSkin
    tools: list[Floats]
    view: Camera
    colours: Colours
    hidden: Bools
    title: str
    length: str
    box: Neighbourhood
    backend: str | None = None
    dots: int = 300

    @property
    def is_slice(self) -> bool:
        return self.view.axis is not None and slice_axis(self.body) == self.view.axis

    def stopped_early(self) -> "Drawing":
        """The drawing with a title that says so of its run."""
        return replace(self, title=f"{self.title}, the run stopped early")

    def draw(self, axes: Any, limits: tuple[float, float] | None = None, extent: Box | None = None) -> Colours:
        """Draw into plane axes; limits: of the colours, extent: of the places shown. Returns what explains the colours."""
        tint = self.colours
        if limits is not None:
            tint = Colours(tint.label, tint.kind, tint.on_contact, *limits)
        low, high = extent or self.extent()
        if self.is_slice:
            _paint_slice(axes, self, tint, float(np.max(high - low)))
            first, second = (i for i in range(3) if i != self.view.axis)
            axes.set_xlabel(f"{AXES[first]} [{self.length}]")
            axes.set_ylabel(f"{AXES[second]} [{self.length}]")
        else:
            _paint_space(axes, self, tint, low, high)
            axes.set_axis_off()
            low = low - [0.0, _triad(axes, self.view, low, high, self.length)]
        axes.set_xlim(low[0], high[0]), axes.set_ylim(low[1], high[1])
        axes.set_aspect("equal")
        return tint

    def extent(self) -> Box:
        """Least and largest places (2,) of all that is drawn, with a margin."""
        points = [self.body.x, *(self.tools if not self.is_slice else [_section(t, self)[0] for t in self.tools])]
        flat = np.concatenate([self.view.flat(p.reshape(-1, 3)) for p in points])
        low, high = flat.min(axis=0), flat.max(axis=0)
        banded = self.is_slice and self.colours.on_contact and self.colours.kind == "amount"
        margin = (0.02 + (SPIKE if banded else 0.0)) * float(np.max(high - low))
        return low - margin, high + margin

    def figure(
        self, limits: tuple[float, float] | None = None, title: str | None = None, extent: Box | None = None
    ) -> "Figure":
        """A figure of its own, as wide as a page; limits, extent as for `draw`."""
        across, tall = np.subtract(*reversed(extent or self.extent()))
        ticks, below = 0.7 if self.is_slice else 0.0, self._bar_below(across, tall)
        room = WIDTH - ticks - (0.1 if below else 1.3 if self.colours.kind != "status" else 1.5)  # bar or legend beside it
        height = max(min(room * tall / across, TALLEST), FLATTEST)
        width = min(room, max(height * across / tall, 0.45 * WIDTH)) + WIDTH - room
        figure = figures.Figure(figsize=(width, height + 0.5 + 0.6 * ticks + (0.9 if below else 0.0)), layout="compressed")
        self.fill(figure, limits, title, extent)
        return figure

    def fill(
        self,
        figure: "Figure",
        limits: tuple[float, float] | None = None,
        title: str | None = None,
        extent: Box | None = None,
    ) -> None:
        """Draw into a figure in place of what it holds."""
        below = self._bar_below(*np.subtract(*reversed(extent or self.extent())))
        figure.clear()
        axes = figure.add_subplot()
        bar: dict[str, Any] = {"location": "bottom", "shrink": 0.7, "aspect": 35} if below else {"shrink": 0.9, "aspect": 22}
        self.draw(axes, limits, extent).explain(axes, LETTERS, **bar)
        axes.set_title(self.title if title is None else title, fontsize=LETTERS + 1)
        axes.tick_params(labelsize=LETTERS)
        axes.xaxis.label.set_size(LETTERS), axes.yaxis.label.set_size(LETTERS)

    def _bar_below(self, across: float, tall: float) -> bool:
        return bool(across > 2.2 * tall) and self.colours.kind != "status"


def picture_format(path: str | Path) -> str:
    """What a path's ending says; SceneError where that is no kind of picture."""
    ending, known = Path(path).suffix[1:].lower(), figures.Figure().canvas.get_supported_filetypes()
    if ending not in known:
        wrong = f"ends in '.{ending}'" if ending else "has no ending"
        raise SceneError(f"picture '{path}' {wrong}; give it one of .png, .pdf, .svg ({', '.join(sorted(known))})")
    return ending


def save(figure: "Figure", path: str | Path, kind: str = "png") -> None:
    """The figure as a file of a kind, whatever the path's ending."""
    if kind != "png":
        figure.savefig(path, dpi=DOTS, format=kind)
        return
    dpi = figure.dpi
    figure.dpi = DOTS
    agg.FigureCanvasAgg(figure).print_png(path)  # savefig would draw all of it once more, for its layout alone
    figure.dpi = dpi


# -- in space -------------------------------------------------------------------------------------------------------------
def _paint_space(axes: Any, drawing: Drawing, tint: Colours, low: Floats, high: Floats) -> None:
    """An image of the places from low to high (2,): of bodies that are not seen through the facets that face the eye, and
    what is seen through."""
    view, hidden = drawing.view, drawing.hidden[drawing.body.body]
    body = drawing.body.part(~hidden & (normals(drawing.body.x) @ view.towards > 0.0))
    parts = layers(body, [*drawing.tools, drawing.body.part(hidden).x], view, tint, float(np.max(high - low)))
    by_pyvista = drawing.backend == "pyvista" or (drawing.backend is None and pyvista_works())
    image = (rendered if by_pyvista else rasterised)(parts, view, low, high, round(LONGEST * drawing.dots))
    axes.imshow(image, extent=np.column_stack([low, high]).ravel())


def _triad(axes: Any, view: Camera, low: Floats, high: Floats, unit: str) -> float:
    """The axes' directions in the lower left corner, their arms a round number of lengths long; returns the room below."""
    span = float(np.max(high - low))
    exponent = np.floor(np.log10(0.12 * span))
    length = float(max(m * 10**exponent for m in (1, 2, 5) if m * 10**exponent <= 0.12 * span))
    arms = length * np.column_stack([view.right, view.up])
    foot = low + [0.03 * span - min(0.0, arms[:, 0].min()), -1.5 * max(0.0, arms[:, 1].max())]
    lines = np.stack([np.broadcast_to(foot, arms.shape), foot + arms], axis=1)
    axes.add_collection(collections.LineCollection(lines, colors="0.2", linewidths=1.0))
    seen = np.linalg.norm(arms, axis=1) > 0.2 * length
    for letter, arm in zip(np.array(list(AXES))[seen], arms[seen], strict=True):
        tip = foot + 1.3 * arm
        axes.text(*tip, letter, fontsize=LETTERS, ha="center", va="center", color="0.2")
    reach = foot[0] + max(0.0, 1.5 * arms[:, 0].max())
    axes.text(reach + 0.02 * span, foot[1], f"arms: {length:g} {unit}", fontsize=LETTERS, va="center", color="0.2")
    return float(low[1] - foot[1] - 1.4 * min(0.0, arms[:, 1].min()) + 0.03 * span)


# -- slices ---------------------------------------------------------------------------------------------------------------
def _paint_slice(axes: Any, drawing: Drawing, tint: Colours, size: float) -> None:
    """The side of a slice that faces the eye, its colours going over from corner to corner, its surfaces as lines, walls."""
    body, view = drawing.body, drawing.view
    near = view.depth(body.X) >= view.depth(body.X).max() - FLAT * np.ptp(body.X)
    side = body.part(near.all(axis=1))
    wall = body.part(~near.all(axis=1))
    whole, tiles, values = view.flat(side.x), view.flat(side.x), side.values
    while len(tiles) < MANY and np.ptp(values, axis=1).max(initial=0.0) > UNSEEN * (tint.high - tint.low):
        tiles, values = quarters(tiles), quarters(values)
    face = tint.of(mean(values))
    axes.add_collection(collections.PolyCollection(tiles, facecolors=face, edgecolors=face, linewidths=0.2))
    around = whole[:, [3, 0, 1] if side.cut else [3, 0, 1, 2, 3]]
    axes.add_collection(collections.LineCollection(around, colors=(0, 0, 0, 0.22), linewidths=0.25))
    for tiles in drawing.tools:
        ends, normal = _section(tiles, drawing)
        flat, out = view.flat(ends), view.flat(normal)
        inner = flat - BAND * size * _normals_at_ends(flat, out)
        _fill(axes, np.concatenate([flat, inner[:, ::-1]], axis=1), (*TOOL, 0.6))
        axes.add_collection(collections.LineCollection(flat, colors=[0.6 * TOOL], linewidths=1.2, capstyle="round"))
    ends, values, normal = _surface_lines(wall, near[~near.all(axis=1)])
    flat = view.flat(ends)
    axes.add_collection(collections.LineCollection(flat, colors="0.15", linewidths=0.6, capstyle="round"))
    if tint.on_contact:
        there = np.isfinite(values).all(axis=1)
        out = _normals_at_ends(flat[there], view.flat(normal[there]))
        thin = float(np.ptp(view.flat(side.x.reshape(-1, 3)), axis=0).min())
        _paint_surface(axes, flat[there], values[there], out, tint, (STRIPE * size, min(SPIKE * size, DEEPEST * thin)))


def _paint_surface(
    axes: Any, ends: Floats, values: Floats, out: Floats, tint: Colours, heights: tuple[float, float]
) -> None:
    """A contact field on lines (n, 2, 2) with normals there: a band inside the body in its colours, of amounts as high as
    the value; heights: the least, that there is a field shows without a value too, and that of the largest value."""
    least, highest = heights
    if tint.kind == "status":  # half a line has the status of its end
        ends, out = _halves(ends), _halves(out)
        values = np.repeat(np.concatenate([values[:, 0], values[:, 1]])[:, None], 2, axis=1)
    else:  # the colour follows the value between the nodes
        ends, out, values = (_pieces(part) for part in (ends, out, values))
    if not len(ends):
        return
    face = tint.of(values.mean(axis=1))
    height = np.full(values.shape, least)
    if tint.kind == "amount":
        height = np.maximum(highest * np.clip(values / tint.high, 0.0, 1.0), least)
    band = np.concatenate([ends, (ends - height[..., None] * out)[:, ::-1]], axis=1)
    axes.add_collection(collections.PolyCollection(band, facecolors=face, edgecolors=face, linewidths=0.3, zorder=3))
    axes.add_collection(collections.LineCollection(band[:, 2:], colors="0.15", linewidths=0.5, zorder=3))
    axes.add_collection(collections.LineCollection(ends, colors="0.15", linewidths=0.6, capstyle="round", zorder=4))


def _halves(ends: Floats) -> Floats:
    """Lines (n, 2, 2) cut in the middle (2 n, 2, 2): all first halves, then all second ones."""
    middle = ends.mean(axis=1, keepdims=True)
    return np.concatenate([np.concatenate([ends[:, :1], middle], axis=1), np.concatenate([middle, ends[:, 1:]], axis=1)])


def _pieces(ends: Floats) -> Floats:
    """What lines have at their ends (n, 2, ...), at the ends of PIECES parts of each (PIECES n, 2, ...)."""
    at = [(1.0 - s) * ends[:, 0] + s * ends[:, 1] for s in np.linspace(0.0, 1.0, PIECES + 1)]
    return np.concatenate([np.stack([at[i], at[i + 1]], axis=1) for i in range(PIECES)])


def _normals_at_ends(ends: Floats, normal: Floats) -> Floats:
    """Unit normals (n, 2, 2) at the ends of lines (n, 2, 2): means of the lines (n, 2) that meet there."""
    spot = np.round(ends.reshape(-1, 2) / max(float(np.ptp(ends)) if len(ends) else 1.0, 1e-300) * 1e6 + 0.123)
    _, which = np.unique(spot, axis=0, return_inverse=True)
    total = np.zeros((len(spot), 2))
    np.add.at(total, which.ravel(), np.repeat(unit(normal), 2, axis=0))
    return unit(total[which.ravel()]).reshape(ends.shape)


def _surface_lines(wall: DrawnSkin, near: Bools) -> tuple[Floats, Floats, Floats]:
    """Edges in a slice's near plane of the facets across it: ends (n, 2, 3), values there (n, 2), facets' normals (n, 3)."""
    following = np.roll(wall.X, -1, axis=1)
    edge = near & np.roll(near, -1, axis=1) & (np.linalg.norm(following - wall.X, axis=2) > 0.0)
    there = edge.any(axis=1)
    i = np.argmax(edge[there], axis=1)
    rows, pair = np.flatnonzero(there)[:, None], np.column_stack([i, (i + 1) % 4])
    return wall.x[rows, pair], wall.values[rows, pair], normals(wall.x[there])


def _section(tiles: Floats, drawing: Drawing) -> tuple[Floats, Floats]:
    """Where a tool meets the middle plane of a slice: ends (n, 2, 3) of lines, unit normals (n, 3) in the plane."""
    view = drawing.view
    depth = view.depth(drawing.body.X)
    place = 0.5 * (depth.min() + depth.max()) + 1e-4 * np.ptp(depth)  # off the corners of a tool that has the same middle
    triangles = np.concatenate([tiles[:, [0, 1, 2]], tiles[:, [0, 2, 3]]])
    above = view.depth(triangles) > place
    triangles = triangles[above.any(axis=1) & ~above.all(axis=1)]
    height = view.depth(triangles) - place
    crossed = (height > 0.0) != (np.roll(height, -1, axis=1) > 0.0)  # two edges of each
    first, second = np.argmax(crossed, axis=1), 2 - np.argmax(crossed[:, ::-1], axis=1)
    ends = np.stack([_crossing(triangles, height, edge) for edge in (first, second)], axis=1)
    normal = np.cross(triangles[:, 1] - triangles[:, 0], triangles[:, 2] - triangles[:, 0])
    return ends, unit(normal - np.outer(normal @ view.towards, view.towards))


def _crossing(triangles: Floats, height: Floats, edge: Array) -> Floats:
    """Point (n, 3) of height zero on the edge number (n,) of each triangle."""
    rows, after = np.arange(len(edge)), (edge + 1) % 3
    share = height[rows, edge] / np.where(height[rows, edge] == height[rows, after], 1.0,
                                          height[rows, edge] - height[rows, after])  # fmt: skip
    start, end = triangles[rows, edge], triangles[rows, after]
    return start + share[:, None] * (end - start)


def _fill(axes: Any, polygons: Floats, colour: tuple[float, ...]) -> None:
    """Polygons (n, k, 2) in one transparent colour, once where they overlap."""
    if not len(polygons):
        return
    (x, y), (p, q) = (polygons[:, i].T - polygons[:, 0].T for i in (1, 2))
    turn = x * q - y * p < 0.0  # all run the same way round, or overlaps would cancel
    polygons = np.where(turn[:, None, None], polygons[:, ::-1], polygons)
    count, k, _ = polygons.shape
    codes = np.full((count, k + 1), paths.Path.LINETO)
    codes[:, 0], codes[:, -1] = paths.Path.MOVETO, paths.Path.CLOSEPOLY
    vertices = np.concatenate([polygons, polygons[:, :1]], axis=1).reshape(-1, 2)
    axes.add_patch(patches.PathPatch(paths.Path(vertices, codes.ravel()), facecolor=colour, edgecolor="none", zorder=1))
