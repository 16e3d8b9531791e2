"""Analytic tools met by nodes, and their polygons by averages: `python3 docs/tools_by_averages.py`, for choices.md.

In plane strain: a strap wound a quarter turn over a drum and pulled until it slides, and a sharp punch on a layer.
"""

import gmsh
import numpy as np

from fenics_contact import (
    Body,
    Output,
    Scene,
    Stage,
    mooney_rivlin,
    neo_hooke,
    read_gmsh,
    rigid_curve,
    rigid_cylinder,
    rigid_punch,
    solve,
)
from fenics_contact.meshes import rectangles

RADIUS, TAIL, TURN = 25.0, 10.0, np.pi / 2  # mm, of the drum and of the strap's straight ends; of its winding
RIGHT = RADIUS * TURN + TAIL  # mm, from the point where the strap first touches to its moved end
STRETCH, STEPS = (1.0, 1.4, 1.4, 1.7), {"stretch": 3, "wind": 18, "pull": 10}
WIDE, HIGH = 20.0, 10.0  # mm, half of the punch and the layer


def polyline(points):
    """A curve named "tool" through points (n, 2), the bodies on its left."""
    tags = [gmsh.model.geo.addPoint(*point, 0) for point in points]
    lines = [gmsh.model.geo.addLine(*ends) for ends in zip(tags, tags[1:], strict=False)]
    gmsh.model.geo.synchronize()
    for line in lines:
        gmsh.model.mesh.setTransfiniteCurve(line, 2)
    gmsh.model.mesh.generate(1)
    gmsh.model.setPhysicalName(1, gmsh.model.addPhysicalGroup(1, lines), "tool")


def end(X, t):
    """Displacement (n, 2) of the strap's moved end: a rigid face, normal to the straight part between drum and end."""
    angle = np.interp(t, [1, 2], [0, TURN])
    along, normal = np.array([np.cos(angle), -np.sin(angle)]), np.array([np.sin(angle), np.cos(angle)])
    length = np.interp(t, range(4), STRETCH) * RIGHT - RADIUS * angle
    return RADIUS * normal + length * along + (X[:, 1:2] - RADIUS) * normal - X[:, :2] * [1, 1]


def strap(thick, sides=None):
    """A strap on a drum, or on one of so many sides: tangents, cut-backs, ratio of the end forces."""
    mesh = read_gmsh(rectangles.build, rectangles={"strap": ((-TAIL, RADIUS), (TAIL + RIGHT, thick), (80, 2))})
    scene = Scene(Body(mesh, "strap", neo_hooke(mu=0.4, K=5.0)), plane="strain")
    scene.fix("strap_xmin", "xy")
    scene.fix("strap_xmax", "xy")
    drum = rigid_cylinder(RADIUS, point=(0, 0, 0), axis=(0, 0, 1), name="drum")
    if sides is not None:
        angles = np.linspace(-0.6 * np.pi, 1.1 * np.pi, sides + 1)
        drum = rigid_curve(polyline, "tool", name="drum", points=RADIUS * np.column_stack([np.cos(angles), np.sin(angles)]))
    scene.contact("strap_ymin", drum, friction=0.3, name="wrap")
    stages = []
    for i, name in enumerate(STEPS):
        x, y = (lambda X, t, i=i, k=k: (end(X, i + t) - end(X, i))[:, k] for k in range(2))
        stages.append(Stage(name, prescribe={("strap_xmax", "x"): x, ("strap_xmax", "y"): y}, steps=STEPS[name]))
    result = solve(scene, stages=stages, out=Output(progress=False))
    x, y = (result.column(f"wrap_force_{axis}_N")[-1] for axis in "xy")
    return result.verdict.iterations, result.verdict.cuts, y / x


def punch(cells, formula):
    """A sharp punch, by its formula or by its polygon, 0.8 mm in a layer of 30 mm: tangents, cut-backs, force [N]."""
    mesh = read_gmsh(rectangles.build, rectangles={"layer": ((0.0, 0.0), (30.0, HIGH), (cells, cells // 3))})
    scene = Scene(Body(mesh, "layer", mooney_rivlin(a1=0.1863, a2=0.0098, K=5.0)), plane="strain")
    scene.fix("layer_ymin")
    scene.fix("layer_xmin", "x")
    corners = [(-WIDE, HIGH + 8), (-WIDE, HIGH), (WIDE, HIGH), (WIDE, HIGH + 8)]
    tool = rigid_curve(polyline, "tool", points=corners)
    if formula:
        tool = rigid_punch(half_width=WIDE, height=20.0, face=(0, HIGH, 0), direction=(0, -1, 0))
    scene.contact("layer_ymax", tool, name="top")
    result = solve(scene, move={tool: (0, -0.8, 0)}, steps=4, out=Output(progress=False))
    return result.verdict.iterations, result.verdict.cuts, abs(result.column("top_force_y_N")[-1])


if __name__ == "__main__":
    for thick in (2.0, 1.0, 0.5):
        print(f"strap {thick:g} mm: nodes", strap(thick), "averages on 400 sides", strap(thick, 400), flush=True)
    for cells in (15, 30, 60, 120):
        print(f"punch, {cells} cells: nodes", punch(cells, True), "averages", punch(cells, False), flush=True)
