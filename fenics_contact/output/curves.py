"""Curves: columns of a history over one another, and a quantity along a line, with names and units of a reader's words."""

from collections.abc import Mapping
from typing import TYPE_CHECKING, Any

import numpy as np

from fenics_contact.assembly.finding import spot, tidied
from fenics_contact.output.late import figures
from fenics_contact.output.pictures import LETTERS, WIDTH
from fenics_contact.types import Array, Floats
from fenics_contact.units import Units

if TYPE_CHECKING:
    from matplotlib.figure import Figure

MARKS = 40  # points of a curve up to which each is marked
ENDS = "osD^v"  # marks of the steps with which stages end, one after the other
AROUND = 0.25  # of the length from the first zone in contact to the last: what is shown beside them


def words(column: str, units: Units) -> tuple[str, str]:
    """A column's name as a reader says it, and its unit, "" where the name has none."""
    L, F, p = units.length, units.force, units.pressure
    known = (L, F, p, "rad", f"{F}{L}", f"{L}2", f"{F}_per_{L}", f"{p}_per_{L}")
    unit = next((u for u in sorted(known, key=len, reverse=True) if column.endswith(f"_{u}")), "")
    name = column.removesuffix(f"_{unit}") if unit else column
    return name.replace("_", " "), unit.replace("_per_", "/").replace(f"{L}2", f"{L}²")


def labelled(name: str, unit: str) -> str:
    return f"{name} [{unit}]" if unit else name


def times(factor: float) -> str:
    """A factor before a name, nothing for one."""
    return {1.0: "", -1.0: "−"}.get(factor, f"{factor:g} × ".replace("-", "−"))


def history_figure(
    table: Mapping[str, Array], units: Units, factors: tuple[float, float], ends: Mapping[str, int]
) -> "Figure":
    """All columns but the first over the first, those of one unit on one pair of axes; table: {column name: (steps,)};
    factors: of x and of all others; ends: {stage: row of its last step}, marked."""
    (x, places), *rest = table.items()
    of_x, of_y = factors
    by_unit: dict[str, list[str]] = {}
    for column, _ in rest:
        by_unit.setdefault(words(column, units)[1], []).append(column)
    figure = figures.Figure(figsize=(WIDTH, 0.6 + 3.0 * len(by_unit)), layout="constrained")
    for axes, (unit, columns) in zip(figure.subplots(len(by_unit), 1, squeeze=False)[:, 0], by_unit.items(), strict=True):
        names = {column: times(of_y) + words(column, units)[0] for column in columns}
        for column, name in names.items():
            axes.plot(of_x * places, of_y * table[column], marker="o" if len(places) <= MARKS else None, markersize=3,
                      linewidth=1.2, label=name)  # fmt: skip
        marks = []
        for i, (stage, row) in enumerate(ends.items()):
            again, kind = divmod(i, len(ENDS))
            look = {"markersize": 7 + 3 * again, "markerfacecolor": "none", "markeredgecolor": "k", "linestyle": "none"}
            marks += axes.plot(of_x * places[row], of_y * table[columns[0]][row], ENDS[kind], label=stage, **look)
        name = names[columns[0]] if len(columns) == 1 else ""
        axes.set_ylabel(labelled(name, unit) if name else f"[{unit}]" if unit else "", fontsize=LETTERS)
        axes.set_xlabel(times(of_x) + labelled(*words(x, units)), fontsize=LETTERS)
        axes.tick_params(labelsize=LETTERS)
        axes.grid(linewidth=0.3)
        curves = axes.legend(handles=axes.lines[: len(columns)], fontsize=LETTERS) if len(columns) > 1 else None
        if marks and axes is figure.axes[0]:  # above, where no curve runs through it
            where = {"loc": "lower left", "bbox_to_anchor": (0.0, 1.01), "borderaxespad": 0.0, "frameon": False}
            style = {"title": "ends of stages", "ncol": min(len(marks), 5), "fontsize": LETTERS, "title_fontsize": LETTERS}
            axes.legend(handles=marks, **where, **style)
            if curves:
                axes.add_artist(curves)
    return figure


def line_figure(table: Mapping[str, Array], ends: Floats, units: Units, whole: bool = False) -> "Figure":
    """Pressure, and the size of friction where there is some, over the way along a line of a contact, `line` of lines.py.

    ends (n, 2): of the zones in contact, drawn as dashed lines [length]; these and what is near them are shown, or the whole
    line. Dotted lines lie between chains, which are no neighbours.
    """
    L, p = units.length, units.pressure
    friction = np.linalg.norm([table[f"friction_{axis}_{p}"] for axis in "xyz"], axis=0)
    rubs = friction.max(initial=0.0) > 0.0
    figure = figures.Figure(figsize=(WIDTH, 3.4), layout="constrained")
    axes, place, chain = figure.subplots(), table[f"arc_{L}"], table["chain"]
    marks = {"marker": "o" if len(place) <= MARKS else None, "markersize": 3}
    for number in np.unique(chain):
        part, words = chain == number, ("pressure", "friction") if number == 0 else ("_", "_")  # named once
        along_line(axes, place[part], table[f"pressure_{p}"][part], words[0], color="C0", **marks)
        if rubs:
            axes.plot(place[part], friction[part], linewidth=1.2, label=words[1], color="C1")
        if number:
            axes.axvline(place[part][0], color="0.4", linewidth=0.8, linestyle=":")
    if rubs:
        axes.legend(fontsize=LETTERS)
    for end in ends.ravel():
        axes.axvline(end, color="0.4", linewidth=0.8, linestyle="--")
    if len(ends) and not whole:
        near = AROUND * float(ends.max() - ends.min())
        axes.set_xlim(max(ends.min() - near, place.min()) - 0.1 * near, min(ends.max() + near, place.max()) + 0.1 * near)
    reference = np.column_stack([table[f"{axis}_reference_{L}"] for axis in "xyz"])
    start = spot(tidied(reference, np.abs(reference).max())[0])
    axes.set_xlabel(labelled(f"way along the line from what was at {start}", L), fontsize=LETTERS)
    axes.set_ylabel(f"[{p}]" if rubs else labelled("pressure", p), fontsize=LETTERS)
    axes.tick_params(labelsize=LETTERS)
    return figure


def along_line(axes: Any, place: Floats, pressure: Floats, label: str | None = None, **line: Any) -> None:
    """A contact quantity (n,) over places (n,) along a line, NaN left out, filled down to zero; into given axes."""
    there = np.isfinite(place) & np.isfinite(pressure)
    order = np.argsort(place[there], kind="stable")
    place, pressure = place[there][order], pressure[there][order]
    (drawn,) = axes.plot(place, pressure, **({"linewidth": 1.2, "label": label} | line))
    axes.fill_between(place, 0.0, pressure, color=drawn.get_color(), alpha=0.12, linewidth=0.0)
    axes.grid(linewidth=0.3)
