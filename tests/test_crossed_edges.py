"""Edges that cross between nodes: no node of either body lies behind the other's facets, and no pressure holds them."""

import re

import gmsh
import numpy as np
import pytest

from fenics_contact import Body, Scene, neo_hooke, read_gmsh, rigid_surface, solve
from fenics_contact.contact.crossing import _side
from fenics_contact.contact.master import FacetSurface
from fenics_contact.kernels.closest_point import EDGE
from fenics_contact.meshes import box, two_blocks

pytestmark = pytest.mark.parallel
SLOPE = 0.6
ACROSS = np.hypot(1.0, SLOPE)  # how far down a ridge of that slope a place lies over its distance from the sides
SOFT = neo_hooke(1.0, 3.0)


def placed(name, move):
    """Places of a body's nodes that move (x, y, z) -> z leads up or down."""
    (group,) = (tag for _, tag in gmsh.model.getPhysicalGroups(3) if gmsh.model.getPhysicalName(3, tag) == name)
    (volume,) = gmsh.model.getEntitiesForPhysicalGroup(3, group)
    tags, places, _ = gmsh.model.mesh.getNodes(3, volume, includeBoundary=True)
    for tag, (x, y, z) in dict(zip(tags, places.reshape(-1, 3), strict=True)).items():
        gmsh.model.mesh.setNode(tag, (x, y, move(x, y, z)), [])


SIZE, LOW = (2.0, 2.0, 1.0), (-1.0, -1.0)


def falls(x, y, z):
    return z - SLOPE * abs(y) * (1.0 + z)


def roofs(n, m, across):
    """Ridge on ridge at right angles in the origin; n, m: cells along the lower and the upper one, and across both."""
    cells = {"lower_cells": (n, across, 2), "upper_cells": (across, m, 2)}
    two_blocks.build(lower=SIZE, lower_origin=(*LOW, -1.0), upper=SIZE, upper_origin=(*LOW, 0.0), **cells)
    placed("lower", falls)
    placed("upper", lambda x, y, z: z + SLOPE * abs(x) * (1.0 - z))


def roof(n, across):
    box.build(SIZE, (n, across, 2), (*LOW, -1.0), "lower")
    placed("lower", falls)


def tool(m):
    """The sides of the upper ridge, of m facets along it."""
    g = gmsh.model.geo
    x = np.array([[-1.0, 0.0, 1.0], [1.0, 1.0, 1.0]])
    low, high = ([g.addPoint(a, y, SLOPE * abs(a)) for a in x[0]] for y in (-1.0, 1.0))
    along = [g.addLine(*ends) for ends in zip(low, high, strict=True)]
    sides = [[g.addLine(*ends) for ends in zip(row[:-1], row[1:], strict=True)] for row in (low, high)]
    loops = [g.addCurveLoop([sides[0][i], along[i + 1], -sides[1][i], -along[i]]) for i in range(2)]
    faces = [g.addPlaneSurface([loop]) for loop in loops]
    for lines, cells in ((along, m), (sides[0] + sides[1], 1)):
        for line in lines:
            g.mesh.setTransfiniteCurve(line, cells + 1)
    for face in faces:
        g.mesh.setTransfiniteSurface(face)
        g.mesh.setRecombine(2, face)
    g.synchronize()
    gmsh.model.setPhysicalName(2, gmsh.model.addPhysicalGroup(2, faces), "roof")
    gmsh.model.mesh.generate(2)


def pressed(down, n=3, m=3, kind="body", across=4, swapped=False, steps=1):
    """Of two roofs, the upper one a tool's where kind is that, pressed into each other."""
    if kind == "tool":
        scene, upper = Scene(Body(read_gmsh(roof, n=n, across=across), "lower", SOFT)), rigid_surface(tool, m=m, flip=True)
        scene.fix("zmin")
        scene.contact("zmax", upper, 0.0, name="c")
        return solve(scene, move={upper: (0.0, 0.0, -down)}, steps=steps)
    mesh = read_gmsh(roofs, n=n, m=m, across=across)
    scene = Scene(Body(mesh, "lower", SOFT), Body(mesh, "upper", SOFT))
    scene.fix("lower_bottom")
    scene.fix("upper_top", "xy")
    scene.prescribe("upper_top", "z", -down)
    sides = "lower_top", "upper_bottom"
    scene.contact(*(sides[::-1] if swapped else sides), 0.0, name="c")
    return solve(scene, steps=steps)


def said(result, words):
    return [note for note in result.verdict.notes if words in note]


def depth(note):
    return float(re.search(r"lie ([\d.e-]+) in each other", note)[1])


@pytest.mark.parametrize("down", [0.02, 0.2])
@pytest.mark.parametrize("where", [{}, {"swapped": True}, {"kind": "tool"}, {"m": 5}])
def test_ridges_that_cross_between_nodes_lie_in_each_other_as_deep_as_they_do(down, where):
    """Nothing holds them, so that how deep a ridge lies below the other's sides is known."""
    result = pressed(down, **where).require()
    assert not result.column("c_load_N").any()
    (note,) = said(result, "never closed")
    assert depth(note) == pytest.approx(down / ACROSS, rel=5e-3) and "edge" in note and "away" not in note
    deep = said(result, "nothing presses yet")
    assert len(deep) == (down == 0.2) and all("step 1 " in one and "in each other" in one for one in deep)


def test_ridges_that_end_before_they_touch_do_so():
    result = pressed(-0.01).require()
    (note,) = said(result, "never closed")
    assert "away" in note and "in each other" not in note


def test_edges_that_have_come_in_deep_are_lost():
    """Three quarters of the slave's facet, whose shorter side lies up the slope."""
    result = pressed(0.5, n=1, m=1, across=8, steps=50)
    assert result.verdict.kind == "projection lost" and "lie" in result.verdict.reason
    assert "where an edge of one crosses the other" in result.verdict.reason
    assert 0.5 * result.column("t")[-1] / ACROSS == pytest.approx(0.75 * 0.25 * ACROSS, abs=0.012)


def test_each_side_of_a_triangle_on_the_border_is_known():
    """A square of two, in whichever corner they begin: behind its four sides nothing lies, behind their common one it goes
    on, and that alone is no border edge that is asked."""
    X = np.array([[0.0, 0.0, 0.0], [1.0, 0.0, 0.0], [1.0, 1.0, 0.0], [0.0, 1.0, 0.0]])
    for i, j in np.ndindex(3, 3):
        rings = np.array([np.roll([0, 1, 2], i), np.roll([2, 3, 0], j)])
        side = _side(FacetSurface((rings[:, [0, 1, 2, 2]], np.array([3, 3])), X), False)
        assert side.border[EDGE].sum() == 4 and len(side.edges) == 5
        assert side.edges[side.beside[:, 0] != side.beside[:, 1]].tolist() == [[0, 2]]
