"""Pictures in space by pyvista, where it is installed and draws without a screen."""

import functools
import importlib.util
import subprocess
import sys
from collections.abc import Sequence
from typing import Any

import numpy as np

from fenics_contact.output.layers import Layer
from fenics_contact.output.views import Camera
from fenics_contact.types import Array, Floats

PEELS = 12  # surfaces seen through one another
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


def rendered(layers: Sequence[Layer], view: Camera, low: Floats, high: Floats, pixels: int) -> Array:
    """Image (rows, columns, 3) of layers between places low, high (2,), `pixels` along its longer side."""
    pyvista: Any = importlib.import_module("pyvista")
    with pyvista.vtk_verbosity("error"):  # without a screen VTK warns that there is none, and draws
        return _rendered(pyvista, layers, view, (low, high), pixels)


def _rendered(pyvista: Any, layers: Sequence[Layer], view: Camera, places: tuple[Floats, Floats], pixels: int) -> Array:
    low, high = places
    size = float(np.max(high - low))
    window = np.maximum(1, np.rint(pixels * (high - low) / size)).astype(int).tolist()
    plotter = pyvista.Plotter(off_screen=True, window_size=window, lighting="none")
    plotter.set_background("white")
    plotter.enable_depth_peeling(PEELS)
    plotter.enable_anti_aliasing("ssaa")
    for layer in layers:
        n, k = layer.corners.shape[:2]
        if n:
            cells = np.column_stack([np.full(n, k), np.arange(n * k).reshape(n, k)]).ravel()
            mesh = pyvista.PolyData(layer.corners.reshape(-1, 3), **{"lines" if layer.kind == "lines" else "faces": cells})
            mesh["colour"] = np.rint(255 * layer.colours.reshape(-1, 4)).astype(np.uint8)
            plotter.add_mesh(mesh, scalars="colour", rgb=True, lighting=False, line_width=LINE)
    _aim(plotter.camera, view, low, high, np.concatenate([layer.corners.reshape(-1, 3) for layer in layers]))
    plotter.renderer.reset_camera_clipping_range()
    image: Array = plotter.screenshot(return_img=True)
    plotter.close()
    return image


def _aim(camera: Any, view: Camera, low: Floats, high: Floats, places: Floats) -> None:
    """So that the image ends at the places low, high (2,) of the picture."""
    middle = 0.5 * (low + high) @ np.stack([view.right, view.up]) + view.depth(places).max() * view.towards
    camera.parallel_projection = True
    camera.focal_point, camera.up = middle, view.up
    camera.position = middle + np.max(high - low) * view.towards
    camera.parallel_scale = 0.5 * (high - low)[1]
