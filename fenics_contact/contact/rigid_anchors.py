"""From where friction on an analytic tool grows: places in the tool's frame, one for each slave point."""

from __future__ import annotations

from typing import TYPE_CHECKING

import numpy as np

from fenics_contact.assembly.trial import Trial
from fenics_contact.contact.partner import SingleAnchors, strayed, worked
from fenics_contact.contact.rigid_places import RigidFeet
from fenics_contact.kernels.rigid_element import committed_anchors, slips_from
from fenics_contact.kernels.status import OPEN, SLIP, STICK
from fenics_contact.types import Anchors, Array, Bools, Floats, Ints

if TYPE_CHECKING:
    from fenics_contact.contact.rigid import RigidPartner


class RigidAnchors(SingleAnchors):
    """((ne, nq, 3),) [length]."""

    def __init__(self, partner: RigidPartner) -> None:
        self._partner = partner

    def none(self) -> Anchors:
        return (np.zeros((*self._partner.surface.area.shape, 3)),)

    def _committed(self, feet: RigidFeet, trial: Trial, touch: float | None) -> tuple[Anchors, Floats]:
        new, sliding = np.empty_like(trial.history.anchors[0]), np.empty_like(trial.area)
        history = trial.history.anchors[0], trial.history.shift
        committed_anchors(*self._partner.places.points_at(feet), self._partner.laws(trial, touch), history, new, sliding)
        return (new,), sliding

    def slips(self, feet: RigidFeet, trial: Trial, status: Ints) -> Floats:
        """See `Anchoring.slips`."""
        slip = self.slip(feet, trial.history.rests, status >= STICK)
        pulled = self.slip(feet, trial.history.anchors, status == SLIP)
        return np.linalg.norm(strayed(pulled, slip), axis=2)

    def slid(self, feet: RigidFeet, trial: Trial, status: Ints) -> tuple[Floats, Floats]:
        """See `Anchoring.slid`."""
        slips, rests, tool = status == SLIP, trial.history.rests, self._partner.tool
        pulled, slip = (self.slip(feet, anchors, slips) for anchors in (trial.history.anchors, rests))
        # chords of what may be round; beside a sharp edge points rest where they are themselves, off its flat faces
        way = slip if tool.sharp else self.here(feet, trial)[0] - rests[0]
        slid = np.linalg.norm(way, axis=2)
        return np.where(slips, slid, 0.0), np.where(status == OPEN, slid, worked(pulled, slip))

    def slip(self, feet: RigidFeet, rests: Anchors, which: Bools | None = None) -> Floats:
        """Slip (ne, nq, 3) of some points from where they rest, or anchors, in the tool's frame [length]; 0 for others."""
        slip = np.empty_like(rests[0])
        slips_from(*self._partner.places.points_at(feet), rests[0], slip)
        return slip if which is None else np.where(which[..., None], slip, 0.0)

    def augmented(self, feet: RigidFeet, trial: Trial, status: Ints, share: float) -> Anchors:
        """See `Anchoring.augmented`."""
        anchor, slip = trial.history.anchors[0], self.slip(feet, trial.history.rests)
        behind = self.committed(feet, trial)[0][0] - slip  # by the friction within its limit, and by the slip once more
        return (np.where((status >= STICK)[..., None], anchor + share * (behind - anchor), anchor),)

    def stiffened(self, feet: RigidFeet, trial: Trial, rests: Anchors, factor: float) -> Anchors:
        """Anchors that greater penalties need for points that slip on from rest as they do."""
        foot, anchor = self.here(feet, trial)[0], trial.history.anchors[0]
        return (foot - (foot - anchor + (factor - 1.0) * self.slip(feet, rests)) / factor,)

    def packed(self, anchors: Anchors, feet: RigidFeet, name: str) -> dict[str, Array]:
        """Anchors as arrays (ne, ...) that no partition changes."""
        return {name: anchors[0]}

    def unpacked(self, values: dict[str, Array], name: str) -> Anchors:
        return (np.ascontiguousarray(values[name]),)
