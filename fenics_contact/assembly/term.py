"""What a System sums: terms of the virtual power, the state they depend on, and the border of the tools' travel."""

from dataclasses import dataclass
from typing import Protocol

import numpy as np

from fenics_contact import compat
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
    """A part of the virtual power. Evaluation depends on the state and committed history only; only commit writes.

    A term with `foresees` set offers hold(share), foresee(state) and release(), between which its evaluation depends on
    unknowns of its own too, e.g. contact pressures, which a stepper's solves carry along. A term without the attribute
    has no such unknowns and no kinks either.

    A term whose `tolerance` [length] is not None has multipliers that only augment(state) changes; misfit(state) is its
    error over the tolerance. One with raise_penalty(state), collective, changes penalties and says so, or gives None.
    drop(), where there is one, takes all of this back to the last commit.
    """

    name: str
    symmetric: bool
    penalised: bool  # has it penalties: stiffen(state, factor), relax(), resultants(state) -> (forces (n,), pressures (m,))

    def add_residual(self, state, residual, tool_residual): ...

    def couplings(self, state):
        """None while the couplings given last, at first none, suffice; else keys row * N + column of global blocks.

        They come on top of the cells' own. Called on all ranks before every tangent; another rank may have other keys.
        """

    def add_tangent(self, state, matrix, border): ...

    def commit(self, state): ...

    def history(self):
        """{name: array (ne, ...)} of what commit writes, for elements numbered by `key` (ne,) on any partition alike."""

    def restore(self, values):
        """Take up what history gave, for this rank's elements."""

    def statuses(self):
        """Status codes (n,) of this rank's points at the state evaluated last."""

    def spots(self):
        """Reference positions (n, 3) of these points."""

    def objection(self, state):
        """None, or the Finding why this state, evaluated last, must not be accepted though it is in balance. Collective."""

    def trouble(self, state):
        """None, or the Finding that keeps the step after this accepted state from converging. Collective."""

    # A term that condenses unknowns of its own also offers add_followed_residual, with the arguments of add_residual: the
    # residual at the values its unknowns have by the last tangent's linearisation, where Newton's method proper has them.


class Border:
    """Couplings with the tools' travel: columns, rows (3 tools, local dofs) and corner (3 tools, 3 tools)."""

    def __init__(self, tools, dofs):
        self.columns = np.zeros((3 * tools, dofs))
        self.rows = np.zeros((3 * tools, dofs))
        self.corner = np.zeros((3 * tools, 3 * tools))

    def clear(self):
        for part in (self.columns, self.rows, self.corner):
            part[:] = 0.0


class FormTerm:
    """A term given by UFL forms: `residual` (linear) and, unless it does not depend on u, `tangent` (bilinear).

    Each is a form or a list of forms to be summed; quadrature rules that differ go into forms of their own, for FFCx 0.5
    confuses the values of two rules in one kernel.
    """

    penalised = False

    def __init__(self, name, residual, tangent=None, symmetric=True):
        self.name, self.symmetric = name, symmetric
        self._residuals = [compat.compile_form(form) for form in _listed(residual)]
        self._tangents = [CellForm(form) for form in _listed(tangent)]
        self.tangent_form = self._tangents[0].whole if self._tangents else None  # its cells' couplings are the pattern

    def add_residual(self, state, residual, tool_residual):
        for form in self._residuals:
            compat.assemble_vector(residual, form)

    def couplings(self, state):
        """None: the cells' own couplings are the pattern's base."""

    def add_tangent(self, state, matrix, border):
        for form in self._tangents:
            form.add(matrix)

    def commit(self, state):
        """Forms keep no history."""

    def history(self):
        """None to keep."""
        return {}

    def restore(self, values):
        """Nothing to take up."""

    def statuses(self):
        return np.empty(0, dtype=int)

    def spots(self):
        return np.empty((0, 3))

    def objection(self, state):
        """None: forms compute no differences of coordinates."""

    def trouble(self, state):
        """None: what forms suffer from is found in the tangent."""


def _listed(forms):
    if forms is None:
        return []
    return forms if isinstance(forms, list) else [forms]
