"""A wrong statement is refused on all ranks before any solve, with the thing and the remedy named, and leaves no files."""

import subprocess
import sys
from pathlib import Path

import gmsh
import numpy as np
import pytest
from mpi4py import MPI

import fenics_contact as fc
from fenics_contact import Body, Scene, read_gmsh, rigid_plane, rigid_punch, rigid_sphere, solve
from meshes import box

pytestmark = pytest.mark.parallel
COMM = MPI.COMM_WORLD
NAN = float("nan")


@pytest.fixture(scope="module")
def mesh():
    return read_gmsh(box.build, size=(4.0, 4.0, 2.0), cells=(4, 4, 2))


@pytest.fixture
def out(tmp_path):
    """One folder name for all ranks; nothing may be left in it."""
    folder = COMM.bcast(tmp_path) / "results"
    yield folder
    COMM.Barrier()
    assert not folder.exists() or not list(folder.iterdir()), "a refused run left files behind"


def held(mesh, material=None):
    """A block held at its bottom, as a start for one mistake."""
    scene = Scene(Body(mesh, "box", material or fc.neo_hooke(1.0, 5.0)))
    scene.fix("zmin")
    return scene


def pressed(mesh, **contact):
    scene = held(mesh)
    tool = rigid_punch(half_width=1.0, height=2.0, face=(2.0, 2.0, 2.0))
    scene.contact("zmax", tool, **{"name": "top", **contact})
    return scene, tool


def refused(action, *words):
    """The action raises ValueError (SceneError is one) on every rank, with all words in its message."""
    with pytest.raises(ValueError) as caught:
        action()
    message = str(caught.value)
    assert all(word in message for word in words), message
    assert len(set(COMM.allgather(message))) == 1, "the ranks say different things"


# -- groups and meshes ------------------------------------------------------------------------------------------------
def test_unknown_surface_lists_the_known_ones(mesh):
    refused(lambda: held(mesh).fix("lid"), "'lid'", "xmin", "zmax")
    refused(lambda: held(mesh).contact("lid", rigid_plane()), "'lid'", "zmax")
    refused(lambda: held(mesh).traction("lid", (0, 0, 1)), "'lid'", "zmax")


def test_unknown_volume_lists_the_known_ones(mesh):
    refused(lambda: Scene(Body(mesh, "rubber", fc.neo_hooke(1.0, 5.0))), "'rubber'", "box")


def with_empty_surface():
    box.build(cells=(2, 2, 2))
    point = gmsh.model.addDiscreteEntity(2)
    gmsh.model.setPhysicalName(2, gmsh.model.addPhysicalGroup(2, [point]), "ghost")


def test_empty_surface():
    refused(lambda: read_gmsh(with_empty_surface), "'ghost'", "no facets", "surfaces")


def prisms():
    base = gmsh.model.occ.addRectangle(0, 0, 0, 1, 1)
    out = gmsh.model.occ.extrude([(2, base)], 0, 0, 1, numElements=[2], recombine=True)  # triangles swept: prisms
    gmsh.model.occ.synchronize()
    gmsh.model.mesh.generate(3)
    gmsh.model.setPhysicalName(3, gmsh.model.addPhysicalGroup(3, [tag for dim, tag in out if dim == 3]), "box")


def test_unsupported_cell_type():
    refused(lambda: read_gmsh(prisms), "Prism", "hexahedra or tetrahedra")


def inside_out():
    """One hexahedron whose upper corner has been pulled through its bottom."""
    tag = gmsh.model.addDiscreteEntity(3)
    corners = np.array([[0, 0, 0], [1, 0, 0], [1, 1, 0], [0, 1, 0], [0, 0, 1], [1, 0, 1], [1, 1, -2], [0, 1, 1]], float)
    gmsh.model.mesh.addNodes(3, tag, list(range(1, 9)), corners.ravel())
    gmsh.model.mesh.addElementsByType(tag, 5, [1], list(range(1, 9)))
    gmsh.model.setPhysicalName(3, gmsh.model.addPhysicalGroup(3, [tag]), "box")


def test_inverted_element():
    refused(lambda: read_gmsh(inside_out), "inverted", "element 1")


def test_failing_script_and_missing_file_and_unnamed_group():
    refused(lambda: read_gmsh("no_such_file.msh"), "no_such_file.msh")
    refused(lambda: read_gmsh(box.build, cells=(1, 1)), "index out of range")
    refused(lambda: read_gmsh(lambda: box.build(name="")), "no name", "setPhysicalName")


# -- numbers ----------------------------------------------------------------------------------------------------------
@pytest.mark.parametrize("bad", [0.0, -1.0, NAN, float("inf")])
def test_modulus_must_be_positive(bad):
    refused(lambda: fc.mooney_paper(0.1, 0.1, bad), "mooney_paper", "K", "positive")
    refused(lambda: fc.mooney_rivlin(bad, 0.1, 5.0), "mooney_rivlin", "a1", "positive")
    refused(lambda: fc.neo_hooke(bad, 5.0), "neo_hooke", "mu", "positive")
    refused(lambda: fc.yeoh(bad, 0.1, 0.1, 5.0), "yeoh", "c1", "positive")
    refused(lambda: fc.from_elastic(bad, 0.3), "from_elastic", "E", "positive")


def test_parameters_must_be_finite_and_stable():
    refused(lambda: fc.yeoh(0.1, NAN, 0.1, 5.0), "yeoh", "c2")
    refused(lambda: fc.yeoh(0.1, 0.1, NAN, 5.0), "yeoh", "c3")
    refused(lambda: fc.mooney_paper(0.1, NAN, 5.0), "mooney_paper", "nan")
    refused(lambda: fc.mooney_rivlin(0.1, -0.2, 5.0), "mooney_rivlin", "positive")
    refused(lambda: fc.from_elastic(1.0, 0.5), "nu")
    refused(lambda: fc.from_elastic(1.0, NAN), "nu")


@pytest.mark.parametrize("bad", [0.0, -1.0, NAN])
@pytest.mark.parametrize("which", ["penalty", "tangential_penalty", "tangential_share"])
def test_penalty_must_be_positive(mesh, which, bad):
    refused(lambda: pressed(mesh, **{which: bad}), "top", which, "positive")


@pytest.mark.parametrize("bad", [-0.1, NAN])
def test_friction_must_not_be_negative(mesh, bad):
    refused(lambda: pressed(mesh, friction=bad), "top", "friction", "positive")


def test_tools_must_have_sane_lengths():
    refused(lambda: rigid_punch(half_width=-1.0, height=1.0), "half_width", "positive")
    refused(lambda: rigid_punch(half_width=1.0, height=NAN), "height", "positive")
    refused(lambda: rigid_punch(half_width=1.0, height=1.0, fillet=2.0), "fillet", "smaller")
    refused(lambda: rigid_sphere(0.0, (0, 0, 0)), "radius", "positive")
    refused(lambda: rigid_sphere(1.0, (0, NAN, 0)), "centre", "finite")
    refused(lambda: rigid_plane(normal=(0, 0, 0)), "normal", "zero")


@pytest.mark.parametrize("steps", [0, -3, 2.5, NAN, [], [0.5, 0.2], [0.5, NAN]])
def test_steps(mesh, out, steps):
    scene, tool = pressed(mesh)
    refused(lambda: solve(scene, move={tool: (0, 0, -0.1)}, steps=steps, out=out, progress=False), "steps", "increasing")


@pytest.mark.parametrize("drive", ["move", "push"])
def test_nan_in_a_tools_drive(mesh, out, drive):
    scene, tool = pressed(mesh)
    refused(lambda: solve(scene, **{drive: {tool: (0, 0, NAN)}}, out=out, progress=False), drive, "punch", "finite")

    def late(t):  # fine at first: a run that only looks at the present step would fail half-way
        return (0.0, 0.0, -0.1 * t if t < 0.8 else NAN)

    refused(lambda: solve(scene, **{drive: {tool: late}}, out=out, progress=False), drive, "punch", "finite")


def test_nan_in_loads_and_supports(mesh, out):
    refused(lambda: held(mesh).traction("zmax", (0, NAN, 0)), "traction", "zmax", "finite")
    refused(lambda: held(mesh).body_force((0, 0, NAN)), "body force", "finite")
    refused(lambda: held(mesh).prescribe("zmax", "z", NAN), "zmax", "finite")
    scene = held(mesh)
    scene.prescribe("zmax", "z", lambda X, t: np.where((t > 0.8) & (X[:, 0] > 3.5), NAN, -0.1 * t))
    refused(lambda: solve(scene, steps=10, out=out, progress=False), "zmax", "finite")


# -- statements that cannot be computed -----------------------------------------------------------------------------
def test_tool_deep_inside_the_body(mesh, out):
    """1.5 mm inside a block 2 mm high with cells of 1 mm."""
    scene = held(mesh)
    tool = rigid_punch(half_width=5.0, height=10.0, face=(2.0, 2.0, 0.5))
    scene.contact("zmax", tool, name="top")
    refused(lambda: solve(scene, move={tool: (0, 0, -0.1)}, out=out, progress=False), "top", "inside", "outwards")


def test_narrow_tool_deep_inside_the_body(mesh):
    """As deep, but the punch's back (0.5 mm above the surface) is nearer than its face."""
    scene = held(mesh)
    tool = rigid_punch(half_width=1.0, height=2.0, face=(2.0, 2.0, 0.5))
    scene.contact("zmax", tool, name="top")
    refused(lambda: scene.system({tool: (0, 0, -0.1)}), "top", "inside", "outwards")


def test_contradictory_supports(mesh, out):
    scene = held(mesh)
    scene.prescribe("xmin", "z", 0.1)
    refused(lambda: solve(scene, out=out, progress=False), "zmin", "xmin", "contradict")


@pytest.mark.parametrize("held_axes", ["", "z", "xy"])
def test_nothing_against_rigid_motion(mesh, out, held_axes):
    scene = Scene(Body(mesh, "box", fc.neo_hooke(1.0, 5.0)))
    scene.fix("zmin", held_axes)
    scene.traction("zmax", (0, 0, -0.1))
    loose = ", ".join(a for a in "xyz" if a not in held_axes)
    refused(lambda: solve(scene, out=out, progress=False), "box", f"along {loose}:", "fix")


def test_frictionless_floor_does_not_hold_sideways(mesh, out):
    scene = Scene(Body(mesh, "box", fc.neo_hooke(1.0, 5.0)))
    scene.contact("zmin", rigid_plane(), name="floor")
    refused(lambda: solve(scene, out=out, progress=False), "box", "along x, y:")


def test_unknown_words(mesh, out):
    scene, tool = pressed(mesh)
    other = rigid_plane(name="other")
    refused(lambda: solve(scene, move={other: (0, 0, 1)}, out=out, progress=False), "other", "in no contact")
    refused(lambda: solve(scene, move={tool: (0, 0, 0)}, method="magic", out=out), "magic", "newton")
    refused(lambda: solve(scene, move={tool: (0, 0, 0)}, linear="magic", out=out, progress=False), "magic", "direct")
    refused(lambda: scene.fix("zmin", "w"), "'w'", "x, y, z")
    refused(lambda: pressed(mesh, points=0), "top", "points", "Gauss")


def test_unwritable_folder(mesh, tmp_path):
    blocker = COMM.bcast(tmp_path) / "a_file"
    if COMM.rank == 0:
        blocker.write_text("not a folder")
    COMM.Barrier()
    scene, tool = pressed(mesh)
    action = lambda: solve(scene, move={tool: (0, 0, -0.1)}, out=blocker / "results", progress=False)  # noqa: E731
    refused(action, "a_file", "out=")
    COMM.Barrier()
    assert blocker.read_text() == "not a folder"


@pytest.mark.parametrize(
    ("missing", "package"),
    [
        *((name, f"python3-{name}") for name in "dolfinx gmsh numba petsc4py mpi4py tqdm matplotlib ufl".split()),
        ("dolfinx ufl basix ffcx petsc4py", "python3-dolfinx"),
    ],
)
def test_a_missing_module_is_named_with_its_debian_package(missing, package):
    if COMM.rank != 0:
        return
    block = f"import sys; sys.modules.update(dict.fromkeys({missing.split()!r})); import fenics_contact"
    said = last_line(block)
    assert said.startswith(f"ImportError: {missing.split()[0]} is missing") and f"package {package} " in said, said


def test_studies_name_scipy():
    if COMM.rank == 0:
        assert "package python3-scipy " in last_line(
            "import sys; sys.modules['scipy'] = None; import fenics_contact.studies.sphere"
        )


def last_line(code):
    """What a Python process that fails says last."""
    root = Path(__file__).resolve().parent.parent
    done = subprocess.run([sys.executable, "-c", code], cwd=root, capture_output=True, text=True, timeout=60)
    assert done.returncode != 0
    return done.stderr.strip().splitlines()[-1]


def test_frictionless_punch_does_not_hold_sideways(mesh, out):
    scene = Scene(Body(mesh, "box", fc.neo_hooke(1.0, 5.0)))
    scene.fix("zmin", "xz")
    tool = rigid_punch(half_width=5.0, height=2.0, face=(2.0, 2.0, 2.0))
    scene.contact("zmax", tool, name="top")
    refused(lambda: solve(scene, move={tool: (0, 0, -0.1)}, out=out, progress=False), "box", "along y:")
