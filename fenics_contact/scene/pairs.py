"""Periodic and cyclic pairs of faces: which node follows which, and what supports of followers ask of their leaders."""

from collections.abc import Callable, Sequence
from dataclasses import dataclass, replace
from functools import partial
from typing import TYPE_CHECKING

import numpy as np

from fenics_contact import compat
from fenics_contact.assembly.entries import Carried, Entry, Prescribed
from fenics_contact.assembly.finding import spot
from fenics_contact.assembly.numbering import node_keys
from fenics_contact.assembly.pairs import Follower, Image, Pairs
from fenics_contact.assembly.pose import Pose, rotation
from fenics_contact.assembly.stages import Stages
from fenics_contact.assembly.ties import Ties
from fenics_contact.scene.courses import Course, Part
from fenics_contact.scene.directions import Group, unit
from fenics_contact.scene.functions import Drive, Path, Places, Ramp, ramp
from fenics_contact.scene.stage import Stage
from fenics_contact.scene.statements import FacePair
from fenics_contact.types import Floats, Ints64
from fenics_contact.values import SceneError, finite, group_names, shown

if TYPE_CHECKING:  # which states them
    from fenics_contact.scene.scene import Scene

MATCH = 1e-6  # of a face's size: how far nodes that belong together may lie apart, a hundred times gmsh's own tolerance
CLOSED = 1e-9  # of two ways round to a node: what may lie between them
RAY = np.array([0.5403, 0.7071, 0.4563])  # along which the nodes of a face are told apart: no plane of a model's
SOME = 4_000_000  # distances looked at in one go

# of a statement's nodes on this rank, keys (n,) and X (n, 3): the prescribed displacement of those, of any rank, of which
# keys (m,) are given. Collective.
CourseAt = Callable[[Places, Ints64], Prescribed]


@dataclass(frozen=True)
class _Nodes:
    """Nodes of all ranks by rising keys (n,): X (n, 3) [length] and global numbers (n,)."""

    keys: Ints64
    X: Floats
    numbers: Ints64


@dataclass(frozen=True)
class Tied:
    """Nodes of both faces of a pair, number `number`, that are tied to one rigid body and so belong to no pair any more:
    first (n, 3), those of the first face at the start, second (n, 3), where the pair puts the second's [length]."""

    pair: FacePair
    number: int
    body: int
    turn: Floats
    first: Floats
    second: Floats

    def off(self, ways: Floats, pose: Pose) -> float:
        """How far apart the body leads nodes, whose pose is given, that the pair holds together [length]."""
        ahead = (pose.placed(self.second) - self.second) - (pose.placed(self.first) - self.first) @ self.turn.T
        return float(np.abs(ahead - ways[self.number]).max(initial=0.0))

    def words(self, hub: str, free: bool) -> str:
        """What is wrong where it does so."""
        how = "may lead" if free else "leads"
        let = (
            "move and turn about the way from face to face"
            if self.pair.axis is None
            else "move along the pair's axis and turn about it"
        )
        further = ", and leave relative= out there, for a rigid body does not stretch" if self.pair.driven else ""
        return (
            f"'{hub}', to which nodes of both faces of the {self.pair.what} are tied, {how} them otherwise than the pair "
            f"does; let it {let} alone{further}, or tie a surface that does not reach these faces"
        )


class FacePairs:
    """The nodes of a scene's pairs of faces: all of them on every rank; ways: of each pair t -> (3,) [length]; ties: nodes
    that rigid bodies lead, as one both of what a pair joins, in whose place they then are: `tied`.

    led (n,): keys of the nodes that follow, rising; leads (n,): keys of those that lead them; X (n, 3) [length] and Follower
    of the former; on_axis: pairs and the keys of nodes that these lead to themselves. Collective, SceneError on all ranks.
    """

    def __init__(self, scene: "Scene", ways: Sequence[Path], ties: Ties) -> None:
        self._space, self._comm, self._pairs, self._ways = scene.space, scene.mesh.comm, scene.pairs, ways
        self._keys = node_keys(scene.space)
        faces = [[self._gathered(scene, group) for group in (pair.first, pair.second)] for pair in scene.pairs]
        count = len(faces)
        self._all = _united([face for pair in faces for face in pair])
        n = len(self._all.keys)
        self._root, self._turn = np.arange(n), np.tile(np.eye(3), (n, 1, 1))
        self._ahead = np.zeros((n, 3, count, 3))
        self._members = {i: [i] for i in range(n)}
        self.on_axis: list[tuple[FacePair, Ints64]] = []
        # (pair, X, what must do nothing with the ways) of closed rounds
        self._loops: list[tuple[FacePair, Floats, Floats]] = []
        self.tied: list[Tied] = []
        self._across: list[Image] = []
        bodies = self._bodies(ties, len(scene.tools))
        for k, (pair, (first, second)) in enumerate(zip(scene.pairs, faces, strict=True)):
            turn, places, order = _matched(pair, first, second)
            self._across.append(Image(turn, places[0] - turn @ first.X[0]))
            across = np.abs(second.X.mean(axis=0) - first.X.mean(axis=0))[0]
            if scene.section is not None and scene.section.axisymmetric and across > MATCH * np.ptp(second.X, axis=0).max():
                raise SceneError(
                    f"{pair.what}: all the way round what repeats does so along y; these faces lie apart along x"
                )
            one, other = (np.searchsorted(self._all.keys, keys) for keys in (first.keys, second.keys[order]))
            self._refuse_half_tied(pair, bodies, [tool.name for tool in scene.tools], one, other)
            led = (bodies[one] >= 0) & (one != other)
            self.tied += [
                Tied(pair, k, int(body), turn, first.X[led & (bodies[one] == body)], places[led & (bodies[one] == body)])
                for body in np.unique(bodies[one[led]])
            ]
            self._join(k, pair, turn, one[~led], other[~led])
        follow = np.flatnonzero(self._root != np.arange(n))
        self._follow = follow
        self.led, self.X = self._all.keys[follow], self._all.X[follow]
        self.leads = self._all.keys[self._root[follow]]
        self.follower = Follower(self._turn[follow], self._ahead[follow])

    def ways(self, t: float) -> Floats:
        """Relative displacements (pairs, 3) at t [length]. Collective."""
        return np.array([way(t) for way in self._ways])

    def pairs(self) -> Pairs:
        """Of this rank's nodes. Collective."""
        nodes = np.flatnonzero(np.isin(self._keys, self.led))
        at = np.searchsorted(self.led, self._keys[nodes])
        leads = self._all.numbers[self._root[self._follow[at]]]
        return Pairs(self._space, (nodes, leads), self.follower.of(at), self.ways, self._across)

    def open_loop(self, ways: Floats) -> tuple[FacePair, Floats] | None:
        """A pair that does not fit the other ones when these lead so far (pairs, 3), and where; or None."""
        allowed = CLOSED * max(np.abs(ways).max(initial=0.0), 1e-300)
        found = [(pair, X) for pair, X, ahead in self._loops if np.abs(np.einsum("cpd,pd->c", ahead, ways)).max() > allowed]
        return found[0] if found else None

    # -- supports -------------------------------------------------------------------------------------------------
    def of_leaders(self, statement: int, nodes: Ints64, direction: Floats, course: CourseAt) -> list[Entry]:
        """What a statement about local nodes (n,) asks of those that follow, as entries of the leading ones. Collective."""
        keys, X = self._keys, self._space.tabulate_dof_coordinates()
        mine, entries = np.isin(keys[nodes], self.led), list[Entry]()
        named = np.unique(np.concatenate(self._comm.allgather(keys[nodes[mine]])))
        rows = np.searchsorted(self.led, named)
        local = np.argsort(keys)
        for turn in _distinct(self.follower.turn[rows]):
            alike = rows[np.abs(self.follower.turn[rows] - turn).max(axis=(1, 2)) <= CLOSED]
            here = alike[np.isin(self.leads[alike], keys)]
            leads = local[np.searchsorted(keys[local], self.leads[here])].astype(np.int32)
            follower = self.follower.of(here)
            ahead = np.einsum("c,ncpd->npd", direction, follower.ahead)
            value = _Shifted(course((keys[nodes], X[nodes]), self.led[here]), ahead, self.ways)
            along = turn.T @ direction
            along = np.where(np.abs(along) < 1e-12, 0.0, along)
            along = along / np.linalg.norm(along)
            offset = partial(self._offset, follower)
            carried = Carried(statement, self.X[here], follower.turn, follower.ahead, offset)
            entries.append(Entry(leads, along, value, carried))
        return entries

    def _offset(self, follower: Follower, t: float) -> Floats:
        return follower.offset(self.ways(t))

    def _gathered(self, scene: "Scene", group: tuple[str, ...]) -> _Nodes:
        nodes = scene.mesh.nodes(scene.space, *group)
        X, numbers = scene.space.tabulate_dof_coordinates()[nodes], compat.global_blocks(scene.space)[nodes]
        parts = self._comm.allgather((self._keys[nodes], X, numbers))
        return _united([_Nodes(*part) for part in parts])

    def _bodies(self, ties: Ties, count: int) -> Ints64:
        """The rigid body that leads each of all nodes, -1 of none. Collective."""
        bodies = np.full(len(self._all.keys), -1)
        for body in range(count):
            keys = np.concatenate(self._comm.allgather(self._keys[ties.of(body)]))
            bodies[np.isin(self._all.keys, keys)] = body
        return bodies

    def _refuse_half_tied(self, pair: FacePair, bodies: Ints64, hubs: Sequence[str], one: Ints64, other: Ints64) -> None:
        """Of nodes that belong together a rigid body leads both or none."""
        apart = np.flatnonzero(bodies[one] != bodies[other])
        if not apart.size:
            return
        a, b = one[apart[0]], other[apart[0]]
        a, b = (a, b) if bodies[a] >= 0 else (b, a)
        what = f"'{hubs[bodies[b]]}' leads the latter" if bodies[b] >= 0 else "nothing ties the latter"
        raise SceneError(
            f"tie to '{hubs[bodies[a]]}': it leads the node at {spot(self._all.X[a])}, to which that at "
            f"{spot(self._all.X[b])} belongs in the {pair.what}, and {what}; tie the nodes of both faces to one body, "
            "or of none"
        )

    def _join(self, k: int, pair: FacePair, turn: Floats, one: Ints64, other: Ints64) -> None:
        """Let nodes `other` follow nodes `one` of all, by a turn and the way of pair k."""
        own = np.zeros((3, len(self._pairs), 3))
        own[:, k] = np.eye(3)
        fixed = one == other
        if fixed.any():
            self.on_axis.append((pair, self._all.keys[one[fixed]]))
        for a, b in zip(one[~fixed], other[~fixed], strict=True):
            ahead = np.tensordot(turn, self._ahead[a], 1) + own - self._ahead[b]
            turned, root = turn @ self._turn[a], self._root[b]
            if root == self._root[a]:
                if np.abs(turned - self._turn[b]).max() > CLOSED:
                    raise SceneError(
                        f"{pair.what}: with the other pairs it leads the node at {spot(self._all.X[b])} round to itself, "
                        "turned; leave one of them out"
                    )
                self._loops.append((pair, self._all.X[b], ahead))
                continue
            way, offset = self._turn[b].T @ turned, np.tensordot(self._turn[b].T, ahead, 1)
            for i in self._members.pop(root):
                self._ahead[i] += np.tensordot(self._turn[i], offset, 1)
                self._turn[i] = self._turn[i] @ way
                self._root[i] = self._root[a]
                self._members[self._root[a]].append(i)


class _Shifted:
    """What a statement prescribes of nodes that follow (n,), of those that lead them: without the way they are ahead, whose
    part along the statement's direction is along . ways (n, pairs, 3). A Prescribed."""

    def __init__(self, course: Prescribed, along: Floats, ways: Callable[[float], Floats]) -> None:
        self._course, self._along, self._ways = course, along, ways

    def _ahead(self, t: float) -> Floats:
        return np.einsum("npd,pd->n", self._along, self._ways(t))

    def __call__(self, t: float) -> Floats:
        return self._course(t) - self._ahead(t)

    def few(self, t: float) -> Floats:
        return self._course.few(t)

    def jump(self) -> float:
        return self._course.jump()

    def begin(self, origin: Floats, before: Sequence[float]) -> None:
        self._course.begin(origin + self._ahead(0.0), before)

    def said(self) -> list[float]:
        return self._course.said()

    def led(self) -> bool:
        return self._course.led()


def _united(parts: Sequence[_Nodes]) -> _Nodes:
    keys = np.concatenate([part.keys for part in parts])
    known, first = np.unique(keys, return_index=True)
    return _Nodes(known, *(np.concatenate([getattr(part, of) for part in parts])[first] for of in ("X", "numbers")))


def _distinct(turns: Floats) -> list[Floats]:
    """Each of the turns (n, 3, 3) once, in an order that no partition changes."""
    found: list[Floats] = []
    for turn in turns:
        if all(np.abs(turn - other).max() > CLOSED for other in found):
            found.append(turn)
    return found


# -- nodes that belong together ---------------------------------------------------------------------------------------
def _matched(pair: FacePair, first: _Nodes, second: _Nodes) -> tuple[Floats, Floats, Ints64]:
    """The turn (3, 3) of a pair and, of the nodes of its first face, where it puts them (n, 3) [length] and which of the
    second's lie there and follow them."""
    if len(first.keys) != len(second.keys):
        raise SceneError(
            f"{pair.what}: '{'+'.join(pair.first)}' has {len(first.keys)} nodes and '{'+'.join(pair.second)}' "
            f"{len(second.keys)}; mesh both alike, e.g. with gmsh.model.mesh.setPeriodic"
        )
    turn = np.eye(3)
    if pair.axis is None or pair.point is None:
        places = first.X + (second.X.mean(axis=0) - first.X.mean(axis=0))
    else:
        turn = _turn(pair, first.X.mean(axis=0), second.X.mean(axis=0), pair.axis, pair.point)
        places = (first.X - pair.point) @ turn.T + pair.point
    at, apart = _nearest(places, second.X)
    worst, size = int(apart.argmax()), float(np.ptp(second.X, axis=0).max())
    if apart[worst] > MATCH * size:
        how = "moved onto the second face" if pair.axis is None else "turned onto the second face"
        raise SceneError(
            f"{pair.what}: the nodes do not match: that at {spot(first.X[worst])}, {how}, lies {apart[worst]:.3g} from the "
            "next one there; mesh both faces alike, e.g. with gmsh.model.mesh.setPeriodic"
        )
    if len(np.unique(at)) < len(at):
        raise SceneError(f"{pair.what}: several nodes of one face lie on one another; name faces that do not overlap")
    if pair.axis is not None:
        _refuse_part(pair, turn)
    if pair.axis is None and np.array_equal(first.keys, second.keys[at]):
        raise SceneError(f"{pair.what}: both faces have the same nodes; name two faces")
    return turn, places, at


def _turn(pair: FacePair, one: Floats, other: Floats, axis: Floats, point: Floats) -> Floats:
    """The rotation about an axis that carries the middle of one face to the side of the other's."""
    flat = np.eye(3) - np.outer(axis, axis)
    a, b = flat @ (one - point), flat @ (other - point)
    if not (np.linalg.norm(a) > 0.0 and np.linalg.norm(b) > 0.0):
        raise SceneError(f"{pair.what}: the middle of a face lies on the axis; give faces on one side of it each")
    angle = np.arctan2(axis @ np.cross(a, b), a @ b)
    if abs(angle) < MATCH:
        raise SceneError(f"{pair.what}: about that axis there is no angle between the faces; check axis= and point=")
    return rotation(angle * axis)


def _refuse_part(pair: FacePair, turn: Floats) -> None:
    """A turn (3, 3) must lead back to the start, for sectors to make a whole."""
    angle = float(np.arccos(np.clip((np.trace(turn) - 1.0) / 2.0, -1.0, 1.0)))
    sectors = 2.0 * np.pi / angle
    if abs(angle - 2.0 * np.pi / round(sectors)) > MATCH:
        few = int(sectors)
        raise SceneError(
            f"{pair.what}: the faces are {np.degrees(angle):.6g} degrees apart, and {sectors:.6g} sectors make no turn; "
            f"draw {360.0 / few:.6g} degrees, {few} sectors, or {360.0 / (few + 1):.6g}, {few + 1} sectors"
        )


def _nearest(places: Floats, X: Floats) -> tuple[Ints64, Floats]:
    """The nearest of as many X (n, 3) to each place (n, 3), and how far it is."""
    at = np.empty(len(X), dtype=np.int64)
    at[np.argsort(places @ RAY)] = np.argsort(X @ RAY)
    apart = np.linalg.norm(places - X[at], axis=1)
    open_ = np.flatnonzero(apart > MATCH * np.ptp(X, axis=0).max())
    for rows in np.array_split(open_, 1 + len(open_) * len(X) // SOME):
        squares = ((places[rows, None] - X[None]) ** 2).sum(axis=2)
        at[rows], apart[rows] = squares.argmin(axis=1), np.sqrt(squares.min(axis=1))
    return at, apart


def ways_of(scene: "Scene", stated: Sequence[Stage], stages: Stages) -> list[tuple[str, Path]]:
    """Name and relative displacement (3,) of each pair over the stages: what the scene says in the first one, what stages
    add. Collective."""
    parts = [dict[int, Part]() for _ in scene.pairs]
    for i, stage in enumerate(stated):
        for key, value in stage.relative.items():
            names = tuple(group_names(group, stage.says("relative")) for group in key)
            what = stage.says(f"relative of '{'+'.join(names[0])}' - '{'+'.join(names[1])}'")
            k = next((k for k, pair in enumerate(scene.pairs) if (pair.first, pair.second) == names), None)
            if k is None or scene.pairs[k].axis is not None:
                known = ", ".join(pair.name for pair in scene.pairs if pair.axis is None) or "none"
                raise SceneError(
                    f"{what}: the scene states no such periodic pair; state it, scene.periodic({shown(key[0])}, "
                    f"{shown(key[1])}); it has {known}"
                )
            parts[k][i] = Part(_way(scene, value, what), by=True)
    named = zip(scene.pairs, parts, strict=True)
    return [(f"relative displacement of the {one.what}", Course(stages, one.way, of, np.zeros(3))) for one, of in named]


def _way(scene: "Scene", relative: Drive, what: str) -> Path:
    """A relative displacement as a function of t or s, which a plane mesh must allow."""
    way, section = ramp(scene.mesh.comm, relative, what), scene.section
    shut = [] if section is None else [0, 2] if section.axisymmetric else [2]
    if any(way(t)[i] != 0.0 for i in shut for t in (0.25, 0.5, 1.0)):
        raise SceneError(f"{what} = {shown(relative)}: a plane mesh cannot be led so; leave that component out")
    return way


# -- statements -------------------------------------------------------------------------------------------------------
def paired(
    scene: "Scene", first: Group, second: Group, relative: Drive, axis: object = None, point: object = None
) -> FacePair:
    """A FacePair as it is stated, checked but for its nodes. Collective."""
    word, section = "periodic" if axis is None else "cyclic", scene.section
    names, others = group_names(first, f"{word}: first"), group_names(second, f"{word}: second")
    pair = FacePair(names, others, Ramp(np.zeros(3)))
    what = f"{word} pair {pair.name}"
    if common := set(names) & set(others):
        raise SceneError(f"{what}: both faces are '{common.pop()}'; name two")
    for group in (names, others):
        scene.groups.facets(group)
    if axis is not None:
        along, through = np.array(unit(axis, what)), finite(point, f"{what}: point", (3,))
        if section is not None and (section.axisymmetric or abs(along[2]) != 1.0):
            raise SceneError(f"{what}: in a plane mesh faces are turned about z alone, in axisymmetric ones not at all")
        return replace(pair, axis=along, point=through)
    return replace(pair, way=_way(scene, relative, f"{what}: relative"))
