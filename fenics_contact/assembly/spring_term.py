"""Springs on all bodies and free tools as a term of a System: in it only while their share of stiffness is above zero."""

from collections.abc import Callable

import numpy as np

from fenics_contact.assembly.blocks import Blocks
from fenics_contact.assembly.cell_forms import CellForm, LinearForm
from fenics_contact.assembly.term import FormTerm, State
from fenics_contact.assembly.trial import Trials
from fenics_contact.types import Bools, Constant, Floats, Form, Function

# share of stiffness, places the springs pull to, (residual, tangent), on tools
Springs = tuple[Constant, Function, tuple[Form, Form], float]


class SpringTerm(FormTerm):
    """Forces kappa (u - u_0) per reference volume, and alike on free tools.

    constant: kappa over E/L^2 of a body as a Constant in the forms; reference: Function u_0; forms: (residual, tangent),
    compiled when first needed; on_tools [force/length]: stiffness at share 1 of free components of the tools' coordinates;
    free: which (tools, 6) these are in the stage that is on.
    """

    most: dict[str, float]  # the largest values of all accepted steps

    def __init__(
        self,
        name: str,
        constant: Constant,
        reference: Function,
        forms: tuple[Form, Form],
        on_tools: float,
        free: Callable[[], Bools],
    ) -> None:
        super().__init__(name, None, None)
        self._constant, self._reference, self._forms = constant, reference, forms
        self._on_tools, self._free, self._q = on_tools, free, np.zeros(free().shape)

    def recall(self, most: list[float]) -> None:
        """Go on from the values of `most`, in its order, that a checkpoint held."""
        self.most = dict(zip(self.most, most, strict=True))

    @property
    def share(self) -> float:
        """kappa over E/L^2."""
        return float(self._constant.value)

    def resist(self, value: float) -> None:
        """Take springs of this share of stiffness, 0: none."""
        if value > 0.0 and not self._residuals:
            residual, tangent = self._forms
            self._residuals, self._tangents = [LinearForm(residual)], [CellForm(tangent, symmetric=True)]
        self._constant.value = value

    def begin(self, u: Floats, q: Floats) -> None:
        """Pull towards a displacement (local array) and tools' coordinates (tools, 6)."""
        self._reference.x.array[:] = u
        self._q = q.copy()

    @property
    def _first_rank(self) -> bool:
        return self._reference.function_space.mesh.comm.rank == 0

    def _tool_pull(self, state: State) -> Floats:
        return np.where(self._free(), self.share * self._on_tools * (state.q - self._q), 0.0)

    def add_residual(self, state: State, residual: Floats, tool_residual: Floats, trials: Trials | None = None) -> None:
        if self.share > 0.0:
            super().add_residual(state, residual, tool_residual)
            if self._first_rank:
                tool_residual += self._tool_pull(state)

    def tangent(self, state: State, trials: Trials | None = None) -> Blocks:
        if not self.share > 0.0:
            return Blocks()
        on_tools = np.where(self._free(), self.share * self._on_tools, 0.0).ravel() if self._first_rank else None
        return Blocks(forms=tuple(self._tangents), free=on_tools)

    def spent(self, state: State) -> tuple[float, float]:
        """(sum of the forces' sizes [force], their work on the way from u_0 at these forces [force length]). Collective."""
        local, moved = np.zeros_like(state.u.x.array), state.u.x.array - self._reference.x.array
        FormTerm.add_residual(self, state, local, np.zeros_like(self._q))
        tools, comm = self._tool_pull(state), state.comm
        force, work = comm.allreduce(np.array([np.abs(local).sum(), local @ moved]))
        return force + np.abs(tools).sum(), work + float((tools * (state.q - self._q)).sum())
