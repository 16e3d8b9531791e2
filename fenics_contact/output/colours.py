"""Colours of a picture: of a field by its kind, of bodies and tools without one, and what explains them to the reader."""

from dataclasses import dataclass
from typing import Any

import numpy as np

from fenics_contact.kernels.status import NAMES
from fenics_contact.output.late import cm, colors, matplotlib, patches
from fenics_contact.types import Floats

BODY = np.array([0.86, 0.86, 0.84])  # of bodies where the field is not
TOOL = np.array([0.42, 0.47, 0.53])
# Okabe & Ito's, told apart with any colour vision: open, closed, stick, slip
STATUS = ("#FFFFFF", "#56B4E9", "#0072B2", "#D55E00")
ONE_SIDED = 0.05  # of the larger: below this the smaller side of zero does not take half of the colours
ROUND_OFF = 1e-9  # of the largest value: differences that computing leaves
LIGHT = np.array([0.3, 0.5, 0.8])  # direction to it, in the picture's right, up, towards


@dataclass(frozen=True)
class Colours:
    """Colours of one field: low and high are its limits; kind as in `Look`; blank: it has no value, or zeros alone, and the
    limits stand for none."""

    label: str
    kind: str
    on_contact: bool
    low: float
    high: float
    blank: bool = False

    @property
    def scale(self) -> Any:
        """What gives a value its colour, and a colour bar its own."""
        if self.kind == "status":
            return cm.ScalarMappable(colors.BoundaryNorm(np.arange(-0.5, 4.0), 4), colors.ListedColormap(STATUS))
        if self.kind == "signed":
            name = "RdBu_r" if self.low == -self.high else "viridis"  # the pale middle is zero, or there is none
        else:
            name = "YlOrRd" if self.on_contact else "viridis"  # surfaces without pressure stay pale
        return cm.ScalarMappable(colors.Normalize(self.low, self.high), matplotlib.colormaps[name])

    def of(self, values: Floats, shade: Floats | float = 1.0) -> Floats:
        """RGBA (n, 4) of values (n,); the body's own where a value is NaN, darkened by shade (n,)."""
        there = np.isfinite(values)
        found = np.array(self.scale.to_rgba(np.where(there, values, self.low)))
        found[~there, :3] = BODY * np.broadcast_to(shade, values.shape)[~there, None]
        return found

    def explain(self, axes: Any, size: float, **bar: Any) -> None:
        """A colour bar beside axes, or a list of them, or of statuses a legend; size of its letters [points]."""
        last = axes[-1] if isinstance(axes, list) else axes
        if self.kind == "status":
            marks = [patches.Patch(facecolor=c, edgecolor="0.4", label=name) for c, name in zip(STATUS, NAMES, strict=True)]
            marks.append(patches.Patch(facecolor=BODY, edgecolor="0.4", label="no contact\nstated"))
            last.legend(handles=marks, title=self.label.replace(": ", ":\n"), fontsize=size, title_fontsize=size,
                        loc="center left", bbox_to_anchor=(1.01, 0.5), frameon=False)  # fmt: skip
            return
        found = last.figure.colorbar(
            self.scale, ax=axes, **({"panchor": (0.5, 0.5)} | bar)
        )  # what is drawn stays in the middle
        found.set_label(self.label, size=size)
        found.ax.tick_params(labelsize=size)


def colours(label: str, kind: str, on_contact: bool, values: Floats) -> Colours:
    """Of a field with these values: contact quantities from zero on, signed ones with zero in the middle."""
    finite = values[np.isfinite(values)]
    low, high = (float(finite.min()), float(finite.max())) if finite.size else (0.0, 0.0)
    if kind == "signed" and min(-low, high) > ONE_SIDED * max(-low, high):
        low, high = -max(-low, high), max(-low, high)
    elif on_contact:
        low, high = min(low, 0.0), max(high, 0.0)
    blank = low == high == 0.0
    if not high - low > ROUND_OFF * max(-low, high):  # one value, whatever its last places
        low, high = (low, 1.0) if low == 0.0 else (low - 0.05 * abs(low), low + 0.05 * abs(low))
    return Colours(label, kind, on_contact, low, high, blank)


def shade(normal: Floats) -> Floats:
    """Brightness (n,) of facets without a field; normal (n, 3) in the picture's right, up, towards, of any length."""
    length = np.maximum(np.linalg.norm(normal, axis=1), 1e-300)
    return 0.72 + 0.28 * np.abs(normal @ LIGHT) / (length * np.linalg.norm(LIGHT))
