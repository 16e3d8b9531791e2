"""Pictures in space without pyvista: the same layers, painted pixel by pixel."""

from collections.abc import Sequence

import numpy as np

from fenics_contact.kernels.pixels import averaged, draw, paint
from fenics_contact.output.layers import Layer
from fenics_contact.output.views import Camera
from fenics_contact.types import Array, Floats

SMOOTH = 2  # pixels across one of the image: edges are smooth
LINE = 1.5  # width of lines [pixels of the image]


def rasterised(layers: Sequence[Layer], view: Camera, low: Floats, high: Floats, pixels: int) -> Array:
    """Image (rows, columns, 3) of layers between places low, high (2,), `pixels` along its longer side."""
    scale = pixels / float(np.max(high - low))
    columns, rows = np.maximum(1, np.rint(scale * (high - low))).astype(int)
    image = np.ones((SMOOTH * rows, SMOOTH * columns, 3), dtype=np.float32)
    depth = np.full(image.shape[:2], -np.inf, dtype=np.float32)

    def seen(corners: Floats) -> Floats:
        """(column, row, depth) in pixels, rows from the top."""
        across, up = np.moveaxis(view.flat(corners) - [low[0], high[1]], -1, 0)
        return SMOOTH * scale * np.stack([across, -up, view.depth(corners)], axis=-1)

    for kind in ("solid", "glass", "lines"):  # lines lie over what is seen through, and hide nothing
        parts = [(seen(layer.corners), layer.colours) for layer in layers if layer.kind == kind and len(layer.corners)]
        if not parts:
            continue
        if kind == "lines":
            for corners, colours in parts:
                draw(image, depth, corners, np.ascontiguousarray(colours[:, 0]), 0.5 * SMOOTH * LINE)
            continue
        corners, colours = (np.concatenate(column) for column in zip(*parts, strict=True))
        order = np.argsort(corners[..., 2].mean(axis=1), kind="stable")
        for half in ([0, 1, 2], [0, 2, 3]):
            paint(image, depth, corners[order][:, half], colours[order][:, half], kind == "glass")
    return averaged(image, SMOOTH)
