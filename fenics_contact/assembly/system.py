"""The nonlinear system R(u, q, t) = 0 as a sum of terms, its tangent with the tools' border, and its supports."""

from collections.abc import Callable, Iterable, Iterator, Sequence
from contextlib import contextmanager, nullcontext

import numpy as np
from mpi4py import MPI
from petsc4py import PETSc

from fenics_contact import compat
from fenics_contact.assembly.acceptance import Acceptance, Cells
from fenics_contact.assembly.blocks import Blocks, insert
from fenics_contact.assembly.border import Border
from fenics_contact.assembly.damping import Damping
from fenics_contact.assembly.exchange import copy_to_ghosts, ghosted_vector, lasting, sum_to_owners
from fenics_contact.assembly.finding import Foremost, foremost
from fenics_contact.assembly.foresight import Foresight
from fenics_contact.assembly.grounding import Grounding
from fenics_contact.assembly.holds import Holds
from fenics_contact.assembly.pattern import Couplings
from fenics_contact.assembly.scales import Scales
from fenics_contact.assembly.size import bodies_size, farthest
from fenics_contact.assembly.spring_term import SpringTerm
from fenics_contact.assembly.stages import End
from fenics_contact.assembly.term import FluidTerm, FormTerm, State, Term
from fenics_contact.assembly.tool_motion import ToolMotion
from fenics_contact.assembly.trail import Trail
from fenics_contact.assembly.trial import Trials
from fenics_contact.timing import Timers
from fenics_contact.types import Floats, Vec

Terms = tuple[FormTerm, *tuple[Term, ...]]  # the solid first


class System:
    """Sum of terms with supports and tools; the steppers know nothing else.

    A step begins with begin_step; residual, tangent and update take it into balance; where `acceptance` has no objection to
    the state there, `trail` commits it, and rolls back otherwise. `scales` say what is balance, `foresight` by what contacts
    judge their points on the way.

    space: vector space of u; terms: the first one is the solid, whose cells couple its dofs and whose laws are the bodies'
    materials; holds: Holds, whose supports and contacts are the System's: supports, contact_terms; driven: ToolMotion of the
    tools, and set_loads(t), which puts the loads of parameter t into the forms;
    cells: what is asked of how these are strained; grounding, damping: those of the terms that are, or None;
    bulk_over_shear: the largest of the bodies, what slows an iterative solver.
    """

    def __init__(
        self,
        state: State,
        terms: Terms,
        holds: Holds,
        driven: tuple[ToolMotion, Callable[[float], None]],
        cells: Cells,
        timers: Timers,
    ) -> None:
        tools, set_loads = driven
        self.state, self.terms, self.tools, self.stages = state, terms, tools, tools.stages
        self.holds, self.supports, self.contact_terms = holds, holds.supports, holds.contacts
        self.set_loads, self.cells, self.timers = set_loads, cells, timers
        self.bulk_over_shear: float = max(law.bulk_modulus / law.shear_modulus for law in terms[0].laws)
        self.bodies = holds.bodies  # (name, local nodes) of each group of bonded bodies
        self.fluids = [term for term in terms if isinstance(term, FluidTerm)]
        self.augmented = [
            contact for contact in self.contact_terms if contact.penetration is not None
        ]  # those with multipliers
        self.springs = [term for term in terms if isinstance(term, SpringTerm)]
        self.grounding = next((term for term in terms if isinstance(term, Grounding)), None)
        self.damping = next((term for term in terms if isinstance(term, Damping)), None)
        # has the user asked for springs in every step, and for damping wherever one fails?
        self.stabilised = self.grounding is not None and self.grounding.always
        self.damped = self.damping is not None and self.damping.always
        self.space = state.u.function_space
        self.comm = lasting(self.space.mesh.comm)
        self.symmetric = all(term.symmetric for term in terms)
        self.condensed = any(term.condensed for term in terms)
        self.couplings = Couplings(terms, self.space, self.symmetric)
        self.matrix = self.couplings.matrix()
        self.vector = compat.petsc_vector(state.u)
        self.residual_vector, self._work = ghosted_vector(self.space), ghosted_vector(self.space)
        self.border = Border(len(tools), len(state.u.x.array)) if len(tools) else None
        self.tool_residual: Floats = np.zeros((len(tools), 6))
        self.extent = bodies_size(self.space)
        far = farthest(self.space) if self.contact_terms else self.extent
        self.scales = Scales(self.vector, self.extent, max(far, tools.reach))
        self._at_rest = self.comm.allreduce(terms[0].strain_energy())  # an energy may be stated with a constant of its own
        self.trail = Trail(state, terms, self.scales, tools.stages, set_loads)
        self.foresight = Foresight(self.contact_terms)
        self.acceptance = Acceptance(state, terms, cells, holds, self.scales, self.grounding)

    # -- a step -------------------------------------------------------------------------------------------------------
    def begin_step(self, t: float) -> tuple[Floats, Floats]:
        """Set the loads of t; returns the motion still owed: du on the supports' dofs and dq of the moved tools."""
        self.state.t = t
        self.set_loads(t)
        owed = self.places(t) - self.supports.held(self.state.u.x.array)
        return owed, np.where(self.tools.free, 0.0, self.tools.prescribed(t) - self.state.q)

    def assemble_residual(self, followed: bool = False, trials: Trials | None = None) -> float:
        """Fill residual_vector (supports' dofs zero) with (23), and tool_residual; returns the out-of-balance norm [force].

        `scales.forces` is then the largest norm of a single term, reactions included: the scale of the residual.
        followed: with condensed unknowns where the last tangent's linearisation puts them; trials: see Term.
        """
        total = self.residual_vector
        total.set(0.0)
        tool_residual = np.zeros_like(self.tool_residual)
        largest = 0.0
        for term in self.terms:
            if term in self.springs and not term.share > 0.0:
                continue
            with self.timers("residual"):
                with self._work.localForm() as local:
                    local.set(0.0)
                    array = local.array_w
                    add = term.add_followed_residual if followed else term.add_residual
                    add(self.state, array, tool_residual, trials)
                sum_to_owners(self._work)
                largest = max(largest, self._work.norm())
                total.axpy(1.0, self._work)
        self.scales.meet(largest)
        with total.localForm() as local:
            self.reactions = self.supports.held_forces(local.array_r)
            self.supports.ties.add_wrenches(self.state.poses, self.state.q, local.array_r, tool_residual)
            self.supports.put_forces(local.array_w, 0.0)
        self.comm.Allreduce(MPI.IN_PLACE, tool_residual)
        self.tool_residual = tool_residual - self.tools.forces(self.state.t)
        free = self.tool_residual[self.tools.free]
        return float(np.hypot(total.norm(), np.linalg.norm(free)))

    def assemble_tangent(
        self, terms: Sequence[Term] | None = None, trials: Trials | None = None, more: Iterable[Blocks] | None = None
    ) -> None:
        """Fill the matrix (supports not yet eliminated) with the rates of (24), and the border; of some terms if so asked,
        whose motions are those of all nodes and tools, tied or not.

        trials: see Term; more: what is no term's, and tells nothing of scales.
        """
        with self.timers("insertion"):
            self.matrix = self.couplings.suited(self.matrix, self.state, trials)
        with self.timers("bulk tangent"):  # whose blocks nearly all are
            self.matrix.zeroEntries()
        if self.border is not None:
            self.border.clear()
        for term in self.terms if terms is None else terms:
            with self.timers("bulk tangent"):
                blocks = term.tangent(self.state, trials)
            with self.timers("bulk tangent" if blocks.forms else "insertion"):
                insert(blocks, self.matrix, self.border)
            self.foresight.learn(term, blocks.at)
        with self.timers("insertion"):
            self.matrix.assemble()
            self.scales.meet_stiffness(self.matrix.getDiagonal().norm(PETSc.NormType.NORM_INFINITY))
            if more is not None:
                for blocks in more:
                    insert(blocks, self.matrix, self.border)
                self.matrix.assemble()
            if self.border is not None:
                if terms is None and self.supports.ties:
                    self._extend_border(self.border)
                self.border.sum_corner(self.comm)

    def _extend_border(self, border: Border) -> None:
        """Let tools carry along what is tied to them. Collective."""
        forces, state = np.zeros_like(self.state.u.x.array), self.state
        self.supports.put_forces(forces, self.reactions)
        self.supports.ties.extend(border, self.matrix, state.poses, state.q, self.tools.free, forces)

    def update(self, du: Vec, dq: Floats, share: float = 1.0) -> None:
        """Add a PETSc increment (owned part) and one of the tools' coordinates to the state.

        share: how much of the last tangent solve's increment the state then holds.
        """
        self.vector.axpy(1.0, du)
        copy_to_ghosts(self.vector)
        self.state.q += dq
        self.supports.ties.place(self.state.poses, self.state.q, self.state.u.x.array)
        self.state.share = share

    # -- what else is asked of the state ------------------------------------------------------------------------------
    def places(self, t: float) -> Floats:
        """Displacements [length] of the supports' dofs at t: prescribed ones, and where tools at t carry what is tied."""
        values, supports, state = self.supports.values(t), self.supports, self.state
        if supports.ties:
            q, u = np.where(self.tools.free, state.q, self.tools.prescribed(t)), np.zeros_like(state.u.x.array)
            supports.ties.place(state.poses, q, u)
            values[supports.tied] = u[supports.dofs[supports.tied]]
        return values

    def ending(self) -> End:
        """How the stage that is on would end at the committed state; the force on a tool that is moved is what it takes to
        hold it. Collective."""
        self.assemble_residual()
        stated = self.tools.forces(self.state.t)
        forces = np.where(self.tools.free, stated, self.tool_residual + stated)
        return End(self.state.t, self.state.q.copy(), forces)

    @contextmanager
    def as_accepted(self) -> Iterator[None]:
        """Contacts see meanwhile what they saw when the last state was accepted, and springs are faint: how bodies give way
        there by themselves is asked."""
        with self.foresight.as_accepted(), self.grounding.faint() if self.grounding else nullcontext():
            yield

    def length(self, du: Vec, dq: Floats) -> float:
        """Of a motion: root of the mean square over the nodes, tools on top [length]. Collective."""
        return float(np.sqrt(du.dot(du) / (du.getSize() / 3) + np.sum(dq**2)))

    def longest(self, vectors: Floats) -> Foremost | None:
        """The node at which one of vectors (3 n,), of owned nodes and maybe ghosts behind them, is longest. Collective."""
        X = self.space.tabulate_dof_coordinates()[: self.space.dofmap.index_map.size_local]
        return foremost(self.comm, np.linalg.norm(vectors.reshape(-1, 3)[: len(X)], axis=1), X)

    def still(self) -> tuple[Floats, Floats]:
        """Increments of the supports' dofs and of the tools' coordinates that stay where they are."""
        return np.zeros(len(self.supports.dofs)), np.zeros_like(self.state.q)

    def strain_energy(self) -> float:
        """Of the bodies at the state, over that at rest [force x length]. Collective."""
        return self.comm.allreduce(self.terms[0].strain_energy()) - self._at_rest

    def new_vector(self) -> Vec:
        """A PETSc vector like u, of owned and ghost dofs, zero."""
        vector = self.residual_vector.duplicate()
        with vector.localForm() as local:
            local.set(0.0)
        return vector

    def border_vector(self, values: Floats) -> Vec:
        """Local array of a border row or column (owned and ghost dofs) -> PETSc vector summed over ranks."""
        vector = self.new_vector()
        with vector.localForm() as local:
            local.array_w[:] = values
        sum_to_owners(vector)
        return vector
