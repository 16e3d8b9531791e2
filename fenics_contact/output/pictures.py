"""PNG pictures: the deformed body coloured by a field, and curves."""

from pathlib import Path
from typing import Any

import matplotlib
import numpy as np
from matplotlib.collections import PolyCollection
from matplotlib.figure import Figure
from mpl_toolkits.mplot3d.art3d import Poly3DCollection

from fenics_contact.types import Floats

COLOURS = "viridis"


def draw_body(
    axes: Any,
    corners: Floats,
    values: Floats,
    limits: tuple[float, float] | None = None,
    view: tuple[float, float] = (28, 40),
) -> Any:
    """Draw facets (n, 3 or 4, 3) coloured by their mean value into 3-D axes; returns the colour map for a colour bar."""
    colour = values.mean(axis=1)
    low, high = limits or (colour.min(), colour.max())
    scale = matplotlib.cm.ScalarMappable(matplotlib.colors.Normalize(low, high), COLOURS)
    facets = Poly3DCollection(corners, facecolors=scale.to_rgba(colour), edgecolors=(0, 0, 0, 0.25), linewidths=0.2)
    axes.add_collection3d(facets)
    lowest, highest = corners.min(axis=(0, 1)), corners.max(axis=(0, 1))
    for name, a, b in zip("xyz", lowest, highest, strict=True):
        getattr(axes, f"set_{name}lim")(a, b)
    ends = np.array([lowest[2], highest[2]])
    near_zero = np.abs(ends) < 0.01 * np.ptp(ends)  # a penetration is no height worth a label
    axes.set_zticks(ends, ["0" if zero else f"{z:.3g}" for z, zero in zip(ends, near_zero, strict=True)])
    axes.set_box_aspect(np.maximum(highest - lowest, 1e-12 * np.ptp([lowest, highest])))
    axes.view_init(*view)
    return scale


def draw_slice(axes: Any, corners: Floats, values: Floats, across: str = "z") -> Any:
    """Draw the facets (n, 3 or 4, 3) normal to an axis, coloured by their mean value, into plane axes; returns the colours.

    For plane strain: both ends of the slice lie on top of each other.
    """
    axis = "xyz".index(across)
    flat = np.ptp(corners[..., axis], axis=1) < 1e-9 * np.ptp(corners)
    plane = [i for i in range(3) if i != axis]
    facets = PolyCollection(corners[flat][..., plane], array=values[flat].mean(axis=1), cmap=COLOURS)
    facets.set(edgecolor=(0, 0, 0, 0.25), linewidth=0.2)
    axes.add_collection(facets)
    axes.autoscale()
    axes.set_aspect("equal")
    return facets


def body_picture(
    path: str | Path, corners: Floats, values: Floats, label: str, title: str = "", view: tuple[float, float] = (28, 40)
) -> None:
    """One PNG of a deformed body with a colour bar named `label`."""
    figure = Figure(figsize=(8, 5))  # a constrained layout collapses 3-D axes on Matplotlib 3.6
    axes = figure.add_subplot(projection="3d")
    scale = draw_body(axes, corners, values, view=view)
    figure.colorbar(scale, ax=axes, label=label, shrink=0.7, pad=0.12)
    axes.set_title(title)
    figure.savefig(Path(path), dpi=150, format="png")
