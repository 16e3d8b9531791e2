"""history.csv, a row per accepted step, and summary.json, both with units in their names."""

import csv
import errno
import io
import json
import math
import os
from collections.abc import Collection, Mapping, Sequence
from pathlib import Path
from types import MappingProxyType
from typing import Any

import numpy as np

from fenics_contact.output.columns import HistoryRow
from fenics_contact.output.energies import Energies
from fenics_contact.output.files import complete
from fenics_contact.output.names import energy_unit, plain_name
from fenics_contact.types import Floats
from fenics_contact.units import Units

UNSEEN = 5e-5  # of the work done: less is 0.00%
GROSS = 0.36  # of the work done: more than a cone pressed in a single step misses, a third, and at large strain 0.342
COSTLY = 0.01  # of a load or a travel: an error of the penalties beyond what the default is meant to cost
MANIFOLD = 3.0  # times a load: a change as great is beyond what its rates can tell
ROUGH = 0.03  # of a load: what some six cells across a contact leave as well (docs/choices.md)
# Of a load; a shorter lever makes up for a part: of 4 % that are said 1 is true, of 9 % 3, of 20 ... 60 % nearly all
MISSED = 0.05
STIFFER = "raise penalty= of the contact, a Penalty(factor=...), or give it penetration=, a smaller one where it has one"
SOFT = 0.95  # of a load, to first order: beyond that the penalties' springs are a twentieth as stiff as the bodies, or less

# of what is not accounted for: what more of it a contact's pressures, or turns, leave is to be its cause
MOST, SEVERAL = 0.5, 3  # and of so many steps one of which leaves most, that one is
# times what pressures leave: what more of it comes with steps twice as long is the steps'. Of these it is 4 on smooth paths,
# 2.2 ... 3.6 on those of a tube crushed flat and of round bodies that roll, and 1.01 ... 1.02 at sharp edges
GROWS = 1.5
WIDE = 0.1  # rad: forces that turn by less in a step have their work missed by a thousandth of itself, the angle's square/12
# by what pressures act along: why that leaves some of the work whatever the steps, and what mends it
ALONG = {
    "slave": (
        "the slave's normals, which are not the master's where what touches is narrow beside the cells and slides; more "
        "steps and multipliers do not mend that, finer cells do where it is round; at a sharp edge leave points= out, or "
        "where it is let the side without that edge be the slave, or round the edge over some cells"
    ),
    "face": (
        "the normals of a sharp punch's faces alone, and what rubber presses sideways on its edges is missing, where these "
        "dig in and slide; more steps, finer cells and multipliers do not mend that, a fillet over two cells or more does: "
        "rigid_punch(..., fillet=)"
    ),
}

Summary = dict[str, Any]  # what JSON can hold


def stages_line(seconds: dict[str, float]) -> str:
    """Where the time went, in one line."""
    stages = ", ".join(
        f"{stage} {t:.0f}" if t >= 10 else f"{stage} {t:.2g}"
        for stage, t in seconds.items()
        if stage != "total" and t >= 0.005
    )
    return f"{seconds['total']:.3g} s: {stages}"


def limit_points(history: list[HistoryRow]) -> list[dict[str, Any]]:
    """Step, t and kind of the limit points among a continuation's accepted steps."""
    kinds = {1: "maximum of the load", -1: "minimum of the load"}
    found = [row for row in history if row.get("limit_point")]
    return [{"step": row["step"], "t": row["t"], "kind": kinds[int(row["limit_point"])]} for row in found]


def stages_summary(history: list[HistoryRow]) -> list[dict[str, Any]]:
    """Name, first and last step and last t of the stages gone through, [] of a run without."""
    found: dict[str, list[HistoryRow]] = {}
    for row in history:
        if "stage" in row:
            found.setdefault(row["stage"], []).append(row)
    return [{"name": name, "steps": [rows[0]["step"], rows[-1]["step"]], "t": rows[-1]["t"]} for name, rows in found.items()]


def penalty_summary(error: dict[str, Any] | None, tools: Sequence[str], units: Units) -> Summary:
    """What grows as the penalties do, under names that carry units, and as shares of what was computed; {} if not known.

    Changes of a contact's force, a resultant, and of its load, the pressure integrated over its surface, are shares of the
    load: a ring closed on a shaft has no resultant. A share of None: more than a first order in 1/penalty can tell. opening:
    with how much of the load points would pull by then, which open before.
    """
    if error is None:
        return {}
    out = {}
    for name, e in error["contacts"].items():
        load, peak = e["load"], e["peak"]
        out[name] = {
            f"force_change_{units.force}": list(e["force_change"]),
            f"load_{units.force}": load,
            "force_change_over_load": float(np.linalg.norm(e["force_change"])) / load if load > 0.0 else 0.0,
            "load_change_over_load": e["load_change"] / load if load > 0.0 else 0.0,
            "opening_over_load": e["opening"] / load if load > 0.0 else 0.0,
            f"peak_pressure_{units.pressure}": peak,
            f"peak_pressure_at_{units.length}": e["peak_at"],
            "peak_pressure_change_share": e["peak_change"] / peak
            if peak and e["peak_change"] is not None
            else e["peak_change"],
        }
    travel = {f"{tool}_{units.length}": list(change) for tool, change in zip(tools, error["travel_change"], strict=True)}
    angles = {f"{tool}_rad": list(change) for tool, change in zip(tools, error["angle_change"], strict=True) if change.any()}
    return {"contacts": out, "travel_change": travel, "angle_change": angles}


def penalty_lines(summary: Summary, units: Units) -> list[str]:
    """The same in a line per contact."""
    lines = []
    for name, e in summary.get("contacts", {}).items():
        text = (
            f"contact '{name}' carries a load of {e[f'load_{units.force}']:.4g} {units.force}; infinitely stiff penalties "
            f"would change its force by {e['force_change_over_load']:.2%} of this load, the load itself by "
            f"{e['load_change_over_load']:+.2%}"
        )
        peak, change = e[f"peak_pressure_{units.pressure}"], e["peak_pressure_change_share"]
        if peak > 0.0:
            where = ", ".join(f"{x:.4g}" for x in e[f"peak_pressure_at_{units.length}"])
            how = f"{change:+.2%}" if change is not None else "more than a third, which only a finer mesh can settle"
            text += f", and its peak pressure, {peak:.4g} {units.pressure} at ({where}) of the undeformed body, by {how}"
        lines.append(text)
    return lines


def energy_line(energies: Energies, summary: Summary, units: Units) -> str:
    """Where the work of supports, loads and tools went, in one line: as shares of the work done, as in energy_summary."""
    unit = f"{units.force} {units.length}"
    if not summary:
        return "no work done"
    done = summary[f"work_done_{energy_unit(units)}"]
    went = {"bodies": energies.strain, "penalties": energies.penalty, "friction": sum(energies.friction.values())}
    went |= {"damping": energies.damping, "missing": energies.error, "of overlaps as drawn": energies.drawn}
    if (again := done - energies.drawn - energies.external_work) > UNSEEN * done:
        went["in and out again"] = again
    shares = ", ".join(f"{name} {part / done:.2%}" for name, part in went.items() if part)
    return f"work done {done:.4g} {unit}, in the end {energies.external_work:.4g} went in; of the work done: {shares}"


def energy_summary(
    rows: Sequence[HistoryRow],
    units: Units,
    along: Mapping[str, str] = MappingProxyType({}),
    growth: Mapping[str, float] = MappingProxyType({}),
    noise: float = 0.0,
) -> Summary:
    """Of a run's rows the work that went in and out; what is not accounted for in the end, and its share of that; the most
    that was not after a step, of those after which it was beyond COSTLY and what steps explain, if any; the step that left
    most of it; of it by contact, of those in `along`, whose pressures act along what ALONG names and need have no energy,
    the share that they left; of that and, by "", of all its growth, how many times as much steps twice as long would leave,
    where that is known; {} where no work was done but rounding, up to noise [force length].

    Where a force grows with the way to the power p the trapezoidal rule errs by p (p + 1) / 12 / steps^2 of the work: by
    1 / steps^2 at most up to the cube. One step that misses more than GROSS may have gone anywhere. What later stages leave
    the other way hides none of it.
    """
    unit = energy_unit(units)
    done = rows[-1][f"work_done_{unit}"] if rows else 0.0
    if not done > noise:
        return {}
    error, work = (np.array([row[f"{of}_{unit}"] for row in rows]) for of in ("energy_error", "work_done"))
    explained = np.minimum(1.0 / np.arange(1, len(rows) + 1) ** 2, GROSS) * work
    told = np.abs(error) > np.maximum(COSTLY * done, explained)
    last = int((np.abs(error) * (told | (not told.any()))).argmax())
    left = np.abs(np.diff(error[: last + 1], prepend=0.0))
    most, pressures = int(left.argmax()), {name: f"{plain_name(name)}_normal_work_error_{unit}" for name in along}
    return {
        f"work_done_{unit}": done, f"error_{unit}": error[-1], "error_share": abs(error[-1]) / done,
        f"greatest_error_{unit}": error[last], "greatest_error_step": last + 1, "greatest_error_t": rows[last]["t"],
        "explained_share": explained[last] / done,
        "worst_step": most + 1, "worst_step_t": rows[most]["t"], "worst_step_share": left[most] / max(left.sum(), 1e-300),
        f"normal_work_error_{unit}": {name: rows[-1][column] for name, column in pressures.items()},
        "left_by_pressures": {name: rows[last][column] / (error[last] or 1.0) for name, column in pressures.items()},
        "normal_work_error_growth": {name: growth[name] for name in along if name in growth},
        "normals": dict(along), "error_growth": growth.get(""),
    }  # fmt: skip


def greatest_loads(history: Sequence[HistoryRow], contacts: Sequence[str], units: Units) -> dict[str, float]:
    """The greatest load of each of these contacts in any step [force]."""
    columns = {name: f"{plain_name(name)}_load_{units.force}" for name in contacts}
    return {name: max((row[column] for row in history), default=0.0) for name, column in columns.items()}


def greatest_travels(history: Sequence[HistoryRow], tools: Sequence[str], units: Units) -> dict[str, float]:
    """How far each of these tools has been from its start at most [length]."""
    names = {tool: [f"{plain_name(tool)}_travel_{axis}_{units.length}" for axis in "xyz"] for tool in tools}
    return {
        tool: max((math.hypot(*(row.get(name, 0.0) for name in columns)) for row in history), default=0.0)
        for tool, columns in names.items()
    }


def widest_turn(rows: Sequence[HistoryRow], units: Units, tools: Mapping[str, Floats]) -> float:
    """The most by which a tool turns in a step [rad], where more than MOST of what is not accounted for was left in steps
    that turn one by more than WIDE, of several not in one; else 0. tools: angles (3,) by name that it begins with [rad]."""
    left = np.abs(np.diff([0.0, *(row[f"energy_error_{energy_unit(units)}"] for row in rows)]))
    names = [[f"{plain_name(tool)}_angle_{axis}_rad" for axis in "xyz"] for tool in tools]
    angles = np.array([[[row.get(name, 0.0) for name in of] for of in names] for row in rows])
    angles = angles.reshape(len(rows), len(names), 3)
    first = np.array([tools[tool] for tool in tools], dtype=float).reshape(1, len(names), 3)
    turns = np.linalg.norm(np.diff(angles, axis=0, prepend=first), axis=2).max(axis=1, initial=0.0)
    wide = left[turns > WIDE]
    alike = len(wide) < SEVERAL or wide.max() < MOST * wide.sum()  # arcs cost all that turn as far the same
    return float(turns.max(initial=0.0)) if alike and wide.sum() > MOST * left.sum() else 0.0


def energy_notes(
    summary: Summary, units: Units, overlaps: Sequence[str] = (), turned: float = 0.0, has: Collection[str] = ()
) -> list[str]:
    """A note where more than COSTLY of the work done is not accounted for, and more than the steps explain. summary: not {}.

    overlaps: names of the contacts that overlap at the start, whose energy the first step lets go; turned: see
    `widest_turn` [rad]; has: which of the remedies "damping" and "penetration" the run has, which are not named then, and
    "jump" where its start is out of balance.
    """
    unit, jumps = energy_unit(units), "jump" in has and summary["worst_step"] == 1
    lost, done = abs(summary[f"greatest_error_{unit}"]), summary[f"work_done_{unit}"]
    if (share := lost / done) <= max(COSTLY, 0.0 if jumps else summary["explained_share"]):
        return []
    when = "" if lost == abs(summary[f"error_{unit}"]) else f" at t = {summary['greatest_error_t']:.6g}"
    text = f"energy: {lost:.4g} {units.force} {units.length} of the work done, {done:.4g}, are missing{when} ({share:.1%})"
    if overlaps and summary["worst_step"] == 1:
        which = f"contact{'s' * (len(overlaps) > 1)} {', '.join(map(repr, overlaps))}"
        return [
            f"{text}, {summary['worst_step_share']:.0%} of that in step 1, which presses apart what overlaps at the start "
            f"({which}): the energy of that is no work; start without overlap"
        ]
    if jumps:
        return [f"{text}, {summary['worst_step_share']:.0%} of that in step 1, which starts out of balance"]
    where = f"{summary['worst_step_share']:.0%} of that in step {summary['worst_step']} to t = {summary['worst_step_t']:.6g}"
    parts = summary["left_by_pressures"]
    growth = summary["normal_work_error_growth"].get(most := max(parts, key=parts.__getitem__, default=""))
    if growth is not None and parts[most] > MOST:
        left = f"{text}, {parts[most]:.0%} of that left by the pressures of contact '{most}', "
        if growth > GROWS:
            return [f"{left}{growth:.2g} times as much with steps twice as long; {where}: take more steps, there above all"]
        if summary["worst_step_share"] > MOST:  # of which longer steps tell nothing
            return [f"{left}{where}: take more steps there"]
        return [f"{left}as much with steps twice as long: they act along {ALONG[summary['normals'][most]]}"]
    if turned > 0.0:
        where = (
            f"most of that in steps that turn a tool by up to {math.degrees(turned):.0f} degrees: forces that turn along "
            "do their work on an arc, which is missed by the square of the angle"
        )
    carried = "" if "damping" in has else " (Method(damping=True) carries it where a step fails there)"
    growth = summary["error_growth"] or 0.0
    grown = f" (steps twice as long miss {growth:.2g} times as much)" if growth > GROWS else ""
    lessened = "" if grown or "penetration" in has else " (penetration= lessens that)"  # not what is the steps'
    return [
        f"{text}, {where}: take more steps there{grown}; what stays then went into a sudden motion within a step{carried} "
        f"or into friction: where sticking turns to sliding, and against round tools{lessened}"
    ]


def penalty_notes(
    summary: Summary,
    travel: Mapping[str, float],
    units: Units,
    greatest: Mapping[str, float],
    astray: Mapping[str, str] = MappingProxyType({}),
) -> list[str]:
    """A note per contact whose penalties cost more than COSTLY of its load, and per tool that is so far off by them, as a
    share of its greatest travel {name: [length]}.

    greatest: of each contact that has met its master the greatest load in any step [force]: one that has been let off, or
    barely touches, with less than COSTLY of the greatest of all, has what balance and multipliers have left, of which the
    penalties may hold all, or what matters to none; astray: contacts that end far from
    their penetration=, of which no first order tells what that costs, and what to do.

    Where points that would pull, and open before, have most of the change, few carry, and no first order tells what the
    penalties cost.

    Penalties are springs in series with the bodies: of stiffnesses e and k they lose k / (k + e) of the load to first order,
    and k / e in truth.
    """
    notes, least = [], COSTLY * max(greatest.values(), default=0.0)
    for name, e in summary.get("contacts", {}).items():
        if name not in greatest:
            continue
        share, load = max(e["force_change_over_load"], abs(e["load_change_over_load"])), e[f"load_{units.force}"]
        if name in astray:
            text = "its force may be far off, for it ends far from the penetration= asked for"
            notes.append(f"contact '{name}': {text}; {astray[name]}")
        elif share * load > COSTLY * max(load, least) and e["opening_over_load"] < MOST * share:
            about = f"about {share / (1.0 - share):.1%}" if share < SOFT else f"more than {SOFT / (1.0 - SOFT):.0%}"
            notes.append(f"contact '{name}': its penalties change the force by {about} of the load; {STIFFER}")
    for name, size in travel.items() if summary else ():
        change = float(np.linalg.norm(summary["travel_change"][f"{name}_{units.length}"]))
        if change > COSTLY * size:
            share = change / size if size > 0.0 else np.inf
            notes.append(f"tool '{name}': penalties change its travel by about {share:.1%}; {STIFFER}")
    return notes


def chord_summary(errors: Mapping[str, tuple[float, float]], units: Units) -> Summary:
    """By contact how its load would change, over that, were surfaces round that straight cells stand for, and how far off
    these are at most."""
    return {name: {"load_change_over_load": share, f"cut_off_{units.length}": off} for name, (share, off) in errors.items()}


def chord_notes(summary: Summary, units: Units) -> list[str]:
    """A note per contact whose load would change by more than ROUGH were all surfaces round, those of others, too."""
    notes, off = [], {name: e[f"cut_off_{units.length}"] for name, e in summary.items()}
    straight = [name for name in off if off[name] > 0.0]
    for name, e in summary.items():
        share = e["load_change_over_load"]
        if abs(share) > ROUGH:
            change, finer = f"its load would change by about {share:+.0%}", math.ceil(math.sqrt(abs(share) / ROUGH))
            if abs(share) > MANIFOLD:  # a contact that gives way, a strap on its drum for one, does so long before
                change, finer = "its load may change, by how much no first order tells", 2
            whose = f"the surfaces of {', '.join(map(repr, straight))}" if straight != [name] else "its surfaces"
            notes.append(
                f"contact '{name}': were {whose} as round as their straight cells tell, which are off by "
                f"{max(off.values()):.2g} {units.length}, {change}: take curved cells (gmsh's setOrder(2), "
                f"degree=2), sides of 1/{finer} of their length on all that is round, or, of a meshed tool, a formula"
            )
    return notes


def node_summary(errors: Mapping[str, tuple[float, float | None]], units: Units) -> Summary:
    """By contact how its load would change, over that, were nodes held as the points beside them, and how much deeper they
    lie where no step's note says so."""
    return {
        name: {"load_change_over_load": share} | ({} if deep is None else {f"deeper_{units.length}": deep})
        for name, (share, deep) in errors.items()
    }


def node_notes(summary: Summary, units: Units) -> list[str]:
    """A note per contact whose load would change by more than MISSED."""
    notes = []
    for name, e in summary.items():
        share = abs(e["load_change_over_load"])
        off, deeper = f"its load may be off by {_about(share)}", e.get(f"deeper_{units.length}")
        if share > MISSED and deeper is None:
            notes.append(
                f"contact '{name}': in the end {off} for what lies inside between its nodes, as noted with the step"
            )
        elif share > MISSED:
            notes.append(
                f"contact '{name}': nodes lie up to {deeper:.2g} {units.length} deeper in the master than the Gauss points "
                f"beside them, and {off}, most at first touch: take finer cells where it touches, more points= per facet, "
                'or degree=1 and points="nodes"'
            )
    return notes


def _about(share: float) -> str:
    """A share of a load to first order, in words."""
    return f"about {share:.0%}" if share < 1.0 else "as much as itself"


class HistoryFile:
    """Appends rows to history.csv, each written at once or not at all, so that a killed run keeps its accepted steps."""

    def __init__(self, folder: Path, rows: Sequence[HistoryRow] = ()) -> None:
        """rows: those of the steps before, where a run is resumed; they replace what a killed run left of the file."""
        self._columns: list[str] | None = None
        with complete(Path(folder) / "history.csv") as draft:
            self._file = open(draft, "wb", buffering=0)  # noqa: SIM115 - lives as long as the run
            for row in rows:
                self.write(row)

    def write(self, row: HistoryRow) -> None:
        text = io.StringIO()
        writer = csv.DictWriter(text, self._columns or list(row))
        if self._columns is None:
            writer.writeheader()
        writer.writerow({k: f"{v:.12g}" if isinstance(v, float) else v for k, v in row.items()})
        data, end = text.getvalue().encode(), self._file.tell()
        try:
            if self._file.write(data) < len(data):
                raise OSError(errno.ENOSPC, os.strerror(errno.ENOSPC))
        except OSError:
            self._file.seek(end)
            self._file.truncate()  # a full disk takes a part of a row
            raise
        self._columns = list(row)

    def close(self) -> None:
        self._file.close()


def write_summary(folder: Path, content: Summary) -> None:
    """summary.json, replaced in one move so that readers never see half of it."""
    with complete(Path(folder) / "summary.json") as draft:
        draft.write_text(json.dumps(content, indent=2, default=plain) + "\n")


def plain(value: object) -> Any:
    """What JSON takes in place of a NumPy value."""
    if isinstance(value, np.generic):
        return value.item()
    if isinstance(value, np.ndarray):
        return value.tolist()
    return str(value)
