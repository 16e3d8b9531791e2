"""What a System sums: terms of the virtual power, and the state they depend on."""

from abc import ABC, abstractmethod
from collections.abc import Sequence
from dataclasses import dataclass
from typing import Any, NamedTuple, Protocol

import numpy as np
from mpi4py import MPI

from fenics_contact import compat
from fenics_contact.assembly.blocks import Blocks
from fenics_contact.assembly.cell_forms import CellForm, LinearForm
from fenics_contact.assembly.finding import Finding, Remark
from fenics_contact.assembly.pose import Pose, Poses
from fenics_contact.assembly.trial import Trials
from fenics_contact.types import Array, Constant, Floats, Form, Function, Ints64


@dataclass
class State:
    """Displacement u (Function, [length]), coordinates q of the tools (tools, 6) [length] and load parameter t.

    q: travel of the tools' reference points, then their rotations, as `poses` counts them; share: how much of the last
    tangent solve's increment is in u; terms with unknowns of their own follow by it.
    """

    u: Function
    q: Floats
    poses: Poses
    t: float = 0.0
    share: float = 1.0

    @property
    def comm(self) -> MPI.Comm:
        """Of all ranks that have a part of the state."""
        return self.u.function_space.mesh.comm

    def way_from(self, u: Floats, q: Floats) -> float:
        """Largest motion [length] of a node or a tool from u (local array) and q. Collective."""
        way = max(self.comm.allgather(np.abs(self.u.x.array - u).max(initial=0.0)))
        return max(way, np.abs(self.q - q).max(initial=0.0))

    @property
    def travel(self) -> Floats:
        """Travel of the tools' reference points (tools, 3) [length], a view of q."""
        return self.q[:, :3]

    @property
    def angles(self) -> Floats:
        """Rotation vectors of the tools (tools, 3) [radians]: of those that turn freely about all axes the sum of the
        accepted steps' ones."""
        return self.q[:, 3:] / self.poses.lever

    @property
    def tools(self) -> list[Pose]:
        """Where all tools are."""
        return [self.pose(i) for i in range(len(self.q))]

    def pose(self, tool: int) -> Pose:
        """Where a tool is."""
        return self.poses.at(tool, self.q[tool])


class Findings(Protocol):
    """What ails a term at a state: by default nothing, as of forms, which compute no differences of coordinates and whose
    ills are found in the tangent. Collective."""

    def objection(self, state: State) -> Finding | None:
        """None, or the Finding why this state, evaluated last, must not be accepted though it is in balance."""
        return None

    def trouble(self, state: State) -> Finding | None:
        """None, or the Finding that keeps the step after this accepted state from converging."""
        return None

    def remarks(self, state: State, noise: float) -> dict[str, Remark]:
        """{kind: what is to be said of an accepted state}."""
        return {}


class Healthy(Findings):
    """Of a term that nothing ails."""


class Term(Protocol):
    """A part of the virtual power. Evaluation depends on the state and on what contacts are evaluated with, which is their
    own unless `trials` have another one; only commit writes history, of which by default there is none.

    symmetric: is its tangent so; condensed: has it unknowns of its own that are condensed out, for which
    add_followed_residual gives the residual at the values that they have by the last tangent's linearisation, where
    Newton's method proper has them; key (ne,): numbers of this rank's elements that no partition changes.
    """

    name: str
    symmetric: bool
    condensed: bool
    key: Ints64
    findings: Findings

    def add_residual(self, state: State, residual: Floats, tool_residual: Floats, trials: Trials | None = None) -> None: ...

    def add_followed_residual(
        self, state: State, residual: Floats, tool_residual: Floats, trials: Trials | None = None
    ) -> None:
        """By default the residual: there are no other unknowns."""
        self.add_residual(state, residual, tool_residual, trials)

    def couplings(self, state: State, trials: Trials | None = None) -> Ints64 | None:
        """None while the couplings given last, at first none, suffice; else keys row * N + column of global blocks.

        They come on top of the cells' own. Called on all ranks before every tangent; another rank may have other keys.
        """
        return None

    def tangent(self, state: State, trials: Trials | None = None) -> Blocks:
        """Blocks of the tangent."""
        ...

    def commit(self, state: State) -> None:
        """Keep what the next step needs of this accepted state."""
        return

    def rollback(self) -> None:
        """Back to what the last accepted step left."""
        return

    def history(self) -> dict[str, Array]:
        """{name: array (ne, ...)} of what commit writes, for elements numbered by `key` (ne,) on any partition alike."""
        return {}

    def restore(self, values: dict[str, Array], state: State) -> None:
        """Take up what history gave, for this rank's elements, at the accepted state."""
        return

    def statuses(self) -> Array:
        """Status codes (n,) of this rank's points at the state evaluated last."""
        return np.empty(0, dtype=int)

    def spots(self) -> Floats:
        """Reference positions (n, 3) of these points."""
        return np.empty((0, 3))


Swelling = tuple[Floats, Floats]  # ratios, and rates of the energy with them


class Energy(NamedTuple):
    """Strain energy as a form, and its rates with the ratios by which bodies swell: with each that is one number, and, as
    linear forms, with those that a field has at its nodes."""

    form: Form
    by_ratio: Sequence[tuple[Constant, Form]] = ()
    by_field: Sequence[tuple[Function, Form]] = ()


class FormTerm(Term):
    """A term given by UFL forms: `residual` (linear) and, unless it does not depend on u, `tangent` (bilinear).

    Each is a form or a list of forms to be summed; quadrature rules that differ go into forms of their own, for FFCx 0.5
    confuses the values of two rules in one kernel. Of a solid: laws, by body, what its Cauchy stress comes from; energy, its
    strain Energy.
    """

    condensed = False
    key: Ints64 = np.empty(0, dtype=np.int64)
    findings: Findings = Healthy()

    def __init__(
        self,
        name: str,
        residual: Form | list[Form] | None,
        tangent: Form | list[Form] | None = None,
        symmetric: bool = True,
        laws: Sequence[Any] = (),
        energy: Energy | None = None,
    ) -> None:
        self.name, self.symmetric, self.laws = name, symmetric, laws
        self._residuals = [LinearForm(form) for form in _listed(residual)]
        self._tangents = [CellForm(form, symmetric) for form in _listed(tangent)]
        self._energy = None if energy is None else compat.compile_form(energy.form)
        self._by_ratio = [(ratio, compat.compile_form(rate)) for ratio, rate in (energy.by_ratio if energy else ())]
        self._by_field = [(field, compat.compile_form(rate)) for field, rate in (energy.by_field if energy else ())]
        self.tangent_form = self._tangents[0].whole if self._tangents else None  # its cells' couplings are the pattern

    def add_residual(self, state: State, residual: Floats, tool_residual: Floats, trials: Trials | None = None) -> None:
        for form in self._residuals:
            form.add(residual)

    def strain_energy(self) -> float:
        """Of this rank's cells at the present displacement [force x length]; zero of a term without."""
        return 0.0 if self._energy is None else compat.assemble_scalar(self._energy)

    def swelling(self) -> tuple[Swelling, list[Swelling]]:
        """Ratios by which bodies swell, and the rates of this rank's strain energy with them [force x length]: of those that
        are one number, (n,), and of each field, at local nodes."""
        numbers = np.array([float(ratio.value) for ratio, _ in self._by_ratio])
        rates = np.array([compat.assemble_scalar(rate) for _, rate in self._by_ratio])
        fields = [(field.x.array.copy(), np.zeros_like(field.x.array)) for field, _ in self._by_field]
        for (_, at_nodes), (_, rate) in zip(fields, self._by_field, strict=True):
            compat.assemble_vector(at_nodes, rate)
        return (numbers, rates), fields

    def tangent(self, state: State, trials: Trials | None = None) -> Blocks:
        return Blocks(forms=tuple(self._tangents))


def _listed(forms: Form | list[Form] | None) -> list[Form]:
    if forms is None:
        return []
    return forms if isinstance(forms, list) else [forms]


class FluidTerm(FormTerm, ABC):
    """What solvers ask of a fluid that comes in where contact lets it."""

    @abstractmethod
    def advance(self, state: State, back: bool) -> bool:
        """Go, in a balanced state, to where it is connected to its source, back: also from what is cut off; has it moved?
        Collective."""

    @abstractmethod
    def gained(self) -> tuple[int, str, str] | None:
        """None where it is as in the accepted state; else how many nodes it has reached since, one of them that lay next to
        it and the one farthest from that, as text. Collective."""

    @abstractmethod
    def opening(self, state: State, more: float) -> tuple[int, str, str] | None:
        """The same of what it would gain in the accepted state if its pressure were greater by a share. Collective."""

    @abstractmethod
    def kept_out(self, state: State) -> tuple[list[str], float]:
        """Names of the contacts that press some node at which the fluid does not act by more than it would, and its greatest
        pressure. Collective."""
