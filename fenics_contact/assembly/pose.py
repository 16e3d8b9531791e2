"""Where rigid bodies are: the place of a reference point and a rotation, by the six coordinates that solvers move."""

from collections.abc import Callable, Iterable
from typing import NamedTuple

import numpy as np

from fenics_contact.types import Bools, Floats

KEPT = 8  # poses of a body: a step's measures ask for those of the last three states by turns
SMALL = 0.1  # radians below which the rates of a rotation come from series, exact to the last place


class Pose(NamedTuple):
    """Place of one rigid body: start (3,), where its reference point began, and travel (3,) of that [length]; turn (3, 3):
    rotation since then; rate (3, 3): spin per change of the three coordinates of the rotation [1/length]; lever [length]:
    of which these coordinates are the angle's multiple."""

    start: Floats
    travel: Floats
    turn: Floats
    rate: Floats
    lever: float

    @property
    def place(self) -> Floats:
        """The reference point (3,) [length]."""
        return self.start + self.travel

    def same(self, other: "Pose") -> bool:
        """Whether the other is no other place."""
        if self is other:
            return True
        return np.array_equal(self.travel, other.travel) and np.array_equal(self.turn, other.turn)

    def placed(self, X: Floats) -> Floats:
        """Where points X (..., 3) of the body have gone [length]."""
        return self.turned(X) + self.travel

    def turned(self, X: Floats) -> Floats:
        """Where points X (..., 3) would be by the rotation alone, about where the reference point began [length]."""
        return X + (X - self.start) @ (self.turn - np.eye(3)).T

    def before(self, x: Floats) -> Floats:
        """Where points of the body that are at x (..., 3) were at the start [length]."""
        return (x - self.place) @ self.turn + self.start

    def way(self, then: "Pose", x: Floats) -> Floats:
        """Ways (..., 3) of points at x (..., 3) of the body to another pose along the tangents of their circles: as a solve
        foresees them."""
        return then.place - self.place + np.cross(rotation_vector(then.turn @ self.turn.T), x - self.place)

    def motions(self, x: Floats) -> Floats:
        """Velocities (n, 3, 6) of points at x (n, 3) of the body, per unit of its travel and of its spin."""
        return np.concatenate([np.broadcast_to(np.eye(3), (len(x), 3, 3)), -skew(x - self.place)], axis=2)

    def by_coordinates(self, rates: Floats) -> Floats:
        """Rates (..., 6) with travel and spin as rates with the six coordinates."""
        return np.concatenate([rates[..., :3], rates[..., 3:] @ self.rate], axis=-1)

    def per_coordinate(self, wrench: Floats) -> Floats:
        """Forces (6,) whose product with a change of the coordinates is the work of a wrench (6,)."""
        return np.concatenate([wrench[:3], self.lever * (wrench[3:] @ self.rate)])

    def wrench(self, x: Floats, forces: Floats) -> Floats:
        """Resultant (6,) of forces (n, 3) at x (n, 3): force; torque about the reference point, over the lever [force]."""
        moments = (x - self.place).T @ forces  # sums of products: x x f is what of them is skew
        torque = np.array([moments[i, j] - moments[j, i] for i, j in ((1, 2), (2, 0), (0, 1))])
        return np.concatenate([forces.sum(axis=0), torque / self.lever])


class Poses:
    """From the coordinates q (tools, 6) of rigid bodies to their poses.

    q are the travel of the reference point and a rotation vector times the lever, so that all of them are lengths and what
    works on them are forces. starts (tools, 3): reference points at the start [length]; spherical: which (tools,) may turn
    about all axes in the stage that is on. There the rotation vector is counted from the last accepted pose,
    R = exp((q - q_last)/lever) R_last, for a vector is no coordinate from a whole turn on; elsewhere from where the stage
    began: a path of the user's, or the angle about one axis.
    """

    def __init__(self, starts: Floats, lever: float, spherical: Callable[[], Bools]) -> None:
        self.starts, self.lever, self._spherical = starts, lever, spherical
        self.counted = np.zeros_like(starts)  # q[:, 3:] of the pose from which rotations are counted,
        self.turns = np.tile(np.eye(3), (len(starts), 1, 1))  # and the rotation there
        self._known: dict[tuple[int, bytes], Pose] = {}  # by body and coordinates

    def at(self, i: int, q: Floats) -> Pose:
        """The Pose of body i; q (6,): its coordinates."""
        pose = self._known.get((i, q.tobytes()))
        if pose is None:  # asked for many times at each: as dear as the kernels of a small contact
            if len(self._known) >= KEPT * len(self.starts):
                self._known.clear()
            vector = (q[3:] - self.counted[i]) / self.lever
            turn = rotation(vector) @ self.turns[i]
            pose = Pose(self.starts[i], q[:3].copy(), turn, spin_rate(vector) / self.lever, self.lever)
            self._known[i, q.tobytes()] = pose
        return pose

    def accept(self, q: Floats) -> None:
        """Count from the poses of q (tools, 6) on, where all rotations are free."""
        self._count(np.flatnonzero(self._spherical()), q)

    def begin(self, q: Floats) -> None:
        """Count from the poses of q (tools, 6) on, where a stage begins: what turns in it turns what it finds."""
        self._count(range(len(q)), q)

    def _count(self, bodies: Iterable[int], q: Floats) -> None:
        for i in bodies:
            left, _, right = np.linalg.svd(self.at(i, q[i]).turn)  # products of many rotations stay one
            self.turns[i], self.counted[i] = left @ right, q[i, 3:]
            self._known.clear()

    def resume(self, counted: Floats, turns: Floats) -> None:
        """Count from where a run that is resumed did."""
        self.counted[:], self.turns[:] = counted, turns
        self._known.clear()


def skew(vectors: Floats) -> Floats:
    """Matrices (..., 3, 3) that give v x a for vectors v (..., 3)."""
    out = np.zeros((*vectors.shape, 3))
    for i, j, k in ((0, 1, 2), (1, 2, 0), (2, 0, 1)):
        out[..., k, j], out[..., j, k] = vectors[..., i], -vectors[..., i]
    return out


def rotation(vector: Floats) -> Floats:
    """exp of a rotation vector (3,) [radians]: Rodrigues' formula; (3, 3)."""
    angle, S = float(np.linalg.norm(vector)), skew(vector)
    return np.eye(3) + np.sinc(angle / np.pi) * S + 0.5 * np.sinc(0.5 * angle / np.pi) ** 2 * S @ S


def rotation_vector(turn: Floats) -> Floats:
    """The rotation vector (3,) [radians] of less than half a turn (3, 3)."""
    twice = np.array([turn[2, 1] - turn[1, 2], turn[0, 2] - turn[2, 0], turn[1, 0] - turn[0, 1]])  # sine of the angle
    sine, cosine = 0.5 * np.linalg.norm(twice), 0.5 * (np.trace(turn) - 1.0)
    return np.asarray(0.5 * twice * (np.arctan2(sine, cosine) / sine if sine > 0.0 else 1.0))


def spin_rate(vector: Floats) -> Floats:
    """Spin (3, 3) per rate of a rotation vector (3,): d exp(v) = (T dv) x exp(v) (Cardona & Geradin 1988,
    doi:10.1002/nme.1620261105)."""
    angle, S = float(np.linalg.norm(vector)), skew(vector)
    square = angle * angle
    if angle < SMALL:
        third = 1 / 6 - square / 120 + square**2 / 5040 - square**3 / 362880
    else:
        third = (angle - np.sin(angle)) / (square * angle)
    return np.eye(3) + 0.5 * np.sinc(0.5 * angle / np.pi) ** 2 * S + third * S @ S
