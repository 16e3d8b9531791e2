"""Quarter of a square plate on structured hexahedra, refined towards the edge of a square punch pressed on its top."""

import gmsh


def build(
    half_width: float = 40.0,
    height: float = 10.0,
    punch: float = 20.0,
    inside: int = 14,
    outside: int = 10,
    layers: int = 8,
    ratio: float = 1.15,
    patch: bool = False,
) -> None:
    """Quarter plate 0 <= x, y <= half_width, 0 <= z <= height [length].

    inside, outside: cells from the centre to the punch's edge and from there to the rim; layers: cells over the height;
    ratio: size of a cell over that of its neighbour nearer to the edge (1: uniform); patch: name the part of the top under
    the punch "under_punch" and only the rest "top".
    """
    plane = [
        gmsh.model.occ.addRectangle(x, y, 0, dx, dy)
        for x, dx in ((0, punch), (punch, half_width - punch))
        for y, dy in ((0, punch), (punch, half_width - punch))
    ]
    plane = [tag for _, tag in gmsh.model.occ.fragment([(2, plane[0])], [(2, tag) for tag in plane[1:]])[0]]
    gmsh.model.occ.synchronize()
    for _, curve in gmsh.model.getEntities(1):
        low, high = gmsh.model.getParametrizationBounds(1, curve)
        start, end = (gmsh.model.getValue(1, curve, list(bound)) for bound in (low, high))
        axis = 0 if abs(end[0] - start[0]) > abs(end[1] - start[1]) else 1
        under = max(start[axis], end[axis]) <= punch * (1 + 1e-9)
        away = abs(end[axis] - punch) > abs(start[axis] - punch)  # does the curve run away from the punch's edge?
        growth = ratio if away else 1 / ratio
        gmsh.model.mesh.setTransfiniteCurve(curve, (inside if under else outside) + 1, "Progression", growth)
    for face in plane:
        gmsh.model.mesh.setTransfiniteSurface(face)
        gmsh.model.mesh.setRecombine(2, face)
    tops = [ratio**i for i in range(layers)]  # thinner towards the top
    heights = [sum(tops[layers - 1 - j] for j in range(i + 1)) / sum(tops) for i in range(layers)]
    volumes = gmsh.model.occ.extrude([(2, face) for face in plane], 0, 0, height, [1] * layers, heights, recombine=True)
    gmsh.model.occ.synchronize()
    gmsh.model.mesh.generate(3)

    gmsh.model.setPhysicalName(3, gmsh.model.addPhysicalGroup(3, [tag for dim, tag in volumes if dim == 3]), "plate")
    for name, axis, place in (("symmetry_x", 0, 0), ("symmetry_y", 1, 0), ("bottom", 2, 0), ("top", 2, height)):
        faces = [f for _, f in gmsh.model.getEntities(2) if abs(gmsh.model.occ.getCenterOfMass(2, f)[axis] - place) < 1e-9]
        under = [f for f in faces if name == "top" and patch and max(gmsh.model.occ.getCenterOfMass(2, f)[:2]) < punch]
        for label, group in (("under_punch", under), (name, [f for f in faces if f not in under])):
            if group:
                gmsh.model.setPhysicalName(2, gmsh.model.addPhysicalGroup(2, group), label)
