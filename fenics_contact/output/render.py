"""Pictures in space by pyvista, where it is installed and draws without a screen: each pixel shows what is nearest to it."""

import functools
import importlib.util
import subprocess
import sys
from collections.abc import Sequence
from typing import Any

import numpy as np

from fenics_contact.output.colours import Colours
from fenics_contact.output.layers import facets, seen_through, sharp_edges
from fenics_contact.output.skin import Skin, normals, quarters
from fenics_contact.output.views import View
from fenics_contact.types import Array, Floats

PIXELS = 1600  # along the longer side of an image: 300 to the inch at a page's width
PEELS = 12  # surfaces seen through one another
NEARER = 1e-3  # of the picture's size: how far lines lie before the surfaces they belong to
EDGES = np.array([0.0, 0.0, 0.0, 0.35])  # colour of the facets' edges
LINE = 3.0  # width of lines [pixels], half of it after smoothing
TRIAL = """
import pyvista
plotter = pyvista.Plotter(off_screen=True, window_size=[32, 32])
plotter.add_mesh(pyvista.Plane(), color="black")
assert plotter.screenshot(return_img=True).std() > 0.0
"""
SECONDS = 60.0  # for the trial, which takes one or two


@functools.cache
def pyvista_works() -> bool:
    """Whether pyvista draws here. Tried once, in a process of its own: without a display some builds of VTK abort theirs."""
    if importlib.util.find_spec("pyvista") is None:
        return False
    try:
        return subprocess.run([sys.executable, "-c", TRIAL], capture_output=True, timeout=SECONDS).returncode == 0
    except subprocess.TimeoutExpired:
        return False


def rendered(body: Skin, glass: Sequence[Floats], view: View, tint: Colours, low: Floats, high: Floats) -> Array:
    """Image (rows, columns, 3) of facets, and of tiles (n, 4, 3) that are seen through, between places low, high (2,)."""
    pyvista: Any = importlib.import_module("pyvista")
    size = float(np.max(high - low))
    window = np.maximum(1, np.rint(PIXELS * (high - low) / size)).astype(int).tolist()
    plotter = pyvista.Plotter(off_screen=True, window_size=window, lighting="none")
    plotter.set_background("white")
    plotter.enable_depth_peeling(PEELS)
    plotter.enable_anti_aliasing("ssaa")
    nearer = NEARER * size * view.towards

    def add(corners: Floats, colours: Floats, lines: bool = False) -> None:
        """Facets (n, k, 3), or lines through them, in the colours (n, k, 4) of their corners."""
        n, k = corners.shape[:2]
        if n:
            cells = np.column_stack([np.full(n, k), np.arange(n * k).reshape(n, k)]).ravel()
            mesh = pyvista.PolyData(corners.reshape(-1, 3), **{"lines" if lines else "faces": cells})
            mesh["colour"] = np.rint(255 * np.broadcast_to(colours, (n, k, 4)).reshape(-1, 4)).astype(np.uint8)
            plotter.add_mesh(mesh, scalars="colour", rgb=True, lighting=False, line_width=LINE)

    coloured = np.isfinite(body.values).any(axis=1)
    plain, field = body.part(~coloured), body.part(coloured)
    add(plain.x, facets(plain, view, tint)[1][:, None])
    add(quarters(field.x), _corner_colours(field.values, tint))
    add(body.x[:, [0, 1, 2, 3, 0]] + nearer, EDGES, lines=True)
    for tiles in glass:
        # what faces away touches surfaces before it at most, whose colours it leaves alone
        behind = (normals(tiles) @ view.towards < 0.0)[:, None, None] * nearer
        add(tiles - behind, seen_through(tiles, view)[1][:, None])
        ends, _, colour, _ = sharp_edges(tiles, view)
        add(ends[:, :2] + nearer, colour[:, None], lines=True)
    _aim(plotter.camera, view, low, high, body.x)
    plotter.renderer.reset_camera_clipping_range()
    image: Array = plotter.screenshot(return_img=True)
    plotter.close()
    return image


def _corner_colours(values: Floats, tint: Colours) -> Floats:
    """RGBA (4 n, 4, 4) at the corners of the quarters of facets with values (n, 4); a status is one colour to a quarter."""
    cut = quarters(values)
    cut = np.repeat(cut[:, :1], 4, axis=1) if tint.kind == "status" else cut
    return tint.of(cut.ravel()).reshape(*cut.shape, 4)


def _aim(camera: Any, view: View, low: Floats, high: Floats, places: Floats) -> None:
    """So that the image ends at the places low, high (2,) of the picture."""
    middle = 0.5 * (low + high) @ np.stack([view.right, view.up]) + view.depth(places).max() * view.towards
    camera.parallel_projection = True
    camera.focal_point, camera.up = middle, view.up
    camera.position = middle + np.max(high - low) * view.towards
    camera.parallel_scale = 0.5 * (high - low)[1]
