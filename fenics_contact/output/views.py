"""From where to look at a model: along the thin axis of a slice, else from where most of the drawn field is seen."""

from dataclasses import dataclass

import numpy as np

from fenics_contact.output.skin import AXES, FLAT, DrawnSkin, normals
from fenics_contact.types import Bools, Floats

FLATTER = 0.5  # of the largest: thickness up to which one layer of cells is a slice
THIN = 0.1  # of the other two: the same of several layers
# Directions by preference, elevation and azimuth [degrees]: those behind are taken where they show more of the field
ELEVATIONS, AZIMUTHS = (30.0, 50.0, -30.0, -50.0), (-60.0, -30.0, 30.0, 60.0, 120.0, 150.0, -120.0, -150.0)
ENOUGH = 0.95  # of what the best direction shows
BELOW = 0.6  # what is seen from below counts so much of what is seen from above, where people look from
GRAZING = 0.35  # cosine between a facet's normal and the direction to the eye from which on all of it counts as seen
UPRIGHT = np.eye(3)
Angles = tuple[float, float]


@dataclass(frozen=True)
class Camera:
    """A parallel projection. right, up, towards (3,): unit vectors of the picture and to the eye; axis: that of a slice."""

    right: Floats
    up: Floats
    towards: Floats
    axis: int | None = None

    def flat(self, points: Floats) -> Floats:
        """Places (..., 2) in the picture of points (..., 3)."""
        return points @ np.column_stack([self.right, self.up])

    def depth(self, points: Floats) -> Floats:
        """How near to the eye points (..., 3) are [length]."""
        return points @ self.towards


def along(axis: int) -> Camera:
    """A slice seen along its axis, the other two to the right and up: x-y from z, x-z from -y, y-z from x."""
    first, second = (i for i in range(3) if i != axis)
    unit = np.eye(3)
    return Camera(unit[first], unit[second], np.cross(unit[first], unit[second]), axis)


def from_angles(elevation: float, azimuth: float, frame: Floats = UPRIGHT) -> Camera:
    """elevation above the x-y plane, azimuth about z from x [degrees], of the eye; frame (3, 3): rows x, y, z."""
    e, a = np.radians([elevation, azimuth])
    towards = np.array([np.cos(e) * np.cos(a), np.cos(e) * np.sin(a), np.sin(e)])
    right = np.array([-np.sin(a), np.cos(a), 0.0])
    return Camera(right @ frame, np.cross(towards, right) @ frame, towards @ frame)


def upright(down: Floats) -> Floats:
    """Frame (3, 3) for `from_angles` whose z is up where weight acts along `down` (3,), a coordinate axis; else UPRIGHT."""
    along = np.flatnonzero(np.abs(down) > FLAT * np.abs(down).max())
    if len(along) != 1:
        return UPRIGHT
    right, up = np.eye(3)[int(along[0] == 0)], -np.sign(down) * np.eye(3)[along[0]]
    return np.array([right, np.cross(up, right), up])


def slice_axis(body: DrawnSkin) -> int | None:
    """The axis across a plane-strain slice: nothing moves along it, and it is one cell thick, or thin. None: no slice."""
    size = np.ptp(body.X.reshape(-1, 3), axis=0)
    moved = np.abs(body.x - body.X).max(axis=(0, 1))
    low, high = body.X.min(axis=(0, 1)), body.X.max(axis=(0, 1))
    from_ends = np.minimum(body.X - low, high - body.X).max(axis=(0, 1))
    one_cell = (from_ends < FLAT * size.max()) & (size < FLATTER * size.max())
    thin = size < THIN * np.sort(size)[1]
    found = (moved <= FLAT * moved.max()) & (one_cell | thin)
    return int(np.argmin(np.where(found, size, np.inf))) if found.any() else None


def choose(body: DrawnSkin, opaque: Bools, wanted: str | Angles | None, frame: Floats = UPRIGHT) -> Camera:
    """The view of a model: the one wanted, an axis or (elevation, azimuth) in degrees, or the best.

    opaque (n,): the facets that hide others; frame: see `upright`. The best: of a slice along its axis; else the first of
    the directions above from which nearly as much of the field is seen as from any, facets weighted by its square.
    """
    if isinstance(wanted, str):
        return along(AXES.index(wanted))
    if wanted is not None:
        return from_angles(*wanted)
    axis = slice_axis(body)
    if axis is not None:
        return along(axis)
    views = [from_angles(elevation, azimuth, frame) for elevation in ELEVATIONS for azimuth in AZIMUTHS]
    seen = np.array([_seen(body, opaque, view, frame[2]) for view in views])
    return views[int(np.argmax(seen >= ENOUGH * seen.max()))]


def _seen(body: DrawnSkin, opaque: Bools, view: Camera, up: Floats) -> float:
    """How much of the field is seen from a direction: facets that no opaque one hides, by area and the field's square."""
    normal, centre = normals(body.x), body.x.mean(axis=1)
    area = np.linalg.norm(normal, axis=1)
    facing = normal @ view.towards / np.maximum(area, 1e-300)
    value = np.abs(np.nan_to_num(body.values)).max(axis=1)
    strength = area * value**2
    if not strength.any():  # nothing but zeros: the surface it is defined on
        strength = area * np.isfinite(body.values).any(axis=1)
    place, depth = view.flat(centre), view.depth(centre)
    front = opaque & (facing > 0.0)
    if not front.any():
        return 0.0
    width = 1.5 * float(np.sqrt(np.median(area[front])))
    spot = np.floor((place - place.min(axis=0)) / width).astype(np.int64)
    spot = spot[:, 0] * (int(spot[:, 1].max()) + 1) + spot[:, 1]
    nearest = np.full(int(spot.max()) + 1, -np.inf)
    np.maximum.at(nearest, spot[front], depth[front])
    clear = depth >= nearest[spot] - 3.0 * np.maximum(width, np.sqrt(area))
    amount = float(np.sum(strength * clear * np.clip(facing / GRAZING, 0.0, 1.0)))
    return amount * (BELOW if view.towards @ up < 0.0 else 1.0)
