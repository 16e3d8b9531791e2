"""A solid whose pressure lives cell by cell and is condensed out, so that only the displacement stays unknown."""

from collections.abc import Sequence
from typing import Any

import numpy as np

from fenics_contact import compat
from fenics_contact.assembly.blocks import Blocks
from fenics_contact.assembly.term import Energy, FormTerm, State, Swelling
from fenics_contact.assembly.trial import Trials
from fenics_contact.types import Array, Floats, Form, Function, Ints64, Space


class CellBlocks:
    """A bilinear form between a space without continuity and another one, as one dense block per owned cell."""

    def __init__(self, form: Form, rows: Space, columns: Space) -> None:
        self._form, self._matrix = form, compat.create_matrix(form)
        cells = compat.cell_map(rows.mesh).size_local
        numbers = _dofs(columns, compat.global_blocks(columns))[:cells]
        self._rows = _dofs(rows)[:cells]
        self.shape = *self._rows.shape, numbers.shape[1]
        # PETSc keeps a row's columns in rising order; these are their places in the cell
        self._order = np.argsort(numbers, axis=1)[:, None, :]

    def assemble(self) -> Floats:
        """Blocks (cells, rows per cell, columns per cell) at the present coefficients. Collective."""
        self._matrix.zeroEntries()
        compat.assemble_matrix(self._matrix, self._form)
        self._matrix.assemble()
        values = self._matrix.getValuesCSR()[2].reshape(-1, self.shape[2])[self._rows]
        blocks = np.empty(self.shape)
        np.put_along_axis(blocks, np.broadcast_to(self._order, self.shape), values, axis=2)
        return blocks


def _dofs(space: Space, blocks: Ints64 | None = None) -> Ints64:
    """(cells, dofs per cell): local numbers, or those of the numbering `blocks`."""
    size = space.dofmap.index_map_bs
    own = compat.cell_dofs(space)
    cells: Array = own if blocks is None else blocks[own]
    return (size * cells[..., None] + np.arange(size)).reshape(len(cells), size * cells.shape[1])  # of no cells too


class CondensedPressure(FormTerm):
    """The three-field solid of Simo, Taylor & Pister (1985, doi:10.1016/0045-7825(85)90033-7), in u alone.

    In every cell the dilatation theta is the projection of J, the pressure p that of the energy's slope in theta:

        M theta = int q J dX,    M p = int q E_theta dX,    M = int q q dX,

    and the residual is the virtual power at this p(u): a pure function of u. E(F, theta) is W(F) + U(theta), or
    has a third part that both are in (`materials.at_dilatation`). The residual's derivative is
    K(p) + B^T D B + B^T M^-1 C + C^T M^-1 B with B = int q J div v dX, C = int q (dE_theta/du . v) dX and
    D = M^-1 (int q E_theta,theta q dX) M^-1.

    In K(p), the tangent at fixed pressure, p is not p(u) but the one Newton's method gives a pressure that is an unknown
    of its own: p + s (p(u) - p) + (D B + M^-1 C) du after a share s of the last tangent's increment. Far from the solution
    p(u) = K (J - 1) carries K times the second-order error of J, which makes Newton diverge at large K / mu; this one
    does not. The line search looks at the residual of the same pressure. At the first tangent after a commit or a rollback
    it is the committed state's, so that a step cut back equals a small step.

    power: residual, which holds `pressure`, and tangent, which holds `predicted`; forms: compiled `volume` int q J, `law`
    int q E_theta, `stiffness` int q E_theta,theta q, `mass` M, `coupling` B and, unless it is zero, `cross` C; fields:
    Functions pressure, predicted, dilatation in q's space, written here.
    """

    condensed = True

    def __init__(
        self,
        power: tuple[Form, Form],
        forms: dict[str, Form],
        u: Function,
        fields: tuple[Function, Function, Function],
        laws: Sequence[Any] = (),
        energy: Energy | None = None,
    ) -> None:
        super().__init__("solid", *power, laws=laws, energy=energy)
        self.pressure, self._predicted, self._dilatation = fields
        self._forms, q, v = forms, self.pressure.function_space, u.function_space
        self._coupling = CellBlocks(forms["coupling"], q, v)
        self._stiffness = CellBlocks(forms["stiffness"], q, q)
        self._cross = CellBlocks(forms["cross"], q, v) if "cross" in forms else None
        mass = CellBlocks(forms["mass"], q, q)
        self._inverse_mass = np.linalg.inv(mass.assemble())
        cells = len(self._inverse_mass)
        self._pressure_dofs = _dofs(q)[:cells]
        self._dofs = _dofs(v)[:cells]
        self._blocks = np.ascontiguousarray(compat.cell_dofs(v)[:cells])
        self._start = u.x.array.copy(), self._cell_values(self._predicted)  # committed displacement and its prediction
        self.key = compat.original_cells(u.function_space.mesh)[:cells].astype(np.int64)
        # displacement, pressure, the eliminated one and its slope (cells, q, dofs) at the last tangent
        self._last: tuple[Floats, Floats, Floats, Floats] | None = None

    def _cell_values(self, function: Function) -> Floats:
        return function.x.array[self._pressure_dofs]

    def _projected(self, form: str, target: Function) -> Floats:
        """Put the projection of what the linear form integrates against q into target; returns its values by cell."""
        integral = np.zeros(len(target.x.array))
        compat.assemble_vector(integral, self._forms[form])
        values = np.einsum("cij,cj->ci", self._inverse_mass, integral[self._pressure_dofs])
        target.x.array[self._pressure_dofs] = values
        return values

    def _evaluate(self) -> Floats:
        """Dilatation and pressure of the present displacement; returns the pressure by cell."""
        self._projected("volume", self._dilatation)
        return self._projected("law", self.pressure)

    def _follow(self, state: State) -> Floats:
        """Put the pressure that follows the last tangent into `predicted`, and return it by cell."""
        u = state.u.x.array
        if np.array_equal(u, self._start[0]):
            values = self._start[1]
        elif self._last is None:
            values = self._evaluate()
        else:
            before, own, eliminated, slope = self._last
            values = own + state.share * (eliminated - own) + np.einsum("cij,cj->ci", slope, (u - before)[self._dofs])
        self._predicted.x.array[self._pressure_dofs] = values
        return values

    def add_residual(self, state: State, residual: Floats, tool_residual: Floats, trials: Trials | None = None) -> None:
        self._evaluate()
        super().add_residual(state, residual, tool_residual)

    def add_followed_residual(
        self, state: State, residual: Floats, tool_residual: Floats, trials: Trials | None = None
    ) -> None:
        """The residual at the pressure of the tangent."""
        kept = self._evaluate()
        self.pressure.x.array[self._pressure_dofs] = self._follow(state)
        super().add_residual(state, residual, tool_residual)
        self.pressure.x.array[self._pressure_dofs] = kept

    def strain_energy(self) -> float:
        """Of this rank's cells, the volume's at their dilatations [force x length]."""
        self._evaluate()
        return super().strain_energy()

    def swelling(self) -> tuple[Swelling, list[Swelling]]:
        """As of other solids, the volume's at their dilatations."""
        self._evaluate()
        return super().swelling()

    def tangent(self, state: State, trials: Trials | None = None) -> Blocks:
        eliminated, own = self._evaluate(), self._follow(state)
        coupling = self._coupling.assemble()
        dilatation = self._inverse_mass @ coupling  # its rate with the cell's displacement
        if self._cross is None:
            slope = self._inverse_mass @ (self._stiffness.assemble() @ dilatation)
            blocks = coupling.transpose(0, 2, 1) @ slope
        else:
            cross = self._cross.assemble()
            slope = self._inverse_mass @ (self._stiffness.assemble() @ dilatation + cross)
            blocks = coupling.transpose(0, 2, 1) @ slope + cross.transpose(0, 2, 1) @ dilatation
        self._last = state.u.x.array.copy(), own, eliminated, slope
        return Blocks(forms=tuple(self._tangents), cells=(self._blocks, blocks))

    def commit(self, state: State) -> None:
        """Keep the pressure at the accepted displacement: where the next step, or its repetition, starts."""
        self._evaluate()
        self._start = state.u.x.array.copy(), self._follow(state)

    def history(self) -> dict[str, Array]:
        """The committed prediction of the pressure, by owned cell (cells, q)."""
        return {"pressure": self._start[1]}

    def restore(self, values: dict[str, Array], state: State) -> None:
        """The displacement is the committed one already."""
        self._start = state.u.x.array.copy(), np.array(values["pressure"])
