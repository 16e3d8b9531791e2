"""Walls that meet in a crease, and fold on one another there."""

import gmsh
import numpy as np
import pytest
from drawn import ring
from mpi4py import MPI
from taylor import orders, remainders

from fenics_contact import Body, Method, Output, Scene, SceneError, Stage, neo_hooke, read_gmsh, rigid_plane, solve
from fenics_contact.kernels.status import CLOSED, SLIP, STICK
from fenics_contact.meshes import rectangles

WIDTH, FLOOR, HEIGHT = 10.0, 6.0, 10.0


def triangles(size):
    gmsh.option.setNumber("Mesh.MeshSizeMax", size)
    gmsh.model.mesh.generate(2)


def quadrilaterals(size):
    sizes = {"MeshSizeMin": 2 * size, "MeshSizeMax": 2 * size}
    for option, value in (sizes | {"RecombineAll": 1, "SubdivisionAlgorithm": 1}).items():
        gmsh.option.setNumber(f"Mesh.{option}", value)
    gmsh.model.mesh.generate(2)


def polygon(body, corners, sides, fill):
    """A plane mesh of what lies within corners (n, 2); sides: {name: numbers of sides, the first from the first corner};
    fill: what meshes it."""

    def script():
        geo = gmsh.model.geo
        points = [geo.addPoint(*corner, 0.0) for corner in corners]
        lines = [geo.addLine(a, b) for a, b in zip(points, points[1:] + points[:1], strict=True)]
        sheet = geo.addPlaneSurface([geo.addCurveLoop(lines)])
        geo.synchronize()
        gmsh.model.setPhysicalName(2, gmsh.model.addPhysicalGroup(2, [sheet]), body)
        for name, numbers in sides.items():
            gmsh.model.setPhysicalName(1, gmsh.model.addPhysicalGroup(1, [lines[i] for i in numbers]), name)
        fill()

    return read_gmsh(script)


def grooved(half, n, thick=0.0, slope=30.0):
    """A block with a groove in its top down to FLOOR, or its right half; n cells across each half, up it and along the wall.
    thick [length]: one layer along z, else in the plane."""
    mouth = (HEIGHT - FLOOR) * np.tan(np.radians(slope))
    rows = [(0.0, 0.0), (0.0, FLOOR), (mouth, HEIGHT)]  # of corners, from the middle to the sides

    def script():
        geo, lines, faces = gmsh.model.geo, {}, {}
        points = {(s * x, y): geo.addPoint(s * x, y, 0.0) for s in (1, -1) for inner, y in rows for x in (inner, WIDTH)}

        def line(name, *ends):
            key = tuple(sorted(ends))
            lines.setdefault(key, (name, geo.addLine(points[key[0]], points[key[1]])))
            return lines[key][1] * (1 if key == ends else -1)

        for side, s in (("right", 1), ("left", -1))[: 1 if half else 2]:
            for (a, low), (b, high), what in zip(rows, rows[1:], ("middle", f"{side}_wall"), strict=False):
                ring = (s * a, low), (s * WIDTH, low), (s * WIDTH, high), (s * b, high)
                names = ("bottom" if low == 0.0 else "", side, "top" if high == HEIGHT else "", what)
                loop = [line(name, one, two) for name, one, two in zip(names, ring, ring[1:] + ring[:1], strict=True)]
                faces[geo.addPlaneSurface([geo.addCurveLoop(loop)])] = names
        for _, tag in lines.values():
            geo.mesh.setTransfiniteCurve(tag, n + 1)
        for face in faces:
            geo.mesh.setTransfiniteSurface(face)
            geo.mesh.setRecombine(2, face)
        groups = {}
        if not thick:
            groups["block"] = [(2, face) for face in faces]
            for name, tag in lines.values():
                groups.setdefault(name, []).append((1, tag))
        for face, names in faces.items():
            if thick:
                top, volume, *around = geo.extrude([(2, face)], 0.0, 0.0, thick, numElements=[1], recombine=True)
                groups.setdefault("block", []).append(volume)
                groups.setdefault("ends", []).extend([(2, face), top])
                for name, wall in zip(names, around, strict=True):
                    groups.setdefault(name, []).append(wall)
        geo.synchronize()
        groups.pop("", None)
        if not half:
            groups.pop("middle", None)
        for name, entities in groups.items():
            dim = entities[0][0]
            gmsh.model.setPhysicalName(dim, gmsh.model.addPhysicalGroup(dim, sorted({tag for _, tag in entities})), name)
        gmsh.model.mesh.generate(3 if thick else 2)

    return read_gmsh(script)


def grooved_scene(half=False, n=6, degree=1, thick=0.0, friction=0.0, thickness=1.0, **law):
    """Its bottom lies on ice, its sides are pushed in by 3 mm each; the other half of a half is a rigid plane."""
    body = Body(grooved(half, n, thick), "block", neo_hooke(1.0, K=20.0))
    scene = Scene(body, plane=None if thick else "strain", degree=degree, thickness=thickness)
    scene.fix("bottom", "y")
    scene.prescribe("right", "x", -3.0)
    if not half:
        scene.prescribe("left", "x", 3.0)
    if thick:
        scene.fix("ends", "z")
    if half:
        scene.fix("middle", "x")
    scene.contact(
        "right_wall", rigid_plane((0.0, 0.0, 0.0), (1.0, 0.0, 0.0)) if half else "left_wall", friction, name="c", **law
    )
    return scene


def closed(half, **how):
    """What is there in the end; no note says that an edge digs in."""
    result = solve(grooved_scene(half, **how), steps=10, method=Method(tolerance=1e-10)).require()
    assert not any("lean" in note or "inside" in note for note in result.verdict.notes)
    return result.history[-1]


@pytest.mark.parallel
@pytest.mark.parametrize("degree", [1, 2])
def test_walls_that_fold_on_each_other_are_as_one_on_its_mirror(degree):
    """The half's nodes meet a plane one by one and its crease nothing, so forces come near each other with finer cells."""
    apart = []
    for n in (6, 12):
        half, whole = (closed(half, n=n, degree=degree) for half in (True, False))
        assert whole["right_reaction_x_N"] == pytest.approx(half["right_reaction_x_N"], rel=1e-3 / degree)
        assert whole["left_reaction_x_N"] == pytest.approx(-whole["right_reaction_x_N"], rel=1e-6)
        assert abs(whole["c_force_y_N"]) < 0.01 * whole["c_force_x_N"]
        apart.append(whole["c_force_x_N"] / half["c_force_x_N"] - 1.0)
    assert 0.0 < apart[1] < 0.6 * apart[0] < 0.08
    rough = closed(False, n=12, degree=degree, friction=0.4)  # which by symmetry has nothing to hold
    assert rough["c_force_x_N"] == pytest.approx(whole["c_force_x_N"], rel=1e-3)


@pytest.mark.serial
@pytest.mark.parametrize("degree, friction, deep", [(1, 0.4, 1.0), (2, 0.0, 0.5)])
def test_folded_walls_in_the_plane_have_the_digits_of_a_layer(degree, friction, deep):
    """Of one that is no deeper than the sides of its facets along the plane are long: means of gaps go by the longest."""
    plane, layer = (closed(False, degree=degree, friction=friction, **way) for way in ({"thickness": deep}, {"thick": deep}))
    for key in ("c_force_x_N", "right_reaction_x_N", "c_peak_pressure_MPa", "c_area_mm2"):
        assert plane[key] == pytest.approx(layer[key], rel=1e-8)


@pytest.mark.serial
@pytest.mark.parametrize("friction, slid, status", [(0.0, 0.0, CLOSED), (0.05, 0.3, SLIP), (9.0, 0.01, STICK)])
@pytest.mark.parametrize("degree, thick", [(1, 0.0), (2, 0.0), (1, 2.0)])
def test_tangent_of_folded_walls(degree, thick, friction, slid, status):
    """Nodes in the crease are slaves and masters at once."""
    system = grooved_scene(degree=degree, thick=thick, friction=friction).system()
    state, contact, X = system.state, system.contact_terms[0], system.space.tabulate_dof_coordinates()
    wall = np.tan(np.radians(30.0)) * np.maximum(X[:, 1] - FLOOR, 0.0)
    u = 0.01 * np.random.default_rng(1).uniform(-1, 1, X.shape)
    u[:, 0] -= 1.02 * np.sign(X[:, 0]) * wall * np.exp((wall - np.abs(X[:, 0])) / 3.0)
    if not thick:
        u[:, 2] = 0.0
    state.u.x.array[:] = u.ravel()
    contact.commit(state)
    u[:, 1] += slid * np.sign(X[:, 0]) * wall / wall.max()
    state.u.x.array[:] = u.ravel()
    assert (contact.response(state).status == status).sum() > 3
    assert orders(remainders(system, contact, 1e-5)).min() > 1.98


def bulged(steel, friction, size):
    """Half of a block, bonded below, that bulges over what it is bonded to: a steel plate or what is rigid."""

    def script():
        occ, model = gmsh.model.occ, gmsh.model
        sheets = [(2, occ.addRectangle(0, 0, 0, 5, 6))] + ([(2, occ.addRectangle(0, -2, 0, 9, 2))] if steel else [])
        if steel:
            occ.fragment(sheets[:1], sheets[1:])
        occ.synchronize()
        boxes = {"side": (5, 0, 5, 6), "top": (0, 6, 5, 6), "mirror": (0, 0, 0, 6), "bond": (0, 0, 5, 0)}
        boxes |= {"plate": (5, 0, 9, 0), "below": (0, -2, 9, -2), "end": (0, -2, 0, 0)} if steel else {}
        for dim, name, box in [
            (2, "rubber", (0, 0, 5, 6)),
            (2, "steel", (0, -2, 9, 0)),
            *((1, *item) for item in boxes.items()),
        ]:
            (x, y, right, high), off = box, 1e-3
            found = model.getEntitiesInBoundingBox(x - off, y - off, -off, right + off, high + off, off, dim)
            if found and (name != "bond" or not steel):
                model.setPhysicalName(dim, model.addPhysicalGroup(dim, [tag for _, tag in found]), name)
        quadrilaterals(size)

    mesh = read_gmsh(script)
    bodies = [Body(mesh, "rubber", neo_hooke(1.0, K=50.0))]
    if steel:
        bodies.append(Body(mesh, "steel", neo_hooke(8e4, K=1.6e5)))
    scene = Scene(*bodies, plane="strain", element="mixed")
    scene.fix("below" if steel else "bond")
    for name in ("mirror", "end")[: 1 + steel]:
        scene.fix(name, "x")
    scene.fix("top", "x")
    scene.prescribe("top", "y", -2.2)
    scene.contact("side", "plate" if steel else rigid_plane((0.0, 0.0, 0.0), (0.0, 1.0, 0.0)), friction, name="c")
    return solve(scene, steps=8, method=Method(tolerance=1e-10)).require().history[-1]


@pytest.mark.serial
@pytest.mark.parametrize("friction", [0.0, 0.5])
def test_rubber_that_bulges_over_a_plate_that_it_is_bonded_to_is_as_on_what_is_rigid(friction):
    """The plate's free top begins where the bond ends, and slave nodes there are the plate's, too."""
    apart = []
    for size in (0.25, 0.125):
        plate, rigid = bulged(True, friction, size), bulged(False, friction, size)
        apart.append(plate["c_force_y_N"] / rigid["c_force_y_N"] - 1.0)
        assert plate["top_reaction_y_N"] == pytest.approx(rigid["top_reaction_y_N"], rel=2e-3)
    assert 0.0 < apart[1] < 0.7 * apart[0] < 0.12  # the rigid plane's nodes have nothing of the first half cell


# ---- walls that meet at ridges, too: they look away from each other there


def ridged(size, depth=4.0, pitch=6.0, grooves=2):
    """A sleeve with V-shaped grooves next to each other; `over` and `under` are all walls that look up and down, those of
    each groove have its number."""
    outline = [(14.0, 0.0)]
    for i in range(grooves):
        outline += [(14.0 - depth, (i + 0.5) * pitch), (14.0, (i + 1.0) * pitch)]
    over, under = range(0, 2 * grooves, 2), range(1, 2 * grooves, 2)
    sides = {"over": over, "under": under, "top": [2 * grooves], "bottom": [2 * grooves + 2]}
    sides |= {f"{name}{i}": [of[i]] for name, of in (("over", over), ("under", under)) for i in range(grooves)}
    return polygon("sleeve", [*outline, (6.0, grooves * pitch), (6.0, 0.0)], sides, lambda: quadrilaterals(size))


@pytest.mark.parallel
@pytest.mark.parametrize("degree", [1, 2])
@pytest.mark.parametrize("slave, master", [("under", "over"), ("over", "under")])
def test_grooves_as_one_contact_are_as_one_each(slave, master, degree):
    """In short steps: long ones end where a contact first touches, of which there are one or two."""
    found = []
    for numbers in (("",), ("0", "1")):
        scene = Scene(Body(ridged(0.5), "sleeve", neo_hooke(1.0, K=2.0)), plane="axisymmetric", degree=degree)
        scene.fix("bottom")
        scene.fix("top", "x")
        scene.prescribe("top", "y", -3.5)
        for i in numbers:
            scene.contact(f"{slave}{i}", f"{master}{i}", 0.3, name=f"c{i}")
        row = solve(scene, steps=48 * degree, method=Method(tolerance=1e-10)).require().history[-1]
        found.append((row["top_reaction_y_N"], sum(row[f"c{i}_force_y_N"] for i in numbers)))
    assert abs(found[0][1]) > 20.0
    np.testing.assert_allclose(*found, rtol=1e-6)


@pytest.mark.serial
@pytest.mark.parametrize("height", [0.5, 3.0, 8.0])
def test_flanks_of_a_wedge_press_on_nothing(height):
    """What bends has its other side behind it, at the tip as near as one likes."""

    corners, sides = [(0.0, -height / 2), (4.0, 0.0), (0.0, height / 2)], {"low": [0], "high": [1], "root": [2]}
    found = []
    for contact in (False, True):
        mesh = polygon("wedge", corners, sides, lambda: triangles(0.4))
        scene = Scene(Body(mesh, "wedge", neo_hooke(1.0, K=3.0)), plane="strain")
        scene.fix("root")
        scene.traction("high", (0.0, -0.002 * height**2, 0.0))
        if contact:
            scene.contact("low", "high", name="c")
        found.append(solve(scene, steps=4, method=Method(tolerance=1e-10)).require().history[-1])
    assert found[0]["external_work_Nmm"] == pytest.approx(found[1]["external_work_Nmm"], rel=1e-8)
    assert found[1]["c_load_N"] == 0.0


@pytest.mark.serial
def test_a_body_that_is_drawn_through_itself_is_refused():
    """A clip whose arms overlap: what lies behind a slave's facet would be taken for the other side of its wall."""

    corners = [(0.0, 0.0), (5.0, 0.0), (5.0, 6.0), (3.0, 6.0), (3.0, 2.0), (2.0, 2.0), (2.0, 6.0), (0.0, 6.0)]
    for bent in (0.9, 1.5):
        mesh = polygon("clip", corners, {"bottom": [0], "right": [3], "left": [5]}, lambda: triangles(0.5))
        x = mesh.domain.geometry.x
        x[:, 0] -= np.where(x[:, 0] > 2.5, bent * np.maximum(x[:, 1] - 2.0, 0.0) / 4.0, 0.0)
        scene = Scene(Body(mesh, "clip", neo_hooke(1.0, K=3.0)), plane="strain")
        scene.fix("bottom")
        scene.contact("left", "right", name="c")
        if bent < 1.0:
            solve(scene, steps=1).require()
            continue
        with pytest.raises(SceneError, match="'clip' is drawn through itself at "):
            solve(scene, steps=1)


@pytest.mark.serial
@pytest.mark.parametrize("wall", [0.5, 1.0])
def test_a_hose_of_curved_cells_is_not_drawn_through_itself(wall):
    """Its bore is hollow: nodes between corners lie within the straight cells of these."""

    def draw():
        ring("hose", 0.0, (3.0, 3.0 + wall), (2, 4), ("bore", "outside"), turn=-0.25 * np.pi)
        (bore,) = (group for group in gmsh.model.getPhysicalGroups(1) if gmsh.model.getPhysicalName(*group) == "bore")
        _, above, _, below = gmsh.model.getEntitiesForPhysicalGroup(*bore)
        gmsh.model.removePhysicalGroups([bore])
        for name, arc in (("above", above), ("below", below)):
            gmsh.model.setPhysicalName(1, gmsh.model.addPhysicalGroup(1, [arc]), name)
        gmsh.model.mesh.setOrder(2)

    scene = Scene(Body(read_gmsh(draw), "hose", neo_hooke(1.0, K=20.0)), plane="strain", degree=2)
    scene.fix("outside")
    scene.contact("below", "above", name="c")
    assert scene.system().contact_terms[0].places.meets_itself


FLANKS = "upper_xmin", "upper_xmax"


def sharp_block(friction, slaves, degree, finer=1):
    """A stiff block on a soft one, and its way: pressed in by 0.3, then dragged by 0.6."""
    upper, lower = ((-2.0, 0.0), (3.0, 2.0), (6 * finer, 4 * finer)), ((-4.0, -2.0), (8.0, 2.0), (16 * finer, 5 * finer))
    mesh = read_gmsh(rectangles.build, rectangles={"upper": upper, "lower": lower})
    bodies = Body(mesh, "upper", neo_hooke(20.0, 100.0)), Body(mesh, "lower", neo_hooke(1.0, 5.0))
    scene = Scene(*bodies, plane="strain", degree=degree)
    scene.fix("lower_ymin")
    scene.fix("upper_ymax")
    scene.contact(("upper_ymin", *slaves), "lower_ymax", friction, name="c")
    ways = ("p", {("upper_ymax", "y"): -0.3}, 3), ("d", {("upper_ymax", "x"): 0.6}, 2)
    return scene, [Stage(name, prescribe=way, steps=steps) for name, way, steps in ways]


def borne(friction, slaves=FLANKS, degree=2, finer=1, **how):
    """Forces (steps, 2) at the ends of the stated steps."""
    scene, stages = sharp_block(friction, slaves, degree, finer)
    result = solve(scene, stages=stages, **how).require()
    t, stated = result.column("t"), [1 / 3, 2 / 3, 1.0, 1.5, 2.0]
    at = [int(np.argmin(np.abs(t - one))) for one in stated]
    assert t[at] == pytest.approx(stated)
    return np.column_stack([result.column(f"c_force_{axis}_N") for axis in "xy"])[at]


@pytest.mark.parallel
@pytest.mark.parametrize("friction, degree, finer", [(0.0, 2, 1), (0.1, 2, 1), (0.3, 2, 1), (0.3, 1, 2)])
def test_flanks_that_touch_nothing_change_nothing(friction, degree, finer):
    """What presses under an edge is not asked what its flank sees: means over both opened and closed, and nothing ended."""
    bare = borne(friction, (), degree, finer)
    np.testing.assert_allclose(borne(friction, FLANKS, degree, finer), bare, atol=1e-8 * np.abs(bare).max())


@pytest.mark.parallel
@pytest.mark.parametrize("degree", [1, 2])
@pytest.mark.parametrize("master", ["body", "tool"])
def test_an_edge_shows_the_pressure_of_the_side_that_presses(master, degree):
    """Over the areas of both sides it would be half of that, and the area in contact larger than the block is wide."""
    peaks, areas = [], []
    for flanks in ((), ("up_xmin", "up_xmax")):
        drawn = {"up": ((-1.5, 0), (3, 2), (6, 4))}
        drawn |= {"low": ((-6, -3), (12, 3), (24, 6))} if master == "body" else {}
        mesh = read_gmsh(rectangles.build, rectangles=drawn)
        scene = Scene(*(Body(mesh, name, neo_hooke(1.0, 5.0)) for name in drawn), plane="strain", degree=degree)
        scene.prescribe("up_ymax", "x", 0.0)
        scene.prescribe("up_ymax", "y", -0.3)
        on = rigid_plane((0, 0, 0), (0, 1, 0), name="floor")
        if master == "body":
            scene.fix("low_ymin")
            on = "low_ymax"
        scene.contact(("up_ymin", *flanks), on, 0.3, name="c")
        result = solve(scene, steps=3).require()
        line = result.line("c", "x")
        at_edge = np.flatnonzero((np.abs(line["y_reference_mm"]) < 1e-9) & (np.abs(line["x_reference_mm"]) > 1.4))
        peaks.append(result.column("c_peak_pressure_MPa")[-1])
        areas.append(result.column("c_area_mm2")[-1])
        np.testing.assert_allclose(line["pressure_MPa"][at_edge], peaks[-1], rtol=1e-6)
        assert (line["gap_mm"][at_edge] < 0.0).all()
    # a node has one penalty for both sides on a tool, twice as stiff
    near = 1e-9 if master == "body" else 0.03
    np.testing.assert_allclose((peaks[1], areas[1]), (peaks[0], areas[0]), rtol=near)


def pressed_roof(friction):
    """A stiff ridge of 90 degrees, pressed straight into a soft block, at the end."""
    drawn = {"low": ((-3.0, -2.0), (6.0, 2.0), (24, 8)), "roof": ((0.0, 5.0), (1.0, 1.0), (4, 4))}
    mesh = read_gmsh(rectangles.build, rectangles=drawn)
    x = mesh.domain.geometry.x
    roof, half = x[:, 1] > 4.0, np.sqrt(0.5)
    x[roof, :2] = (x[roof, :2] - (0.0, 5.0)) @ np.array([[half, half], [-half, half]])
    scene = Scene(Body(mesh, "low", neo_hooke(1.0, 3.0)), Body(mesh, "roof", neo_hooke(50.0, 150.0)), plane="strain")
    scene.fix("low_ymin")
    scene.fix(("roof_ymax", "roof_xmax"), "x")
    scene.prescribe(("roof_ymax", "roof_xmax"), "y", -0.3)
    scene.contact(("roof_ymin", "roof_xmin"), "low_ymax", friction, name="c")
    return solve(scene, steps=10).require()


@pytest.mark.parallel
@pytest.mark.parametrize("friction", [0.01, 0.3])
def test_a_ridge_shows_what_acts_across_and_along_the_master(friction):
    """Its flanks lean by 45 degrees to what it presses: with the pressures along their own normals the load was less than
    what it is to hold, by up to a third, and friction had a part of that."""
    result = pressed_roof(friction)
    row, contact, state = result.history[-1], result.system.contact_terms[0], result.system.state
    force, rubs = (np.array([row[f"c_{part}_{axis}_N"] for axis in "xy"]) for part in ("force", "friction"))
    load = row["c_load_N"]
    assert np.cos(np.radians(28.0)) * load < np.linalg.norm(force - rubs) <= load  # no facet that is pressed leans by more
    assert np.linalg.norm(rubs) < friction * load
    (pressure, along), across = contact.forces.acting(state), contact.forces.pressing(state)
    most = result.system.comm.allreduce(pressure.max(initial=0.0), op=MPI.MAX)
    assert (np.linalg.norm(along, axis=2) - friction * pressure).max(initial=0.0) < 1e-12 * most
    assert (np.linalg.norm(across, axis=2) - pressure).max(initial=0.0) < 1e-12 * most
    assert np.abs(np.einsum("nqc,nqc->nq", across, along)).max(initial=0.0) < 1e-3 * friction * most**2
    at, owned = result.measured.surfaces[0].at_state(), result.system.space.dofmap.index_map.size_local
    held = result.system.comm.allreduce((at.pressure * at.area)[:owned].sum())
    assert held == pytest.approx(load, rel=1e-9)


@pytest.mark.parallel
def test_a_run_is_resumed_with_what_both_sides_of_an_edge_have(tmp_path):
    out, (scene, stages) = MPI.COMM_WORLD.bcast(tmp_path), sharp_block(0.3, FLANKS, 1)
    solve(scene, stages=stages[:1], out=Output(out, checkpoint=True)).require()
    resumed = borne(0.3, degree=1, out=Output(out, checkpoint=True, resume=True))
    np.testing.assert_allclose(resumed, borne(0.3, degree=1), rtol=1e-7)
