"""Whether an analytic tool has passed through a slave surface in a step: by its looks the contact is open, or presses.

Both ends of a place's way are put into the tool's frame, where the way is straight and the facets turn on it as their
tangents do. A place that enters the tool by the front of its facet and leaves it by the back was passed through; one that
slides round the tool turns its front to it as it leaves. Of a way with the tool's sizes or shorter nothing is left of that.
"""

from typing import NamedTuple

import numpy as np

from fenics_contact.contact.tools import RigidTool
from fenics_contact.contact.unit import unit
from fenics_contact.kernels.rigid_element import ToolPose, distances, point_normals
from fenics_contact.types import Bools, Floats, Ints64

FINEST = 1 / 256  # of a way: what of it lies in the tool for less may be missed where it passes close by before
HALVINGS = 20  # of such a share, until where a way begins to lie in the tool is known
LOOKS = 17  # places between there and where it leaves the tool, at which is asked how deep they lie
LEAN = 0.05  # sine by which a facet must turn its front, or its back, to the tool: flat walls slide along each other
# Of a cell's height, and of the length within the tool: what goes less deep grazes it, as a secant of 45 degrees does
GRAZES = 0.1
ACROSS = -0.5  # cosine between the tool's normals where a place enters and leaves: these are two sides of the tool
BEYOND = 2.0  # a place of a facet of degree 2 may go farther than its nodes, by less than that


def at_start(tool: RigidTool) -> ToolPose:
    """A tool as kernels/rigid_element.py takes it, where it is at the start."""
    return tool.kind, tool.shape, tool.origin, tool.axes, np.zeros(3)


class Facets(NamedTuple):
    """Places on nf facets: weights a (nf, nq, k) of the nodes in them and gradients (nf, nq, 1 or 2, k) along tangents,
    t1 x t2 pointing out of the body, or t1 x z; X (nf, k, 3): reference positions of the nodes [length]."""

    a: Floats
    gradients: Floats
    X: Floats


class Ways(NamedTuple):
    """Of n places in the tool's frame: from `start` (n, 3) by `step` (n, 3) [length]; tangents (2, n, 2, 3) at both ends."""

    start: Floats
    step: Floats
    tangents: Floats

    def at(self, share: Floats, some: Ints64) -> Floats:
        """Where the places `some` (m,) are after shares (m,) of their ways."""
        return self.start[some] + share[:, None] * self.step[some]

    def outward(self, share: Floats, some: Ints64) -> Floats:
        """Unit normals (m, 3) out of the body there."""
        then, now = self.tangents[:, some]
        along = then + share[:, None, None] * (now - then)
        return unit(np.cross(along[:, 0], along[:, 1]))

    def back(self) -> "Ways":
        """The same ways from their ends."""
        return Ways(self.start + self.step, -self.step, self.tangents[::-1])


def depths_passed(facets: Facets, then: Floats, now: Floats, tool: ToolPose, height: float) -> tuple[Floats, Floats]:
    """How deep (n,) the ways of places on the facets that a tool has passed through have led through it, zero for others,
    and their reference positions (n, 3) [length].

    then, now (nf, k, 3): the facets' nodes at both ends, in the frame of `tool`; height: of a cell. Only places are looked
    at that can have met the tool: distances change by no more than the way.
    """
    middle, way = then.mean(axis=1), np.linalg.norm(now - then, axis=2).max(axis=1, initial=0.0)
    radius = np.linalg.norm(then - middle[:, None], axis=2).max(axis=1, initial=0.0)
    near = np.flatnonzero(BEYOND * way > np.maximum(tool_distances(middle, tool) - radius, 0.0))
    a, gradients = facets.a[near], facets.gradients[near]
    start, end = ((a @ x[near]).reshape(-1, 3) for x in (then, now))
    tangents = np.stack([facet_tangents(gradients, x[near]) for x in (then, now)])
    depth = _depths(Ways(start, end - start, tangents), tool, height)
    return depth, (a @ facets.X[near]).reshape(-1, 3)


def facet_tangents(gradients: Floats, x: Floats) -> Floats:
    """Tangents (n, 2, 3) at places; of a plane mesh the second one is across."""
    along = np.einsum("fqtk,fkc->fqtc", gradients, x)
    if along.shape[2] == 1:
        along = np.concatenate([along, np.broadcast_to([0.0, 0.0, 1.0], along.shape)], axis=2)
    return along.reshape(-1, 2, 3)


def _depths(ways: Ways, tool: ToolPose, height: float) -> Floats:
    """Depths (n,) of the ways that lead through the tool and out of it behind the surface, zero for others [length]."""
    out, length = np.zeros(len(ways.start)), np.linalg.norm(ways.step, axis=1)
    ends = tool_distances(ways.start, tool), tool_distances(ways.start + ways.step, tool)
    first, last = np.zeros_like(out), np.ones_like(out)

    def facing(some: Ints64, share: Floats) -> tuple[Floats, Floats]:
        """The tool's normals (m, 3), and sines (m,) by which the facets turn their backs to it."""
        normals = tool_normals(ways.at(share[some], some), tool)
        return normals, _dots(normals, ways.outward(share[some], some))

    some = np.flatnonzero(length > np.maximum(ends[0], 0.0) + np.maximum(ends[1], 0.0))
    left, met = _entries(ways.back(), some, tool)
    last[some], some = 1.0 - left, some[met]
    leaves, back = facing(some, last)
    leaves, some = leaves[back > LEAN], some[back > LEAN]  # in an ordinary step there are none
    first[some] = _entries(ways, some, tool)[0]
    enters, front = facing(some, first)
    shares = np.linspace(first[some], last[some], LOOKS)
    depth = np.max([-tool_distances(ways.at(share, some), tool) for share in shares], axis=0, initial=0.0)
    held = np.maximum(np.maximum(-ends[0], -ends[1])[some], 0.0)  # contact's own penetrations lead through nothing
    deep = depth - held > GRAZES * np.minimum((last - first)[some] * length[some], height)
    through = (front < -LEAN) & (deep | (_dots(enters, leaves) < ACROSS))
    out[some[through]] = depth[through]
    return out


def _entries(ways: Ways, some: Ints64, tool: ToolPose) -> tuple[Floats, Bools]:
    """Shares (m,) of the ways `some` after which they first lie in the tool, and which of them (m,) do."""
    length = np.linalg.norm(ways.step[some], axis=1)
    before, share, going = np.zeros(len(some)), np.zeros(len(some)), np.arange(len(some))
    while len(going):
        gap = tool_distances(ways.at(share[going], some[going]), tool)
        going, gap = going[gap > 0.0], gap[gap > 0.0]
        before[going] = share[going]
        share[going] += np.maximum(gap / length[going], FINEST)  # no part of the tool is nearer
        going = going[share[going] < 1.0]
    met = share < 1.0
    inside = np.flatnonzero(met & (share > 0.0))
    for _ in range(HALVINGS if len(inside) else 0):
        middle = 0.5 * (before[inside] + share[inside])
        deep = tool_distances(ways.at(middle, some[inside]), tool) <= 0.0
        share[inside], before[inside] = np.where(deep, middle, share[inside]), np.where(deep, before[inside], middle)
    return share, met


def _dots(a: Floats, b: Floats) -> Floats:
    return np.asarray(np.einsum("nc,nc->n", a, b))


def tool_distances(x: Floats, tool: ToolPose) -> Floats:
    """Signed distances (n,) to the tool of places x (n, 3)."""
    gap = np.empty(len(x))
    distances(np.ascontiguousarray(x), tool, gap)
    return gap


def tool_normals(x: Floats, tool: ToolPose) -> Floats:
    """Unit normals (n, 3) of the tool at places x (n, 3)."""
    out, one = np.empty((len(x), 1, 3)), np.ones((len(x), 1, 1))
    spacing = np.full(len(x), np.finfo(float).tiny)  # as it is: a sharp edge does not fade out between points
    point_normals((x[:, None], one, one[:, 0], spacing), tool, out)
    return out[:, 0]
