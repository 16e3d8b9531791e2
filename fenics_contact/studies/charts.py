"""Charts drawn from a study's rows: error against time with its Pareto front, and maps of where a method fails."""

from statistics import median

import numpy as np
from matplotlib.colors import LogNorm
from matplotlib.figure import Figure

# Okabe & Ito's colours, told apart with any colour vision and in grey with the markers
COLOURS = ("#0072B2", "#D55E00", "#009E73", "#CC79A7", "#E69F00", "#56B4E9", "#000000", "#8C8C00")
MARKERS = "os^Dv<>P"


def medians(rows, parameters):
    """One row per set of parameters: the median of seconds over its repeats, all else from the first."""
    groups = {}
    for row in rows:
        groups.setdefault(tuple(row.get(p, "") for p in parameters), []).append(row)
    return [same[0] | {"seconds": median(_seconds(r) for r in same)} for same in groups.values()]


def _seconds(row):
    return row["seconds"] if isinstance(row.get("seconds"), float | int) else float("nan")


def pareto(points):
    """Indices of the (time, error) pairs that no other one beats in both, by rising time."""
    front, best = [], np.inf
    for i in sorted(range(len(points)), key=lambda i: points[i]):
        if points[i][1] < best:
            front.append(i)
            best = points[i][1]
    return front


def cheapest(rows, tolerance):
    """The fastest converged row with an error of at most `tolerance`, or None."""
    good = [row for row in rows if row["converged"] is True and row["error"] <= tolerance]
    return min(good, key=_seconds, default=None)


def work_precision(path, rows, series, baseline, title="", parameters=()):
    """Draw log error against log time over the time of a baseline; returns the rows on the Pareto front.

    path: picture; rows: of a study; series: function row -> label of its curve; baseline: function row -> bool, true for
    the one row whose time is 1; parameters: the study's, to take medians over repeats.
    """
    rows = [r for r in medians(rows, parameters) if r["converged"] is True and r["error"] > 0.0]
    unit = _seconds(next(r for r in rows if baseline(r)))
    points = [(_seconds(r) / unit, r["error"]) for r in rows]
    figure = Figure(figsize=(7, 5))
    axes = figure.add_subplot()
    labels = list(dict.fromkeys(series(r) for r in rows))
    for number, label in enumerate(labels):
        mine = sorted(p for p, r in zip(points, rows, strict=True) if series(r) == label)
        style = {"color": COLOURS[number % len(COLOURS)], "marker": MARKERS[number % len(MARKERS)]}
        axes.loglog(*np.transpose(mine), markersize=5, linewidth=1.2, **style)
        axes.annotate(label, mine[-1], xytext=(5, 0), textcoords="offset points", color=style["color"], fontsize=8)
    front = pareto(points)
    axes.loglog(*np.transpose([points[i] for i in front]), color="black", linewidth=5, alpha=0.15, zorder=0)
    axes.set_xlabel("time over that of the baseline run")
    axes.set_ylabel("relative error")
    axes.set_title(title, fontsize=10)
    axes.margins(x=0.25)
    axes.grid(which="major", linewidth=0.3)
    figure.savefig(path, dpi=150, bbox_inches="tight")
    return [rows[i] for i in front]


def stability_map(path, rows, x, y, panel=None, title=""):
    """Draw where a method converges, and with how many iterations, over two parameters; a panel per value of a third.

    Failed runs are grey with the t they reached and the first word of their verdict.
    """
    panels = list(dict.fromkeys(row[panel] for row in rows)) if panel else [None]
    columns, lines = (list(dict.fromkeys(row[name] for row in rows)) for name in (x, y))
    figure = Figure(figsize=(1.5 + (1 + 0.75 * len(columns)) * len(panels), 1.6 + 0.5 * len(lines)))
    counts = [row["iterations"] for row in rows if row["converged"] is True]
    norm = LogNorm(min(counts, default=1), max([*counts, 2]))
    for number, value in enumerate(panels):
        axes = figure.add_subplot(1, len(panels), number + 1)
        values = np.full((len(lines), len(columns)), np.nan)
        for row in rows:
            if panel and row[panel] != value:
                continue
            i, j = lines.index(row[y]), columns.index(row[x])
            if row["converged"] is True:
                values[i, j] = row["iterations"]
                cut = f"\n{row['cut_backs']:g} cuts" if row["cut_backs"] else ""
                dark = norm(row["iterations"]) > 0.6
                text, colour = f"{row['iterations']:g}{cut}", "white" if dark else "black"
            else:
                reached = f"{row['t_reached']:.2f}" if isinstance(row["t_reached"], float | int) else "0"
                text, colour = f"× t={reached}\n{' '.join(str(row['verdict']).split()[:2])[:14]}", "black"
            axes.text(j, i, text, ha="center", va="center", fontsize=6, color=colour)
        axes.set_facecolor("lightgrey")
        picture = axes.imshow(values, norm=norm, cmap="cividis_r", origin="lower", aspect="auto")
        axes.set_xticks(range(len(columns)), [_label(c) for c in columns], fontsize=8)
        axes.set_yticks(range(len(lines)), [_label(line) for line in lines] if number == 0 else [], fontsize=8)
        axes.set_xlabel(x.replace("_", " "))
        if number == 0:
            axes.set_ylabel(y.replace("_", " "))
        axes.set_title(_label(value) if panel else title, fontsize=9)
    figure.colorbar(picture, ax=figure.axes, label="Newton iterations (grey: failed)")
    if panel:
        figure.suptitle(title, fontsize=10)
    figure.savefig(path, dpi=150, bbox_inches="tight")


def _label(value):
    return f"{value:g}" if isinstance(value, float | int) and not isinstance(value, bool) else str(value)


def slope(sizes, errors):
    """Observed order: the slope of log error over log size by least squares."""
    return float(np.polyfit(np.log(sizes), np.log(errors), 1)[0])
