"""What a run says of statements that can be meant, but seldom are."""

import gmsh
import numpy as np
import pytest
from drawn import quadrilateral, straight
from mpi4py import MPI

from fenics_contact import (
    Body,
    Motion,
    Penalty,
    Scene,
    SceneError,
    Stage,
    neo_hooke,
    read_gmsh,
    read_mesh,
    rigid_curve,
    rigid_hub,
    rigid_plane,
    solve,
)
from fenics_contact.meshes import rectangles

pytestmark = pytest.mark.parallel
COMM = MPI.COMM_WORLD
RUBBER = neo_hooke(mu=0.5, K=5.0)  # E = 1.45 MPa


def pressed(material=RUBBER, friction=0.0, **options):
    """A strip of four cells of 1 mm under a plane that touches it."""
    mesh = read_gmsh(rectangles.build, rectangles={"strip": ((0.0, 0.0), (4.0, 1.0), (4, 1))})
    scene = Scene(Body(mesh, "strip", material), plane="strain")
    scene.fix("strip_ymin")
    lid = rigid_plane((0.0, 1.0, 0.0), normal=(0.0, -1.0, 0.0), name="lid")
    scene.contact("strip_ymax", lid, friction, name="top", **options)
    return scene, lid


def notes(scene, **drive):
    result = solve(scene, steps=1, **drive)
    return result, "\n".join(result.verdict.notes)


@pytest.mark.parametrize("factor, known", [(1e8, "penalty too stiff"), (1e-6, "penalty too soft")])
def test_penalties_far_from_the_bodies_stiffness_are_named_first(factor, known):
    """However the run ends: with neither the cause is anything else, nor is a greater penalty the remedy of a stiff one."""
    scene, lid = pressed(friction=0.3, penalty=Penalty(factor=factor))
    result, said = notes(scene, push={lid: (0.0, -1.0, 0.0)})
    assert f"penalty= is {factor:.0e} times Young's modulus over a cell's height" in said
    assert result.converged or result.verdict.kind == known
    assert result.verdict.kind != "penalty too stiff" or "raise penalty" not in said


@pytest.mark.parametrize("factor", [1.0, 1e4])
def test_penalties_that_are_a_choice_are_not(factor):
    scene, lid = pressed(penalty=Penalty(factor=factor))
    assert "times Young's modulus" not in notes(scene, move={lid: (0.0, -0.1, 0.0)})[1]


@pytest.mark.parametrize("mu, K, ratio", [(2.5, 0.5, -0.44), (0.5, 0.3, -0.04), (0.5, 0.4, None)])
def test_moduli_that_are_mixed_up(mu, K, ratio):
    scene, lid = pressed(neo_hooke(mu=mu, K=K))
    said = notes(scene, move={lid: (0.0, -0.1, 0.0)})[1]
    assert ("Poisson's ratio of" in said) == (ratio is not None)
    assert ratio is None or f"Poisson's ratio of {ratio:.2f}" in said


@pytest.mark.parametrize("friction", [2.0, 30.0])
def test_friction_in_per_cent(friction):
    scene, lid = pressed(friction=friction)
    assert ("not in per cent" in notes(scene, move={lid: (0.0, -0.1, 0.0)})[1]) == (friction == 30.0)


def test_pressures_that_go_on_under_a_closed_contact():
    for where in ("all", "open"):
        scene, lid = pressed()
        scene.pressure("strip_ymax", 0.01, where=where)
        said = notes(scene, move={lid: (0.0, -0.1, 0.0)})[1]
        assert ("goes on beneath contact 'top'" in said) == (where == "all")
    scene, lid = pressed()
    scene.pressure("strip_xmax", 0.01)
    assert "goes on beneath" not in notes(scene, move={lid: (0.0, -0.1, 0.0)})[1]


def wave(t):
    """A pressure that is none in the middle and in the end."""
    return 0.01 * np.sin(2.0 * np.pi * t)


@pytest.mark.parametrize(
    "value, there",
    [
        (0.0, False),
        (lambda t: 0.0, False),
        (lambda X, t: np.where(X[:, 1] < 0.5, 0.01 * t, 0.0), False),  # on the sides' lower halves alone
        (wave, True),
        (lambda X, t: 0.01 * t * (X[:, 1] > 0.9), True),
    ],
)
def test_nothing_is_said_to_go_on_where_there_is_no_pressure(value, there):
    scene, lid = pressed()
    scene.pressure(("strip_ymax", "strip_xmax"), value)
    assert ("goes on beneath contact 'top'" in notes(scene, move={lid: (0.0, -0.1, 0.0)})[1]) == there


def test_a_pressure_that_a_later_stage_brings_goes_on():
    for later in (0.0, 0.01):
        scene, lid = pressed()
        scene.pressure("strip_ymax", 0.0)
        stages = [Stage("lid", move={lid: (0.0, -0.1, 0.0)}), Stage("load", pressures={"strip_ymax": later})]
        said = "\n".join(solve(scene, steps=1, stages=stages).verdict.notes)
        assert ("goes on beneath" in said) == (later > 0.0)


def test_loads_in_other_units_than_moduli():
    """0.1 MPa as 1e5 Pa, and a tool's 1 N as 1000 mN on 4 mm^2: no body of 1.45 MPa bears these."""
    scene, lid = pressed()
    scene.pressure("strip_xmax", 1e5)
    assert "comes to 1e+05 MPa, 7e+04 times Young's modulus" in notes(scene, move={lid: (0.0, -0.1, 0.0)})[1]
    scene, lid = pressed()
    said = notes(scene, push={lid: (0.0, -1000.0, 0.0)})[1]
    assert "the push of tool 'lid' over all of its contacts' area comes to 2.5e+02 MPa" in said
    scene, lid = pressed()
    stages = [Stage("lid", move={lid: (0.0, -0.1, 0.0)}), Stage("load", pressures={"strip_xmax": 0.5})]
    scene.pressure("strip_xmax", 0.01)
    assert "Young's modulus of all bodies" not in "\n".join(solve(scene, steps=1, stages=stages).verdict.notes)


@pytest.mark.parametrize("side, told", [("strip_ymin", True), ("strip_xmax", False)])
def test_a_force_on_a_side_that_is_fixed_all_over(side, told):
    mesh = read_gmsh(rectangles.build, rectangles={"strip": ((0.0, 0.0), (4.0, 1.0), (4, 1))})
    scene = Scene(Body(mesh, "strip", RUBBER), plane="strain")
    scene.fix("strip_ymin")
    scene.force(side, (0.0, -0.01, 0.0))
    assert (f"'{side}' moves nothing" in notes(scene)[1]) == told


@pytest.mark.parametrize("free", [False, True])
def test_a_force_on_a_side_that_a_hub_carries(free):
    """It moves the hub where that may go."""
    mesh = read_gmsh(rectangles.build, rectangles={"strip": ((0.0, 0.0), (4.0, 1.0), (4, 1))})
    scene, hub = Scene(Body(mesh, "strip", RUBBER), plane="strain"), rigid_hub("hub", (2.0, 1.0, 0.0))
    scene.fix("strip_ymin")
    scene.tie("strip_ymax", hub)
    scene.force("strip_ymax", (0.01, 0.0, 0.0))
    motion = Motion(force=(0.01, 0.0, 0.0)) if free else Motion(y=-0.01)
    assert ("'strip_ymax' moves nothing" in notes(scene, move={hub: motion})[1]) != free


@pytest.mark.parametrize("plane", ["strain", "axisymmetric"])
@pytest.mark.parametrize("share", [0.45, 0.6])
def test_a_corner_through_its_cell(share, plane):
    """A square of four nodes of which one is moved by a share of both sides: J = 1 - 2 share there, times 1 - share where it
    turns about a side, on which the strain is 0 / 0; and above zero in all points of which the stress asks."""
    mesh = read_gmsh(rectangles.build, rectangles={"square": ((0.0, 0.0), (1.0, 1.0), (1, 1))})
    scene = Scene(Body(mesh, "square", RUBBER), plane=plane, accept_locking=True)
    for side in ("xmin", "ymin", "xmax", "ymax"):
        for axis in "xy":
            scene.prescribe(f"square_{side}", axis, lambda X, t: -share * t * X[:, 0] * X[:, 1])
    result = solve(scene, steps=1).require()
    smallest, remarks = scene.volume_ratio(result.system.state.u).look()
    sizes = [remark.size for remark in remarks.values()]
    size = (2.0 * share - 1.0) * (1.0 - share if plane == "axisymmetric" else 1.0)
    assert sizes == pytest.approx([size] if share > 0.5 else [], abs=1e-5)
    assert result.column("smallest_J")[-1] == smallest > 0.0
    told = any("body 'square'" in note and "inside out at a corner" in note for note in result.verdict.notes)
    assert told == (share > 0.5)


def draw_bent(dim, share, path=None):
    """A triangle or a tetrahedron of order 2 with sides of 1, of which one has its middle node at a share of its length:
    below 1/4 it is inside out at the corner there, by 4 share - 1, and below 0.1 in quadrature points, too."""
    corners = np.vstack([np.zeros(3), np.eye(3)])[: dim + 1]
    edges = [(0, 1), (1, 2), (2, 0), (3, 0), (3, 2), (3, 1)][: 3 * dim - 3]
    X = np.vstack([corners, [0.5 * (corners[a] + corners[b]) for a, b in edges]])
    X[dim + 1, 0] = share
    middle = {frozenset(edge): i for i, edge in enumerate(edges, dim + 2)}
    sides = {2: [(0, 1), (1, 2), (2, 0)], 3: [(0, 2, 1), (0, 1, 3), (1, 2, 3), (0, 3, 2)]}[dim]
    nodes = []
    for side in sides:
        around = zip(side, side[1:] + side[:1], strict=True) if dim == 3 else [side]
        nodes.append([corner + 1 for corner in side] + [middle[frozenset(edge)] for edge in around])
    kinds = {1: 8, 2: 9, 3: 11}
    for d, rows in ((dim, [list(range(1, len(X) + 1))]), (dim - 1, nodes)):
        gmsh.model.addDiscreteEntity(d, 1)
        if d == dim:
            gmsh.model.mesh.addNodes(d, 1, list(range(1, len(X) + 1)), X.ravel())
        gmsh.model.mesh.addElementsByType(1, kinds[d], [], np.ravel(rows))
        gmsh.model.setPhysicalName(d, gmsh.model.addPhysicalGroup(d, [1]), "cell" if d == dim else "skin")
    if path:
        gmsh.write(str(path))


@pytest.mark.parametrize("dim", [2, 3])
@pytest.mark.parametrize(
    "share, ends, drawn, turned", [(0.2, 0.3, True, False), (0.3, 0.2, False, True), (0.3, 0.4, False, False)]
)
def test_a_corner_that_is_inside_out_as_drawn(dim, share, ends, drawn, turned):
    """It is told at the start, and of its J nothing later, which is below zero where it has come upright."""
    mesh = read_gmsh(draw_bent, dim=dim, share=share)
    scene = Scene(Body(mesh, "cell", RUBBER), degree=2, plane="strain" if dim == 2 else None, accept_locking=True)
    for axis in "xyz"[:dim]:
        way = (ends - share) * (axis == "x")
        scene.prescribe("skin", axis, lambda X, t, way=way: way * t * (np.abs(X - [share, 0, 0]).max(axis=1) < 1e-9))
    said = notes(scene)[1]
    assert ("body 'cell': 1 cell is inside out as drawn" in said and "at (0, 0, 0)" in said) == drawn
    assert ("turned inside out at a corner" in said) == turned


@pytest.mark.parametrize("side", [0.001, 1.0])
def test_a_corner_that_is_flat_as_drawn_tells_nothing(side):
    """Two sides all but in line, as where quadrilaterals meet a circle: strains of a thousandth turn the corner over."""
    corners, names = side * np.array([[0.0, 0.0], [1.0, 0.0], [0.5, 0.5001], [0.0, 1.0]]), ("ymin", "right", "top", "xmin")
    mesh = read_gmsh(lambda: quadrilateral("cell", corners, (1, 1), names))
    scene = Scene(Body(mesh, "cell", RUBBER), plane="strain", accept_locking=True)
    moved = side * np.array([0.5, 0.5001, 0.0])
    for axis in "xy":
        scene.prescribe(names, axis, lambda X, t: -1e-3 * side * t * (np.abs(X - moved).max(axis=1) < 1e-9 * side))
    result = solve(scene, steps=1).require()
    assert result.column("smallest_J")[-1] > 0.9
    assert not any("inside out" in note for note in result.verdict.notes)


@pytest.mark.parametrize("dim", [2, 3])
def test_a_cell_that_is_inside_out_where_the_stress_asks_is_refused(dim, tmp_path):
    path = COMM.bcast(tmp_path) / "cell.msh"
    assert not read_gmsh(draw_bent, dim=dim, share=0.3).folded
    for mesh in (read_gmsh(draw_bent, dim=dim, share=0.2, path=path), read_mesh(path)):
        (found,) = mesh.folded
        assert (found.body, found.count, found.place) == ("cell", 1, (0.0, 0.0, 0.0)) and found.worst < -0.1
    with pytest.raises(SceneError, match="1 inverted or flat elements, the first is element 1"):
        read_gmsh(draw_bent, dim=dim, share=0.05, path=path)
    with pytest.raises(SceneError, match="1 inverted or flat elements, the first is element 1"):
        read_mesh(path)


def test_a_cell_on_the_axis_has_a_volume():
    """J is asked beside the axis, on which the strain around it is 0 / 0."""
    mesh = read_gmsh(rectangles.build, rectangles={"rod": ((0.0, 0.0), (1.0, 1.0), (2, 2))})
    scene = Scene(Body(mesh, "rod", RUBBER), plane="axisymmetric")
    scene.fix("rod_xmin", "x")
    scene.fix("rod_ymin", "y")
    scene.prescribe("rod_ymax", "y", -0.2)
    result = solve(scene, steps=1).require()
    assert not result.verdict.notes, result.verdict.notes


@pytest.mark.parametrize(("length", "told"), [(3e-3, True), (0.9, True), (3.0, False)])
def test_a_tool_in_other_units_is_told(length, told):
    """A flat bar, drawn in metres or in millimetres, over a strip of four cells of 1 mm."""
    scene, _ = pressed()
    tool = rigid_curve(lambda: straight("bar", (0.5, 1.5), (0.5 + length, 1.5), 3), group="bar", name="bar")
    scene.contact("strip_ymax", tool, name="c")
    found = solve(scene, move={tool: (0.0, -0.1, 0.0)}).verdict.notes
    said = [note for note in found if "same units, or mesh" in note]
    assert len(said) == told and all(f"'bar' is {length:.3g} long" in note for note in said)
