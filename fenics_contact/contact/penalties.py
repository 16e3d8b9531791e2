"""Penalties of a contact: from the stiffness beneath its slave points, raised where these sink in too far all the same."""

import numpy as np

from fenics_contact.contact.friction import friction_of
from fenics_contact.kernels.status import OPEN

# Default penalty over (Young's modulus at rest / distance of nodes below each other): the force it costs is reported in the
# README.
PENALTY_FACTOR = 100.0
# Default tangential over normal penalty: ten times more elastic slip, for far fewer iterations, as long as a point on the
# Coulomb cone has slipped elastically no further than SLIPS times its penetration, mu / share: beyond a friction of 0.3 the
# share grows with it, or the elastic slip would cost several percent of the force (README, penalties).
TANGENTIAL_SHARE = 0.1
SLIPS = 3.0
# Of the height of the cell beneath: a deeper point raises a default penalty. The default gets there where the pressure is
# twice Young's modulus (degree 2: four times): strains of order one, a corner, or rubber that cannot escape.
DEEPEST = 0.02
AIM = 0.5  # of that depth: where a raised penalty puts the deepest point under the same pressure
LARGEST = 10.0  # times the default; Newton's method fails the more often the stiffer it gets beyond (studies, map_penalty)
# Penalties on the way to a step's solution, where the penalties themselves are too stiff for it: at first so soft that the
# deepest point of the last accepted state would lie as deep as under a raised penalty, down to this part of them
SOFTEST = 0.01
WORTH = 0.5  # a greater part of the penalties is no help

_NOT_HELD = np.empty(0)


def penalties(statement, surface):
    """Normal and tangential penalties (ne,) [pressure/length] of a stated contact, and which of both may be raised.

    A number that the user has given stays what it is.
    """
    factor = statement.penalty_factor or PENALTY_FACTOR
    share = statement.tangential_share or max(TANGENTIAL_SHARE, friction_of(statement.friction).mu / SLIPS)
    normal = np.full_like(surface.stiffness, statement.penalty) if statement.penalty else factor * surface.stiffness
    typed = statement.tangential_penalty
    tangential = np.full_like(normal, typed) if typed else share * normal
    adapts = not (statement.penalty or statement.penalty_factor or statement.penetration)
    return normal, tangential, (adapts, adapts and not typed)


class Penalties:
    """Mixed into contact terms: penalties that a run may raise, and vary to see what they cost.

    Needs normal_penalty, tangential_penalty (ne,) [pressure/length], gap, cover, status, shift, surface; evaluate(state);
    _kept, the accepted (anchors, shift); before, the anchors at the start of the step accepted last; swap_anchors(anchors),
    which gives back the old ones;
    hold_friction(factor), which lets points feel their accepted friction traction again under tangential penalties greater
    by that factor; and rest_anchors(state, factor), see `stiffen`.
    """

    adapts = (False, False)  # normal, tangential
    # may have softer penalties on the way to a solution: not under a sharp edge, where other points then hold (19 cut-backs
    # instead of 7 on a punch with 1000 E/h); with facets as a master it has not been tried
    softens = False
    _judged = _NOT_HELD  # (points,) gaps that decide statuses in the place of the present ones until `release`

    def set_up_penalties(self):
        self._base = self.normal_penalty, self.tangential_penalty
        # (ne, 2): how much greater the penalties are than at first, and how much they may become at most
        self.raised = np.tile([1.0, LARGEST], (len(self.normal_penalty), 1))
        self._raised = self.raised  # at the last accepted state
        self._varied = None

    def put_penalties(self, normal, tangential):
        self.normal_penalty, self.tangential_penalty = normal, tangential

    def _put_raised(self):
        normal, tangential = self._base
        factor = self.raised[:, 0]
        self.put_penalties(normal * factor, tangential * factor if self.adapts[1] else tangential)

    # -- raised where points lie too deep ---------------------------------------------------------------------------
    def raise_penalty(self, state):
        """None; or, where a point lies deeper than DEEPEST allows, penalties are raised and it is said how. Collective."""
        if not self.adapts[0]:
            return None
        self.evaluate(state)
        comm = state.u.function_space.mesh.comm
        held = np.where((self.cover >= 1.0) & (self.status != OPEN), -self.gap, 0.0)
        depth, place = self._worst(comm, (held / self.surface.height[:, None]).ravel())
        room = min(comm.allgather((self.raised[:, 1] / self.raised[:, 0]).min(initial=np.inf)))
        if depth <= DEEPEST or room <= 1.0 + 1e-9:  # round-off of a factor that has reached its bound
            return None
        factor = min(depth / (AIM * DEEPEST), room)
        if self.adapts[1]:
            self.hold_friction(factor)
        self.raised = self.raised * [factor, 1.0]
        self._put_raised()
        return (
            f"{place} lies {depth:.1%} of a cell deep: penalties raised to {self.raise_factor(comm):.3g} times the default"
        )

    def forgo_raise(self):
        """Penalties have been raised in vain: they stay as they are."""
        self.raised = self.raised[:, [0, 0]]

    def raise_factor(self, comm):
        """By how much the penalties are greater than at first, on all ranks. Collective."""
        return max(comm.allgather(self.raised[:, 0].max(initial=1.0)))

    def keep_penalties(self):
        self._raised = self.raised

    def drop_penalties(self):
        if self.raised is not self._raised:
            self.raised = self._raised
            self._put_raised()

    def restore_penalties(self, raised):
        self.raised = self._raised = raised
        self._put_raised()

    # -- softer on the way to a solution ----------------------------------------------------------------------------
    def softness(self, state):
        """The part of the penalties under which the accepted pressures sink AIM * DEEPEST of a cell, or 1. Collective."""
        if not self.softens:
            return 1.0
        self.evaluate(state)
        held = np.where((self.cover >= 1.0) & (self.status != OPEN), -(self.gap + self.shift), 0.0)
        depth = self._worst(state.u.function_space.mesh.comm, (held / self.surface.height[:, None]).ravel())[0]
        part = max(depth / (AIM * DEEPEST), SOFTEST)
        return part if part < WORTH else 1.0

    def soften(self, state, part):
        """Until `harden`, only a part of the penalties at an accepted state; until `release` points press as they did.

        Friction goes on from the traction it had.
        """
        self.evaluate(state)
        gaps = (self.gap + self.shift) / part
        self._hard = self._kept[0], self.shift, self.normal_penalty, self.tangential_penalty
        self.hold_friction(part)
        self.shift = self.shift / part
        self.put_penalties(part * self.normal_penalty, part * self.tangential_penalty)
        self._judged = gaps.ravel()

    def release(self):
        """Judge by the gaps again."""
        self._judged = _NOT_HELD

    def harden(self):
        """The penalties and the friction history of before."""
        self.release()
        anchors, self.shift, *both = self._hard
        self.swap_anchors(anchors)
        self.put_penalties(*both)

    # -- varied to see what they cost -------------------------------------------------------------------------------
    def stiffen(self, state, factor):
        """Until `relax`, forces are those that penalties greater by `factor` give at a state just accepted.

        Multipliers stay; what sticks has rested at the same place under the same traction, and slips on from there by as
        much; what slipped in the last step slips. Collective.
        """
        anchors = self.swap_anchors(self.before)
        self._varied = anchors, self.shift, self.normal_penalty, self.tangential_penalty
        self.swap_anchors(self.rest_anchors(state, factor))
        self.shift = self.shift / factor
        self.put_penalties(self.normal_penalty * factor, self.tangential_penalty * factor)

    def relax(self):
        anchors, self.shift, *both = self._varied
        self.swap_anchors(anchors)
        self.put_penalties(*both)
