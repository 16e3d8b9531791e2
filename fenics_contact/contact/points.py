"""What every contact term says of its slave points: their number in a checkpoint, status, place, and what ails them."""

from contextlib import contextmanager

import numpy as np

from fenics_contact.assembly.finding import LOST, TOO_SOFT, TOO_STIFF, Finding, spot
from fenics_contact.contact.friction import allowed, coulomb
from fenics_contact.contact.penalties import Penalties
from fenics_contact.kernels.status import CLOSED, OPEN, SLIP, STICK

SUNK = 0.5  # of a cell's height: a point that deep is held by nothing that deserves the name of contact
DEEP = 0.05  # of a cell's height: a penetration that the result should not be trusted with unasked
RESOLVED = 1e-12  # of the coordinates: the pressure of a penetration that small is known to 2e-4 at best
CRUMBS = 1e-8  # of the coordinates: what a pressure must shorten the body beneath by, to matter
SLID_OFF = 0.5  # of the area that has been in contact: when so much has left the master, that is what ails the contact


class SlavePoints(Penalties):
    """Mixed into contact terms.

    Needs their name and surface, and per element and point status, gap, cover, traction, met (has been in contact) and
    shift (multiplier over penalty, [length]); also slips(state), shift_anchors(state), node_gaps(state, nodes, X), the gaps
    (n,) of slave nodes, and `grounded`: whether the master holds a body by itself, as a tool does, or only as far as it is
    held, as another body.

    A contact with a tolerance [length] is augmented: the penalty carries only what multipliers do not yet carry. Between
    accepted steps these grow by Uzawa's rule (Simo & Laursen 1992, doi:10.1016/0045-7949(92)90540-G): lambda <- min(lambda
    + eps_N g, 0) and, where a point sticks, lambda_T <- lambda_T + eps_T times its slip since it came to rest, which is kept
    in the place of its anchor. A point half out under a sharp edge keeps the body's spring that acts there in series with
    the penalty (cover = its share of eps_N): lambda <- cover (lambda + eps_N g) leaves that spring alone.
    """

    tolerance = None
    penalised = True
    # what to do where the slave has left the master
    slid_off = "make the master's surface larger where the slave leaves it, raise the penalty, or end the path before"
    search = np.inf  # gaps from this on are not told apart [length]
    _remarked = False

    def misfit(self, state):
        """Largest error of this rank's points over the tolerance: penetration, pressure across a gap, slip in stick."""
        self.evaluate(state)
        return max(np.abs(self._grown() - self.shift).max(initial=0.0), self.slips(state).max(initial=0.0)) / self.tolerance

    def _grown(self):
        return np.minimum(self.cover * (self.gap + self.shift), 0.0)

    def augment(self, state, share=1.0):
        """Let multipliers take over what the penalty carries, or a share of its pressure and none of its friction.

        They count as history once the step is accepted.
        """
        self.evaluate(state)
        grown = self._grown()
        if share == 1.0:
            self.shift_anchors(state)
        self.shift = grown if share == 1.0 else self.shift + share * (grown - self.shift)

    def swap_multipliers(self, multipliers):
        """Take (anchors, shift), which another state of the step had; gives the old ones."""
        anchors, shift = multipliers
        old, self.shift = (self.swap_anchors(anchors), self.shift), shift
        return old

    def resultants(self, state):
        """Force on the slave (3,), summed over all ranks, and contact pressure at this rank's points (n,). Collective."""
        self.evaluate(state)
        comm = state.u.function_space.mesh.comm
        return self.measures(state, comm)["force"], self.split_traction(state)[0].ravel()

    @contextmanager
    def only(self, mask, frictionless=False):
        """Within it the points (n,) of a mask alone exert forces, without friction if so asked."""
        area, friction = self.surface.area, self.friction
        self.friction = coulomb(0.0) if frictionless else friction
        self.weigh(np.where(mask.reshape(area.shape), area, 0.0))
        try:
            yield
        finally:
            self.friction = friction
            self.weigh(area)

    @contextmanager
    def with_friction(self, mu):
        """Within it the contact has another coefficient of friction."""
        own, self.friction = self.friction, coulomb(mu)
        try:
            yield
        finally:
            self.friction = own

    def grip(self, state):
        """(friction, what its law allows): sums of their sizes over this rank's points at a state [force]."""
        self.evaluate(state)
        pressure, along = self.split_traction(state)
        area = self.surface.area
        return float((np.linalg.norm(along, axis=2) * area).sum()), float((allowed(self.friction, pressure) * area).sum())

    def weigh(self, area):
        """Take other areas (ne, nq) [length^2] for the points."""
        self.surface.area = area

    def laws(self, frictionless):
        """{name: status code} of the laws that can hold at a point."""
        return {"normal": CLOSED} if frictionless else {"stick": STICK, "slip": SLIP}

    def branches(self, state):
        """Rows of codes (n, ...), the status first: where one changes the traction has a kink. Collective."""
        self.evaluate(state)
        return self.status.reshape(-1, 1).copy()

    def holding(self, state, least):
        """Letters of the axes along which the contact holds a body at a state: none where it presses with no more than
        `least` [force] in all; with friction all, else those that the normals of closed points have a part in. Collective.
        """
        self.evaluate(state)
        closed, pressing = self.status != OPEN, np.linalg.norm(self.traction, axis=2) * self.surface.area
        along = np.abs(self.normals(state)[closed]).max(axis=0, initial=0.0) > 1e-6
        along = along | (self.rough and bool(closed.any()))
        sums = state.u.function_space.mesh.comm.allreduce(np.append(along.astype(float), pressing.sum()))
        return {letter for letter, count in zip("xyz", sums, strict=False) if count and sums[3] > least}

    @property
    def rough(self):
        """Whether there is friction."""
        return self.friction.mu > 0.0

    @property
    def friction_stated(self):
        """Coulomb's mu, or the numbers of a friction law by name."""
        return self.friction.mu if self.friction == coulomb(self.friction.mu) else self.friction._asdict()

    @property
    def key(self):
        return self.surface.key

    def statuses(self):
        return self.status.ravel()

    def spots(self):
        return np.einsum("eqk,ekc->eqc", self.surface.a, self.surface.X).reshape(-1, 3)

    def unpaired(self, state):
        """None: a tool has no end."""
        return np.zeros(self.surface.points, dtype=bool)

    def trouble(self, state):
        comm = state.u.function_space.mesh.comm
        self.evaluate(state)
        area, gone = self.surface.area.ravel(), self.met.ravel() & self.unpaired(state)
        met, lost = comm.allreduce(np.array([area[self.met.ravel()].sum(), area[gone].sum()]))
        if lost > SLID_OFF * met:
            text = f"{lost / met:.0%} of the area that was in contact has no partner on '{self.master_name}' any more"
            return Finding(LOST, text, self._worst(comm, np.where(gone, area, 0.0))[1], self.slid_off)
        return self._sunk(SUNK, comm)

    def deep(self, state):
        """None, or the Finding that a point lies deep enough to be distrusted. Collective."""
        self.evaluate(state)
        return self._sunk(DEEP, state.u.function_space.mesh.comm)

    def _sunk(self, share, comm):
        """None, or the Finding that a point lies deeper than a share of a cell's height. Collective."""
        depth, place = self._deepest(comm)
        height = self.surface.cell_height
        if depth <= share * height:
            return None
        text = f"a point lies {depth:.3g} inside '{self.master_name}', where a cell is {height:.3g} high"
        return Finding(TOO_SOFT, text, place, "raise penalty= of this contact, or leave it to the default")

    def _deepest(self, comm):
        """(penetration [length], place) of the deepest point at the state evaluated last. Collective."""
        held = np.where((self.cover >= 1.0) & (self.status != OPEN), -self.gap, 0.0).ravel()
        return self._worst(comm, held)

    def never_met(self, state):
        """None, or how far away the master is after a run in which no point has touched it. Collective."""
        comm = state.u.function_space.mesh.comm
        if comm.allreduce(int(self.met.sum())):
            return None
        self.evaluate(state)
        nearest = min(comm.allgather(self.gap.min(initial=np.inf)))
        beyond = "more than " if nearest >= self.search else ""
        return (
            f"contact '{self.name}' never closed: '{self.master_name}' ends {beyond}{nearest:.3g} away; see that both "
            "are in the same units and in their places, and that the path is long enough"
        )

    def remark(self, state):
        """None, or at the first accepted step where it is so, that points or nodes lie deep in the master. Collective."""
        if self._remarked:
            return None
        depth, place = self._deepest(state.u.function_space.mesh.comm)
        remedy = "penetration= keeps it out, or raise penalty="
        if depth <= DEEP * self.surface.cell_height:
            depth, place = self.node_depth(state)
            place, remedy = f"a node between points, {place},", 'more points= per facet keep it out, or points="nodes"'
        if depth <= DEEP * self.surface.cell_height:
            depth, place = self.depth_beside(state)
            place, remedy = f"a node that is no slave, {place},", "name the surface it lies on among the slaves"
        if depth <= DEEP * self.surface.cell_height:
            return None
        self._remarked = True
        text = f"{place} lies {depth:.3g} inside '{self.master_name}', where a cell is {self.surface.cell_height:.3g} high"
        return f"{text}: {remedy}"

    def node_depth(self, state):
        """Depth [length] and place of the deepest node of the facets with Gauss points that have a partner, touching or not.

        Zero where points are nodes themselves, which the penetration measures. Collective.
        """
        s, comm = self.surface, state.u.function_space.mesh.comm
        if s.gradients is None or s.corners:
            return 0.0, ""
        near = ~self.unpaired(state).reshape(s.area.shape).all(axis=1)
        nodes, first = np.unique(s.nodes[near], return_index=True)
        X = s.X[near].reshape(-1, 3)[first]
        depth, place = self._worst(comm, -self.node_gaps(state, nodes, X), X)
        return max(depth, 0.0), place

    def depth_beside(self, state):
        """Depth [length] and place of the deepest node off the slave surface; zero where that is not looked for."""
        return 0.0, ""

    def objection(self, state):
        """None, or the Finding why a state in balance must not be accepted: bodies have passed through one another, a
        point is held by nothing, or penetrations are too small for a number beside the coordinates. Collective."""
        comm = state.u.function_space.mesh.comm
        depth = self.lost_depth(state, comm)
        if depth > self.touch:
            text = f"'{self.master_name}' was passed through by {depth:.3g}: a point lies too deep to be held"
            remedy = f"take smaller steps, or raise the penalty; or {self.slid_off}"
            return Finding(LOST, text, f"contact '{self.name}'", remedy)
        if sunk := self._sunk(SUNK, comm):
            return sunk
        pressure = np.linalg.norm(self.traction, axis=2).ravel()
        largest, place = self._worst(comm, pressure)
        soft = self.surface.stiffness.min(initial=np.inf)
        x = np.abs(self.surface.X).max(initial=0.0) + np.abs(state.u.x.array).max(initial=0.0)
        low = comm.allgather((soft, (self.gap + self.shift).min(initial=0.0), -x))
        soft, depth, size = (-value for value in np.min(low, axis=0))
        # a contact without load has tiny penetrations too: one with load shortens the body beneath it by far more
        if not (depth < RESOLVED * size and largest > -soft * CRUMBS * size):
            return None
        text = f"the deepest penetration {depth:.1e} is round-off beside coordinates of {size:.3g}, and so is the pressure"
        return Finding(TOO_STIFF, text, place, "lower penalty= of this contact, or leave it to the default")

    def _worst(self, comm, values, spots=None):
        """Largest of values (n,) over all ranks, and the place of its point, or of its node at spots (n, 3)."""
        here = (-np.inf, "")
        if len(values):
            point = int(values.argmax())
            here = (
                float(values[point]),
                f"contact '{self.name}' at {spot((self.spots() if spots is None else spots)[point])}",
            )
        return max(comm.allgather(here))
