"""Linear solves with a System's tangent: elimination of supports, choice of solver, the tools' border."""

from functools import partial
from typing import Any

import numpy as np
from petsc4py import PETSc

from fenics_contact.assembly.finding import MEMORY, MOVES, RIGID_MOTION, UNKNOWN
from fenics_contact.assembly.scales import TOLERANCE
from fenics_contact.assembly.system import System
from fenics_contact.solvers.choice import Choice, foreseen_costs
from fenics_contact.solvers.free_rows import Rows
from fenics_contact.solvers.reuse import REUSE_ABOVE, TIGHTEST, ReusingSolver
from fenics_contact.solvers.softest import INVERSE, ITERATIVE, Softest
from fenics_contact.solvers.stalls import Stalls
from fenics_contact.solvers.verdict import StepFailed
from fenics_contact.types import Array, Floats, Mat, Vec

LINEAR = ("auto", "direct", "iterative")  # what a run may ask for
# MUMPS' INFOG(1) where work space or memory does not suffice (its users' guide, section "error diagnostics").
# Not -8, -9 and -14, -15: a nearly singular matrix, whose pivots are delayed, asks for more work space than foreseen.
NO_MEMORY = (-5, -7, -13, -19)
OUT_OF_MEMORY = 55  # PETSc's error code
# Jacobi sweeps that take the rigid-body modes away where a penalty or a support holds a node, and their damping: measured on
# the frictional punch, 20x20x5 and 40x40x10; one sweep, or five, cost up to half as many iterations again.
SWEEPS, DAMPING = 2, 0.9

# Of the stiffest node's, or of those between which it is the difference: less resistance is round-off. At a limit point,
# located to 1e-6 of the way, 1e-7 is left.
LOOSE = 1e-12
# Where the bodies alone give way, soft as a thin arch is beside its contact's penalties, a limit point may leave less. There
# the contact still resists the tool: more than this of the stiffest node's, by the bodies that stand still; and less than
# this resistance, round-off of either sign, tells the direction of a path and not how far the tool goes.
GRIPPED, LEAST = 1e-6, 1e-15

# Iterations of a solve up to SMALL unknowns, where a factorisation costs no more, and may take over
LONGEST_IF_SMALL, SMALL = 100, 30_000
FACTORISE = 'let the linear solver factorise: solve(..., method=Method(linear="auto"))'
ROUGHLY = 1e-2  # relative residual of solves that tell whether an eigenvalue is negative

Side = tuple[Vec, Floats, Floats, Floats]  # right-hand side, tools' one (tools, 6), du on the supports' dofs, dq
Solution = tuple[Vec, Floats]  # du and dq (tools, 6) [length]


# of the tools: Schur complement, rows of the border, and the bodies' responses to unit motions of its columns
_Border = tuple["_Held", list[Vec], list[Vec]]


class LinearFailure(StepFailed):
    """The linear solver could not solve the tangent system."""


class LinearSolver:
    """Solves K du + C dq = -R with prescribed du and dq.

    system: System; method: "direct" (MUMPS: Cholesky where the tangent is symmetric, else LU), "iterative" (CG or GMRES with
    smoothed aggregation and the rigid-body modes), or "auto", see `Choice`. Either is kept from tangent to tangent while it
    pays,
    unless `afresh`: a continuation's tangents are nearly singular, and what an old one tells of the softest motion is wrong;
    there a tool that contact grips counts as held, however little the bodies resist it.
    singular: the tangents are so on purpose, and what hardly resists a tool moves it all the further.
    """

    def __init__(self, system: System, method: str = "auto", afresh: bool = False, singular: bool = False) -> None:
        if method not in LINEAR:
            raise ValueError(f"linear solver '{method}' is not one of {', '.join(LINEAR)}")
        self.system = system
        self._loose, self._turns = 0.0 if singular else LOOSE, afresh
        size = system.vector.getSize()
        self._forced = method == "iterative"
        choice = Choice(system.comm, foreseen_costs(system)) if method == "auto" else None
        method = choice.first_counting if choice and afresh else choice.first if choice else method
        # negative pivots of the last tangent, tools included (Haynsworth 1968, doi:10.1016/0024-3795(68)90050-5); of an
        # unsymmetric one the sign of its determinant tells only whether they are odd, 1, or even, 0; None: not known
        self.negative: int | None = None
        self.fresh = False  # whether the last tangent was factorised itself, and no older one served
        self.tangents = 0  # solved with so far, those of failed steps included
        self._of_border: int | None = 0  # the share of the tools' Schur complement in them
        self._softest: Softest | None = None
        self._pivot: float | None = None
        self._matrix: Mat = None  # with the supports eliminated
        self._border: _Border | None = None  # of the last tangent
        modes = partial(_soft_modes, system)
        # on a continuation's way an iterative solver may fail where a factorisation does not: no trials
        trials = choice if choice and not afresh and size > REUSE_ABOVE else method
        rows = Rows(system.comm, size, system.supports.owned, system.space.mesh.topology.dim == 2)
        self._solver = ReusingSolver(rows, system.symmetric, trials, modes, system.timers, afresh)
        if size <= SMALL and not self._forced:
            self._solver.give_up_after(LONGEST_IF_SMALL)
        self.stalls = Stalls(self._solver, system.trail, lasts=afresh)

    @property
    def method(self) -> str:
        return self._solver.method

    @property
    def again(self) -> str:
        """What a solve `again` is: "cycles" of multigrid, "iterations" over a factorisation, a "substitution", or "little"
        where the matrix is so small that a new tangent costs not much more."""
        if self.method == "iterative":
            return "cycles"
        if self._solver.plain:
            return "little"
        return "substitution" if self._solver.anew else "iterations"

    @property
    def rates(self) -> dict[str, float]:
        """Seconds per digit that each method tried has taken last; {} where the choice was not in doubt."""
        return self.stalls.choice.rates if self.stalls.choice else {}

    @property
    def iterations(self) -> int:
        """Krylov iterations so far."""
        return self._solver.iterations

    @property
    def builds(self) -> int:
        """Factorisations or multigrid hierarchies made so far."""
        return self._solver.builds

    def solve(self, du_supports: Floats, dq: Floats, tolerance: float = TIGHTEST, again: bool = False) -> Solution:
        """Increment (du Vec, dq (tools, 6)) of the assembled tangent and residual.

        du_supports: increments of the supports' local dofs; dq (tools, 6): increments of prescribed tools, zero where free.
        tolerance: relative residual at which an iterative solve may stop; a new factorisation does not look at it.
        again: keep the tangent and factorisation of the last solve; supports and tools then stay where they are.
        Raises LinearFailure, on all ranks, if the solver fails.
        """
        system = self.system
        return self.solve_sides([(system.residual_vector, system.tool_residual, du_supports, dq)], tolerance, again)[0]

    def solve_sides(self, sides: list[Side], tolerance: float = TIGHTEST, again: bool = False) -> list[Solution]:
        """Increments (du, dq) for several sides with one factorisation and one set of the tools' responses.

        sides: (residual Vec, tool residual (tools, 6), du_supports, dq) each. Raises LinearFailure as `solve` does.
        """
        self._tolerance, made = tolerance, self.builds
        self.tangents += not again
        if not again:
            self.stalls.renew()
        system, free = self.system, np.flatnonzero(self.system.tools.free.ravel())
        rights: list[Vec] = []
        for residual, _, _, dq in sides:
            rhs = residual.copy()
            rhs.scale(-1.0)
            self._add_prescribed_motion(rhs, dq)
            rights.append(rhs)
        self._eliminate(rights, [du_supports for _, _, du_supports, _ in sides], again)
        increments = [self._solve(rhs) for rhs in rights]
        self.fresh = self.builds > made or (again and self.fresh)
        PETSc.garbage_cleanup(system.comm)  # Python alone never frees what several ranks share
        for du, (_, _, du_supports, _) in zip(increments, sides, strict=True):
            with du.localForm() as local:
                system.supports.put(local.array_w, du_supports)
        border = system.border
        self.negative, self._of_border = self._solver.negative_pivots(), 0
        if not free.size or border is None:
            return [(du, dq) for du, (_, _, _, dq) in zip(increments, sides, strict=True)]
        if self._border is None or not again:
            columns = [self._response(-border.columns[c]) for c in free]
            rows = [system.border_vector(border.rows[c]) for c in free]
            held = _Held(border.corner[np.ix_(free, free)], rows, columns, system.scales.stiffness, self._loose)
            self._border = held, rows, columns
        self._of_border = self._border[0].negative(system.symmetric)
        if self._of_border is None:
            self.negative = None
        elif self.negative is not None:
            self.negative += self._of_border
            self.negative = self.negative if system.symmetric else self.negative % 2
        return [
            self._with_free_tools(du, dq, -tool_residual.ravel()[free] - border.corner[free] @ dq.ravel(), self._border)
            for du, (_, tool_residual, _, dq) in zip(increments, sides, strict=True)
        ]

    def forget(self) -> None:
        """The next tangent is factorised, or coarsened, itself."""
        self._solver.use(self.method)

    def resists(self) -> bool | None:
        """Whether the last tangent resists every motion, tools included, as far as a few products with it tell; None: not
        known. Of an unsymmetric one whether its determinant is positive. Collective."""
        if self._of_border is None:
            return None
        softest = self._softest_motion()
        body, before = self._solver.resists(softest, self._matrix), self._solver.negative_pivots()
        if body is None and before is None and not self.system.symmetric:  # a small system's hierarchy, each time a new one
            return not (softest.has_turned(self._inverse, ITERATIVE) or self._of_border)
        if body is None or (body and before and self.system.symmetric):  # what was soft then hides what is soft now
            return None
        if self.system.symmetric:
            return body and not self._of_border
        if before is None:  # a cycle may have negative eigenvalues of its own
            body = body or not softest.has_turned(self._inverse, ITERATIVE, alone=True)
        odd = (not body) + (before or 0) + self._of_border
        return odd % 2 == 0

    def count_negative(self, before: float | None) -> int | None:
        """Negative pivots of the tangent factorised last; of an unsymmetric one 2 where its determinant hides motions that
        it does not resist, as a column's that may bend either way, for as long as it is positive. None: not known.

        before: what this was for the state before; what is softest tells no more of two that were found. Collective.
        """
        if self.system.symmetric or self.negative != 0:
            return self.negative
        return 2 if before == 2 or self._softest_motion().has_turned(self._solver.substituted, INVERSE) else 0

    def _softest_motion(self) -> Softest:
        if self._softest is None:
            loads = self.system.new_vector()
            first, end = loads.getOwnershipRange()
            loads.array_w[:] = np.cos(1.7 * np.arange(first, end) ** 1.5)
            self.system.supports.put_forces(loads.array_w, 0.0)
            self._softest = Softest(loads)
        return self._softest

    def _inverse(self, right: Vec, out: Vec) -> int:
        return self._solver.solve(self._matrix, self.system.couplings.patterns, right, out, ROUGHLY)

    def _with_free_tools(self, du: Vec, dq: Floats, right: Floats, border: _Border) -> Solution:
        """The pushed tools' share of an increment. What nothing resists and nothing loads stays where it is."""
        (held, rows, columns), free = border, np.flatnonzero(self.system.tools.free.ravel())
        right = right - [row.dot(du) for row in rows]
        moved, unheld = held.solve(right)
        borne = max(TOLERANCE * self.system.scales.balance, self.system.scales.noise)
        if self._turns and np.abs(unheld).max(initial=0.0) > borne:
            moved, unheld = held.solve(right, turning=True)
        if np.abs(unheld).max(initial=0.0) > borne:
            raise self._unheld(free[np.abs(unheld) > 0.3 * np.abs(unheld).max()])
        for amount, column in zip(moved, columns, strict=True):
            du.axpy(amount, column)
        total = dq.ravel().copy()
        total[free] += moved
        state, loose = self.system.state, np.zeros_like(dq)
        loose.flat[free] = moved
        with du.localForm() as local:
            self.system.supports.ties.follow(state.poses, state.q, loose, local.array_w)
        return du, total.reshape(-1, 6)

    def _unheld(self, components: Array) -> LinearFailure:
        """What to raise where loads act on these components (of tools, 6 each) and nothing resists."""
        ways = [MOVES[axis] for axis in sorted(set(components % 6))]
        names = dict.fromkeys(self.system.tools.names[c // 6] for c in components)
        remedy = "bring it into contact before the force acts, or solve(..., method=Method(stabilise=True))"
        if (components % 6 >= 3).all():
            remedy = "let the moment begin once friction holds it, or prescribe this rotation in its Motion (rx=, ry=, rz=)"
        place = ", ".join(f"tool '{name}'" for name in names)
        return LinearFailure(f"it {', '.join(ways)} and meets no resistance", RIGID_MOTION, place, remedy)

    def _add_prescribed_motion(self, rhs: Vec, dq: Floats) -> None:
        if self.system.border is None:
            return
        for c in np.flatnonzero(dq.ravel()):
            rhs.axpy(-dq.ravel()[c], self.system.border_vector(self.system.border.columns[c]))

    def _eliminate(self, rights: list[Vec], du_supports: list[Floats], again: bool) -> None:
        """Put the supports' increments into the right-hand sides and unit rows into the matrix, keeping its symmetry.

        The supports' own rows get zero on the right, so that norms are those of the unknown part. again: the matrix has its.
        """
        system = self.system
        if self._pivot is None:  # a diagonal of the matrix's own size keeps the multigrid's smoother bounds sane
            self._pivot = max(system.matrix.getDiagonal().norm(PETSc.NormType.NORM_INFINITY), 1e-300)
        du, force = system.new_vector(), system.new_vector()
        for rhs, values in zip(rights, du_supports, strict=True):
            with du.localForm() as local:
                local.set(0.0)
                system.supports.put(local.array_w, values)
            system.matrix.mult(du, force)
            rhs.axpy(-1.0, force)
            system.supports.put_forces(rhs.array_w, 0.0)
        if not again:
            self._matrix = system.supports.eliminated(system.matrix, self._pivot, system.couplings.patterns)

    def _response(self, forces: Floats) -> Vec:
        """du/dq of one free component of a tool: K^-1 (-C), from its column -C as a local array."""
        column = self.system.border_vector(forces)
        with column.localForm() as local:
            self.system.supports.put_forces(local.array_w, 0.0)
        return self._solve(column)

    def _solve(self, rhs: Vec) -> Vec:
        """Solution with the eliminated matrix; where an iterative solver stalls the direct one stands in, see Stalls."""
        system, solver, out = self.system, self._solver, rhs.duplicate()
        change = system.supports.change
        if change is not None:
            change.to_own_forces(rhs)
        reason = solver.solve(self._matrix, system.couplings.patterns, rhs, out, self._tolerance)
        if reason < 0 and self.method == "iterative" and not self._forced:
            self.stalls.stalled(reason)
            reason = solver.solve(self._matrix, system.couplings.patterns, rhs, out, self._tolerance)
        if reason < 0:
            raise LinearFailure(*self._cause(reason))
        if change is not None:
            change.to_space(out)
        return out

    def _cause(self, reason: int) -> tuple[str, ...]:
        """Arguments of LinearFailure after PETSc's reason or error code."""
        code = self._solver.mumps_code if reason == PETSc.KSP.ConvergedReason.DIVERGED_PCSETUP_FAILED else 0
        if code in NO_MEMORY or reason == -OUT_OF_MEMORY:
            text = f"the direct solver could not get the memory it needs (MUMPS {code})"
            return text, MEMORY, "", 'use method=Method(linear="iterative"), more ranks on more machines, or a coarser mesh'
        if self.method == "iterative":
            return f"the iterative linear solver stopped (PETSc's reason {reason})", UNKNOWN, "", FACTORISE
        return (f"the {self.method} linear solver failed (reason {reason}): the tangent is singular",)


class _Held:
    """The border's Schur complement S on the tools' free components: what resists them once the bodies have given way.

    corner (n, n); rows, columns: of the border, and the bodies' responses to unit motions; stiffness: of the stiffest node
    [force / length]. Scaled by the sizes of what it is the difference and sum of, so that what is round-off, and no
    resistance, shows: singular values below `loose`. Collective.
    """

    def __init__(self, corner: Floats, rows: list[Vec], columns: list[Vec], stiffness: float, loose: float) -> None:
        schur, size = corner.copy(), np.abs(np.diag(corner))
        for i, row in enumerate(rows):
            schur[i] += [row.dot(column) for column in columns]
            size[i] += row.norm() * columns[i].norm()
        self._known = bool(np.isfinite(schur).all() and np.isfinite(size).all())
        if not self._known:
            return
        self._scale = 1.0 / np.sqrt(np.maximum(size, stiffness)) if stiffness > 0.0 else np.ones(len(size))
        self._scaled = self._scale[:, None] * schur * self._scale
        parts: tuple[Floats, Floats, Floats] = np.linalg.svd(self._scaled)
        self._left, self._values, self._right = parts
        self._least, self._loose = loose, self._values < loose
        scaled = self._scale[:, None] * corner * self._scale
        self._gripped = np.abs(np.einsum("ia,ij,aj->a", self._left, scaled, self._right)) > GRIPPED

    def negative(self, symmetric: bool) -> int | None:
        """Negative eigenvalues of S; where it is not symmetric whether they are odd; None where that is not known."""
        if not self._known:
            return 0
        if symmetric:
            return int(np.sum(np.linalg.eigvalsh(0.5 * (self._scaled + self._scaled.T)) < -self._least))
        return None if self._loose.any() else int(np.linalg.det(self._scaled) < 0.0)

    def solve(self, right: Floats, turning: bool = False) -> tuple[Floats, Floats]:
        """(motions, forces) (n,): S on these motions makes up for `right`, but for the forces that nothing resists.

        turning: a path may pass a limit point, where the bodies give way to a tool that contact grips all the same: there
        what is left of S counts, however little.
        """
        if not self._known:
            return np.full(len(right), np.nan), np.zeros(len(right))
        parts, loose = self._left.T @ (self._scale * right), self._loose & ~(self._gripped & turning)
        unheld = self._left @ np.where(loose, parts, 0.0) / self._scale
        values = np.maximum(self._values, LEAST) if turning else self._values
        motions = np.divide(parts, values, out=np.zeros_like(parts), where=~loose)
        return self._scale * (self._right.T @ motions), unheld


def _soft_modes(system: System, matrix: Mat) -> Any:
    """Near-null space of the eliminated tangent: rigid motions of the deformed mesh that fade where something holds them.

    Where a penalty or a support holds a node the motions cost energy, and a coarse grid made from them can correct nothing
    around it: a frictional punch then takes hundreds of iterations, or fails. Jacobi's relaxation takes them away there and
    leaves them alone elsewhere, where the tangent hardly resists them.
    """
    owned = system.space.dofmap.index_map.size_local
    X = system.space.tabulate_dof_coordinates()[:owned] + system.vector.array_r.reshape(-1, 3)
    # one centre for all ranks: a motion that changes between them costs energy there
    X = X - system.comm.allreduce(X.sum(axis=0)) / system.comm.allreduce(owned)
    modes = np.zeros((6, owned, 3))
    for i in range(3):
        modes[i, :, i] = 1.0
        j, k = (i + 1) % 3, (i + 2) % 3
        modes[3 + i, :, j], modes[3 + i, :, k] = -X[:, k], X[:, j]
    vectors = [PETSc.Vec().createWithArray(mode.ravel().copy(), comm=system.comm) for mode in modes]
    if system.supports.change is not None:
        for vector in vectors:
            system.supports.change.to_own(vector)
    step = matrix.getDiagonal()
    step.reciprocal()
    step.scale(DAMPING)
    force = step.duplicate()
    for i, vector in enumerate(vectors):
        for _ in range(SWEEPS):
            matrix.mult(vector, force)
            force.pointwiseMult(force, step)
            vector.axpy(-1.0, force)
        for other in vectors[:i]:
            vector.axpy(-vector.dot(other), other)
        vector.normalize()
    return PETSc.NullSpace().create(vectors=vectors, comm=system.comm)
