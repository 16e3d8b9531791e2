"""Maps of where a method converges, with how many iterations, and where and how it fails."""

import textwrap
from collections.abc import Callable, Mapping
from pathlib import Path
from typing import TYPE_CHECKING, Any

import numpy as np

from fenics_contact.output.late import colors, figures, patches
from fenics_contact.studies.runner import Row, StudyError

if TYPE_CHECKING:
    from matplotlib.axes import Axes
    from matplotlib.colors import LogNorm
    from matplotlib.patches import Rectangle

# What a failed run's field says, by a part of its verdict; the first that fits
FAILURES = {
    "inside out": "inverted",
    "inverted": "inverted",
    "cycling": "cycling",
    "too stiff": "too stiff",
    "rigid-body": "loose",
    "projection lost": "lost",
    "out of balance": "diverges",
    "linear solver": "singular",
    "passed through": "lost",
    "refused": "refused",
    "no end within": "too long",
    "no convergence": "no conv.",
    "stopped": "crashed",
    "limit": "limit point",
}
WRONG = "#D55E00"
WIDTH, LETTERS, DOTS = 6.3, 9.0, 150  # of charts: inches (16 cm, a page's width), points, dots per inch


def failure(row: Row) -> str:
    """One or two words for how a run failed."""
    verdict = str(row["verdict"])
    return next((words for part, words in FAILURES.items() if part in verdict), " ".join(verdict.split()[:2])[:14])


def noted(row: Row) -> bool:
    """Whether a run converged with notes on its result; tables of before these were kept know of none."""
    return row["converged"] is True and bool(row.get("notes"))


def iterations(row: Row) -> str:
    """The text of a converged run's field."""
    return f"{row['iterations']:g}" + (
        f"\n{row['cut_backs']:g} cut{'s' * (row['cut_backs'] > 1)}" if row["cut_backs"] else ""
    )


def stability_map(
    path: str | Path,
    rows: list[Row],
    x: str,
    y: str,
    *,
    panel: str | None = None,
    title: str = "",
    text: Callable[[Row], str] = iterations,
    wrong: Callable[[Row], bool] = lambda row: False,
    names: Mapping[str, str] | None = None,
) -> None:
    """Draw where a method converges, and with how many iterations, over two parameters; a panel per value of a third.

    Failed runs are hatched, with the t they reached and how they failed; those with notes on their results have a dotted
    frame. text(row): what a converged field says; wrong(row): whether it converged to something wrong, which is framed;
    names: {parameter: axis label with unit}. As wide as a page, panels below one another. StudyError for rows that do not
    know their iterations.
    """
    names = names or {}
    panels = list(dict.fromkeys(row[panel] for row in rows)) if panel else [None]
    columns, lines = (list(dict.fromkeys(row[name] for row in rows)) for name in (x, y))
    figure = figures.Figure(figsize=(WIDTH, 0.9 + (0.75 + 0.42 * len(lines)) * len(panels)), layout="constrained")
    counts = [row.get("iterations", "") for row in rows if row["converged"] is True]
    if not all(isinstance(count, int | float) for count in counts):
        raise StudyError("the rows do not know their iterations: let the case return its Result, or metrics(result, ...)")
    norm = colors.LogNorm(min(counts, default=1), max([*counts, 2]))
    for value, axes in zip(panels, figure.subplots(len(panels), 1, squeeze=False)[:, 0], strict=True):
        mine = [row for row in rows if panel is None or row[panel] == value]
        values = np.full((len(lines), len(columns)), np.nan)
        for row in mine:
            i, j = lines.index(row[y]), columns.index(row[x])
            values[i, j] = row["iterations"] if row["converged"] is True else np.nan
            _field(axes, (i, j), row, norm, text, wrong)
        picture = axes.imshow(values, norm=norm, cmap="cividis_r", origin="lower", aspect="auto")
        axes.set_xticks(range(len(columns)), [short(c) for c in columns])
        axes.set_yticks(range(len(lines)), [short(line) for line in lines])
        axes.set_title(f"{names.get(panel, panel)}: {short(value)}" if panel else "", fontsize=LETTERS)
        axes.set_ylabel(names.get(y, y.replace("_", " ")), fontsize=LETTERS)
        axes.tick_params(labelsize=LETTERS)
    axes.set_xlabel(names.get(x, x.replace("_", " ")), fontsize=LETTERS)
    bar = figure.colorbar(picture, ax=figure.axes, location="bottom", aspect=50, shrink=0.8)
    dotted = ", dotted frame: with notes" if any(map(noted, rows)) else ""
    bar.set_label(f"tangent solves (hatched: failed{dotted})", size=LETTERS)
    even = [m * 10**n for n in range(5) for m in (1, 2, 5) if norm.vmin <= m * 10**n <= norm.vmax]
    ticks = even if len(even) > 1 else [norm.vmin, norm.vmax]
    bar.set_ticks(ticks, labels=[f"{value:g}" for value in ticks])
    bar.ax.minorticks_off()
    bar.ax.tick_params(labelsize=LETTERS)
    figure.suptitle("\n".join(textwrap.wrap(title, 80)), fontsize=LETTERS + 1)
    figure.savefig(path, dpi=DOTS)


def _field(
    axes: "Axes",
    place: tuple[int, int],
    row: Row,
    norm: "LogNorm",
    text: Callable[[Row], str],
    wrong: Callable[[Row], bool],
) -> None:
    i, j = place
    if row["converged"] is True:
        words, colour = text(row), "white" if norm(row["iterations"]) > 0.5 else "black"
        if wrong(row) or noted(row):
            axes.add_patch(_frame(i, j, "-" if wrong(row) else ":"))
    else:
        reached = f"t={row['t_reached']:.2f}" if isinstance(row["t_reached"], float | int) else ""
        words, colour = f"{reached}\n{failure(row)}", "black"
        hatched = {"facecolor": "white", "edgecolor": "0.7", "hatch": "////", "linewidth": 0.0, "zorder": 1}
        axes.add_patch(patches.Rectangle((j - 0.5, i - 0.5), 1.0, 1.0, **hatched))
    behind = {} if row["converged"] is True else {"bbox": {"facecolor": "white", "edgecolor": "none", "pad": 0.5}}
    axes.text(j, i, words, ha="center", va="center", fontsize=8, linespacing=0.95, color=colour, **behind)


def _frame(i: int, j: int, line: str) -> "Rectangle":
    return patches.Rectangle((j - 0.45, i - 0.42), 0.9, 0.84, fill=False, edgecolor=WRONG, linewidth=2, linestyle=line)


def short(value: Any) -> str:
    """A parameter's value as a chart shows it."""
    return f"{value:g}" if isinstance(value, float | int) and not isinstance(value, bool) else str(value)
