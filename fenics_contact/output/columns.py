"""The columns of a run's history: names that carry units, and their numbers at a step."""

from collections.abc import Iterable, Mapping, Sequence
from dataclasses import dataclass
from types import SimpleNamespace
from typing import Any, Protocol

import numpy as np

from fenics_contact.assembly.section import Section
from fenics_contact.output.energies import Energies
from fenics_contact.output.names import energy_unit, plain_name
from fenics_contact.output.reactions import Reaction
from fenics_contact.output.results import ContactResult, StepResult
from fenics_contact.types import Floats
from fenics_contact.units import Units

AXES = "xyz"
ARCS = ("limit_point", "station", "negative_pivots", "bifurcation")  # of runs with a stage by arc length
SOME = ("stage", "augmentations", *ARCS)  # columns that only some runs have

HistoryRow = dict[str, Any]  # numbers, and the name of the stage


class Report(Protocol):
    """Of a step: solves it took, and out-of-balance forces from the first to the last [force]."""

    @property
    def iterations(self) -> int: ...

    @property
    def residuals(self) -> Sequence[float]: ...


@dataclass(frozen=True)
class Columns:
    """Names of the history's columns. tools, groups of supports, turning tools, tied ones, pairs of faces, by name;
    contacts: {name: has it friction}.

    Names carry units; what is no letter, digit or _ in a name of the scene's becomes _. section: of a plane mesh, of which
    components out of its plane are left out, and all the way round resultants that cancel, and ways that tools cannot go.
    """

    tools: Sequence[str]
    contacts: Mapping[str, bool]
    groups: Sequence[str]
    units: Units
    section: Section | None = None
    turning: Sequence[str] = ()
    tied: Sequence[str] = ()
    pairs: Sequence[str] = ()

    def all(self) -> list[str]:
        """The names of all columns a run may have but the user's own."""
        return [*self._first(), *SOME, damping_column(self.units)]

    def fitted(self, row: HistoryRow, at_rest: HistoryRow, own: Iterable[str]) -> HistoryRow:
        """A row of a run whose stages to come were others, with the columns of this run, in their order: tools that had not
        turned have angles of 0. at_rest: this run's last columns, as of a step in which nothing of theirs comes to pass;
        own: names of the user's columns."""
        turns = {name for tool in self.tools for name in _vector(f"{tool}_angle", np.zeros(3), "rad", AXES)}
        mine = {name: 0.0 if name in turns else np.nan for name in self._first()} | at_rest
        others = turns.union(ARCS).difference(mine, own)  # of stages that are stated no more, which had not begun
        whole = mine | {name: value for name, value in row.items() if name not in others}
        lead = {name: whole[name] for name in ("step", "stage") if name in whole}
        last = {name: whole.pop(name) for name in at_rest}
        return lead | whole | last

    def _first(self) -> HistoryRow:
        """A row of zeros, with the columns that all rows of a run have."""
        nothing, report = np.zeros(3), SimpleNamespace(iterations=0, residuals=[0.0])
        zeros: dict[str, Any] = dict.fromkeys(ContactResult.__dataclass_fields__, 0.0)
        vectors = dict.fromkeys(("force", "friction", "moment", "point", "peak_at", "width"), nothing)
        contact, reaction = ContactResult(**(zeros | vectors)), Reaction(nothing, nothing, nothing)
        result = StepResult(
            dict.fromkeys(self.contacts, contact),
            dict.fromkeys(self.groups, reaction),
            dict.fromkeys(self.tools, nothing),
            dict.fromkeys(self.tools, nothing),
            dict.fromkeys(self.tools, reaction),
            Energies(friction={name: 0.0 for name, rough in self.contacts.items() if rough}),
            dict.fromkeys(self.pairs, nothing),
        )
        return self.row(0, 0.0, report, 0.0, 0.0, result)

    def clash(self) -> str | None:
        """A column that two tools, contacts or groups would share, or None."""
        names = [
            *(f"{name}_travel" for name in self.tools),
            *(f"{name}_angle" for name in self.turning),
            *self.tied,
            *self.pairs,
            *self.contacts,
            *(f"{name}_reaction" for name in self.groups),
        ]
        names = [plain_name(name) for name in names]
        return next((name for i, name in enumerate(names) if name in names[:i]), None)

    def row(self, step: int, t: float, report: Report, seconds: float, smallest_J: float, result: StepResult) -> HistoryRow:
        """One step's numbers under their names."""
        row: HistoryRow = {"step": step, "t": t, "iterations": report.iterations, "residual": report.residuals[-1]}
        row |= {"seconds": seconds, "smallest_J": smallest_J} | self._energies(result.energies)
        for tool, travel in result.travel.items():
            row |= _vector(f"{tool}_travel", travel, self.units.length, self.section.ways if self.section else AXES)
        for tool in self.turning:
            row |= _vector(f"{tool}_angle", result.angles[tool], "rad", self.section.resultants[1] if self.section else AXES)
        for tool in self.tied:
            row |= self._force(f"{tool}_force", result.drives[tool].force)
            row |= self._moment(f"{tool}_moment", result.drives[tool].moment)
        for pair, force in result.pairs.items():
            row |= self._force(f"{pair}_force", force)
        for name, contact in result.contacts.items():
            row |= self._contact(name, contact, self.contacts[name])
        for group, reaction in result.reactions.items():
            row |= self._force(f"{group}_reaction", reaction.force)
            row |= self._moment(f"{group}_reaction_moment", reaction.moment)
            row |= self._centre(f"{group}_reaction_point", reaction.point)
        return row

    def _energies(self, energies: Energies) -> HistoryRow:
        unit = energy_unit(self.units)
        row: HistoryRow = {
            f"external_work_{unit}": energies.external_work,
            f"work_done_{unit}": energies.done,
            f"strain_energy_{unit}": energies.strain,
            f"penalty_energy_{unit}": energies.penalty,
            f"energy_error_{unit}": energies.error,
            f"balance_error_{self.units.force}": energies.balance,
        }
        return row

    def _contact(self, name: str, c: ContactResult, rough: bool) -> HistoryRow:
        length, force, pressure = self.units.length, self.units.force, self.units.pressure
        name = plain_name(name)
        row = self._force(f"{name}_force", c.force) | self._moment(f"{name}_moment", c.moment)
        row |= self._centre(f"{name}_point", c.point)
        row |= {f"{name}_load_{force}": c.load, f"{name}_peak_pressure_{pressure}": c.peak_pressure}
        row |= self._place(f"{name}_peak", c.peak_at) | {f"{name}_area_{length}2": c.area}
        row |= self._place(f"{name}_width", c.width)
        if rough:
            row |= self._force(f"{name}_friction", c.friction)
            row |= {f"{name}_greatest_slip_{length}": c.slip, f"{name}_mean_slip_{length}": c.mean_slip}
            row[f"{name}_friction_work_{energy_unit(self.units)}"] = c.friction_work
        row[f"{name}_normal_work_error_{energy_unit(self.units)}"] = c.normal_work_error
        row |= {f"{name}_active_points": c.active, f"{name}_sticking_points": c.sticking}
        row[f"{name}_penetration_{length}"] = c.penetration
        return row

    def _force(self, name: str, values: Floats) -> HistoryRow:
        return _vector(name, values, self.units.force, self.section.resultants[0] if self.section else AXES)

    def _moment(self, name: str, values: Floats) -> HistoryRow:
        return _vector(name, values, energy_unit(self.units), self.section.resultants[1] if self.section else AXES)

    def _place(self, name: str, values: Floats) -> HistoryRow:
        return _vector(name, values, self.units.length, "xy" if self.section else AXES)

    def _centre(self, name: str, values: Floats) -> HistoryRow:
        """About which moments are taken, where there are any."""
        return self._place(name, values) if self.section is None or self.section.resultants[1] else {}

    def energies(self, rows: Sequence[HistoryRow]) -> Energies | None:
        """What the rows of a run so far say of its energies; None of none."""
        if not rows:
            return None
        last, unit = rows[-1], energy_unit(self.units)
        friction = {name: last[f"{plain_name(name)}_friction_work_{unit}"] for name, rough in self.contacts.items() if rough}
        pressures = {name: last[f"{plain_name(name)}_normal_work_error_{unit}"] for name in self.contacts}
        damping = sum(row.get(damping_column(self.units), 0.0) for row in rows)
        return Energies(
            last[f"external_work_{unit}"], last[f"strain_energy_{unit}"], last[f"penalty_energy_{unit}"], friction, damping,
            last[f"balance_error_{self.units.force}"], pressures, last[f"work_done_{unit}"],
        )  # fmt: skip


def _vector(name: str, values: Floats, unit: str, axes: str) -> HistoryRow:
    return {f"{plain_name(name)}_{axis}_{unit}": float(values[AXES.index(axis)]) for axis in axes}


def damping_column(units: Units) -> str:
    """Name of the column of what damping took in a step."""
    return f"damping_work_{energy_unit(units)}"
