"""The nonlinear system R(u, travel, t) = 0 as a sum of terms, its tangent with the tools' border, and its supports."""

from dataclasses import dataclass
from typing import Protocol

import numpy as np
from petsc4py import PETSc

from fenics_contact import compat
from fenics_contact.assembly.cell_forms import CellForm
from fenics_contact.assembly.exchange import copy_to_ghosts, ghosted_vector, lasting, sum_to_owners
from fenics_contact.assembly.finding import RIGID_MOTION, Finding
from fenics_contact.assembly.holds import ALLOWED
from fenics_contact.assembly.pattern import MatrixPattern
from fenics_contact.assembly.size import bodies_size
from fenics_contact.timing import Timers

TOLERANCE = 1e-8  # out-of-balance share at which steppers call a state balanced, unless told otherwise
ROUNDED = 4.0 * np.finfo(float).eps  # units in the last place by which gaps and positions are known


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


class System:
    """Sum of terms with supports and tools; the steppers know nothing else.

    space: vector space of u; terms: the first one is the solid, whose cells couple its dofs; supports: Supports;
    tools: ToolMotion; set_loads(t): puts the loads of parameter t into the forms; check(least=0.0): None, or the Finding
    that names the place where J is no more than `least`; bodies: (name, local nodes) of each group of bonded bodies.
    """

    def __init__(self, state, terms, supports, tools, set_loads, check=lambda least=0.0: None, bodies=(), timers=None):
        self.state, self.terms, self.supports, self.tools = state, terms, supports, tools
        self.set_loads, self.check, self.bodies = set_loads, check, bodies
        self.timers = timers or Timers()
        for term in terms:
            term.timers = self.timers
        self.space = state.u.function_space
        self.comm = lasting(self.space.mesh.comm)
        self.symmetric = all(term.symmetric for term in terms)
        self.condensed = any(hasattr(term, "add_followed_residual") for term in terms)
        self._pattern = MatrixPattern(terms[0].tangent_form, self.space)
        self._couplings = [np.empty(0, dtype=np.int64)] * len(terms)
        self.matrix = self._new_matrix()
        self.patterns = 1  # matrices made so far
        self.vector = compat.petsc_vector(state.u)
        self.residual_vector, self._work = ghosted_vector(self.space), ghosted_vector(self.space)
        self.border = Border(len(tools), len(state.u.x.array)) if len(tools) else None
        self.tool_residual = np.zeros((len(tools), 3))
        self.bulk_over_shear = 1.0  # the largest of the bodies: what slows an iterative solver
        self.force_scale = 0.0  # largest force norm seen in an accepted state
        self.stiffness = 0.0  # largest diagonal entry of any tangent [force/length]
        self._accepted_stiffness = 0.0
        self.extent = bodies_size(self.space)
        self.reach = self.extent  # largest length of which gaps are differences, tools' radii among them
        self._committed = self._snapshot()
        self.accepted = [self._committed]  # (u local array, travel, t) of the last three accepted states
        self._foreseeing = [term for term in terms if getattr(term, "foresees", False)]
        self.foresees = bool(self._foreseeing)  # has a term unknowns of its own that solves carry along?

    def _new_matrix(self):
        matrix = self._pattern.matrix(np.concatenate(self._couplings))
        matrix.setOption(PETSc.Mat.Option.KEEP_NONZERO_PATTERN, True)
        matrix.setOption(PETSc.Mat.Option.NEW_NONZERO_ALLOCATION_ERR, True)
        if self.symmetric:
            matrix.setOption(PETSc.Mat.Option.SYMMETRIC, True)
        return matrix

    # -- steps ----------------------------------------------------------------------------------------------------
    def _snapshot(self):
        return self.state.u.x.array.copy(), self.state.travel.copy(), self.state.t

    def begin_step(self, t):
        """Set the loads of t; returns the motion still owed: du on the supports' dofs and dq of the moved tools."""
        self.state.t = t
        self.set_loads(t)
        owed = self.supports.values(t) - self.state.u.x.array[self.supports.dofs]
        return owed, np.where(self.tools.free, 0.0, self.tools.prescribed(t) - self.state.travel)

    def commit(self):
        for term in self.terms:
            term.commit(self.state)
        self.force_scale = max(self.force_scale, self.forces)
        self._committed, self._accepted_stiffness = self._snapshot(), self.stiffness
        self.accepted = [*self.accepted[-2:], self._committed]

    def rollback(self):
        """Return to the last committed state."""
        self.release()
        for term in self.terms:
            if hasattr(term, "drop"):
                term.drop()
        self.stiffness = self._accepted_stiffness  # that of an iterate gone astray must not loosen what counts as balance
        u, travel, t = self._committed
        self.state.u.x.array[:] = u
        self.state.travel[:] = travel
        self.state.t = t
        self.set_loads(t)

    def resume(self, travel, t):
        """Declare the displacement in the state, with this travel and t, the committed one; the terms know their history."""
        self.state.travel[:] = travel
        self.state.t = t
        self.set_loads(t)
        self._committed, self._accepted_stiffness = self._snapshot(), self.stiffness
        self.accepted = [self._committed]
        for term in self.augmented:
            term.drop()
        self.assemble_residual()  # the terms' tractions and the reactions are those of the state

    def extrapolate(self, owed):
        """Put the state, of parameter t, on the parabola or line through the last accepted ones, supports in their places.

        owed: supports' displacements still missing. False, and nothing moved, where the supports leave both curves, where
        an element would turn inside out, or where no term foresees the kinks of a contact.
        """
        if not self._foreseeing or self.condensed or len(self.tools):
            return False
        u, dofs = self._committed[0], self.supports.dofs
        for count in (3, 2):
            step = self._onwards(self.accepted[-count:]) if len(self.accepted) >= count else None
            if step is None or self._strays(step[dofs] - owed, owed):
                continue
            step[dofs] = owed
            self.state.u.x.array[:] = u + step
            for term in self._foreseeing:
                term.hold((self.state.t - self._committed[2]) / (self._committed[2] - self.accepted[-2][2]))
            if np.isfinite(self.assemble_residual()):
                return True
            self.release()
            self.state.u.x.array[:] = u
        return False

    def _onwards(self, states):
        """Displacement from the last of these states to the present t on the polynomial through all of them (Lagrange)."""
        times = np.array([state[2] for state in states])
        step = -states[-1][0]
        for i, (u, _, t) in enumerate(states):
            others = np.delete(times, i)
            step = step + np.prod((self.state.t - others) / (t - others)) * u
        return step

    def _strays(self, gap, owed):
        """True where supports would end further from their places than half the way they go. Collective."""
        sizes = self.comm.allreduce(np.array([np.sum(gap**2), np.sum(owed**2)]))
        return bool(sizes[0] > 0.25 * sizes[1])

    def foresee(self):
        """Let the terms take what the last tangent foresees at the state as their own unknowns, until `release`."""
        for term in self._foreseeing:
            term.foresee(self.state)

    def release(self):
        for term in self.contacts:
            term.release()

    @property
    def augmented(self):
        """The terms with multipliers, or with springs that follow, in this step."""
        return [term for term in self.terms if getattr(term, "tolerance", None) is not None]

    def misfit(self):
        """Largest error of the augmented terms over their tolerances. Collective."""
        return max(self.comm.allgather(max((term.misfit(self.state) for term in self.augmented), default=0.0)))

    def augment(self):
        """Let the augmented terms' multipliers take over what penalties carry, until the next rollback or commit."""
        for term in self.augmented:
            term.augment(self.state)

    @property
    def committed(self):
        """Displacement (local array) and travel (tools, 3) of the last accepted state."""
        return self._committed[:2]

    @property
    def committed_t(self):
        return self._committed[2]

    def new_vector(self):
        """A PETSc vector like u, of owned and ghost dofs, zero."""
        vector = self.residual_vector.duplicate()
        with vector.localForm() as local:
            local.set(0.0)
        return vector

    @property
    def noise(self):
        """Out-of-balance force [force] that the last places of the coordinates make: no iteration gets below it."""
        return self.stiffness * ROUNDED * self.reach

    @property
    def scale(self):
        """What out-of-balance forces are compared with [force]: the largest force of any term, now or before.

        A body that moves without strain has no other scale than rounding.
        """
        moved = self.vector.norm(PETSc.NormType.NORM_INFINITY)
        return max(self.forces, self.force_scale, 1e-4 * self.stiffness * moved, self.noise / TOLERANCE)

    def update(self, du, dq, share=1.0):
        """Add a PETSc increment (owned part) and a travel increment to the state.

        share: how much of the last tangent solve's increment the state then holds.
        """
        self.vector.axpy(1.0, du)
        copy_to_ghosts(self.vector)
        self.state.travel += dq
        self.state.share = share

    def objection(self):
        """None, or the Finding why a state in balance must not be accepted. Collective."""
        found = self.check()
        for term in self.terms:
            found = found or term.objection(self.state)
        return found or self.adrift()

    def loose(self):
        """Numbers of the bodies that contacts alone hold, and whose contacts do not press in this state. Collective."""
        if not self.holds.reliant:
            return set()
        least = ALLOWED * max(self.forces, self.force_scale)
        return set(self.holds.loose(lambda contact: contact.holding(self.state, least)))

    def adrift(self):
        """None, or the Finding that a body has lost what holds it: then any place is in balance, and none is the answer."""
        if self.grounding is None or self.grounding.engaged or not (loose := self.loose()):
            return None
        names = ", ".join(self.bodies[i][0] for i in sorted(loose))
        remedy = "solve(..., stabilise=True), fix a surface, or end the path before"
        return Finding(RIGID_MOTION, "no contact that could hold it presses any more", f"body '{names}'", remedy)

    # -- evaluation -----------------------------------------------------------------------------------------------
    def assemble_residual(self, followed=False):
        """Fill residual_vector (supports' dofs zero) and tool_residual; returns the out-of-balance norm [force].

        `forces` is then the largest norm of a single term, reactions included: the scale of the residual.
        followed: with condensed unknowns where the last tangent's linearisation puts them, see Term.
        """
        total = self.residual_vector
        total.set(0.0)
        tool_residual = np.zeros_like(self.tool_residual)
        self.forces = 0.0
        for term in self.terms:
            with self.timers("residual"):
                with self._work.localForm() as local:
                    local.set(0.0)
                    array = local.array_w
                    add = getattr(term, "add_followed_residual", term.add_residual) if followed else term.add_residual
                    add(self.state, array, tool_residual)
                sum_to_owners(self._work)
                self.forces = max(self.forces, self._work.norm())
                total.axpy(1.0, self._work)
        self.tool_residual = self.comm.allreduce(tool_residual) - self.tools.forces(self.state.t)
        with total.localForm() as local:
            self.reactions = local.array_r[self.supports.dofs].copy()
            local.array_w[self.supports.dofs] = 0.0
        free = self.tool_residual[self.tools.free]
        return float(np.hypot(total.norm(), np.linalg.norm(free)))

    def assemble_tangent(self, terms=None):
        """Fill the matrix (supports not yet eliminated) and the border, with some of the terms if so asked."""
        with self.timers("insertion"):
            self._provide_couplings()
        if self.border is not None:
            self.border.clear()
        for term in self.terms if terms is None else terms:
            with self.timers("bulk tangent"):
                term.add_tangent(self.state, self.matrix, self.border)
        with self.timers("insertion"):
            self.matrix.assemble()
            self.stiffness = max(self.stiffness, self.matrix.getDiagonal().norm(PETSc.NormType.NORM_INFINITY))
            if self.border is not None:
                self.border.corner = self.comm.allreduce(self.border.corner)

    def _provide_couplings(self):
        """Clear the matrix; where a term asks for other couplings, on any rank, put a new one in its place."""
        changed = False
        for i, term in enumerate(self.terms):
            keys = term.couplings(self.state)
            if keys is not None:
                self._couplings[i], changed = keys, True
        if self.comm.allreduce(int(changed)):
            self.matrix = self._new_matrix()
            self.patterns += 1
        elif self.matrix.assembled:
            self.matrix.zeroEntries()

    def border_vector(self, values):
        """Local array of a border row or column (owned and ghost dofs) -> PETSc vector summed over ranks."""
        vector = self.new_vector()
        with vector.localForm() as local:
            local.array_w[:] = values
        sum_to_owners(vector)
        return vector
