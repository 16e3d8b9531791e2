"""What a run says of strain that bodies keep where nothing loads them any more."""

import gmsh
import numpy as np
import pytest

from fenics_contact import Body, Method, Scene, neo_hooke, read_gmsh, rigid_cylinder, solve

pytestmark = pytest.mark.parallel
SPAN, THICK = 20.0, 0.4


def strip(rise):
    """A strip on pins at its lower corners, bent to an arch of so much rise [mm]."""

    def build():
        gmsh.model.geo.addPoint(-SPAN / 2, 0.0, 0.0, tag=1)
        for tag, (x, y) in enumerate(((SPAN / 2, 0.0), (SPAN / 2, THICK), (-SPAN / 2, THICK)), 2):
            gmsh.model.geo.addPoint(x, y, 0.0, tag=tag)
        sides = [gmsh.model.geo.addLine(i, i % 4 + 1) for i in range(1, 5)]
        surface = gmsh.model.geo.addPlaneSurface([gmsh.model.geo.addCurveLoop(sides)])
        for side, cells in zip(sides, (16, 1, 16, 1), strict=True):
            gmsh.model.geo.mesh.setTransfiniteCurve(side, cells + 1)
        gmsh.model.geo.mesh.setTransfiniteSurface(surface)
        gmsh.model.geo.mesh.setRecombine(2, surface)
        gmsh.model.geo.synchronize()
        gmsh.model.setPhysicalName(2, gmsh.model.addPhysicalGroup(2, [surface]), "strip")
        gmsh.model.setPhysicalName(1, gmsh.model.addPhysicalGroup(1, [sides[2]]), "top")
        for name, point in (("left", 1), ("right", 2)):
            gmsh.model.setPhysicalName(0, gmsh.model.addPhysicalGroup(0, [point]), name)
        gmsh.model.mesh.generate(2)
        tags, places, _ = gmsh.model.mesh.getNodes()
        for tag, (x, y, z) in zip(tags, places.reshape(-1, 3), strict=True):
            gmsh.model.mesh.setNode(tag, [x, y + rise * np.cos(np.pi * x / SPAN), z], [])

    scene = Scene(Body(read_gmsh(build), "strip", neo_hooke(1.0, 5.0)), degree=2, plane="strain")
    scene.fix(("left", "right"))
    return scene


@pytest.mark.parametrize("rise, snaps", [(0.0, False), (2.0, True)])
def test_an_arch_that_stays_on_the_other_side(rise, snaps):
    """A roller goes down and back: a flat strip follows it, an arch stays where it has snapped to, and both are said to."""
    scene = strip(rise)
    roller = rigid_cylinder(2.0, (0.0, rise + THICK + 2.0, 0.0), (0.0, 0.0, 1.0), name="roller")
    scene.contact("top", roller)
    depth = 2.0 * rise + 1.0
    way = {roller: lambda t: (0.0, -depth * (1.0 - abs(1.0 - 2.0 * t)) + 0.1 * max(2.0 * t - 1.0, 0.0), 0.0)}
    result = solve(scene, move=way, steps=12, method=Method(damping=True)).require()
    kept = result.column("strain_energy_Nmm")[-1] / result.column("strain_energy_Nmm").max()
    told = [note for note in result.verdict.notes if "at the end nothing loads the bodies" in note]
    assert (kept > 0.1, len(told)) == (snaps, snaps), (kept, result.verdict.notes)
    assert not snaps or f"keep {kept:.2g} of" in told[0]


def test_a_thin_roller_that_presses():
    """A roller deflects a flat strip by more than its own diameter and the strip's thickness: where it ends it would lie
    below the strip at rest and free of it, yet it is what holds the strip bent, against the pins."""
    scene, radius, depth = strip(0.0), 0.2, 1.5
    roller = rigid_cylinder(radius, (0.0, THICK + radius, 0.0), (0.0, 0.0, 1.0), name="roller")
    scene.contact("top", roller, name="c")
    result = solve(scene, move={roller: (0.0, -depth, 0.0)}, steps=6).require()
    last = result.history[-1]
    assert depth > THICK + 2.0 * radius and last["c_force_y_N"] < 0.0
    assert last["left_right_reaction_y_N"] == pytest.approx(-last["c_force_y_N"], rel=1e-6)
    assert not any("at the end nothing loads the bodies" in note for note in result.verdict.notes), result.verdict.notes
