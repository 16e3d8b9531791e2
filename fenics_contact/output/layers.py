"""What a picture in space consists of: facets of bodies in their colours, tiles that are seen through, sharp edges."""

import numpy as np

from fenics_contact.output.colours import TOOL, Colours, shade
from fenics_contact.output.skin import Skin, normals, quarters
from fenics_contact.output.views import View
from fenics_contact.types import Floats

SEE_THROUGH = 0.14  # opacity of tools, and of bodies that would hide the surface the field lives on
SHARP = np.cos(np.radians(30.0))  # of the angle between a tool's facets from which on their edge is drawn

Layer = tuple[Floats, Floats, Floats, Floats]  # corners (n, 4, 3), colours of faces and edges (n, 4), by which to sort (n,)


def facets(body: Skin, view: View, tint: Colours) -> Layer:
    """Whole facets, each in the colour of its mean."""
    bright = shade(normals(body.x) @ np.column_stack([view.right, view.up, view.towards]))
    face = tint.of(mean(body.values), bright)
    return body.x, face, np.broadcast_to(np.array([0.0, 0.0, 0.0, 0.3]), face.shape), view.depth(body.x).mean(axis=1)


def cut_facets(body: Skin, view: View, tint: Colours) -> Layer:
    """Facets in quarters, each in the colour of its own corner's part; then the facets' edges."""
    values, cut = quarters(body.values), quarters(body.x)
    face = tint.of(values[:, 0] if tint.kind == "status" else mean(values))
    corners, lines = np.concatenate([cut, body.x]), np.zeros((len(body.x), 4))
    edges = np.concatenate([face, np.broadcast_to([0.0, 0.0, 0.0, 0.35], lines.shape)])  # of the same colour: no seams
    return corners, np.concatenate([face, lines]), edges, np.concatenate([view.depth(cut).mean(axis=1), _over(body.x, view)])


def _over(corners: Floats, view: View) -> Floats:
    """Place of lines that lie over the quarters of the facets they bound, the nearest half-way to the nearest corner."""
    depth = view.depth(corners)
    return (
        0.5 * (depth.mean(axis=1) + depth.max(axis=1, initial=-np.inf)) + 1e-3 * np.ptp(depth) if len(depth) else depth[:, 0]
    )


def mean(values: Floats) -> Floats:
    """Means (n,) over the corners of (n, 4) that have a value; NaN where none has."""
    there = np.isfinite(values)
    count = there.sum(axis=1)
    return np.where(count > 0, np.where(there, values, 0.0).sum(axis=1) / np.maximum(count, 1), np.nan)


def seen_through(tiles: Floats, view: View) -> Layer:
    """Facets to be seen through. Those that face away lie behind surfaces they touch, whose colours they leave alone."""
    normal = normals(tiles)
    face = np.column_stack([TOOL * shade(normal @ np.column_stack([view.right, view.up, view.towards]))[:, None],
                            np.full(len(tiles), SEE_THROUGH)])  # fmt: skip
    place = view.depth(tiles).mean(axis=1) - np.where(normal @ view.towards < 0.0, 0.5 * _side(tiles), 0.0)
    return tiles, face, np.zeros_like(face), place


def sharp_edges(tiles: Floats, view: View) -> Layer:
    """Edges at which a surface that is seen through ends or turns sharply, as facets without area, over what they touch."""
    ends = np.stack([tiles, np.roll(tiles, -1, axis=1)], axis=2).reshape(-1, 2, 3)
    normal = np.repeat(unit(normals(tiles)), 4, axis=0)
    there = np.linalg.norm(ends[:, 1] - ends[:, 0], axis=1) > 0.0
    ends, normal = ends[there], normal[there]
    size = max(float(np.ptp(ends)) if len(ends) else 1.0, 1e-300)
    spot = np.round(ends.mean(axis=1) / size * 1e6 + 0.123).astype(np.int64)
    _, first, which, count = np.unique(spot, axis=0, return_index=True, return_inverse=True, return_counts=True)
    total = np.zeros((len(first), 3))
    np.add.at(total, which.ravel(), normal)
    # of two unit normals with the cosine c the sum is sqrt(2 + 2 c) long
    sharp = (count == 1) | ((count == 2) & (np.linalg.norm(total, axis=1) < np.sqrt(2 + 2 * SHARP)))
    chosen = ends[first[sharp]][:, [0, 1, 1, 0]]
    lines = np.tile([*(0.7 * TOOL), 0.9], (len(chosen), 1))
    return chosen, np.zeros((len(chosen), 4)), lines, view.depth(chosen).mean(axis=1) + _side(tiles)


def _side(tiles: Floats) -> float:
    """Side of the largest facet, if it were a square."""
    return float(np.sqrt(np.linalg.norm(normals(tiles), axis=1).max(initial=0.0)))


def unit(vectors: Floats) -> Floats:
    return vectors / np.maximum(np.linalg.norm(vectors, axis=1, keepdims=True), 1e-300)
