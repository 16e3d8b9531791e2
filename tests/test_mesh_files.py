"""Mesh files of other programs: the same scene as gmsh's own model gives, sets as groups, and what is refused."""

import struct
import sys
from functools import cache
from pathlib import Path

import gmsh
import numpy as np
import pytest
import ufl
from mpi4py import MPI
from refusals import refused

from fenics_contact import (
    Body,
    Method,
    Scene,
    SceneError,
    compat,
    neo_hooke,
    read_gmsh,
    read_mesh,
    rigid_plane,
    rigid_surface,
    solve,
)
from fenics_contact.meshes import box

COMM = MPI.COMM_WORLD
SIZE = (2.0, 1.0, 1.5)
# A cell with a number for each node, and what of it lies where: by the manual's figures of the faces S1, S2, ...
HEXAHEDRON = [(0, 0, 0), (1, 0, 0), (1, 1, 0), (0, 1, 0), (0, 0, 1), (1, 0, 1), (1, 1, 1), (0, 1, 1)]
TETRAHEDRON = [(0, 0, 0), (1, 0, 0), (0, 1, 0), (0, 0, 1)]
NASTRAN = "BEGIN BULK\n" + "".join(f"GRID,{n},,{x}.,{y}.,{z}.\n" for n, (x, y, z) in enumerate(TETRAHEDRON, start=1))


@pytest.fixture
def folder(tmp_path):
    """One folder for all ranks."""
    return Path(COMM.bcast(str(tmp_path)))


def written(path, text):
    """The path, as users give it, once rank 0 has written the text there."""
    if COMM.rank == 0:
        path.write_text(text)
    COMM.Barrier()
    return str(path)


@cache
def meshio():
    return pytest.importorskip("meshio", reason="Debian's package python3-meshio is not installed")


# -- the same scene ---------------------------------------------------------------------------------------------------
def pressed(mesh, body, foot, head, bottom=0.0, **options):
    """A block that stands on its foot under a rough plate: forces of both, and its volume by the form."""
    scene = Scene(Body(mesh, body, neo_hooke(0.5, 2.0)), **options)
    scene.fix(foot)
    plate = rigid_plane((0, 0, bottom + SIZE[2]), (0, 0, -1), name="plate")
    scene.contact(head, plate, 0.3, name="c")
    result = solve(scene, move={plate: (0.05, 0, -0.15)}, steps=2, method=Method(tolerance=1e-11)).require()
    return [result.history[-1][f"c_force_{axis}_N"] for axis in "xyz"] + [volume(scene)]


def volume(scene):
    return integral(scene, ufl.dx(domain=scene.mesh.domain))


def integral(scene, measure):
    form = ufl.TestFunction(compat.lagrange_space(scene.mesh.domain, 1)) * measure
    parts = np.zeros(scene.space.dofmap.index_map.size_local + scene.space.dofmap.index_map.num_ghosts)
    compat.assemble_vector(parts, compat.compile_form(form))
    return COMM.allreduce(parts.sum())


def area(mesh, body, group):
    """Of a surface; of a plane scene the length of a curve."""
    plane = "strain" if mesh.plane else None
    scene = Scene(Body(mesh, body, neo_hooke(0.5, 2.0)), accept_locking=True, plane=plane)
    return integral(scene, scene.groups.ds((group,)))


@cache
def by_gmsh():
    return pressed(read_gmsh(box.build, size=SIZE, cells=(3, 2, 2)), "box", "zmin", "zmax")


def drawn(path, draw, **parameters):
    """What gmsh draws, written on rank 0 as it stands; the arrays (X, {gmsh's type: nodes}) too."""
    found = None
    if COMM.rank == 0:
        gmsh.initialize()
        gmsh.option.setNumber("General.Terminal", 0)
        draw(**parameters)
        gmsh.write(str(path))
        tags, X, _ = gmsh.model.mesh.getNodes()
        kinds, _, nodes = gmsh.model.mesh.getElements()
        counts = [gmsh.model.mesh.getElementProperties(kind)[3] for kind in kinds]
        by_kind = {int(k): np.asarray(n, dtype=int).reshape(-1, c) for k, n, c in zip(kinds, nodes, counts, strict=True)}
        found = X.reshape(-1, 3)[np.argsort(tags)], by_kind
        gmsh.finalize()
    return COMM.bcast(found)


def rows(numbers):
    return ",\n".join(", ".join(map(str, numbers[i : i + 8])) for i in range(0, len(numbers), 8)) + "\n"


@pytest.mark.parallel
def test_an_abaqus_file_with_its_sets(folder):
    """People fix a node set and press a surface; sets in pieces, by ranges, of sets, in an included file."""
    X, elements = drawn(folder / "box.msh", box.build, size=SIZE, cells=(3, 2, 2))
    cells = elements[5]
    foot = [int(n) for n in np.flatnonzero(X[:, 2] == 0.0) + 1]
    high = [e for e, nodes in enumerate(cells, start=101) if X[nodes - 1, 2].max() == SIZE[2]]
    face = {e: faces_at(X, cells[e - 101], SIZE[2]) for e in high}
    nodes = "".join(f"{n}, {x!r}, {y!r}, {z!r}\n" for n, (x, y, z) in enumerate(X.tolist(), start=1))
    half = nodes.splitlines(keepends=True)
    written(folder / "rest.txt", "".join(half[9:]))
    text = "** a comment\n*Heading\n a block\n*Node, nset=Everything\n" + "".join(half[:9]) + "*Node, Input=rest.txt\n"
    text += "  ** another\n*ELEMENT, TYPE=C3D8RH,\n ELSET=rubber\n  ** a third\n"
    for e, own in enumerate(cells, start=101):
        text += f"{e}, {', '.join(map(str, own[:5]))},\n {', '.join(map(str, own[5:]))}\n"
    text += f"*Nset, nset=_foot, internal\n{rows(foot[:4])}*Nset, nset=Foot\n_foot\n*Nset, nset=foot\n{rows(foot[4:])}"
    for side in sorted(set(face.values())):
        text += f"*Elset, elset=_high_{side}, internal\n{rows([e for e in high if face[e] == side])}"
    text += "*Surface, name=Head\n" + "".join(f"_high_{side}, {side}\n" for side in sorted(set(face.values())))
    text += f"*Surface, type=ELEMENT, name=Skin\nrubber,\n*Elset, elset=all, generate\n101, {100 + len(cells)}, 1\n"
    text += "*Nset, nset=Corner\n1\n*Nset, nset=OfRubber, elset=rubber\n"
    text += "*Solid Section, elset=RUBBER, material=Gum\n*Material, name=Gum\n*Hyperelastic\n1., 2.\n*Step\n*End Step\n"
    mesh = read_mesh(written(folder / "block.inp", text))
    assert set(mesh.volumes) == {"rubber"} and set(mesh.surfaces) == {"Foot", "Head", "Skin"}
    assert set(mesh.points) == {"Corner", "Everything", "OfRubber"} and len(mesh.points["Corner"]) == 1
    assert pressed(mesh, "rubber", "Foot", "Head") == pytest.approx(by_gmsh(), rel=1e-9, abs=1e-9)
    (a, b, c), areas = SIZE, [area(mesh, "rubber", name) for name in ("Foot", "Head", "Skin")]
    assert areas == pytest.approx([a * b, a * b, 2 * (a * b + b * c + c * a)])


def faces_at(X, nodes, height):
    """The name of the cell's face at this height, by its nodes in the manual."""
    there = "".join(str(i) for i in np.flatnonzero(np.isclose(X[nodes - 1, 2], height)) + 1)
    return {"1234": "S1", "5678": "S2", "1256": "S3", "2367": "S4", "3478": "S5", "1458": "S6"}[there]


def element(kind, X, more=""):
    """An input file of one element."""
    nodes = "".join(f"{n}, {', '.join(map(str, x))}\n" for n, x in enumerate(X, start=1))
    return f"*NODE\n{nodes}*ELEMENT, TYPE={kind}, ELSET=one\n1, {', '.join(str(n) for n in range(1, len(X) + 1))}\n{more}"


@pytest.mark.serial
@pytest.mark.parametrize(
    ("kind", "X", "outward"),
    [
        ("C3D8", HEXAHEDRON, [(0, 0, -1), (0, 0, 1), (0, -1, 0), (1, 0, 0), (0, 1, 0), (-1, 0, 0)]),
        ("C3D4H", TETRAHEDRON, [(0, 0, -1), (0, -1, 0), (1, 1, 1), (-1, 0, 0)]),
    ],
)
def test_each_face_of_an_element_is_where_the_manual_has_it(folder, kind, X, outward):
    names = [f"S{i}" for i in range(1, len(outward) + 1)]
    text = element(kind, X, "".join(f"*SURFACE, NAME=on_{name}\none, {name}\n" for name in names))
    path = written(folder / "one.inp", text)
    for name, normal in zip(names, outward, strict=True):
        tool = rigid_surface(path, f"on_{name}")
        a, b, c = tool.X[tool.nodes[0, :3]]
        turn = np.cross(b - a, c - a)
        np.testing.assert_allclose(turn / np.linalg.norm(turn), np.array(normal) / np.linalg.norm(normal), atol=1e-12)
        assert tool.X @ normal == pytest.approx(max(np.array(X) @ normal), abs=1e-12)  # the outermost there is


@pytest.mark.parallel
def test_surfaces_of_curved_cells(folder):
    """Ten nodes: the volume and the area of a ball's octant are those of gmsh's own curved cells, not of straight ones."""
    path = folder / "ball.msh"
    X, elements = drawn(path, octant)
    number = np.arange(1, len(X) + 1)
    last = [0, 1, 2, 3, 4, 5, 6, 7, 9, 8]  # Abaqus: nodes 9 and 10 lie between 2 and 4, 3 and 4; gmsh: the other way round
    cells = elements[11][:, last]
    text = "*NODE\n" + "".join(f"{n}, {x!r}, {y!r}, {z!r}\n" for n, (x, y, z) in zip(number, X.tolist(), strict=True))
    text += "*ELEMENT, TYPE=C3D10MH, ELSET=ball\n"
    text += "".join(f"{e}, {', '.join(map(str, own))}\n" for e, own in enumerate(cells, start=1))
    round_ = np.flatnonzero(np.abs(np.linalg.norm(X, axis=1) - 1.0) < 1e-9) + 1
    text += f"*NSET, NSET=round\n{rows(list(round_))}*NSET, NSET=some\n{rows(list(round_[:5]))}"
    mesh, wanted = read_mesh(written(folder / "ball.inp", text)), read_mesh(str(path))
    assert set(mesh.surfaces) == {"round"} and not mesh.points  # five nodes of curved cells are no points: see the page
    figures = [[volume_of(one), area(one, "ball", "round")] for one in (mesh, wanted)]
    assert figures[0] == pytest.approx(figures[1], rel=1e-12)
    assert figures[0] == pytest.approx([np.pi / 6, np.pi / 2], rel=2e-3)  # straight edges of 0.5: 3 % less


def volume_of(mesh):
    return volume(Scene(Body(mesh, next(iter(mesh.volumes)), neo_hooke(0.5, 2.0)), accept_locking=True))


@pytest.mark.serial
def test_surfaces_that_others_make_in_an_abaqus_file(folder):
    """Faces of the cube, each of area 1: all six, two of them, one that two surfaces share, and what is left."""
    text = CUBE + "*SURFACE, NAME=Skin\none,\n*SURFACE, NAME=ends\none, S1\none, S2\n*SURFACE, NAME=low\n1, S1\n1, S3\n"
    for name, how, of in (
        ("both", "UNION", "ENDS,\n low"),
        ("shared", "intersection", "ends, a-1.low"),
        ("rest", "DIFFERENCE", "SKIN, both"),
    ):
        text += f"*SURFACE, NAME={name}, COMBINE={how}\n{of}\n"
    mesh = read_mesh(written(folder / "cube.inp", text))
    areas = {name: area(mesh, "one", name) for name in mesh.surfaces}
    assert areas == pytest.approx({"Skin": 6.0, "ends": 2.0, "low": 2.0, "both": 3.0, "shared": 1.0, "rest": 3.0})
    assert at(mesh, "shared", 0.0)


def octant():
    ball = gmsh.model.occ.addSphere(0, 0, 0, 1.0, angle1=0.0, angle3=np.pi / 2)
    gmsh.model.occ.synchronize()
    gmsh.option.setNumber("Mesh.MeshSizeMax", 0.5)
    gmsh.model.mesh.generate(3)
    gmsh.model.mesh.setOrder(2)
    gmsh.model.setPhysicalName(3, gmsh.model.addPhysicalGroup(3, [ball]), "ball")
    hull = [tag for _, tag in gmsh.model.getEntities(2) if gmsh.model.getType(2, tag) == "Sphere"]
    gmsh.model.setPhysicalName(2, gmsh.model.addPhysicalGroup(2, hull), "round")


@pytest.mark.serial
def test_a_plane_abaqus_file(folder):
    """CAX4H with a node set on an edge, clockwise too: what gmsh's rectangles give."""
    text = element("CAX4RH", [(0, 0), (1, 0), (1, 2), (0, 2)], "*NSET, NSET=axis\n1, 4\n*SURFACE, NAME=rim\none, S2\n")
    mesh = read_mesh(written(folder / "plane.inp", text))
    assert mesh.plane and set(mesh.surfaces) == {"axis", "rim"} and set(mesh.volumes) == {"one"}
    assert area(mesh, "one", "rim") == pytest.approx(2.0) and area(mesh, "one", "axis") == pytest.approx(2.0)
    turned = element("CAX4RH", [(0, 0), (0, 2), (1, 2), (1, 0)], "*SURFACE, NAME=rim\none, S3\n")
    assert area(read_mesh(written(folder / "turned.inp", turned)), "one", "rim") == pytest.approx(2.0)


@pytest.mark.serial
@pytest.mark.parametrize("writer", ["gmsh", "fixed-small", "fixed-large"])
def test_a_nastran_file(folder, writer):
    path = folder / "block.bdf"
    drawn(path, box.build, size=SIZE, cells=(3, 2, 2))
    if writer != "gmsh":
        drawn(folder / "block.msh", box.build, size=SIZE, cells=(3, 2, 2))
        if meshio() and COMM.rank == 0:
            mesh = meshio().read(folder / "block.msh")
            mesh.cell_data = {"nastran:ref": mesh.cell_data["gmsh:physical"]}
            meshio().nastran.write(path, mesh, point_format=writer, cell_format="fixed-small")
        COMM.Barrier()
    mesh = read_mesh(str(path))
    assert set(mesh.volumes) == {"pid_1"} and len(mesh.surfaces) == 6
    low, high = (next(name for name in mesh.surfaces if at(mesh, name, z)) for z in (0.0, SIZE[2]))
    assert pressed(mesh, "pid_1", low, high) == pytest.approx(by_gmsh(), rel=1e-6, abs=1e-6)  # seven digits of coordinates


def bulk(kind, number, numbers, style):
    """An element in one of the ways in which programs continue a line."""
    fields = [number, *numbers]
    if style == "one line":
        return ",".join(map(str, [kind, *fields])) + "\n"
    if style == "large":
        parts = [fields[i : i + 4] for i in range(0, len(fields), 4)]
        lines = ["".join(f"{one:<16}" for one in part) for part in parts]
        return f"{kind + '*':8}" + "\n*       ".join(lines) + "\n"
    parts = [fields[i : i + 8] for i in range(0, len(fields), 8)]
    if style == "commas":
        return ",\n,".join(",".join(map(str, part)) for part in [[kind, *parts[0]], *parts[1:]]) + "\n"
    end, begin = {"blank": ("", ""), "half": ("", "+"), "plus": ("+", "+"), "named": (f"+E{number}", f"+E{number}")}[style]
    lines = ["".join(f"{one:<8}" for one in part) for part in parts]
    return f"{kind:8}" + f"{end}\n{begin:8}".join(lines) + "\n"


STYLES = ["blank", "half", "plus", "named", "large", "commas", "one line"]


def ball_bdf(folder, style, sides="CTRIA6"):
    """The octant of test_surfaces_of_curved_cells by Nastran's order of nodes: body 7, side 8; and gmsh's own."""
    X, elements = drawn(folder / "ball.msh", octant)
    last = [0, 1, 2, 3, 4, 5, 6, 7, 9, 8]
    on_ball = [one for one in elements[9] if (abs(np.linalg.norm(X[one - 1], axis=1) - 1.0) < 1e-9).all()]
    text = "".join(f"GRID*,{n},,{x!r},{y!r},*\n*,{z!r}\n" for n, (x, y, z) in enumerate(X.tolist(), start=1))
    text += "".join(bulk("CTETRA", n, [7, *one[last]], style) for n, one in enumerate(elements[11], start=1))
    count = int(sides[-1])
    text += "".join(bulk(sides, n, [8, *one[:count]], style) for n, one in enumerate(on_ball, start=10001))
    return written(folder / "ball.bdf", f"SOL 101\nCEND\nBEGIN BULK\n{text}ENDDATA\n"), str(folder / "ball.msh")


@pytest.mark.serial
@pytest.mark.parametrize("style", STYLES)
def test_curved_cells_of_a_nastran_file(folder, style):
    path, own = ball_bdf(folder, style)
    found, wanted = read_mesh(path), read_mesh(own)
    assert set(found.volumes) == {"pid_7"} and set(found.surfaces) == {"pid_8"}
    figures = [volume_of(found), area(found, "pid_7", "pid_8")]
    assert figures == pytest.approx([volume_of(wanted), area(wanted, "ball", "round")], rel=1e-12)
    assert figures == pytest.approx([np.pi / 6, np.pi / 2], rel=2e-3)


@pytest.mark.serial
@pytest.mark.parametrize("form", [0, 1, 2])
def test_curved_cells_of_a_nastran_file_by_gmsh(folder, form):
    def formed():
        gmsh.option.setNumber("Mesh.BdfFieldFormat", form)
        octant()

    drawn(folder / "ball.bdf", formed)
    assert volume_of(read_mesh(folder / "ball.bdf")) == pytest.approx(np.pi / 6, rel=2e-3)


@pytest.mark.parallel
def test_facets_of_another_order_than_their_cells_are_refused(folder):
    path, _ = ball_bdf(folder, "plus", "CTRIA3")
    words = "'pid_8'", "of type 'Triangle 3'", "'Tetrahedron 10'", "CTRIA6"
    refused(lambda: read_mesh(path), "ball.bdf", *words, kind=SceneError)

    def mixed():
        gmsh.model.addDiscreteEntity(3, 1)
        gmsh.model.mesh.addNodes(3, 1, range(1, 8), [*np.ravel(TETRAHEDRON), 0.5, 0, 0, 0.5, 0.5, 0, 0, 0.5, 0])
        gmsh.model.mesh.addElementsByType(1, 4, [], [1, 2, 3, 4])
        gmsh.model.addDiscreteEntity(2, 1)
        gmsh.model.mesh.addElementsByType(1, 9, [], [1, 2, 3, 5, 6, 7])
        gmsh.model.setPhysicalName(3, gmsh.model.addPhysicalGroup(3, [1]), "one")
        gmsh.model.setPhysicalName(2, gmsh.model.addPhysicalGroup(2, [1]), "low")

    refused(lambda: read_gmsh(mixed), "'low'", "1 of its facets", "'Triangle 6'", "'Tetrahedron 4'", "'Triangle 3'")


@pytest.mark.serial
@pytest.mark.parametrize("style", STYLES)
def test_elements_of_a_nastran_file_that_are_refused(folder, style):
    grid = "".join(f"GRID,{n},,{x},{y},{z}\n" for n, (x, y, z) in enumerate(HEXAHEDRON * 3, start=1))
    cube = bulk("CHEXA", 5, [7, *range(1, 9)], style)
    assert volume_of(read_mesh(written(folder / "one.bdf", grid + cube))) == pytest.approx(1.0)
    for text, words in (
        (bulk("CHEXA", 5, [7, *range(1, 21)], style), ("CHEXA 5 in line 25 has 20 nodes", "8 nodes", "degree=2")),
        (bulk("CTETRA", 5, [7, *range(1, 8)], style), ("CTETRA 5 in line 25 has", "4 or 10")),
        (bulk("CPENTA", 5, [7, *range(1, 7)], style), ("CPENTA 5 in line 25 has 6 nodes",)),
        (bulk("CHEXA", 5, [7, *range(18, 26)], style), ("element 5 in line 25", "no GRID 25")),
        (bulk("CQUAD8", 5, [7, *range(1, 9)], style), ("CQUAD8 5 in line 25 has 8 nodes",)),
        (cube + bulk("CHEXCZ", 6, [7, *range(9, 17)], style), ("CHEXCZ in line", "is not understood")),
        (cube + cube, ("element 5 is given twice, in line 25 and in line",)),
        (cube.replace("7", "x", 1), ("CHEXA in line 25", "'X' is no number")),
        (cube + "INCLUDE 'more.bdf'\n", ("INCLUDE 'MORE.BDF'", "in one file")),
        ("CHEXA 5 7 1 2 3 4 5 6 7 8\n", ("line 25, 'CHEXA 5 7 1", "fields of 8 or 16")),
    ):
        bad = written(folder / "bad.bdf", grid + text)
        refused(lambda bad=bad: read_mesh(bad), "bad.bdf", *words, kind=SceneError)


@pytest.mark.serial
def test_continuations_of_a_nastran_file_that_are_not_in_place(folder):
    one, other = (bulk("CHEXA", n, [7, *range(1, 9)], "named").splitlines() for n in (1, 2))
    text = "\n".join([one[0], other[1], other[0], one[1]]) + "\n"
    refused(lambda: read_mesh(written(folder / "bad.bdf", text)), "line 2 continues '+E1' of CHEXA in line 1 with '+E2'")


def at(mesh, name, height):
    """Whether a surface lies in z = height."""
    facets = mesh.facets(name)
    space = compat.lagrange_space(mesh.domain, 1)
    z = space.tabulate_dof_coordinates()[compat.locate_blocks(space, facets), 2]
    return COMM.allreduce(float(np.abs(z - height).max(initial=0.0)), op=MPI.MAX) < 1e-6


@pytest.mark.serial
@pytest.mark.parametrize("binary", [True, False])
def test_a_vtu_file(folder, binary):
    path = folder / "block.vtu"
    meshio()
    drawn(folder / "block.msh", box.build, size=SIZE, cells=(3, 2, 2))
    if COMM.rank == 0:
        mesh = meshio().read(folder / "block.msh")
        data = {"part": mesh.cell_data["gmsh:physical"], "quality": [np.ones(len(block.data)) for block in mesh.cells]}
        meshio().vtu.write(path, meshio().Mesh(mesh.points, mesh.cells, cell_data=data), binary=binary)
    COMM.Barrier()
    mesh = read_mesh(str(path))
    low, high = (next(name for name in mesh.surfaces if at(mesh, name, z)) for z in (0.0, SIZE[2]))
    assert pressed(mesh, "part_1", low, high) == pytest.approx(by_gmsh(), rel=1e-8, abs=1e-8)
    refused(lambda: read_mesh(str(path), bodies="quality"), "bodies='...'", "it has: part")
    refused(lambda: read_mesh(str(path), bodies="material"), "it has: part")


@pytest.mark.serial
def test_curved_cells_of_a_vtu_file(folder):
    """As meshio orders their nodes."""
    meshio()
    drawn(folder / "ball.msh", octant)
    if COMM.rank == 0:
        mesh = meshio().read(folder / "ball.msh")
        groups = meshio().Mesh(mesh.points, mesh.cells, cell_data={"part": mesh.cell_data["gmsh:physical"]})
        meshio().vtu.write(folder / "ball.vtu", groups)
    COMM.Barrier()
    found, wanted = read_mesh(folder / "ball.vtu"), read_mesh(folder / "ball.msh")
    ((body,), (side,)) = found.volumes, found.surfaces
    figures = [[volume_of(found), area(found, body, side)], [volume_of(wanted), area(wanted, "ball", "round")]]
    assert figures[0] == pytest.approx(figures[1], rel=1e-12)


# -- geometries, tools ------------------------------------------------------------------------------------------------
def solid():
    gmsh.model.occ.addBox(0, 0, 0, *SIZE)
    gmsh.model.occ.synchronize()


@pytest.mark.serial
@pytest.mark.parametrize("suffix", [".step", ".brep"])
def test_a_geometry_is_meshed_with_a_size(folder, suffix):
    path = folder / f"solid{suffix}"
    drawn(path, solid)
    coarse, fine = (read_mesh(str(path), mesh_size=size) for size in (1.0, 0.5))
    assert set(fine.volumes) == {"volume_1"} and set(fine.surfaces) == {f"surface_{i}" for i in range(1, 7)}
    counts = [mesh.domain.topology.index_map(3).size_global for mesh in (coarse, fine)]
    assert 24 <= counts[0] < counts[1]
    assert volume_of(fine) == pytest.approx(np.prod(SIZE), rel=1e-12)
    low = next(name for name in fine.surfaces if at(fine, name, 0.0))
    assert area(fine, "volume_1", low) == pytest.approx(SIZE[0] * SIZE[1], rel=1e-12)
    refused(lambda: read_mesh(str(path)), "mesh_size=", "geometry")
    tool = rigid_surface(str(path), mesh_size=1.0)  # facets look out of the solid: its volume by the divergence theorem
    corners = tool.X[tool.nodes[:, :3]]
    assert np.linalg.det(corners).sum() / 6 == pytest.approx(np.prod(SIZE), rel=1e-12)


@pytest.mark.serial
def test_a_geo_script_with_names_and_sizes_of_its_own(folder):
    text = 'SetFactory("OpenCASCADE"); Box(1) = {0, 0, 0, 2, 1, 1.5}; MeshSize {:} = 0.75;\n'
    text += 'Physical Volume("rubber") = {1}; Physical Surface("ends") = {1, 2};\n'
    path = written(folder / "solid.geo", text)
    own, fine = read_mesh(path), read_mesh(path, mesh_size=0.4)
    assert set(own.volumes) == {"rubber"} and set(own.surfaces) == {"ends"}
    assert own.domain.topology.index_map(3).size_global < fine.domain.topology.index_map(3).size_global
    assert area(own, "rubber", "ends") == pytest.approx(3.0, rel=1e-12)


def stl(*facets):
    """Text of facets, each of three corners."""
    corners = ("outer loop\n" + "".join(f"vertex {x} {y} {z}\n" for x, y, z in one) + "endloop\n" for one in facets)
    return "solid tool\n" + "".join(f"facet normal 0 0 0\n{one}endfacet\n" for one in corners) + "endsolid tool\n"


def binary(facets, states=None):
    """Bytes of them; states: how many they are said to be."""
    rows = (struct.pack("<12fH", 0, 0, 0, *np.ravel(one), 0) for one in facets)
    return b"binary".ljust(80) + struct.pack("<I", len(facets) if states is None else states) + b"".join(rows)


SQUARE = [((-9, -9, 1.5), (-9, 9, 1.5), (9, -9, 1.5)), ((9, -9, 1.5), (-9, 9, 1.5), (9, 9, 1.5))]  # seen from below
SLIVER = ((-9, 9, 1.5), (0, 9, 1.5), (9, 9, 1.5))  # without an area


def two_triangles():
    gmsh.model.addDiscreteEntity(2, 1)
    gmsh.model.mesh.addNodes(2, 1, range(1, 7), np.ravel(SQUARE))
    gmsh.model.mesh.addElementsByType(1, 2, [], range(1, 7))
    gmsh.model.mesh.removeDuplicateNodes()


@pytest.mark.parallel
def test_an_stl_file_is_a_tool(folder):
    """A plate of two triangles presses as gmsh's own two do; facets without area are left out, and said."""
    path = written(folder / "plate.stl", stl(*SQUARE, SLIVER))
    notes, forces = [], []
    for plate in (rigid_surface(two_triangles), rigid_surface(path)):
        scene = Scene(Body(read_gmsh(box.build, size=SIZE, cells=(3, 2, 2)), "box", neo_hooke(0.5, 2.0)))
        scene.fix("zmin")
        scene.contact("zmax", plate, name="c")
        result = solve(scene, move={plate: (0, 0, -0.15)}, steps=2, method=Method(tolerance=1e-11)).require()
        forces.append(result.history[-1]["c_force_z_N"])
        notes.append([note for note in result.verdict.notes if "without area" in note])
    assert forces[1] == pytest.approx(forces[0], rel=1e-9)
    assert notes[0] == [] and len(notes[1]) == 1 and "'tool'" in notes[1][0] and "1 facet" in notes[1][0]
    turned = written(folder / "turned.stl", stl(SQUARE[0], SQUARE[1][::-1]))
    refused(lambda: rigid_surface(turned), "different ways")
    refused(lambda: read_mesh(path), "plate.stl", "rigid_surface(path)")
    refused(lambda: read_gmsh(path), "plate.stl", "no cells of a volume", "rigid_surface(path)")
    refused(lambda: rigid_surface(written(folder / "nothing.stl", stl(SLIVER))), "no facets with an area")


@pytest.mark.serial
def test_shells_alone_are_a_tool_and_where_bodies_names_them_a_plane_mesh(folder):
    path = written(folder / "shells.inp", element("S4R", HEXAHEDRON[:4]))
    assert len(rigid_surface(path).nodes) == 1
    mesh = read_mesh(path, bodies="one")
    assert mesh.plane and set(mesh.volumes) == {"one"}
    standing = written(folder / "standing.inp", element("S4R", [(0, 0, 0), (1, 0, 0), (1, 0, 1), (0, 0, 1)]))
    assert len(rigid_surface(standing).nodes) == 1
    refused(lambda: read_mesh(standing, bodies="one"), "1 elements of type 'Quadrilateral 4'", "plane z = 0", "z = 1")


def hull():
    solid()
    gmsh.model.occ.remove([(3, 1)])
    gmsh.model.occ.synchronize()


@pytest.mark.parallel
def test_what_a_file_without_cells_holds_is_said(folder):
    drawn(folder / "hull.step", hull)
    surfaces = "6 surfaces", "no cells of a volume", "export a solid", "rigid_surface(path)", "a node of this has z = 1.5"
    refused(lambda: read_mesh(folder / "hull.step", mesh_size=1.0), "hull.step", *surfaces)
    assert len(rigid_surface(folder / "hull.step", mesh_size=1.0).nodes) > 6
    junk = written(folder / "junk.iges", "no geometry\n")
    refused(lambda: read_mesh(junk, mesh_size=1.0), "junk.iges", "nothing that gmsh can read", "export a solid")
    curve = written(folder / "curve.geo", "Point(1) = {0, 0, 0}; Point(2) = {1, 0, 0}; Line(1) = {1, 2};\n")
    refused(lambda: read_mesh(curve, mesh_size=1.0), "curve.geo", "1 curves, 2 points", "no cells")
    refused(lambda: read_mesh(written(folder / "wrong.geo", "Box(1 = {\n"), mesh_size=1.0), "line 1: syntax error")
    shells = written(folder / "shells.bdf", NASTRAN + "CTRIA3,1,7,1,2,4\nENDDATA\n")
    refused(
        lambda: read_mesh(shells), "shells.bdf", "1 elements of type 'Triangle 3'", "CHEXA or CTETRA", "rigid_surface(path)"
    )
    assert len(rigid_surface(shells).nodes) == 1
    bars = written(folder / "bars.bdf", NASTRAN + "CBAR,1,7,1,2\nENDDATA\n")
    refused(lambda: read_mesh(bars), "bars.bdf", "4 GRID, 1 CBAR", "no cells", "CHEXA or CTETRA")


@pytest.mark.parallel
def test_an_stl_file_that_is_cut_off_or_no_number_is_refused(folder):
    whole, text = binary(SQUARE), stl(*SQUARE)
    cases = {
        "whole": (whole, ()),
        "cut": (whole[:-30], ("cut off", "states 2 facets and holds 1")),
        "short": (whole[:60], ("cut off", "60 bytes", "export the surface again")),
        "longer": (whole + b"more", ()),  # than its facets, which are all there
        "wrong": (binary(SQUARE, states=1), ("states 1 facets and holds 2",)),
        "none": (binary([]), ("no facets", "export")),
        "nan": (binary([SQUARE[0], np.full((3, 3), np.nan)]), ("1 of its 2 facets", "no finite number", "facet 2")),
        "text": (text, ()),
        "upper": (text.upper(), ()),
        "two": (stl(SQUARE[0]) + stl(SQUARE[1]), ()),
        "text_nan": (text.replace("1.5", "nan", 1), ("line 4: 'vertex -9 -9 nan'", "three finite numbers")),
        "text_inf": (text.replace("1.5", "inf", 1), ("line 4: 'vertex -9 -9 inf'",)),
        "text_word": (text.replace("1.5", "one", 1), ("line 4: 'vertex -9 -9 one'",)),
        "text_cut": (text[:-100], ("cut off", "2 facets with 3 corners and 1 ends")),
        "text_between": (stl(SQUARE[0]).replace("endsolid tool\n", ""), ("cut off", "1 solids with 0 ends")),
        "text_none": (stl(), ("no facets", "export")),
        "words": ("hello\n", ("cut off, or no .stl file",)),
    }
    for name, (content, words) in cases.items():
        path = folder / f"{name}.stl"
        if COMM.rank == 0:
            path.write_bytes(content if isinstance(content, bytes) else content.encode())
        COMM.Barrier()
        if words:
            refused(lambda path=path: rigid_surface(path), path.name, *words, kind=SceneError)
        else:
            assert len(rigid_surface(path).nodes) == 2, name


def broken_triangles():
    two_triangles()
    gmsh.model.mesh.setNode(1, [np.nan, 0.0, 0.0], [])


@pytest.mark.parallel
def test_a_tool_with_a_place_that_is_no_number_is_refused(folder):
    refused(lambda: rigid_surface(broken_triangles), "broken_triangles", "1 of its 4 nodes", "no finite number")


# -- what is refused --------------------------------------------------------------------------------------------------
CUBE = element("C3D8", HEXAHEDRON)


@pytest.mark.serial
@pytest.mark.parametrize(
    ("text", "words"),
    [
        ("*HEADING\n", ("no *ELEMENT",)),
        (
            element("C3D20R", [*HEXAHEDRON, *[(0, 0, i) for i in range(12)]]),
            ("1 of type C3D20R", "element 1)", "8 nodes", "corners", "degree=2"),
        ),
        (element("C3D6", [(0, 0, 0)] * 6), ("C3D6", "hexahedra")),
        (element("COH3D8", HEXAHEDRON), ("line 10 of bad.inp", "COH3D8", "not known", "other elements")),
        (element("S4R", TETRAHEDRON), ("no solid elements", "1 of type S4R", "element 1)", "C3D8", "rigid_surface", "CPE4")),
        (element("S3", HEXAHEDRON[:3]), ("no solid elements", "1 of type S3", "element 1)", "CPE3", "bodies=(...)")),
        (element("B31", HEXAHEDRON[:2]), ("1 of type B31", "no cells of bodies", "C3D8")),
        (element("C3D8", HEXAHEDRON[:7]), ("*ELEMENT", "8 entries", "8 nodes each")),
        (element("C3D8", HEXAHEDRON[4:] + HEXAHEDRON[:4]), ("inverted", "element 1 ")),
        (
            element("C3D8", HEXAHEDRON) + "*ELEMENT, TYPE=C3D4, ELSET=one\n2, 1, 2, 4, 5\n",
            ("mixes", "Hexahedron 8", "Tetrahedron 4"),
        ),
        (CUBE.replace("1, 1, 2", "1, 99, 2"), ("1 nodes", "not in the file", "node 99 of element 1")),
        (CUBE.replace("1, 0, 0, 0", "1, nan, 0, 0"), ("*NODE", "node 1 ", "no finite number")),
        ("*ELEMENT, TYPE=C3D4, ELSET=one\n1, 1, 2, 3, 4\n", ("no *NODE",)),
        (CUBE + "*NODE\n3, 0, 0, 0\n", ("*NODE", "1 numbers", "twice", "is 3, in line 4 of bad.inp", "line 13 of bad.inp")),
        (CUBE + "1, 1, 2, 3, 4, 5, 6, 7, 8\n", ("*ELEMENT", "twice", "is 1, in line 11 of bad.inp", "line 12 of bad.inp")),
        (
            CUBE.replace("=one\n", "=one\n** a comment\n").replace("1, 1, 2", "1, 1, two"),
            ("*ELEMENT in line 10", "'two' in line 12"),
        ),
        (CUBE.replace("2, 1, 0, 0", "2 1 0 0"), ("*NODE in line 1 ", "'2 1 0 0' in line 3 ", "no whole number")),
        (CUBE.replace("2, 1, 0, 0", f"{10**20}, 1, 0, 0"), (f"'{10**20}' in line 3 ", "no whole number")),
        (CUBE + "*NSET, NSET=a, GENERATE\n1, last\n", ("*NSET in line 12 ", "'last' in line 13 ")),
        (CUBE + "*NSET, NSET=a, GENERATE\n1\n", ("'a', line 13 of bad.inp", "first, last and step")),
        (CUBE.replace(", ELSET=one", ""), ("1 cells", "no body", "SOLID SECTION")),
        (CUBE + "*ELSET, ELSET=other\n1\n", ("element 1", "'one'", "'other'", "bodies=")),
        (CUBE + "*SOLID SECTION, ELSET=gum\n", ("'gum'", "the file has: one")),
        (CUBE + "*SURFACE, NAME=top\none, S7\n", ("S7", "S1, S2")),
        (CUBE + "*SURFACE, NAME=top\ntwo, S1\n", ("set 'two'",)),
        (CUBE + "*SURFACE, NAME=top\n1, S1\n99, S1\n", ("elements of '99' have no face S1", "no such cells")),
        (
            CUBE + "*ELEMENT, TYPE=S4, ELSET=skin\n2, 1, 2, 3, 4\n*SURFACE, NAME=top\none, S2\nskin, E1\n",
            ("elements of 'skin' have no face E1",),
        ),
        (CUBE + "*ELSET, ELSET=half, INTERNAL\n1, 99\n", ("*ELSET 'half'", "1 of its elements", "element 99")),
        (CUBE + "*SURFACE, NAME=top\none, S2\n*NSET, NSET=Top\n1, 2\n", ("'Top'", "'top'", "different nodes")),
        (
            CUBE + "*SURFACE, NAME=top\none, S2\n*SURFACE, NAME=TOP\none, S1\n",
            ("*SURFACE in line 14 of bad.inp", "surface 'TOP' already, in line 12 of bad.inp"),
        ),
        (
            CUBE + "*SURFACE, NAME=a\none, S2\n*SURFACE, NAME=b, COMBINE=UNION\na, c\n",
            ("'b' in line 14 of bad.inp", "no surface 'c' of elements, but a"),
        ),
        (CUBE + "*SURFACE, NAME=a\none, S2\n*SURFACE, NAME=b, COMBINE=XOR\na, a\n", ("line 14", "COMBINE=XOR", "UNION")),
        (CUBE + "*SURFACE, NAME=b, CROP\na\n", ("*SURFACE in line 12", "'b'", "cropped", "faces written")),
        (
            CUBE + "*SURFACE, NAME=low, TYPE=NODE\n1\n2\n*NSET, NSET=Low\n1, 2, 3\n",
            ("node set 'Low' and surface 'low'", "different nodes"),
        ),
        (CUBE + "*NSET, NSET=a\nb\n", ("*NSET", "node set 'b'")),
        ("*PART, NAME=a\n" + CUBE + "*END PART\n*PART, NAME=b\n*END PART\n", ("*PART", "without parts")),
        ("*PART, NAME=a\n" + CUBE + "*END PART\n*ASSEMBLY\n*INSTANCE, NAME=a-1, PART=a\n1., 0., 0.\n", ("moved",)),
        (CUBE + "*NGEN\n1, 8\n", ("*NGEN", "written out")),
        (CUBE.replace("*NODE", "*NODE, SYSTEM=C"), ("*NODE", "Cartesian")),
        (CUBE.replace("TYPE=C3D8, ", ""), ("*ELEMENT", "'TYPE'")),
        (CUBE + "*INCLUDE, INPUT=missing.txt\n", ("missing.txt",)),
        (CUBE + "*INCLUDE, INPUT=bad.inp\n", ("*INCLUDE", "bad.inp includes itself")),
        (CUBE + "*NSET, NSET=a, GENERATE\n1, 4, 0\n", ("*NSET", "'a'", "from 1 to 4 by 0")),
        (CUBE + "*NSET, NSET=a\n1, 2, 99\n", ("*NSET 'a'", "1 of its nodes", "node 99")),
        (CUBE + "*NSET, NSET=a, GENERATE\n4, 1, 1\n", ("*NSET", "'a'", "from 4 to 1 by 1")),
        (CUBE.replace("1, 0, 0, 0", "1, 0, zero, 0"), ("*NODE", "'zero' in line 2 of bad.inp", "no coordinate")),
    ],
)
def test_an_abaqus_file_that_is_refused(folder, text, words):
    refused(lambda: read_mesh(written(folder / "bad.inp", text)), "bad.inp", *words, kind=SceneError)


def test_names_in_quotes_have_commas_of_their_own(folder):
    """Programs that let people name sets quote what they write."""
    text = (
        CUBE
        + '*NSET, NSET="Set, 1"\n1, 2, 3, 4\n*NSET, NSET="Set, 2", GENERATE\n5, 8, 1\n*NSET, NSET=both\n"Set, 1", "Set, 2"\n'
    )
    mesh = read_mesh(written(folder / "quoted.inp", text))
    assert set(mesh.surfaces) == {"Set, 1", "Set, 2", "both"}
    assert area(mesh, "one", "Set, 1") == pytest.approx(area(mesh, "one", "Set, 2"))


def test_no_set_is_advised_where_an_abaqus_file_has_none(folder):
    text = CUBE.replace(", ELSET=one", "")
    assert "bod" not in refused(lambda: read_mesh(written(folder / "a.inp", text))).split("no body; ")[1]
    named = text + "*ELSET, ELSET=none, GENERATE\n7, 8, 1\n"
    refused(lambda: read_mesh(written(folder / "a.inp", named)), "or name theirs in bodies=(...), of none")


@pytest.mark.serial
def test_a_wrong_number_in_an_included_file_is_found_there(folder):
    """And numbers with D for their exponent are read beside it."""
    head, nodes, cell = CUBE.partition("1, 0, 0, 0\n")[0], *CUBE.partition("*NODE\n")[2].split("*ELEMENT")
    text = f"{head}*INCLUDE, INPUT=nodes.txt\n*ELEMENT{cell}"
    written(folder / "nodes.txt", "** nodes\n\n" + nodes.replace("2, 1, 0, 0", "2, 1.0d0, 0.D+0, zero"))
    refused(
        lambda: read_mesh(written(folder / "bad.inp", text)), "*NODE in line 1 of bad.inp", "'zero' in line 4 of nodes.txt"
    )
    written(folder / "nodes.txt", nodes.replace("2, 1, 0, 0", "2, 1.0d0, 0.D+0, 0"))
    assert volume_of(read_mesh(folder / "bad.inp")) == pytest.approx(1.0)


@pytest.mark.serial
def test_one_part_and_one_instance_are_the_part(folder):
    text = "*PART, NAME=a\n" + CUBE + "*END PART\n*ASSEMBLY, NAME=all\n*INSTANCE, NAME=a-1, PART=a\n*END INSTANCE\n"
    text += "*NODE\n1, 5, 5, 5\n*NSET, NSET=reference\n1\n*ELEMENT, TYPE=MASS, ELSET=heavy\n1, 1\n"  # the assembly's own
    text += "*ELSET, ELSET=_s, INTERNAL, INSTANCE=a-1\n1\n*SURFACE, NAME=top\n_s, S2\n"
    text += "*NSET, NSET=low, INSTANCE=a-1\n1, 2\n 3, 4\n*SURFACE, TYPE=NODE, NAME=held\na-1.low\n"
    text += "*SURFACE, TYPE=NODE, NAME=_c, INTERNAL\nreference, 1.\n*END ASSEMBLY\n"
    mesh = read_mesh(written(folder / "parts.inp", text), bodies="ONE")
    assert set(mesh.surfaces) == {"top", "low", "held"} and set(mesh.volumes) == {"one"} and not mesh.points


@pytest.mark.serial
def test_sets_of_the_assembly_that_have_the_names_of_the_part_s(folder):
    """As Abaqus/CAE calls them: Set-1 is all of the part for its section, and the foot of the assembly."""
    nodes, cell = CUBE.replace(", ELSET=one", ""), "*ELSET, ELSET=Set-1\n1\n*NSET, NSET=Set-1, GENERATE\n1, 8\n"
    part = "*ELSET, ELSET=_Surf_S1, INTERNAL\n1\n*SURFACE, NAME=Side\n_Surf_S1, S4\n*SOLID SECTION, ELSET=Set-1\n"
    text = f"*PART, NAME=a\n{nodes}{cell}{part}*END PART\n*ASSEMBLY\n*INSTANCE, NAME=a-1, PART=a\n*END INSTANCE\n"
    text += "*NSET, NSET=Set-1, INSTANCE=a-1\n1, 2, 3, 4\n*ELSET, ELSET=SET-1, INSTANCE=a-1, GENERATE\n7, 7\n"
    text += "*ELSET, ELSET=_Surf_S1, INTERNAL, INSTANCE=a-1, GENERATE\n8, 8\n*SURFACE, NAME=Low\na-1.Set-1, S1\n"
    mesh = read_mesh(written(folder / "cae.inp", text + "*NSET, NSET=All, INSTANCE=a-1\nSet-1\n*END ASSEMBLY\n"))
    assert set(mesh.volumes) == {"a-1.Set-1"}
    areas = {name: area(mesh, "a-1.Set-1", name) for name in mesh.surfaces}
    assert areas == pytest.approx({"Set-1": 1.0, "a-1.Set-1": 6.0, "All": 6.0, "Side": 1.0, "Low": 1.0})
    assert at(mesh, "Set-1", 0.0) and at(mesh, "Low", 0.0) and not at(mesh, "Side", 0.0)


@pytest.mark.serial
def test_the_side_of_rigid_facets_to_which_a_surface_looks(folder):
    text = CUBE + "*ELEMENT, TYPE=R3D4, ELSET=plate\n2, 5, 6, 7, 8\n*SURFACE, NAME=up\nplate, SPOS\n*SURFACE, NAME=down\n"
    path = written(folder / "plate.inp", text + "plate, SNEG\n")
    for name, height in (("up", 1.0), ("down", -1.0)):
        tool = rigid_surface(path, name)
        a, b, c = tool.X[tool.nodes[0, :3]]
        assert np.cross(b - a, c - a)[2] == pytest.approx(height)
    shells = written(folder / "shells.inp", element("S4R", HEXAHEDRON[:4], "*SURFACE, NAME=up\none, SPOS\n"))
    assert len(rigid_surface(shells).nodes) == 1


@pytest.mark.parallel
def test_other_files_that_are_refused(folder):
    refused(lambda: read_mesh(written(folder / "mesh.xyz", "")), "mesh.xyz", "'.xyz'", ".inp", ".step", ".stl for a tool")
    refused(lambda: read_mesh(str(folder / "none.inp")), "none.inp", "does not exist")
    refused(lambda: read_mesh(str(folder)), str(folder), "it is a folder")
    refused(lambda: read_mesh(written(folder / "junk.msh", "hello")), "junk.msh", "begin with $MeshFormat", "write it again")
    refused(lambda: read_mesh(written(folder / "cube.inp", CUBE), mesh_size=1.0), "mesh_size=", ".step", "leave it out")
    tetrahedron = NASTRAN + "CTETRA,1,7,1,2,3,4\nENDDATA\n"
    assert set(read_mesh(written(folder / "one.bdf", tetrahedron)).volumes) == {"pid_7"}
    refused(lambda: read_mesh(str(folder / "one.bdf"), bodies="pid_7"), "bodies=", ".inp, .vtu")
    turned = tetrahedron.replace("GRID,4,,", "GRID,4,2,")
    refused(lambda: read_mesh(written(folder / "turned.bdf", turned)), "GRID", "basic coordinate system", "not in 2")
    more = tetrahedron.replace("ENDDATA", "CTRIAX,2,8,1,2,3\nENDDATA")
    refused(lambda: read_mesh(written(folder / "more.bdf", more)), "CTRIAX in line 7 is not understood", "CTRIA6")


def grids(writer):
    """Four nodes in one of Nastran's three ways to write them, numbers with and without E."""
    X = [("0.", "0.", "0."), ("1.0+0", "", ".0"), ("0.", "10.-1", "-0.0"), ("0", "0.D+0", "1.E0")]
    if writer == "free":
        return "".join(f"GRID,{n},,{','.join(one)}\n" for n, one in enumerate(X, start=1))
    if writer == "small":
        return "".join(f"GRID    {n:8}        {x:>8}{y:<8}{z:>8}\n" for n, (x, y, z) in enumerate(X, start=1))
    return "".join(f"GRID*   {n:16}{'':16}{x:>16}{y:<16}*\n*       {z:>16}\n" for n, (x, y, z) in enumerate(X, start=1))


@pytest.mark.serial
@pytest.mark.parametrize("writer", ["free", "small", "large"])
def test_nodes_of_a_nastran_file(folder, writer):
    text = f"BEGIN BULK\n{grids(writer)}CTETRA,1,7,1,2,3,4\nENDDATA\n"
    assert volume_of(read_mesh(written(folder / "one.bdf", text))) == pytest.approx(1.0 / 6.0)
    twin = text.replace("ENDDATA", grids(writer).replace("1.E0", "1.00") + "ENDDATA")  # the same once more is no harm
    assert volume_of(read_mesh(written(folder / "twin.bdf", twin))) == pytest.approx(1.0 / 6.0)
    line, again = (8, 17) if writer == "large" else (5, 10)
    for number, words in (("x.E0", f"GRID 4 in line {line}: 'X.E0'"), ("2.E0", f"in line {line} and in line {again}")):
        bad = written(folder / "bad.bdf", twin.replace("1.E0", number, 1))
        refused(lambda bad=bad: read_mesh(bad), "bad.bdf", words)


@pytest.mark.parallel
@pytest.mark.parametrize("suffix", [".msh", ".inp", ".bdf", ".vtu", ".geo"])
def test_an_empty_file_is_refused(folder, suffix):
    refused(lambda: read_mesh(written(folder / f"none{suffix}", "")), f"none{suffix}", "the file is empty")


@pytest.mark.parallel
def test_a_broken_vtu_file_is_refused(folder):
    meshio()
    refused(lambda: read_mesh(written(folder / "bad.vtu", "<VTKFile>junk")), "bad.vtu", "meshio cannot read it")


@pytest.mark.serial
def test_a_byte_order_mark_is_passed_over(folder):
    assert set(read_mesh(written(folder / "mark.inp", "\ufeff" + CUBE)).volumes) == {"one"}


@pytest.mark.parallel
def test_names_of_sets_in_another_encoding(folder):
    for encoding in ("latin-1", "utf-8"):
        text = CUBE + "*SURFACE, NAME=Fläche\none, S2\n"
        if COMM.rank == 0:
            (folder / "cube.inp").write_bytes(text.encode(encoding))
        COMM.barrier()
        assert list(read_mesh(folder / "cube.inp").surfaces) == ["Fläche"]
        COMM.barrier()


@pytest.mark.parallel
def test_a_missing_meshio_is_named_with_its_package(folder, monkeypatch):
    monkeypatch.setitem(sys.modules, "meshio", None)
    refused(lambda: read_mesh(written(folder / "mesh.vtu", "<VTKFile/>")), "mesh.vtu", "python3-meshio")
