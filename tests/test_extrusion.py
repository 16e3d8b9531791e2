"""A seal pressed against a wall with a round edge: below it is a gap that the rubber enters, where nothing presses."""

import gmsh
import numpy as np
import pytest

from fenics_contact import Body, Method, Output, Result, Scene, neo_hooke, read_gmsh, rigid_curve, rigid_plane, solve
from fenics_contact.meshes import rectangles

pytestmark = pytest.mark.serial
WIDTH, HEIGHT, GAP, RADIUS = 6.0, 3.0, 0.5, 0.3  # mm, the seal's, below the wall and of the wall's edge
PRESSURE = 4.0  # MPa, from behind


def wall(chords: int, parts: int) -> None:
    """Its face and what lies above the gap, straight and in few parts, and the edge in chords."""
    turns = np.linspace(0.0, np.pi / 2, chords + 1)
    edge = [(WIDTH + RADIUS * (1.0 - np.sin(a)), GAP + RADIUS * (1.0 - np.cos(a))) for a in turns]
    places = [(2.0 * WIDTH, GAP), *edge, (WIDTH, 9.0)]
    points = [gmsh.model.geo.addPoint(x, y, 0.0) for x, y in places]
    lines = [gmsh.model.geo.addLine(a, b) for a, b in zip(points, points[1:], strict=False)]
    for line in lines:
        gmsh.model.geo.mesh.setTransfiniteCurve(line, parts + 1 if line in (lines[0], lines[-1]) else 2)
    gmsh.model.geo.synchronize()
    gmsh.model.setPhysicalName(1, gmsh.model.addPhysicalGroup(1, lines), "wall")
    gmsh.model.mesh.generate(1)


def pressed(degree: int, chords: int, parts: int) -> Result:
    cells = (12, 8) if degree == 1 else (6, 4)
    mesh = read_gmsh(rectangles.build, rectangles={"seal": ((0.0, 0.0), (WIDTH, HEIGHT), cells)})
    scene = Scene(Body(mesh, "seal", neo_hooke(1.0, 10.0)), plane="strain", degree=degree)
    scene.contact("seal_ymin", rigid_plane((0, 0, 0), normal=(0, 1, 0)), name="floor")
    scene.contact("seal_ymax", rigid_plane((0, HEIGHT, 0), normal=(0, -1, 0), name="lid"), name="top")
    tool = rigid_curve(wall, group="wall", flip=True, chords=chords, parts=parts)
    scene.contact("seal_xmax", tool, friction=0.3, name="front")
    scene.pressure("seal_xmin", PRESSURE)
    return solve(scene, steps=3, method=Method(stabilise=True), out=Output(progress=False)).require()


@pytest.mark.parametrize("degree", [1, 2])
def test_nothing_presses_in_the_gap_however_fine_the_edge_is(degree: int) -> None:
    """Beside chords shorter than what faces them by far, the straight face, in one part, was continued down to the floor:
    no force along it, and pressure in the gap, without a note."""
    forces = {}
    for chords, parts in ((6, 1), (24, 1), (24, 40)):
        result = pressed(degree, chords, parts)
        line = result.line("front", "y")
        assert (line["pressure_MPa"][line["y_mm"] < GAP - 0.1] == 0.0).all()
        assert result.column("front_force_x_N")[-1] == pytest.approx(
            -PRESSURE * HEIGHT, rel=3e-3
        )  # and what lid and floor give way
        forces[chords, parts] = result.column("front_force_y_N")[-1]
    assert forces[24, 1] == pytest.approx(forces[24, 40], rel=0.02)
    assert forces[6, 1] == pytest.approx(forces[24, 40], rel=0.05)
    assert forces[24, 1] < -1.0
