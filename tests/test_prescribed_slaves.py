"""Slave nodes that supports prescribe along the contact's normal: penalty times overlap acts on them, no body's force."""

import gmsh
import numpy as np
import pytest
from mpi4py import MPI

from fenics_contact import Body, Scene, mooney_rivlin, read_gmsh, rigid_cylinder, rigid_plane, rigid_sphere, solve
from fenics_contact.meshes import box

pytestmark = pytest.mark.parallel
COMM = MPI.COMM_WORLD
RUBBER = mooney_rivlin(a1=0.1863, a2=0.0098, K=5.0)


def pressed_beside(slave, **options):
    """A block, held below and at its side xmin, whose edge nodes above are so prescribed, under a plane that comes down."""
    scene = Scene(Body(read_gmsh(box.build, size=(4.0, 2.0, 2.0), cells=(4, 2, 2)), "box", RUBBER))
    scene.fix("zmin")
    scene.fix("xmin")
    plane = rigid_plane((0, 0, 2.0), (0, 0, -1.0), name="plane")
    scene.contact(slave, plane, 0.0, name="c", **options)
    return solve(scene, move={plane: (0, 0, -0.2)}, steps=2)


def led(result):
    return [note for note in result.verdict.notes if "where supports prescribe" in note]


@pytest.mark.parametrize("options", [{}, {"penetration": 1e-4}])
def test_force_on_prescribed_slave_nodes_is_said(options):
    result = pressed_beside("zmax", **options).require()
    (note,) = led(result)
    contact, total = result.system.contact_terms[0], result.history[0]["c_force_z_N"]
    # the three prescribed nodes: a quarter or half of a facet each, as deep as the plane has come in the first step
    own = max(COMM.allgather(contact.trial.law.eps_n.max(initial=0.0))) * 0.1 * (0.25 + 0.5 + 0.25)
    assert float(note.split(" of the contact's force")[0].split()[-1]) == pytest.approx(own / abs(total), rel=0.01)
    assert note.split("most at ")[1].split(":")[0].endswith(", 1, 2)")  # the middle one, of half a facet
    # what supports hold is no matter of penalties, nor of multipliers
    assert not [other for other in result.verdict.notes if "is not kept" in other or "penalties raised" in other]


def test_prescribed_slave_nodes_that_nothing_touches_are_fine():
    scene = Scene(Body(read_gmsh(box.build, size=(4.0, 2.0, 2.0), cells=(4, 2, 2)), "box", RUBBER))
    scene.fix("zmin")
    scene.fix("xmin")
    ball = rigid_sphere(1.0, (3.0, 1.0, 3.0), name="ball")
    scene.contact("zmax", ball, 0.0, name="c")
    assert not led(solve(scene, move={ball: (0, 0, -0.2)}, steps=2).require())


@pytest.mark.parametrize("options", [{}, {"points": "nodes"}, {"points": 3}, {"points": "nodes", "penetration": 1e-4}])
def test_held_nodes_on_a_tool_are_open_where_nothing_presses(options):
    """A plane lies on a block, one side of which is held, and the other is drawn down: the held edge stays on the plane,
    which carries nothing."""
    scene = Scene(Body(read_gmsh(box.build, size=(4.0, 2.0, 2.0), cells=(4, 2, 2)), "box", RUBBER))
    scene.fix("xmin")
    scene.prescribe("xmax", "z", -0.2)
    scene.contact("zmax", rigid_plane((0, 0, 2.0), (0, 0, -1.0), name="plane"), 0.3, name="c", **options)
    result = solve(scene, steps=1).require()
    (row,), line = result.history, result.line("c", "x", {"y": 1.0})
    names = ("load_N", "area_mm2", "width_x_mm", "width_y_mm", "active_points", "sticking_points", "penetration_mm")
    assert [row[f"c_{name}"] for name in names] == pytest.approx(7 * [0.0], abs=1e-12)
    assert abs(line["gap_mm"]).min() < 0.1 and not line["status"].any() and not len(result.widths("c", "x", {"y": 1.0}))


def arch():
    """A quarter of a tube; its bore in two parts, `near` beside the end on the axis x."""
    g = gmsh.model.geo
    centre, ends = g.addPoint(0, 0, 0), [np.array([np.cos(a), np.sin(a)]) for a in (0.0, np.pi / 8, np.pi / 2)]
    inner, outer = ([g.addPoint(*(radius * end), 0) for end in ends] for radius in (5.0, 8.0))
    rings = [[g.addCircleArc(ring[i], centre, ring[i + 1]) for i in range(2)] for ring in (inner, outer)]
    spokes = [g.addLine(*pair) for pair in zip(inner, outer, strict=True)]
    for i, cells in enumerate((2, 6)):
        face = g.addPlaneSurface([g.addCurveLoop([spokes[i], rings[1][i], -spokes[i + 1], -rings[0][i]])])
        for curve, count in ((spokes[i], 2), (spokes[i + 1], 2), (rings[0][i], cells), (rings[1][i], cells)):
            g.mesh.setTransfiniteCurve(curve, count + 1)
        g.mesh.setTransfiniteSurface(face)
        g.mesh.setRecombine(2, face)
    g.synchronize()
    gmsh.model.setPhysicalName(2, gmsh.model.addPhysicalGroup(2, [1, 2]), "tube")
    named = {"near": rings[0][:1], "far": rings[0][1:], "out": rings[1], "end": spokes[:1], "crown": spokes[2:]}
    for name, curves in named.items():
        gmsh.model.setPhysicalName(1, gmsh.model.addPhysicalGroup(1, curves), name)
    gmsh.model.mesh.generate(2)


def closed(slave, **options):
    """The arch pressed flat by a bar, its bore on its plane of symmetry, which its end is held on."""
    scene = Scene(Body(read_gmsh(arch), "tube", RUBBER), plane="strain", element="mixed")
    scene.fix("end", "y")
    scene.fix("crown", "x")
    bar = rigid_cylinder(10.0, (0, 18.0, 0), axis=(0, 0, 1), name="bar")
    scene.contact("out", bar, name="bar")
    scene.contact(slave, rigid_plane((0, 0, 0), (0, 1, 0), name="plane"), name="c", **options)
    return solve(scene, move={bar: (0, -6.5, 0)}, steps=8).require()


@pytest.mark.parametrize("options", [{}, {"points": 3}, {"penetration": 1e-4}])
def test_what_contact_covers_is_the_same_without_the_held_node(options):
    both, far = closed(("near", "far"), **options), closed("far", **options)
    assert far.column("c_load_N")[-1] > 0.0 and far.column("c_width_x_mm")[-1] < 7.0 < 9.0 < both.line("c", "x")["x_mm"][-1]
    for name in ("load_N", "area_mm2", "width_x_mm", "active_points", "penetration_mm"):
        np.testing.assert_allclose(both.column(f"c_{name}"), far.column(f"c_{name}"), rtol=1e-6, atol=1e-9, err_msg=name)
    np.testing.assert_allclose(both.widths("c", "x"), far.widths("c", "x"), rtol=1e-6)
