"""Curves of what a sweep's runs gave over one of its parameters, how those ended that failed, and notes of the others."""

import textwrap
from collections.abc import Sequence
from pathlib import Path
from typing import TYPE_CHECKING, Any

import numpy as np

from fenics_contact.output.curves import labelled, words
from fenics_contact.output.late import cm, colors, figures, patches
from fenics_contact.studies.charts import COLOURS, MARKERS, MOST
from fenics_contact.studies.runner import Row, StudyError
from fenics_contact.studies.stability import DOTS, LETTERS, WIDTH, noted, short
from fenics_contact.units import Units

if TYPE_CHECKING:
    from matplotlib.axes import Axes

LISTED = 8  # failed runs named in a picture, and as many with notes
LINE = 92  # letters of a line below the panels
BAND = 0.012  # of the axis: half the width of the band where a run failed, or has notes
FAILED, NOTED = "////", "...."  # hatches of these bands


def curves(
    path: str | Path,
    rows: list[Row],
    x: str,
    outputs: Sequence[str],
    *,
    by: str | None = None,
    title: str = "",
    units: Units | None = None,
) -> list[str]:
    """Draw outputs over the parameter x, a panel each, a curve for each value of `by`; returns how failed runs ended, then
    the notes of the others.

    More than four values of `by` are told apart by a colour scale, or by more panels where they are no numbers. At places
    where a run failed the panel is hatched, and its verdict stands below; where one converged with notes on its result the
    panel is dotted, and their beginnings stand below. units: of the names, by default mm, N, MPa.
    StudyError where rows differ in another parameter too: choose among them before.
    """
    units, values = units or Units(), _values(rows, by)
    _refuse_mixed(rows, x, by, outputs)
    numbers = all(isinstance(value, float | int) and not isinstance(value, bool) for value in values)
    scale = (
        cm.ScalarMappable(colors.Normalize(min(values), max(values)), "viridis") if numbers and len(values) > MOST else None
    )
    groups = [values] if scale else [values[i : i + MOST] for i in range(0, len(values), MOST)]
    parameters = [name for name in (x, by) if name]
    said, doubtful = failures(rows, parameters), doubts(rows, parameters)
    begun = [textwrap.shorten(text, LINE, placeholder=" ...") for text in doubtful]
    listed = _listed(said, "Failed (hatched):") + _listed(begun, "With notes (dotted), in full in the table:")
    foot = [line for text in listed for line in textwrap.wrap(text, LINE, subsequent_indent="    ")]
    panels = [(output, group) for output in outputs for group in groups]
    figure = figures.Figure(figsize=(WIDTH, 0.5 + 2.3 * len(panels) + 0.17 * len(foot)), layout="constrained")
    found = figure.subplots(len(panels), 1, sharex=True, squeeze=False)[:, 0]
    for axes, (output, group) in zip(found, panels, strict=True):
        for i, value in enumerate(group):
            colour, marker = (scale.to_rgba(value), "o") if scale else (COLOURS[i], MARKERS[i])
            mine = [row for row in rows if by is None or row[by] == value]
            name, unit = words(by, units) if by else ("", "")
            label = None if by is None or scale else f"{name} {short(value)} {unit}".rstrip()
            _curve(axes, mine, x, output, color=colour, marker=marker, label=label)
        axes.set_ylabel("\n".join(textwrap.wrap(labelled(*words(output, units)), 24)), fontsize=LETTERS)
        _explain(axes, [row for row in rows if by is None or row[by] in group], x)
    for axes, before in zip(found[1:], found, strict=False):  # what says the same as the one above it is said once
        if (legend := axes.get_legend()) and _names(axes) == _names(before):
            legend.set_visible(False)
    found[-1].set_xlabel(labelled(*words(x, units)), fontsize=LETTERS)
    if scale and by:
        bar = figure.colorbar(scale, ax=list(found), aspect=40)
        bar.set_label(labelled(*words(by, units)), size=LETTERS)
        bar.ax.tick_params(labelsize=LETTERS)
    figure.suptitle("\n".join(textwrap.wrap(title, 80)), fontsize=LETTERS + 1)
    if foot:
        figure.supxlabel("\n".join(foot), fontsize=LETTERS, x=0.02, ha="left")
    figure.savefig(path, dpi=DOTS)
    return said + doubtful


def failures(rows: list[Row], parameters: Sequence[str]) -> list[str]:
    """A sentence for each run that failed: its parameters, its verdict, the t it reached."""
    said = []
    for row in rows:
        if row["converged"] is not True:
            reached = f" at t = {row['t_reached']:.3g}" if isinstance(row.get("t_reached"), float | int) else ""
            said.append(f"{_place(row, parameters)}: {row['verdict']}{reached}")
    return list(dict.fromkeys(said))


def doubts(rows: list[Row], parameters: Sequence[str]) -> list[str]:
    """A sentence for each run that converged with notes on its result: its parameters, and these."""
    said = [f"{_place(row, parameters)}: {row['notes']}" for row in rows if noted(row)]
    return list(dict.fromkeys(said))


def _place(row: Row, parameters: Sequence[str]) -> str:
    return ", ".join(f"{name} {short(row[name])}" for name in parameters)


def _listed(said: list[str], title: str) -> list[str]:
    more = [f"and {len(said) - LISTED} more, in the table"] if len(said) > LISTED else []
    return [title, *said[:LISTED], *more] if said else []


def _values(rows: list[Row], by: str | None) -> list[Any]:
    return list(dict.fromkeys(row[by] for row in rows)) if by else [None]


def _refuse_mixed(rows: list[Row], x: str, by: str | None, outputs: Sequence[str]) -> None:
    if not rows:
        raise StudyError("there are no rows to draw")
    for name in (x, *([by] if by else []), *outputs):
        if name not in rows[0]:
            raise StudyError(f"the rows have no column '{name}'; they have {', '.join(rows[0])}")
    if not all(isinstance(row[x], float | int) for row in rows):
        raise StudyError(f"'{x}' is not a number in all rows: draw over one that is, and give this one as by=")
    parameters = list(rows[0])[: list(rows[0]).index("repeat")]
    for name in parameters:
        if name not in (x, by) and len({row[name] for row in rows}) > 1:
            raise StudyError(
                f"the rows differ in '{name}' too: choose among them, [row for row in rows if row['{name}'] == ...]"
            )


def _curve(axes: "Axes", rows: list[Row], x: str, output: str, **line: Any) -> None:
    """An output over x, interrupted where a run failed or gave none."""
    places = sorted(dict.fromkeys(row[x] for row in rows))
    good = {row[x]: row[output] for row in rows if row["converged"] is True}
    heights = [y if isinstance(y := good.get(place), float | int) else np.nan for place in places]
    axes.plot(places, heights, markersize=4, linewidth=1.2, **line)


def _names(axes: "Axes") -> list[str]:
    """What the legend of a panel says."""
    legend = axes.get_legend()
    return [text.get_text() for text in legend.get_texts()] if legend else []


def _explain(axes: "Axes", rows: list[Row], x: str) -> None:
    """Names of the curves, and bands where runs failed, or have notes."""
    axes.tick_params(labelsize=LETTERS, labelbottom=True)
    axes.grid(linewidth=0.3)
    failed = [row[x] for row in rows if row["converged"] is not True]
    doubtful = [row[x] for row in rows if noted(row) and row[x] not in failed]
    handles, labels = axes.get_legend_handles_labels()
    wide = float(np.ptp([row[x] for row in rows]))  # of all panels, where one's own curves may end before a failure
    half = BAND * (wide or float(np.ptp(axes.get_xlim())))
    for places, hatch, name in ((failed, FAILED, "failed"), (doubtful, NOTED, "with notes")):
        how: dict[str, Any] = {"facecolor": "white", "edgecolor": "0.6", "hatch": hatch}
        for place in dict.fromkeys(places):
            axes.axvspan(place - half, place + half, linewidth=0.0, zorder=0, **how)
        if places:
            handles.append(patches.Patch(**how))
            labels.append(name)
    if handles:
        axes.legend(handles, labels, fontsize=LETTERS, loc="center left", bbox_to_anchor=(1.01, 0.5), frameon=False)
