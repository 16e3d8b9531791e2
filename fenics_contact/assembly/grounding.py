"""Stabilisation of bodies and tools that nothing holds yet: soft springs whose far ends follow until they pull no more."""

import numpy as np

from fenics_contact import compat
from fenics_contact.assembly.cell_forms import CellForm
from fenics_contact.assembly.finding import RIGID_MOTION, Finding
from fenics_contact.assembly.holds import ALLOWED
from fenics_contact.assembly.term import FormTerm

SHARE = 1e-2  # stiffness of the springs over E V / L^2 of a body of volume V and size L: a hundredth of its own
SOFTER = 0.25  # change of stiffness where the springs pull as before: nothing has been met yet
LEAST = 1e-6  # of that stiffness


class Grounding(FormTerm):
    """Springs kappa (u - u_0) per reference volume, and alike on free tools, with u_0 at first the last accepted state.

    Within a load step u_0 follows u, solve by solve, until the springs pull less than ALLOWED of the largest force
    (proximal point iteration, Rockafellar 1976, doi:10.1137/0314056): what balances then is the scene without them.
    share: Constant, kappa over E/L^2; reference: Function u_0; forms: (residual, tangent, the bodies' strain energy with
    one test value per cell), compiled when first needed; energies: Function of these values; on_tools [force/length]:
    stiffness at share 1 of free (tools, 3) components of the tools' travel; always: asked for by the user, in every step;
    else in those alone for which `engaged` is set.
    """

    def __init__(self, share, reference, forms, energies, on_tools, free, always):
        super().__init__("stabilisation", None, None)
        self._share, self._reference, self._free, self._on_tools = share, reference, free, on_tools
        self._forms, self._energy, self._cells = forms, None, energies
        self._travel = np.zeros(free.shape)
        self._pull, self._left, self._engaged = None, 0.0, False
        self.always, self.used = always, False
        self.most = {"energy": 0.0, "energy_share": 0.0}  # largest of all accepted steps, [force length]

    def bind(self, system):
        """Forces are compared with the largest of this System; the committed state is where its springs begin."""
        self._system = system
        self.engaged = self.always

    @property
    def engaged(self):
        return self._engaged

    @engaged.setter
    def engaged(self, wanted):
        """Put the springs in, from the last accepted state on, or take them out. Collective."""
        if wanted and self._energy is None:
            residual, tangent, energy = self._forms
            self._residuals, self._tangents = [compat.compile_form(residual)], [CellForm(tangent)]
            self._energy = compat.compile_form(energy)
        self._engaged, self._left, self.used = wanted, 0.0, self.used or wanted
        self.drop()

    def drop(self):
        if self._pull is not None:
            self._left = self._pull
        self._pull, self._share.value = None, SHARE
        self._follow(*self._system.committed)

    def _follow(self, u, travel):
        self._reference.x.array[:] = u
        self._travel = travel.copy()

    def add_residual(self, state, residual, tool_residual):
        if not self._engaged:
            return
        super().add_residual(state, residual, tool_residual)
        if self._rank == 0:
            tool_residual += self._tool_pull(state)

    @property
    def _rank(self):
        return self._reference.function_space.mesh.comm.rank

    def _tool_pull(self, state):
        return np.where(self._free, float(self._share.value) * self._on_tools * (state.travel - self._travel), 0.0)

    def add_tangent(self, state, matrix, border):
        if not self._engaged:
            return
        super().add_tangent(state, matrix, border)
        if border is not None and self._rank == 0:
            border.corner += np.diag(float(self._share.value) * self._on_tools * self._free.ravel())

    def _work(self, state):
        """(force on the springs [force], their energy [force length]). Collective."""
        local, moved = np.zeros_like(state.u.x.array), state.u.x.array - self._reference.x.array
        FormTerm.add_residual(self, state, local, None)
        tools = self._tool_pull(state)
        comm = state.u.function_space.mesh.comm
        force, work = comm.allreduce(np.array([np.abs(local).sum(), local @ moved]))
        return force + np.abs(tools).sum(), 0.5 * (work + float((tools * (state.travel - self._travel)).sum()))

    def pull(self, state):
        """Pull of the springs over the largest force, over what is allowed. Collective."""
        force, _ = self._work(state)
        largest = max(self._system.forces, self._system.force_scale)
        pull = force / (largest * ALLOWED) if largest > 0.0 else 0.0
        self._before, self._pull = self._pull, pull
        return pull

    def follow(self, state):
        """Let the far ends go to where the state is, with softer springs where these pulled as before."""
        if self._before is not None and self._pull > 0.5 * self._before:
            self._share.value = max(SOFTER * float(self._share.value), LEAST * SHARE)
        self._follow(state.u.x.array, state.travel)

    def commit(self, state):
        if not self._engaged:
            return
        _, energy = self._work(state)
        cells = np.zeros(len(self._cells.x.array))
        compat.assemble_vector(cells, self._energy)
        owned = self._cells.function_space.dofmap.index_map.size_local
        elastic = state.u.function_space.mesh.comm.allreduce(float(cells[:owned].sum()))
        share = energy / elastic if elastic > 0.0 else 0.0
        self.most = {"energy": max(energy, self.most["energy"]), "energy_share": max(share, self.most["energy_share"])}
        self._pull, self._share.value = None, SHARE
        self._follow(state.u.x.array, state.travel)

    def trouble(self, state):
        if self._left * ALLOWED > 0.1:
            text = "the stabilisation still carries the load: no contact has been met that holds the bodies"
            return Finding(RIGID_MOTION, text, remedy="close the gap, fix a surface, or turn the load towards the contact")
        return None
