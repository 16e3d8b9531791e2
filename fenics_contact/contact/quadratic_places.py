"""Where Gauss points of slave facets of degree 2 meet facets of degree 2."""

import numpy as np

from fenics_contact import compat
from fenics_contact.assembly.facet_points import ACROSS
from fenics_contact.assembly.term import State
from fenics_contact.contact.pairing import Pairing, Seek, along_normals
from fenics_contact.contact.point_places import PointPlaces
from fenics_contact.contact.unit import unit
from fenics_contact.types import Floats, Ints


class QuadraticPlaces(PointPlaces):
    """A foot lies on the true facet, along the slave's own normal, straight or curved, in space and in the plane."""

    def _seek(self) -> Seek:
        return along_normals(0.0, quadratic=True)

    def _outward(self, coords: Floats) -> Floats:
        """Unit normals (np, 3) out of the slave in its points, the nodes at coords."""
        tangents = np.einsum("qtk,qkc->tqc", self.gradients, coords[self.nodes])
        return unit(np.cross(tangents[0], tangents[1] if len(tangents) > 1 else ACROSS))

    def looks(self, state: State) -> Floats:
        """Unit directions (ne, nq, 3) in which this rank's slave points look for the master: their normals. Collective."""
        return self.feet(state).normals.reshape((*self.surface.area.shape, 3))

    def node_gaps(self, state: State, nodes: Ints, X: Floats) -> Floats:
        """Gaps (n,) of slave nodes along the mean normals around them, endless without a partner. Collective."""
        coords, outward = (feet := self.feet(state)).coords, feet.normals
        normal, weights = compat.Function(state.u.function_space), self.surface.a.reshape(-1, self.surface.a.shape[2])
        sums, local = normal.x.array.reshape(-1, 3), self.slave[self.nodes]
        # squares: on quadratic triangles a corner's shape function has no area
        np.add.at(sums, local, weights[..., None] ** 2 * outward[:, None])
        compat.sum_to_owners(normal)
        compat.copy_to_ghosts(normal)
        places = coords[np.searchsorted(self.slave, nodes)]
        return Pairing(self.facets, self._seek(), self.search).far(places, unit(sums[nodes]), coords, self.search)[4]
