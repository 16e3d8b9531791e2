"""What cells, penalties, chords, nodes and friction between these cost, noted where stages end: the last one may have let go
what others pressed."""

from collections.abc import Callable, Mapping
from functools import partial
from typing import Any, NamedTuple

from fenics_contact.assembly.section import Section
from fenics_contact.assembly.system import System
from fenics_contact.output.between_nodes import friction_notes, friction_summary
from fenics_contact.output.columns import HistoryRow
from fenics_contact.output.history import (
    Summary,
    chord_notes,
    chord_summary,
    greatest_loads,
    greatest_travels,
    node_notes,
    node_summary,
    penalty_notes,
    penalty_summary,
)
from fenics_contact.output.results import Results
from fenics_contact.plans import Plan
from fenics_contact.recording import Recorder
from fenics_contact.scene.scene import Scene
from fenics_contact.scene.stage import Stage
from fenics_contact.scene.within_cells import stiffnesses
from fenics_contact.solvers.chord_error import chord_error, is_round, rounder
from fenics_contact.solvers.friction_error import at_limits, between_nodes, friction_error
from fenics_contact.solvers.giving import gives
from fenics_contact.solvers.linear import LinearSolver
from fenics_contact.solvers.node_error import deeper, lifted, node_error
from fenics_contact.solvers.penalty_error import penalty_error, stiffer
from fenics_contact.solvers.sensitivity import LINEAR, sensitivities
from fenics_contact.solvers.verdict import GREW


class Errors(NamedTuple):
    """What the penalties cost, None if not to be had, and by contact what straight cells, nodes between points and friction
    between nodes do, see `chord_error`, `node_error` and `friction_error`."""

    penalties: dict[str, Any] | None
    chords: dict[str, tuple[float, float]]
    nodes: dict[str, tuple[float, float | None]]
    friction: dict[str, tuple[float, list[float]]]


UNKNOWN = Errors(None, {}, {}, {})


class Costs:
    """Notes of a run on what it costs; each once, and where it is much greater than was said. kept: what the run keeps."""

    def __init__(self, scene: Scene, system: System, kept: Recorder) -> None:
        self.kept, self._scene, self._system = kept, scene, system

    def stage_ended(self, plan: Plan) -> None:
        """All costs in the state in which a stage ends. Collective."""
        if not any(contact.findings.misstated(self._system.state) for contact in self._system.contact_terms):
            self._of_contacts(plan)
        self.stiff(plan)
        self.kept.results.begin_stage()

    def _of_contacts(self, plan: Plan) -> None:
        """What penalties, chords and nodes cost. Collective."""
        scene, system, units = self._scene, self._system, self._scene.units
        with system.timers("penalty error"):
            error, chords, nodes, friction = errors(system, plan.solver, scene.section, self.kept.results)
        travel, loads = greatest(scene, system, self.kept.history)
        cost = penalty_summary(error, list(travel), units)

        def penalties(contacts: Summary) -> list[str]:
            return penalty_notes(cost | {"contacts": contacts}, travel, units, loads) if cost else []

        by_name = {name: e["force_change_over_load"] for name, e in cost.get("contacts", {}).items()}
        self._say(plan.stage, "penalties", by_name, cost.get("contacts", {}), penalties)
        for what, summary, notes in (
            ("chords", chord_summary(chords, units), partial(chord_notes, units=units)),
            ("nodes", node_summary(nodes, units), partial(node_notes, units=units)),
            ("friction", friction_summary(friction), friction_notes),
        ):
            by_name = {name: e["load_change_over_load"] for name, e in summary.items()}
            self._say(plan.stage, what, by_name, summary, notes)

    def stiff(self, plan: Plan) -> None:
        """How far off bodies are by their cells, where they had most strain energy in the stage, or, if any swells, by how
        much only the present says, in the end. Collective."""
        energy, u = self.kept.results.most_strained
        if any(law.swelling for law in self._system.terms[0].laws):
            u = self._system.state.u.x.array.copy()
        if energy > self._system.scales.noise_energy:
            with self._system.timers("cells"):
                found = stiffnesses(self._scene, self._system, u, partial(gives, self._system, plan.solver, u))
            shares = {body: one.share for body, one in found.items()}
            self._say(plan.stage, "cells", shares, found, lambda fresh: [one.note for one in fresh.values()])

    def _say(
        self,
        stage: Stage,
        what: str,
        shares: Mapping[str, float],
        found: Mapping[str, Any],
        notes: Callable[[dict[str, Any]], list[str]],
    ) -> None:
        """The notes on what is found by name, of what has a share greater by GREW than was said."""
        remarked = self.kept.verdict.remarked
        before = {name: remarked.get(name, {}).get(what, (0.0,))[0] for name in found}
        fresh = {name: one for name, one in found.items() if abs(shares[name]) > GREW * before[name]}
        said = notes(fresh)
        self.kept.remark([stage.says(note) for note in said])
        for name in fresh:
            if any(f"'{name}'" in note for note in said):
                remarked.setdefault(name, {})[what] = abs(shares[name]), abs(shares[name]), ""


def greatest(scene: Scene, system: System, history: list[HistoryRow]) -> tuple[dict[str, float], dict[str, float]]:
    """Of all steps the greatest travels of the tools [length] and loads of the contacts [force]."""
    travels = greatest_travels(history, [tool.name for tool in scene.tools], scene.units)
    return travels, greatest_loads(history, [contact.name for contact in system.contact_terms], scene.units)


def errors(system: System, solver: LinearSolver, section: Section | None, results: Results) -> Errors:
    """Of the last accepted state. Collective."""
    round_, deep, between = is_round(system), deeper(system), between_nodes(system)
    varied = [stiffer(system)]
    varied += [rounder(system)] if round_ else []
    varied += [at_limits(system, between)] if between else []
    varied += [lifted(system, deep)] if deep else []
    # points follow what shifts them but for a penetration, all that presses: a solve must tell that from the way
    tolerance = LINEAR * min(deep.part, 1.0) if deep else LINEAR
    found = sensitivities(system, solver, varied, tolerance, results.pressures)
    if found is None:
        return UNKNOWN
    rates = iter(found)
    return Errors(
        penalty_error(system, next(rates), section),
        chord_error(system, next(rates)) if round_ else {},
        friction=friction_error(system, between, next(rates)) if between else {},
        nodes=node_error(system, deep, next(rates)) if deep else {},
    )
