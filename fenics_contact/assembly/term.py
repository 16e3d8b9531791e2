"""What a System sums: terms of the virtual power, and the state they depend on."""

from dataclasses import dataclass
from typing import Protocol

import numpy as np

from fenics_contact import compat
from fenics_contact.assembly.blocks import Blocks
from fenics_contact.assembly.cell_forms import CellForm


@dataclass
class State:
    """Displacement u (Function, [length]), travel of the tools (tools, 3) [length] and load parameter t.

    share: how much of the last tangent solve's increment is in u; terms with unknowns of their own follow by it.
    """

    u: object
    travel: np.ndarray
    t: float = 0.0
    share: float = 1.0


class Term(Protocol):
    """A part of the virtual power. Evaluation depends on the state and the trial only; only commit writes history.

    symmetric: is its tangent so; condensed: has it unknowns of its own that are condensed out, for which
    add_followed_residual gives the residual at the values that they have by the last tangent's linearisation, where
    Newton's method proper has them; timers: seconds by stage.
    """

    name: str
    symmetric: bool
    condensed: bool

    def add_residual(self, state, residual, tool_residual, trial=None): ...

    def add_followed_residual(self, state, residual, tool_residual): ...

    def couplings(self, state):
        """None while the couplings given last, at first none, suffice; else keys row * N + column of global blocks.

        They come on top of the cells' own. Called on all ranks before every tangent; another rank may have other keys.
        """

    def tangent(self, state, trial=None):
        """Blocks of the tangent."""

    def commit(self, state): ...

    def rollback(self):
        """Back to what the last accepted step left."""

    def history(self):
        """{name: array (ne, ...)} of what commit writes, for elements numbered by `key` (ne,) on any partition alike."""

    def restore(self, values, state):
        """Take up what history gave, for this rank's elements, at the accepted state."""

    def statuses(self):
        """Status codes (n,) of this rank's points at the state evaluated last."""

    def spots(self):
        """Reference positions (n, 3) of these points."""

    def objection(self, state):
        """None, or the Finding why this state, evaluated last, must not be accepted though it is in balance. Collective."""

    def trouble(self, state):
        """None, or the Finding that keeps the step after this accepted state from converging. Collective."""

    def remark(self, state):
        """None, or what is to be said of an accepted state. Collective."""


class FormTerm:
    """A term given by UFL forms: `residual` (linear) and, unless it does not depend on u, `tangent` (bilinear).

    Each is a form or a list of forms to be summed; quadrature rules that differ go into forms of their own, for FFCx 0.5
    confuses the values of two rules in one kernel. laws: of a solid, by body, what its Cauchy stress comes from.
    """

    condensed = False

    def __init__(self, name, residual, tangent=None, symmetric=True, laws=()):
        self.name, self.symmetric, self.laws = name, symmetric, laws
        self._residuals = [compat.compile_form(form) for form in _listed(residual)]
        self._tangents = [CellForm(form) for form in _listed(tangent)]
        self.tangent_form = self._tangents[0].whole if self._tangents else None  # its cells' couplings are the pattern

    def add_residual(self, state, residual, tool_residual, trial=None):
        for form in self._residuals:
            compat.assemble_vector(residual, form)

    def add_followed_residual(self, state, residual, tool_residual):
        """The residual: there are no other unknowns."""
        self.add_residual(state, residual, tool_residual)

    def couplings(self, state):
        """None: the cells' own couplings are the pattern's base."""

    def tangent(self, state, trial=None):
        return Blocks(forms=tuple(self._tangents))

    def commit(self, state):
        """Forms keep no history."""

    def rollback(self):
        """Nothing to take back."""

    def history(self):
        """None to keep."""
        return {}

    def restore(self, values, state):
        """Nothing to take up."""

    def statuses(self):
        return np.empty(0, dtype=int)

    def spots(self):
        return np.empty((0, 3))

    def objection(self, state):
        """None: forms compute no differences of coordinates."""

    def trouble(self, state):
        """None: what forms suffer from is found in the tangent."""

    def remark(self, state):
        """None."""


def _listed(forms):
    if forms is None:
        return []
    return forms if isinstance(forms, list) else [forms]
