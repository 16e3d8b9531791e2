"""Charts drawn from a study's rows: error against time with its Pareto front, and what economies buy."""

import textwrap
from collections.abc import Mapping, Sequence
from pathlib import Path
from statistics import median
from typing import TYPE_CHECKING, Any

import numpy as np

from fenics_contact.output.late import figures, tickers
from fenics_contact.studies.runner import Panels, Row, Run, StudyError, Values, of_curve
from fenics_contact.studies.stability import DOTS, LETTERS, WIDTH, short

if TYPE_CHECKING:
    from matplotlib.axes import Axes

# Okabe & Ito's colours, told apart with any colour vision and in grey with the markers
COLOURS = ("#0072B2", "#D55E00", "#009E73", "#CC79A7", "#E69F00", "#56B4E9", "#000000", "#8C8C00")
MARKERS = "os^Dv<>P"
MOST = 4  # curves to a panel, and labels beside it
AIMS = (0.01, 0.001)  # relative errors a user may want

End = tuple[str, tuple[float, float] | None, str]  # of a curve: its label, its last point if it has one, its colour


def medians(rows: list[Row], parameters: Sequence[str]) -> list[Row]:
    """One row per set of parameters: the median of seconds over its repeats, all else from the first."""
    groups: dict[tuple[Any, ...], list[Row]] = {}
    for row in rows:
        groups.setdefault(tuple(row.get(p, "") for p in parameters), []).append(row)
    return [same[0] | {"seconds": median(_seconds(r) for r in same), "busy": 1.0} for same in groups.values()]


def _seconds(row: Row) -> float:
    """Seconds on the processor, which other users of the machine disturb less than wall time; NaN where unknown."""
    busy = row.get("busy")
    share = min(1.0, busy) if isinstance(busy, float | int) else 1.0
    return row["seconds"] * share if isinstance(row.get("seconds"), float | int) else float("nan")


def pareto(points: Sequence[tuple[float, float]]) -> list[int]:
    """Indices of the (time, error) pairs that no other one beats in both, by rising time."""
    front, best = [], np.inf
    for i in sorted(range(len(points)), key=lambda i: points[i]):
        if points[i][1] < best:
            front.append(i)
            best = points[i][1]
    return front


def cheapest(rows: list[Row], tolerance: float) -> Row | None:
    """The fastest converged row with an error of at most `tolerance`, or None."""
    good = [row for row in rows if row["converged"] is True and row["error"] <= tolerance]
    return min(good, key=_seconds, default=None)


def lasting(rows: list[Row], base: Run, panels: Panels, tolerance: float) -> list[Row]:
    """The rows from which on every curve that holds them stays within `tolerance`: not those where errors just cancel."""
    curves = [of_curve(rows, base, values) for panel in panels.values() for values in panel.values()]
    lost = [
        row
        for curve in curves
        for i, row in enumerate(curve)
        if not all(r["converged"] is True and r["error"] <= tolerance for r in curve[i:])
    ]
    return [row for row in rows if not any(row is other for other in lost)]


def slope(sizes: Sequence[float], errors: Sequence[float]) -> float:
    """Observed order: the slope of log error over log size by least squares."""
    return float(np.polyfit(np.log(sizes), np.log(errors), 1)[0])


def hold_slope(what: str, sizes: Sequence[float], errors: Sequence[float], expected: float, within: float) -> str:
    """A sentence with the observed order; StudyError where it is not `expected` within a tolerance."""
    found = slope(sizes, errors)
    if not abs(found - expected) <= within:
        raise StudyError(f"{what}: order {found:.2f}, theory says {expected:g} (errors {np.array(errors)})")
    return f"{what}: observed order {found:.2f}, theory {expected:g}"


def _unit(rows: list[Row], base: Run) -> float:
    """Seconds of the baseline run, whose time is 1."""
    found = of_curve(rows, base, {})
    if not found or found[0]["converged"] is not True:
        raise StudyError(f"the baseline {base} has no converged run")
    return _seconds(found[0])


def answer(rows: list[Row], base: Run, panels: Panels, parameters: Sequence[str]) -> str:
    """In one sentence, what to choose for each of AIMS: of the lasting runs within a tenth of the fastest one's time the
    one nearest to the baseline."""
    rows = medians(rows, parameters)
    unit, parts = _unit(rows, base), []
    if not any(row["error"] > 0.0 for row in rows if row["converged"] is True):
        return "no run has an error: there is no reference to choose by"
    for aim in AIMS:
        good = lasting(rows, base, panels, aim)
        fastest = cheapest(good, aim)
        if fastest is None:
            tight = sorted(row["error"] for row in rows if row["converged"] is True)
            best = next(row for error in tight if (row := cheapest(lasting(rows, base, panels, error), error)))
            parts.append(
                f"for {aim:.1%} no run suffices for sure, the best has {best['error']:.2%} with {_words(best, base)}"
            )
            continue
        near = [row for row in good if row["error"] <= aim and _seconds(row) <= 1.1 * _seconds(fastest)]
        row = min(near, key=lambda row: (sum(row[key] != base[key] for key in base), _seconds(row)))
        ratio = _seconds(row) / unit
        parts.append(
            f"for {aim:.1%} choose {_words(row, base)} (error {row['error']:.2%}, {ratio:.2f} of the baseline's time)"
        )
    return "; ".join(parts)


def _words(row: Row, base: Run) -> str:
    """What sets a run apart from the baseline."""
    changed = [f"{key.replace('_', ' ')} {short(row[key])}" for key in base if row[key] != base[key]]
    return ", ".join(changed) or "the baseline"


def work_precision(
    path: str | Path,
    rows: list[Row],
    base: Run,
    panels: Panels,
    *,
    title: str = "",
    parameters: Sequence[str] = (),
    quantity: str = "relative error",
) -> list[Row]:
    """Draw log error against log time over the baseline's time, a panel for each question; returns the Pareto front's rows.

    path: picture; rows: of a study; base, panels: as given to `expand`; parameters: the study's, for medians over repeats.
    The front of all panels is grey; beside each point stands the value of the curve's first parameter. Rows without any
    error, of a study without a reference, are drawn by their values over time, and have no front.
    """
    if any(not isinstance(r.get("seconds"), int | float) for r in rows if r["converged"] is True):
        raise StudyError("the rows do not know their seconds: let the case return its Result, or metrics(result, error=...)")
    rows = medians(rows, parameters)
    unit = _unit(rows, base)
    good = [r for r in rows if r["converged"] is True and r["error"] > 0.0]
    key = "error" if good else "value"
    good = good or [
        r for r in rows if r["converged"] is True and isinstance(r["value"], float | int) and r["value"] == r["value"]
    ]
    if not good:
        raise StudyError("the rows have neither errors nor values: give metrics(result, value=...)")
    front = pareto([(_seconds(r) / unit, r["error"]) for r in good]) if key == "error" else []
    parts = short_panels(panels)
    figure = figures.Figure(figsize=(WIDTH, 0.6 + 2.6 * len(parts)), layout="constrained")
    axes = figure.subplots(len(parts), 1, sharex=True, sharey=True, squeeze=False)[:, 0]
    for axis, (name, curves) in zip(axes, parts.items(), strict=True):
        if front:
            steps = np.transpose([(_seconds(good[i]) / unit, good[i]["error"]) for i in front])
            axis.step(*steps, where="post", color="black", linewidth=6, alpha=0.12, zorder=0)
        _curves(axis, good, base, curves, unit, key)
        axis.set_title(name, fontsize=LETTERS + 1)
        axis.set_xlabel("time / time of the baseline (★)", fontsize=LETTERS)
        axis.set_ylabel(quantity if front else "value", fontsize=LETTERS)
        axis.tick_params(labelbottom=True, labelleft=True, labelsize=LETTERS)
    words = textwrap.wrap(". ".join(filter(None, [title, "Grey: no run is both faster and better" if front else ""])), 80)
    figure.suptitle("\n".join(words), fontsize=LETTERS + 1)
    figure.savefig(path, dpi=DOTS)
    return [good[i] for i in front]


def short_panels(panels: Panels) -> Panels:
    """The panels, those with more than MOST curves in parts of nearly equal size."""
    found: dict[str, Mapping[str, Values]] = {}
    for name, curves in panels.items():
        count = -(-len(curves) // MOST)
        each = -(-len(curves) // count)
        for part in range(count):
            labels = list(curves)[part * each : (part + 1) * each]
            found[f"{name} ({part + 1} of {count})" if count > 1 else name] = {label: curves[label] for label in labels}
    return found


def _curves(axis: "Axes", good: list[Row], base: Run, curves: Mapping[str, Values], unit: float, key: str) -> None:
    """key: what is drawn over time, "error", or "value" on an even scale."""
    ends: list[End] = []
    axis.set_xscale("log"), axis.set_yscale("log" if key == "error" else "linear")
    for number, (label, values) in enumerate(curves.items()):
        mine = of_curve(good, base, values)
        if not mine:
            ends.append((label + ": none converged", None, COLOURS[number]))
            continue
        first = next(iter(values))
        points = [(_seconds(r) / unit, r[key]) for r in mine]
        axis.plot(*np.transpose(points), color=COLOURS[number], marker=MARKERS[number], markersize=5, linewidth=1.2)
        for place, row in zip(points, mine, strict=True):
            axis.annotate(short(row[first]), place, xytext=(3, 3), textcoords="offset points", fontsize=8,
                          color=COLOURS[number])  # fmt: skip
        ends.append((label, max(points), COLOURS[number]))
    star = of_curve(good, base, {})
    if star:
        axis.plot(1.0, star[0][key], "*", color="black", markersize=11, zorder=5)
    for aim in AIMS if key == "error" else ():
        axis.axhline(aim, color="grey", linewidth=0.6, linestyle=":")
    axis.margins(0.08)
    axis.grid(which="major", linewidth=0.3)
    axis.xaxis.set_major_locator(tickers.LogLocator(subs=(1.0, 2.0, 5.0)))
    axis.xaxis.set_minor_formatter(tickers.NullFormatter())
    axis.xaxis.set_major_formatter(lambda value, _: f"{value:g}")
    _label_ends(axis, ends)


def _label_ends(axis: "Axes", ends: list[End]) -> None:
    """Names of the curves in a column at the right, in the order of their ends and apart from one another."""
    scale = np.log if axis.get_yscale() == "log" else np.asarray
    low, high = scale(axis.get_ylim())
    heights = [(scale(end[1]) - low) / (high - low) if end else 0.0 for _, end, _ in ends]
    order, gap = np.argsort(heights), 0.1
    places = np.array(heights)[order]
    for i in range(1, len(places)):
        places[i] = max(places[i], places[i - 1] + gap)
    places -= max(0.0, places[-1] - 0.98)
    for i in range(len(places) - 1, 0, -1):
        places[i - 1] = min(places[i - 1], places[i] - gap)
    for place, i in zip(places, order, strict=True):
        label, end, colour = ends[i]
        line = {"arrowstyle": "-", "color": colour, "linewidth": 0.5, "alpha": 0.6} if end else None
        axis.annotate(label, end or (1.0, place), xycoords="data" if end else "axes fraction", xytext=(1.02, place),
                      textcoords="axes fraction", color=colour, fontsize=LETTERS, va="center", arrowprops=line)  # fmt: skip


def savings(
    path: str | Path, rows: list[Row], pairs: Mapping[str, tuple[Run, ...]], parameters: Sequence[str] = (), title: str = ""
) -> list[str]:
    """Draw what economies buy: for each the time of the frugal run over the full one's, and the error it adds.

    pairs: {words: (parameters of the full run, parameters of the frugal one)}. Returns a sentence for each.
    """
    rows = medians(rows, parameters)
    figure = figures.Figure(figsize=(WIDTH, 0.9 + 0.75 * len(pairs)), layout="constrained")
    axis, sentences = figure.add_subplot(), []
    for place, (words, runs) in enumerate(reversed(list(pairs.items()))):
        full, frugal = (of_curve(rows, run, {})[0] for run in runs)
        if not (full["converged"] is True and frugal["converged"] is True):
            raise StudyError(f"{words}: a run did not converge")
        ratio, added = _seconds(frugal) / _seconds(full), abs(frugal["value"] / full["value"] - 1)
        share = f"{added:.2%}" if added >= 5e-5 else "< 0.01 %"
        axis.barh(place, ratio, color=COLOURS[0] if ratio < 1.0 else COLOURS[1], height=0.35)
        clear = {"facecolor": "white", "edgecolor": "none", "pad": 1.0}
        axis.annotate(f"{words}: {ratio:.2f} × the time", (0.01, place + 0.24), va="bottom", fontsize=LETTERS, bbox=clear)
        axis.annotate(f" force differs by {share}", (ratio + 0.01, place), va="center", fontsize=LETTERS, bbox=clear)
        sentences.append(f"{words}: {ratio:.2f} of the time, force differs by {share}")
    axis.set_yticks([])
    axis.set_ylim(-0.4, len(pairs) - 0.3)
    axis.axvline(1.0, color="black", linewidth=0.8, zorder=0)
    axis.set_xlim(0.0, 1.5 * max(1.0, axis.get_xlim()[1]))
    axis.set_xlabel("time of the frugal run / time of the full one (1: nothing gained)", fontsize=LETTERS)
    axis.tick_params(labelsize=LETTERS)
    axis.set_title(title, fontsize=LETTERS + 1)
    figure.savefig(path, dpi=DOTS)
    return sentences[::-1]
