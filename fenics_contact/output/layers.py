"""What a picture in space consists of: facets of bodies in their colours, tiles that are seen through, lines."""

from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np

from fenics_contact.output.colours import TOOL, Colours, shade
from fenics_contact.output.skin import DrawnSkin, normals, quarters
from fenics_contact.output.views import Camera
from fenics_contact.types import Array, Floats, Ints64

SEE_THROUGH = 0.14  # opacity of tools, and of bodies that would hide the surface the field lives on
SHARP = np.cos(np.radians(30.0))  # of the angle between a tool's facets from which on their edge is drawn
NEARER = 1e-3  # of the picture's size: how far lines lie before the surfaces they belong to
APART = 4e-3  # of it: what is nearer to a surface before it touches it; penetrations and facets of round surfaces are less
EDGES = np.array([0.0, 0.0, 0.0, 0.45])  # colour of the facets' edges


@dataclass(frozen=True)
class Layer:
    """kind: "solid", "glass", seen through, or "lines"; corners (n, k, 3) of facets with 4 corners or lines with 2
    [length]; colours (n, k, 4) there."""

    kind: str
    corners: Floats
    colours: Floats


def layers(body: DrawnSkin, glass: Sequence[Floats], view: Camera, tint: Colours, size: float) -> list[Layer]:
    """All of a picture in space: of bodies the facets that face the eye, tiles (n, 4, 3) of each thing that is seen through,
    edges of both; size: of the picture [length]."""
    coloured = np.isfinite(body.values).any(axis=1)
    plain, field = body.part(~coloured), body.part(coloured)
    nearer = NEARER * size * view.towards
    found = [
        Layer("solid", plain.x, _one_colour(_shaded(plain, view, tint))),
        Layer("solid", quarters(field.x), _corner_colours(field.values, tint)),
        _lines(_edges(body.x, body.sides)[0] + nearer, EDGES),
    ]
    for tiles in glass:
        normal = normals(tiles)
        # what faces away touches surfaces before it at most, whose colours it leaves alone
        behind = (normal @ view.towards < 0.0)[:, None, None] * (APART * size * view.towards)
        bright = shade(normal @ np.column_stack([view.right, view.up, view.towards]))
        face = np.column_stack([TOOL * bright[:, None], np.full(len(tiles), SEE_THROUGH)])
        found.append(Layer("glass", tiles - behind, _one_colour(face)))
        found.append(_lines(_sharp_edges(tiles) + nearer, np.array([*(0.7 * TOOL), 0.9])))
    return found


def _shaded(body: DrawnSkin, view: Camera, tint: Colours) -> Floats:
    """Colours (n, 4) of facets without a field."""
    bright = shade(normals(body.x) @ np.column_stack([view.right, view.up, view.towards]))
    return tint.of(mean(body.values), bright)


def _one_colour(face: Floats) -> Floats:
    return np.repeat(face[:, None], 4, axis=1)


def _corner_colours(values: Floats, tint: Colours) -> Floats:
    """RGBA (4 n, 4, 4) at the corners of the quarters of facets with values (n, 4); a status is one colour to a quarter."""
    cut = quarters(values)
    cut = np.repeat(cut[:, :1], 4, axis=1) if tint.kind == "status" else cut
    return tint.of(cut.ravel()).reshape(*cut.shape, 4)


def _lines(ends: Floats, colour: Floats) -> Layer:
    return Layer("lines", ends, np.broadcast_to(colour, (*ends.shape[:2], 4)))


def mean(values: Floats) -> Floats:
    """Means (n,) over the corners of (n, 4) that have a value; NaN where none has."""
    there = np.isfinite(values)
    count = there.sum(axis=1)
    return np.where(count > 0, np.where(there, values, 0.0).sum(axis=1) / np.maximum(count, 1), np.nan)


def _edges(tiles: Floats, sides: Sequence[int] = range(4)) -> tuple[Floats, Ints64, Array]:
    """Edges of facets (n, 4, 3), each once: ends (m, 2, 3); of every side of a facet its edge (k,), and its facet (k,).
    sides: those that count, by their first corners."""
    ends = np.stack([tiles, np.roll(tiles, -1, axis=1)], axis=2)[:, sides].reshape(-1, 2, 3)
    there = np.flatnonzero(np.linalg.norm(ends[:, 1] - ends[:, 0], axis=1) > 0.0)
    ends = ends[there]
    size = max(float(np.ptp(ends)) if len(ends) else 1.0, 1e-300)
    spot = np.round(ends.mean(axis=1) / size * 1e6 + 0.123).astype(np.int64)
    _, first, which = np.unique(spot, axis=0, return_index=True, return_inverse=True)
    return ends[first], which.ravel().astype(np.int64), there // len(sides)


def _sharp_edges(tiles: Floats) -> Floats:
    """Ends (n, 2, 3) of the edges at which a surface that is seen through ends or turns sharply."""
    ends, which, facet = _edges(tiles)
    count, total = np.bincount(which, minlength=len(ends)), np.zeros((len(ends), 3))
    np.add.at(total, which, unit(normals(tiles))[facet])
    # of two unit normals with the cosine c the sum is sqrt(2 + 2 c) long
    turns = np.linalg.norm(total, axis=1) < np.sqrt(2 + 2 * SHARP)
    return ends[(count == 1) | ((count == 2) & turns)]


def unit(vectors: Floats) -> Floats:
    return vectors / np.maximum(np.linalg.norm(vectors, axis=1, keepdims=True), 1e-300)
