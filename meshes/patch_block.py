"""A cube whose top (y = size) has a quarter of its own to load: a block under a patch load."""

import gmsh


def build(size: float = 1.0, cells: int = 8) -> None:
    """Cube 0 <= x, y, z <= size [length] of `cells` (an even number) per edge.

    Surfaces: patch (top, x and z below size/2), top (the rest of it), bottom (y = 0), symmetry_x, symmetry_z.
    """
    geo, half = gmsh.model.geo, range(3)
    points = {(i, j): geo.addPoint(i * size / 2, 0, j * size / 2) for i in half for j in half}
    along_x = {(i, j): geo.addLine(points[i, j], points[i + 1, j]) for i in range(2) for j in half}
    along_z = {(i, j): geo.addLine(points[i, j], points[i, j + 1]) for i in half for j in range(2)}
    for line in (*along_x.values(), *along_z.values()):
        geo.mesh.setTransfiniteCurve(line, cells // 2 + 1)
    base = []
    for i in range(2):
        for j in range(2):
            loop = [along_x[i, j], along_z[i + 1, j], -along_x[i, j + 1], -along_z[i, j]]
            base.append(geo.addPlaneSurface([geo.addCurveLoop(loop)]))
            geo.mesh.setTransfiniteSurface(base[-1])
            geo.mesh.setRecombine(2, base[-1])
    out = geo.extrude([(2, face) for face in base], 0, size, 0, [cells], recombine=True)
    geo.synchronize()
    gmsh.model.mesh.generate(3)
    gmsh.model.setPhysicalName(3, gmsh.model.addPhysicalGroup(3, [tag for dim, tag in out if dim == 3]), "block")
    groups: dict[str, list[int]] = {"patch": [], "top": [], "bottom": [], "symmetry_x": [], "symmetry_z": []}
    places = {"bottom": (1, 0.0), "top": (1, size), "symmetry_x": (0, 0.0), "symmetry_z": (2, 0.0)}
    for _, face in gmsh.model.getEntities(2):
        box = gmsh.model.getBoundingBox(2, face)
        flat = [n for n, (axis, at) in places.items() if max(abs(box[axis] - at), abs(box[axis + 3] - at)) < 1e-4 * size]
        if flat == ["top"] and max(box[3], box[5]) < 0.6 * size:
            flat = ["patch"]
        if flat:
            groups[flat[0]].append(face)
    for name, faces in groups.items():
        gmsh.model.setPhysicalName(2, gmsh.model.addPhysicalGroup(2, faces), name)
