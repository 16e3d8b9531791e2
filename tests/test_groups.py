"""Groups of a gmsh model are sets, and what gmsh or its script does wrong is said before dolfinx sees it."""

import sys
from functools import cache
from pathlib import Path

import gmsh
import numpy as np
import pytest
import ufl
from mpi4py import MPI
from refusals import refused

from fenics_contact import Body, Scene, compat, neo_hooke, read_gmsh, rigid_surface, solve
from fenics_contact.mesh_io import GroupNodes
from fenics_contact.meshes import box, two_blocks

pytestmark = pytest.mark.parallel
COMM = MPI.COMM_WORLD
RUBBER = neo_hooke(1.0, 5.0)
SIDES = ("xmin", "xmax", "ymin", "ymax", "zmin", "zmax")


def named(dim, entities, name):
    gmsh.model.setPhysicalName(dim, gmsh.model.addPhysicalGroup(dim, entities), name)


def faces(name):
    """Entities of a surface group by its name."""
    (tag,) = (tag for _, tag in gmsh.model.getPhysicalGroups(2) if gmsh.model.getPhysicalName(2, tag) == name)
    return list(gmsh.model.getEntitiesForPhysicalGroup(2, tag))


def overlapping():
    """A block 2 x 2 x 1 with its six faces, all of them as `skin`, and two of them once more as `foot`."""
    box.build(size=(2.0, 2.0, 1.0), cells=(4, 4, 2))
    named(2, [face for side in SIDES for face in faces(side)], "skin")
    named(2, faces("zmin") + faces("xmin"), "foot")


def copied():
    """The six faces as discrete copies: an element of its own for each group a facet is in, as other programs write them."""
    box.build(size=(2.0, 2.0, 1.0), cells=(4, 4, 2))
    for name, sides in (("skin", SIDES), ("foot", ("zmin", "xmin"))):
        again = gmsh.model.addDiscreteEntity(2)
        for side in sides:
            _, _, (nodes,) = gmsh.model.mesh.getElements(2, faces(side)[0])
            gmsh.model.mesh.addElementsByType(again, 3, [], nodes)
        named(2, [again], name)


def count(mesh, *names):
    """Facets of groups over all ranks, each once."""
    facets = mesh.facets(*names)
    return COMM.allreduce(int((facets < mesh.domain.topology.index_map(2).size_local).sum()))


def area(scene, *group):
    """Reference area of surfaces by the measure of loads."""
    form = ufl.TestFunction(compat.lagrange_space(scene.mesh.domain, 1)) * scene.groups.ds(group)
    forces = np.zeros(scene.space.dofmap.index_map.size_local + scene.space.dofmap.index_map.num_ghosts)
    compat.assemble_vector(forces, compat.compile_form(form))
    return COMM.allreduce(forces.sum())


# -- surfaces ---------------------------------------------------------------------------------------------------------
@pytest.mark.parametrize("draw", [overlapping, copied])
def test_a_facet_is_in_all_its_groups(draw):
    mesh = read_gmsh(draw)
    counts = {"xmin": 8, "xmax": 8, "ymin": 8, "ymax": 8, "zmin": 16, "zmax": 16, "foot": 24, "skin": 64}
    assert {name: count(mesh, name) for name in counts} == counts
    assert count(mesh, "xmin", "foot", "skin") == 64  # together, each facet once
    scene = Scene(Body(mesh, "box", RUBBER))
    assert [area(scene, *names) for names in (("foot",), ("xmin",), ("xmin", "foot", "xmax"))] == pytest.approx([6, 2, 8])


def pulled(*foot):
    """The block held at its foot and drawn at its top by a traction, and its solution's displacement at the top."""
    scene = Scene(Body(read_gmsh(overlapping), "box", RUBBER))
    for name in foot:
        scene.fix(name)
    scene.fix("xmax", "y")
    scene.traction("zmax", (0.05, 0.0, 0.02))
    u = solve(scene, steps=1).require().u
    nodes = compat.locate_blocks(scene.space, scene.mesh.facets("zmax"))
    nodes = nodes[nodes < scene.space.dofmap.index_map.size_local]
    return COMM.allreduce(u.x.array.reshape(-1, 3)[nodes].sum(axis=0))


def test_a_support_on_overlapping_groups_holds_all_their_facets():
    whole = pulled("zmin", "xmin")
    assert pulled("foot") == pytest.approx(whole, rel=1e-12)
    assert pulled("foot", "xmin") == pytest.approx(whole, rel=1e-12)


def blocks_with_more_groups():
    two_blocks.build(lower_cells=(4, 4, 2), upper_cells=(3, 3, 2))
    named(2, faces("lower_top") + faces("upper_bottom"), "interface")
    named(2, faces("lower_bottom") + faces("lower_top"), "plates")


@pytest.mark.parametrize("ranks", [None, {"lower": 0, "upper": COMM.size - 1}])
def test_contact_and_chosen_ranks_with_overlapping_groups(ranks):
    mesh = read_gmsh(blocks_with_more_groups, ranks=ranks)
    assert [count(mesh, name) for name in ("interface", "plates", "lower_top", "upper_bottom")] == [25, 32, 16, 9]
    scene = Scene(Body(mesh, "lower", RUBBER), Body(mesh, "upper", RUBBER))
    scene.fix("lower_bottom")
    scene.fix("upper_top", "xy")
    scene.prescribe("upper_top", "z", -1.0)
    scene.contact("upper_bottom", "lower_top", name="c")
    force = solve(scene, steps=1).require().history[-1]["c_force_z_N"]
    assert force == pytest.approx(plain_force(), rel=1e-9)


@cache
def plain_force():
    """Force of the same two blocks without the additional groups."""
    mesh = read_gmsh(two_blocks.build, lower_cells=(4, 4, 2), upper_cells=(3, 3, 2))
    scene = Scene(Body(mesh, "lower", RUBBER), Body(mesh, "upper", RUBBER))
    scene.fix("lower_bottom")
    scene.fix("upper_top", "xy")
    scene.prescribe("upper_top", "z", -1.0)
    scene.contact("upper_bottom", "lower_top", name="c")
    return solve(scene, steps=1).require().history[-1]["c_force_z_N"]


def partly_beside():
    """A surface group of one face of the block and of a rectangle beside it; the rectangle alone is `tool`."""
    beside()
    named(2, faces("tool") + faces("zmin"), "both")


def beside():
    box.build(cells=(2, 2, 2))
    plate = gmsh.model.addDiscreteEntity(2)
    gmsh.model.mesh.addNodes(2, plate, [501, 502, 503], [3.0, 0, 0, 4, 0, 0, 3, 1, 0])
    gmsh.model.mesh.addElementsByType(plate, 2, [], [501, 502, 503])
    named(2, [plate], "tool")
    named(1, [entity for _, entity in gmsh.model.getEntities(1)], "edges")


@pytest.mark.parametrize("version", [2.2, 4.1])
def test_groups_of_one_name_in_a_file_are_one_or_refused(tmp_path, version):
    """gmsh's format 2 keeps the name of the first alone."""
    path = COMM.bcast(tmp_path) / "box.msh"

    def written():
        box.build(cells=(1, 1, 2))
        gmsh.option.setNumber("Mesh.MshFileVersion", version)
        gmsh.write(str(path))
        path.write_text(path.read_text().replace('"zmax"', '"zmin"'))

    read_gmsh(written)
    if version < 4:
        refused(lambda: read_gmsh(path), "has no name of its own; give it one", ".msh file of format 2")
    else:
        assert count(read_gmsh(path), "zmin") == 2


def test_a_surface_without_cells_has_no_facets_and_disturbs_nothing():
    mesh = read_gmsh(beside)
    assert count(mesh, "tool") == 0 and count(mesh, "zmin") == 4
    assert mesh.domain.geometry.index_map().size_global == 27  # the plate's nodes are not the mesh's
    scene = Scene(Body(mesh, "box", RUBBER))
    for group in ("tool", ("tool",)):
        refused(lambda group=group: scene.fix(group), "group 'tool' has no facets, lines or")
        refused(lambda group=group: scene.pressure(group, 1.0), "surface group 'tool' has no facets")
    refused(lambda: scene.fix(("zmin", "zmax"), "w"), "fix 'zmin' and 'zmax'")
    refused(lambda: read_gmsh(partly_beside), "'both'", "1 of its 5 facets", "on no cell")
    assert len(rigid_surface(partly_beside, "both").size) == 5


# -- volumes ----------------------------------------------------------------------------------------------------------
def box_in_two_groups():
    box.build(cells=(2, 2, 2))
    named(3, [1], "again")


def box_twice():
    box.build(cells=(2, 2, 2))
    _, _, (nodes,) = gmsh.model.mesh.getElements(3, 1)
    again = gmsh.model.addDiscreteEntity(3)
    gmsh.model.mesh.addElementsByType(again, 5, [], nodes)
    named(3, [again], "again")


def with_a_tetrahedron(group):
    """A tetrahedron beside a block of hexahedra, in a group of its own or in none."""
    box.build(cells=(2, 2, 2))
    volume = gmsh.model.addDiscreteEntity(3)
    gmsh.model.mesh.addNodes(3, volume, [501, 502, 503, 504], [3.0, 0, 0, 4, 0, 0, 3, 1, 0, 3, 0, 1])
    gmsh.model.mesh.addElementsByType(volume, 4, [], [501, 502, 503, 504])
    if group:
        named(3, [volume], group)


def unmeshed():
    box.build(cells=(2, 2, 2))
    named(3, [gmsh.model.addDiscreteEntity(3)], "hollow")


def of_order_three():
    box.build(cells=(2, 2, 2))
    gmsh.model.mesh.setOrder(3)


@pytest.mark.parametrize(
    ("draw", "words"),
    [
        (box_in_two_groups, ("volume 1", "'box'", "'again'", "two groups")),
        (box_twice, ("8 cells", "twice")),
        (lambda: with_a_tetrahedron("tip"), ("Hexahedron 8", "Tetrahedron 4", "mixes")),
        (lambda: with_a_tetrahedron(None), ("1 cells", "no group", "addPhysicalGroup")),
        (unmeshed, ("'hollow'", "no cells", "generate")),
        (of_order_three, ("Hexahedron 64", "order 1 or 2")),
    ],
)
def test_what_would_end_the_process_inside_dolfinx_is_refused(draw, words):
    refused(lambda: read_gmsh(draw), *words)


# -- gmsh's own failures ----------------------------------------------------------------------------------------------
def uneven_edges():
    """Transfinite faces whose opposite edges have different numbers of nodes: gmsh throws inside a parallel region."""
    volume = gmsh.model.occ.addBox(0, 0, 0, 1, 1, 1)
    gmsh.model.occ.synchronize()
    for _, curve in gmsh.model.getEntities(1):
        gmsh.model.mesh.setTransfiniteCurve(curve, 5 if curve == 1 else 3)
    for _, face in gmsh.model.getEntities(2):
        gmsh.model.mesh.setTransfiniteSurface(face)
    gmsh.model.mesh.generate(3)
    named(3, [volume], "box")


def impossible_fillet():
    volume = gmsh.model.occ.addBox(0, 0, 0, 1, 1, 1)
    gmsh.model.occ.fillet([volume], [1], [5.0])


def leaving():
    sys.exit("the script has had enough")


@pytest.mark.parametrize(
    ("source", "words"),
    [
        pytest.param(
            *(uneven_edges, ("Surface", "transfinite")),
            marks=pytest.mark.skipif(gmsh.__version__ >= "4.15", reason="this gmsh meshes them otherwise"),
        ),
        (impossible_fillet, ("fillet",)),
        (leaving, ("had enough",)),
        ("missing.msh", ("missing.msh", "does not exist")),
    ],
)
def test_what_gmsh_says_is_shown(source, words):
    refused(lambda: read_gmsh(source), *words)
    refused(lambda: rigid_surface(source), *words)


def test_a_torn_file(tmp_path):
    path = COMM.bcast(str(tmp_path / "torn.msh"))
    if COMM.rank == 0:
        Path(path).write_text("$MeshFormat\n4.1 0 8\n$EndMeshFormat\n$Entities\n1 2\n")
    COMM.Barrier()
    refused(lambda: read_gmsh(path), "torn.msh", "Could not read entities")


def with_a_session_of_its_own():
    gmsh.initialize()
    box.build(cells=(2, 2, 2))
    gmsh.finalize()


def test_a_script_may_open_and_close_gmsh_itself():
    assert count(read_gmsh(with_a_session_of_its_own), "zmin") == 4


# -- nodes that are there twice, and pieces ---------------------------------------------------------------------------
def halves(groups=("lower", "upper"), gap=0.0, shift=0.0, merge=False):
    """Two blocks 1 x 1 x 1, one on the other, meshed apart and brought together; `groups` of the halves may be one."""
    two_blocks.build((1.0,) * 3, (2, 2, 2), (0.0, 0.0, -1.0), (1.0,) * 3, (2, 2, 2), (shift, 0.0, gap))
    if merge:
        gmsh.model.mesh.removeDuplicateNodes()
    if groups[0] == groups[1]:
        gmsh.model.removePhysicalGroups(gmsh.model.getPhysicalGroups(3))
        named(3, [entity for _, entity in gmsh.model.getEntities(3)], groups[0])
    else:
        assert groups == ("lower", "upper")


def stretched(mesh, contact=None, **solving):
    """Held below, drawn by a tenth above: the force that a bonded column of 2 mm takes is not zero."""
    scene = Scene(*(Body(mesh, name, RUBBER) for name in mesh.volumes))
    scene.fix("lower_bottom")
    scene.fix("upper_top", "xy")
    scene.prescribe("upper_top", "z", 0.1)
    if contact:
        scene.contact(*contact, name="c")
    return solve(scene, steps=1, **solving)


@pytest.mark.parametrize("groups", [("lower", "upper"), ("block", "block")])
def test_faces_with_nodes_of_their_own_are_bonded_or_in_contact(groups):
    mesh = read_gmsh(halves, groups=groups)
    place = ("4 faces", "'" + "' and '".join(dict.fromkeys(groups)) + "'", "(0.25, 0.25, 0)")
    refused(lambda: stretched(mesh), *place, "removeDuplicateNodes", "contact")
    refused(lambda: stretched(mesh, ("upper_xmin", "lower_top")), *place)  # a contact that speaks of one side only
    assert stretched(mesh, ("upper_bottom", "lower_top")).converged
    assert stretched(read_gmsh(halves, groups=groups, gap=1e-4)).converged
    assert stretched(read_gmsh(halves, groups=groups, shift=0.3)).converged  # faces that cross others are not their twins

    bonded = stretched(read_gmsh(halves, groups=groups, merge=True)).require()
    space = bonded.u.function_space
    middle = np.abs(space.tabulate_dof_coordinates()[:, 2]) < 1e-9
    moved = np.concatenate(COMM.allgather(bonded.u.x.array[2::3][middle]))
    assert moved.mean() == pytest.approx(0.05, rel=1e-6)  # by symmetry


def test_a_loose_piece_of_a_body_is_refused_by_its_place():
    mesh = read_gmsh(halves, groups=("block", "block"), gap=0.5)
    scene = Scene(Body(mesh, "block", RUBBER))
    scene.fix("lower_bottom")
    refused(lambda: solve(scene, steps=1), "'block, the piece around (0.5, 0.5, 1)'", "along x, y, z")
    scene.fix("upper_top", "xy")
    refused(lambda: solve(scene, steps=1), "'block, the piece around (0.5, 0.5, 1)'", "along z")
    scene.contact("upper_bottom", "lower_top", name="c")  # it holds the piece along its normal
    names, nodes = zip(*scene.system().bodies, strict=True)
    assert names == ("block, the piece around (0.5, 0.5, -0.5)", "block, the piece around (0.5, 0.5, 1)")
    owned = scene.space.dofmap.index_map.size_local
    assert [COMM.allreduce(int((part < owned).sum())) for part in nodes] == [27, 27]


def test_one_volume_in_two_bodies():
    mesh = read_gmsh(box.build)
    refused(lambda: Scene(Body(mesh, "box", RUBBER), Body(mesh, "box", RUBBER)), "'box'", "2 bodies", "one material")


# -- bodies that touch or overlap without a contact --------------------------------------------------------------------
def unmet(result):
    return [note for note in result.verdict.notes if "without a contact there" in note]


def test_bodies_that_touch_without_a_contact_are_said():
    """Faces shifted by 0.6 of their length: the middles of half of those of either side lie on the other."""
    mesh = read_gmsh(halves, shift=0.3)
    (note,) = unmet(stretched(mesh))
    assert "body 'lower' touches or overlaps 'upper'" in note and "4 faces" in note and "(0.75, 0.25, 0)" in note
    assert not unmet(stretched(mesh, ("upper_bottom", "lower_top")))  # what the note advises
    assert not unmet(stretched(read_gmsh(halves, gap=1e-4, shift=0.3)))
    assert not unmet(stretched(read_gmsh(halves, merge=True)))


def swallowed():
    """A small block drawn inside a large one, from which it has not been cut."""
    two_blocks.build((3.0,) * 3, (3, 3, 3), (0.0, 0.0, 0.0), (0.8,) * 3, (1, 1, 1), (1.1, 1.1, 1.1))


def test_a_body_inside_another_is_said():
    mesh = read_gmsh(swallowed)
    scene = Scene(Body(mesh, "lower", RUBBER), Body(mesh, "upper", RUBBER))
    scene.fix("lower_bottom")
    scene.fix("upper_bottom")
    scene.prescribe("upper_top", "z", 0.01)
    (note,) = unmet(solve(scene, steps=1))
    assert "body 'lower' touches or overlaps 'upper'" in note and "6 faces" in note


def test_groups_of_nodes_are_printed_short():
    """A file's node set may hold all nodes of its mesh."""
    groups = GroupNodes({"all": np.arange(5000, dtype=np.int64)[:, None], "tip": np.zeros((1, 1), dtype=np.int64)})
    assert str(groups) == "{'all': 5000 of them, 'tip': 1 of them}" and len(groups["all"]) == 5000
    assert isinstance(read_gmsh(overlapping).points, GroupNodes)
