"""Cook's membrane: a tapered panel of one layer of hexahedra, clamped on the left and loaded on the right."""

import gmsh


def build(cells: int = 16, thickness: float = 1.0, layers: int = 1) -> None:
    """Corners (0, 0), (48, 44), (48, 60), (0, 44) in the plane x, y; cells per edge [lengths in mm].

    Surfaces: left (x = 0), right (x = 48), front and back (z = 0, thickness).
    """
    geo = gmsh.model.geo
    corners = [geo.addPoint(x, y, 0) for x, y in ((0, 0), (48, 44), (48, 60), (0, 44))]
    edges = [geo.addLine(corners[i], corners[(i + 1) % 4]) for i in range(4)]
    for edge in edges:
        geo.mesh.setTransfiniteCurve(edge, cells + 1)
    front = geo.addPlaneSurface([geo.addCurveLoop(edges)])
    geo.mesh.setTransfiniteSurface(front)
    geo.mesh.setRecombine(2, front)
    (_, back), (_, volume), _, (_, right), _, (_, left) = geo.extrude(
        [(2, front)], 0, 0, thickness, [layers], recombine=True
    )
    geo.synchronize()
    gmsh.model.mesh.generate(3)
    gmsh.model.setPhysicalName(3, gmsh.model.addPhysicalGroup(3, [volume]), "membrane")
    for name, face in (("left", left), ("right", right), ("front", front), ("back", back)):
        gmsh.model.setPhysicalName(2, gmsh.model.addPhysicalGroup(2, [face]), name)
