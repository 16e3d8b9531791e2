"""Viscous forces that carry bodies and pushed tools through a jump of the load path, to where they come to rest."""

from collections.abc import Callable

from fenics_contact.assembly.spring_term import Springs, SpringTerm
from fenics_contact.assembly.term import State
from fenics_contact.types import Bools


class Damping(SpringTerm):
    """Springs to the last accepted state, a step of implicit Euler for viscous forces; none, as in every load step, where
    the share is zero. always: asked for by the user, for any step that fails; else for those alone in which contact points
    find no state. fluids_stay: whether fluids only go on just now, and none is taken back; most: jumps taken, and the
    greatest energy that one has let go [force length], and share of it and what was left."""

    def __init__(self, springs: Springs, free: Callable[[], Bools], always: bool) -> None:
        super().__init__("damping", *springs, free)
        self.always = always
        self.fluids_stay = False
        self.most = {"jumps": 0.0, "work": 0.0, "work_share": 0.0}

    def keep_fluids(self, stay: bool) -> None:
        """Let fluids only go on from now, or be taken back too."""
        self.fluids_stay = stay

    def took(self, work: float, strain: float) -> None:
        """A jump has let go of so much energy, and left that of strains [force length]."""
        most, share = self.most, work / max(work + strain, 1e-300)
        self.most = {
            "jumps": most["jumps"] + 1,
            "work": max(work, most["work"]),
            "work_share": max(share, most["work_share"]),
        }

    def commit(self, state: State) -> None:
        self.begin(state.u.x.array, state.q)
