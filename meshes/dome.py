"""A quarter of a spherical cap of hexahedra, three blocks in plan so that none of them collapses at the crown."""

import gmsh
import numpy as np

from fenics_contact.meshes import disc


def build(
    radius: float = 40.0,
    half_angle: float = 45.0,
    thickness: float = 1.5,
    boss: float = 4.0,
    cells: int = 5,
    layers: int = 1,
) -> None:
    """Quarter x, y >= 0 of a cap about the origin, its wall centred on `radius` and `half_angle` [degrees] wide.

    boss: extra thickness of the crown's inside, fading out between half and three quarters of the way to the rim [length];
    cells: along each side of the three blocks; layers: of cells through the wall. Surfaces: symmetry_x (x = 0),
    symmetry_y (y = 0), inner, outer and rim.
    """
    disc.build(radius=1.0, depth=1.0, cells=cells, layers=layers)
    tags, places, _ = gmsh.model.mesh.getNodes()
    for tag, (x, depth, y) in zip(tags, places.reshape(-1, 3), strict=True):
        share = np.hypot(x, y)  # of the way from the crown to the rim
        angle, fade = np.radians(half_angle) * share, np.clip(3 - 4 * share, 0, 1)
        r = radius + thickness * (0.5 - depth) - boss * fade**2 * (3 - 2 * fade) * depth
        plan = r * np.sin(angle) / share if share > 0 else 0.0
        gmsh.model.mesh.setNode(tag, [plan * x, plan * y, r * np.cos(angle)], [])
    # the disc's names, turned with it
    for old, new in (("disc", "dome"), ("front", "outer"), ("back", "inner"), ("symmetry_z", "symmetry_y")):
        for dim, tag in gmsh.model.getPhysicalGroups():
            if gmsh.model.getPhysicalName(dim, tag) == old:
                gmsh.model.removePhysicalName(old)
                gmsh.model.setPhysicalName(dim, tag, new)
