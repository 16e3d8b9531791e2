"""Pictures by what they hold, not by their pixels: facets, tools, view, colours, letters; on any number of ranks."""

import sys
from functools import partial
from itertools import pairwise
from typing import Any

import gmsh
import numpy as np
import pytest
from matplotlib import rcParams
from matplotlib.backends.backend_agg import FigureCanvasAgg
from matplotlib.collections import LineCollection, PolyCollection
from matplotlib.figure import Figure
from matplotlib.patches import PathPatch
from matplotlib.text import Text
from mpi4py import MPI
from PIL import Image

from fenics_contact import (
    Body,
    Film,
    Method,
    Scene,
    Stage,
    Units,
    mooney_rivlin,
    neo_hooke,
    read_gmsh,
    rigid_cylinder,
    rigid_extrusion,
    rigid_plane,
    rigid_punch,
    rigid_revolution,
    rigid_sphere,
    solve,
)
from fenics_contact.meshes import box, disc, punch_plate, rectangles, two_blocks
from fenics_contact.output.colours import BODY, STATUS, colours
from fenics_contact.output.curves import along_line, history_figure, times, words
from fenics_contact.output.fields import Fields
from fenics_contact.output.film import common_limits
from fenics_contact.output.layers import APART, Layer, layers
from fenics_contact.output.lines import line, zones
from fenics_contact.output.pictures import DOTS, LETTERS, PIECES, WIDTH, save
from fenics_contact.output.plot import drawing
from fenics_contact.output.raster import rasterised
from fenics_contact.output.render import pyvista_works
from fenics_contact.output.skin import DrawnSkin, normals, symmetry_planes
from fenics_contact.output.views import from_angles
from fenics_contact.values import SceneError

pytestmark = pytest.mark.parallel
COMM = MPI.COMM_WORLD
ROOT = COMM.rank == 0
RUBBER = {"a1": 0.1863, "a2": 0.0098, "K": 5.0}  # MPa


@pytest.fixture(scope="module")
def punched():
    """Result of a punch pressed into a quarter of a plate of 7 x 7 x 2 cells."""
    mesh = read_gmsh(punch_plate.build, inside=4, outside=3, layers=2, ratio=1.0)
    scene = Scene(Body(mesh, "plate", mooney_rivlin(**RUBBER)))
    scene.fix("symmetry_x", "x")
    scene.fix("symmetry_y", "y")
    punch = rigid_punch(half_width=20.0, height=10.0, face=(0, 0, 10))
    scene.contact("top", punch, 0.3, name="top")
    scene.contact("bottom", rigid_plane(name="floor"), name="bottom")
    return solve(scene, move={punch: (0, 0, -2.0)}, steps=2)


@pytest.fixture(scope="module")
def rolled():
    """Result of a slice x-y of one layer pressed on a floor by a roller."""
    mesh = read_gmsh(box.build, size=(20.0, 5.0, 1.0), cells=(20, 5, 1))
    scene = Scene(Body(mesh, "box", neo_hooke(mu=0.4, K=2.0)))
    scene.fix("ymin")
    scene.fix(("zmin", "zmax"), "z")
    roller = rigid_cylinder(3.0, point=(10, 8, 0), axis=(0, 0, 1), name="roller")
    scene.contact("ymax", roller, 0.2, name="tread")
    return solve(scene, move={roller: (0, -0.8, 0)}, steps=2)


def area(skin):
    return np.linalg.norm(normals(skin.X), axis=1).sum()


def refused(words, call):
    """A SceneError on every rank."""
    with pytest.raises(SceneError, match=words):
        call()


def holds(figure):
    """All that a reader needs: page width, letters of 9 points, nothing cut off."""
    assert figure.get_size_inches()[0] <= WIDTH + 1e-9
    canvas = FigureCanvasAgg(figure)
    canvas.draw()
    texts = [text for text in figure.findobj(Text) if text.get_text() and text.get_visible()]
    assert min(text.get_fontsize() for text in texts) >= LETTERS
    box = figure.get_tightbbox(canvas.get_renderer())
    width, height = figure.get_size_inches()
    assert box.x0 > -0.01 and box.y0 > -0.01 and box.x1 < width + 0.01 and box.y1 < height + 0.01


def test_pressure_under_a_punch(punched):
    drawn, figure = punched.drawing(), punched.plot("contact_pressure", backend="matplotlib")
    fields = Fields(punched.scene, punched.system)
    fields.update()
    highest = COMM.allreduce(float(np.nanmax(fields.of("").pressure.x.array)), op=MPI.MAX)
    assert (drawn is None) is (figure is None) is (not ROOT)
    if not ROOT:
        return
    assert len(drawn.body.x) == 2 * 49 + 4 * 14 and np.count_nonzero(drawn.body.slave) == 2 * 49
    assert np.isfinite(drawn.body.values[drawn.body.slave]).all() and np.isnan(drawn.body.values[~drawn.body.slave]).all()
    np.testing.assert_allclose(area(drawn.body), 2 * 40.0**2 + 4 * 40.0 * 10.0, rtol=1e-12)
    assert drawn.view.axis is None and drawn.view.towards[2] > 0.3  # contact is seen from where its normals point
    assert (drawn.colours.low, drawn.colours.high) == (0.0, pytest.approx(highest)) and not drawn.hidden.any()
    punch, floor = drawn.tools
    np.testing.assert_allclose(punch[..., 2].min(), 8.0)  # after its travel
    assert punch[..., :2].min() >= 0.0 and len(punch) > 10 and np.abs(floor[..., 2]).max() < 1e-12  # cut like the plate
    assert isinstance(figure, Figure) and "contact pressure [MPa]" in [axes.get_ylabel() for axes in figure.axes]
    axes = figure.axes[0]
    assert len(axes.images) == 1
    flat = drawn.view.flat(drawn.body.x.reshape(-1, 3))
    for (low, high), places in zip((axes.get_xlim(), axes.get_ylim()), flat.T, strict=True):
        assert low < places.min() and places.max() < high
    holds(figure)


def test_one_contact_of_several_is_drawn_alone(punched):
    """By the name it has in the files, on its own facets and in its own range; "contact" need not be said twice."""
    both, top, floor, status = (
        punched.drawing(name)
        for name in ("contact_pressure", "top_contact_pressure", "bottom_contact_pressure", "top_contact_status")
    )
    refused("top_gap, bottom_gap", lambda: punched.plot("lid_gap"))
    if not ROOT:
        return
    assert top.colours.label == "top: contact pressure [MPa]" and status.colours.kind == "status"
    for drawn, z, peak in ((top, 10.0, "top"), (floor, 0.0, "bottom")):
        assert np.count_nonzero(drawn.body.slave) == 49 and np.allclose(drawn.body.X[drawn.body.slave][..., 2], z)
        assert drawn.colours.high == pytest.approx(punched.history[-1][f"{peak}_peak_pressure_MPa"])
        assert np.isnan(drawn.body.values[~drawn.body.slave]).all()
    assert both.colours.high == max(top.colours.high, floor.colours.high) and "bottom" in floor.colours.label


@pytest.mark.parametrize("away", [0.0, 0.1])
def test_what_only_round_off_presses_touches_nothing(away):
    """A lid drawn on the block and one beyond it, no step taken: no picture makes colours of the last places."""
    scene = Scene(Body(read_gmsh(box.build, size=(4.0, 4.0, 2.0), cells=(3, 3, 2)), "box", neo_hooke(mu=0.5, K=2.0)))
    scene.fix("zmin")
    lid = rigid_plane((0, 0, 2.0 + away), (0, 0, -1), name="lid")
    scene.contact("zmax", lid, 0.3, name="top")
    result = solve(scene, move={lid: (0, 0, -60.0)}, steps=1, method=Method(smallest_step=0.9))
    assert not result.history and not result.converged
    assert result.column("top_load_N").size == 0
    with pytest.raises(KeyError, match="top_load_N"):
        result.column("typo")
    across: dict[str, Any] = {"along": "x", "cut": {"y": 2.0}}
    asked = (result.line, result.widths, result.plot_line)
    told = [result.table, lambda: result.plot_history("t", "top_load_N"), *(partial(ask, "top", **across) for ask in asked)]
    for ask in told:
        refused("no accepted step", ask)
    with pytest.raises(KeyError, match="no accepted step"):
        result.column("t", "drag")
    surface = result.measured.surfaces[0]
    noise = surface.least_pressure()
    assert 0.0 < noise < 1e-9  # MPa
    result.u.x.array[2::3] += 8e-16 * (away == 0.0)  # two units in the last place of the lid's height
    table = line(surface, "x", {"y": 2.0}, result.scene.units)
    assert (table["pressure_MPa"].max() > 0.0) == (away == 0.0)
    assert len(zones(table, result.scene.units, noise)) == 0
    for name in ("contact_pressure", "status", "gap"):
        drawn = result.drawing(name)
        if ROOT:
            assert "nothing touches" in drawn.title and drawn.title.endswith("stopped early")
            assert name != "contact_pressure" or drawn.colours.high == 1.0 and np.nanmax(drawn.body.values) == 0.0


def test_mirrors_double_the_model(punched):
    planes = symmetry_planes(punched.scene, punched.system)
    assert planes == {0: pytest.approx(0.0), 1: pytest.approx(0.0)}
    once, twice, four = (punched.drawing("displacement_z", mirror=mirror) for mirror in ("", "x", "xy"))
    refused("planes normal to x, y", lambda: punched.drawing(mirror="z"))
    if not ROOT:
        return
    cut = 40.0 * 10.0  # of a face that lies in a plane of symmetry
    np.testing.assert_allclose(area(twice.body), 2 * (area(once.body) - cut))
    np.testing.assert_allclose(area(four.body), 4 * (area(once.body) - 2 * cut))
    assert np.allclose(twice.body.X.min(axis=(0, 1)), [-40.0, 0.0, 0.0])
    out = four.body.X.mean(axis=1) - [0.0, 0.0, 5.0]
    assert (np.einsum("nc,nc->n", normals(four.body.X), out) > 0.0).all()  # images look out too
    assert [len(tiles) for tiles in four.tools] == [4 * len(tiles) for tiles in once.tools]
    assert four.colours == once.colours


def test_wrong_wishes_are_refused_on_all_ranks(punched, tmp_path):
    refused("no field 'pressure'.*contact_pressure", lambda: punched.plot("pressure"))
    refused("view = 'w'", lambda: punched.plot(view="w"))
    for limits in ((1, 0), (0, 0), (0, np.nan), 3.0):
        refused("limits", lambda limits=limits: punched.plot(limits=limits))
    for path in ("a.xyz", "a"):
        refused("ending|ends in '.xyz'.*svg", lambda path=path: punched.plot(path=COMM.bcast(tmp_path) / path))
    refused("factors", lambda: punched.plot_history("t", "top_load_N", factors=(1, 2, 3)))
    for columns in ("t", []):
        refused("nothing to draw over it", lambda columns=columns: punched.plot_history("t", columns))
    assert not list(COMM.bcast(tmp_path).glob("a*"))
    refused("backend = 'vtk'", lambda: punched.plot(backend="vtk"))
    refused("picture.*No such file", lambda: punched.plot(path=COMM.bcast(tmp_path) / "nowhere" / "a.png"))


def colours_seen(figure, blocks=10):
    """Mean colours (blocks, blocks, 3) of the parts of a figure's axes."""
    canvas = FigureCanvasAgg(figure)
    canvas.draw()
    box, image = figure.axes[0].get_window_extent(), np.asarray(canvas.buffer_rgba())[::-1, :, :3] / 255.0
    rows, columns = (np.linspace(*ends, blocks + 1).astype(int) for ends in ((box.y0, box.y1), (box.x0, box.x1)))
    return np.array([[image[i:j, k:m].mean(axis=(0, 1)) for k, m in pairwise(columns)] for i, j in pairwise(rows)])


@pytest.mark.parametrize("name", ["contact_pressure", "status", "displacement_z"])
def test_pyvista_paints_what_matplotlib_does(punched, name, capfd):
    """The same places in the same colours, pixel by pixel; without a screen no warning is left on the user's."""
    if not COMM.bcast(ROOT and pyvista_works()):
        refused("it is not installed, or cannot draw here", lambda: punched.plot(name, backend="pyvista"))
        pytest.skip("pyvista is not installed, or cannot draw here")
    figures = [punched.plot(name, backend=backend) for backend in ("pyvista", "matplotlib")]
    assert "WARN" not in capfd.readouterr().err
    if not ROOT:
        return
    places = [(figure.axes[0].get_xlim(), figure.axes[0].get_ylim()) for figure in figures]
    assert places[0] == places[1]
    first, second = (colours_seen(figure) for figure in figures)
    # which of two surfaces seen through lies before the other changes 0.14 x 0.14 of their shades; lines are a little wider
    # or narrower
    assert np.abs(first - second).mean() < 0.005 and np.abs(first - second).max() < 0.03
    assert (first < 0.5).any()  # neither is empty
    holds(figures[0])


def test_a_pyvista_that_cannot_draw_is_none(monkeypatch):
    """Some builds of VTK abort where there is no display: that ends a trial's process, not this one."""
    monkeypatch.setattr("fenics_contact.output.render.importlib.util.find_spec", lambda name: True)
    monkeypatch.setattr("fenics_contact.output.render.TRIAL", "import os; os.abort()")
    assert pyvista_works.__wrapped__() is False
    monkeypatch.setattr("fenics_contact.output.render.TRIAL", "pass")
    assert pyvista_works.__wrapped__() is True


def test_a_slice_is_seen_along_its_thin_axis(rolled, tmp_path):
    path = COMM.bcast(tmp_path) / "slice.pdf"
    drawn, figure, above = rolled.drawing(), rolled.plot(path=path), rolled.drawing(view=(30, -60))
    if not ROOT:
        return
    assert path.read_bytes().startswith(b"%PDF")
    assert drawn.is_slice and drawn.view.axis == 2 and not above.is_slice
    axes = figure.axes[0]
    assert (axes.get_xlabel(), axes.get_ylabel()) == ("x [mm]", "y [mm]")
    side, band = (c for c in axes.collections if isinstance(c, PolyCollection))
    assert len(side.get_paths()) == 20 * 5 and len(band.get_paths()) == 20 * PIECES  # a band on the slave facets
    value = drawn.body.values[drawn.body.slave]
    most = colours("", "amount", True, value).of(np.array([value.max()]))[0, :3]
    assert np.abs(band.get_facecolors()[:, :3] - most).sum(axis=1).min() < 0.1  # the greatest pressure has its colour
    inside = np.concatenate([path.vertices for path in band.get_paths()])
    top = np.sort(drawn.body.x[..., 1].ravel())[-1]
    assert inside[:, 1].max() <= top + 1e-9 and inside[:, 1].min() < 4.0  # the band lies in the body
    assert any(isinstance(patch, PathPatch) for patch in axes.patches)  # the roller's wall
    lines = np.concatenate([np.concatenate(c.get_segments()) for c in axes.collections if isinstance(c, LineCollection)])
    assert np.hypot(lines[:, 0] - 10.0, lines[:, 1] - 7.2).min() == pytest.approx(3.0, rel=0.02)
    holds(figure)


@pytest.mark.parametrize(
    ("size", "cells", "held", "axis"),
    [
        ((20.0, 0.5, 0.7), (8, 2, 1), "z", 2),  # a strap thinner than its one layer
        ((20.0, 10.0, 0.7), (8, 4, 2), "z", 2),  # two layers, thin
        ((10.0, 0.7, 10.0), (4, 1, 4), "y", 1),
        ((20.0, 10.0, 0.7), (8, 4, 1), "", None),  # a sheet that grows thinner
        ((2.0, 2.0, 2.0), (1, 1, 1), "z", None),  # a single cell
    ],
)
def test_what_is_a_slice(size, cells, held, axis):
    scene = Scene(Body(read_gmsh(box.build, size=size, cells=cells), "box", neo_hooke(mu=0.4, K=2.0)))
    scene.fix("xmin")
    for letter in held:
        scene.fix((f"{letter}min", f"{letter}max"), letter)
    scene.prescribe("xmax", "x", 0.01)
    drawn = solve(scene, steps=1).drawing()
    if ROOT:
        assert drawn.view.axis == axis and drawn.is_slice is (axis is not None)


def pad(tool, plane, length=4.0, **options):
    """A plane pad, 1 mm thick, under a tool that is pressed in."""
    mesh = read_gmsh(rectangles.build, rectangles={"pad": ((0.0, -1.0), (length, 1.0), (int(2 * length), 2))})
    scene = Scene(Body(mesh, "pad", neo_hooke(mu=0.4, K=2.0)), plane=plane, **options)
    scene.fix("pad_ymin")
    scene.contact("pad_ymax", tool, name="dent")
    return solve(scene, move={tool: (0, -0.2, 0)}, steps=1).require()


def walls(figure):
    """Of each piece of a tool's wall in a slice the ends (2, 2) on the tool and those (2, 2) within it."""
    (patch,) = (patch for patch in figure.axes[0].patches if isinstance(patch, PathPatch))
    corners = patch.get_path().vertices.reshape(-1, 5, 2)
    return corners[:, [0, 1, 2, 3]]


@pytest.mark.parametrize(
    ("plane", "radius", "centre"),
    [("axisymmetric", 2.0, (0, 2, 0)), ("strain", 2.0, (2, 2, 0)), ("strain", -6.0, (2, -5.65, 0))],
)
def test_the_wall_of_a_round_tool_is_drawn_without_slits_to_the_pictures_edge(plane, radius, centre):
    """Where the picture ends the arc does, too: all of its points lie on it; pieces of the wall share their ends."""
    thick = {} if plane == "axisymmetric" else {"thickness": 1.0}
    tool = rigid_sphere(2.0, centre, name="tool") if plane == "axisymmetric" else rigid_cylinder(
        abs(radius), centre, (0, 0, 1), hollow=radius < 0.0, name="tool")  # fmt: skip
    result = pad(tool, plane, **thick)
    figure, drawn = result.plot(), result.drawing()
    if not ROOT:
        return
    pieces, middle = walls(figure), np.array(centre[:2]) - [0.0, 0.2]
    distance = np.linalg.norm(pieces.reshape(-1, 2) - middle, axis=1).reshape(-1, 4)
    on_tool = np.sort(np.abs(distance - abs(radius)), axis=1)
    assert on_tool[:, 1].max() < 0.01 * abs(radius)  # two of four
    within = distance.max(axis=1) if radius < 0.0 else distance.min(axis=1)
    np.testing.assert_allclose(within, within.mean(), rtol=2e-3)
    corners = np.round(pieces.reshape(-1, 2), 6)
    _, times = np.unique(corners, axis=0, return_counts=True)
    assert np.count_nonzero(times == 1) <= 4  # those of the two ends alone
    low, high = drawn.box
    assert all((tiles >= low - 1e-12).all() and (tiles <= high + 1e-12).all() for tiles in drawn.tools)


@pytest.mark.parametrize("plane", ["strain", "axisymmetric"])
def test_a_picture_goes_as_far_as_the_walls_that_the_bodies_face(plane):
    """A pad 4 mm long has walls on both sides, 2 and 7 mm away, and in an axisymmetric scene one: all are in the picture.
    What lies behind a side without a contact is not, nor is a plane 40 mm above, and the title names it. A ball that no side
    faces is, where it is nearest."""
    mesh = read_gmsh(rectangles.build, rectangles={"pad": ((0.0, -1.0), (4.0, 1.0), (4, 2))})
    scene = Scene(Body(mesh, "pad", neo_hooke(mu=0.4, K=2.0)), plane=plane)
    scene.fix("pad_ymin", "x")
    scene.prescribe("pad_ymin", "y", 0.1)
    bore = rigid_revolution([(11, -6), (11, 6)], axis=(0, 1, 0), name="groove")
    corners = [(-2, 6), (-2, -4, 0.5), (11, -4, 0.5), (11, 6)]
    walled = {"strain": rigid_extrusion(corners, along=(0, 0, -1), up=(0, 1, 0), name="groove"), "axisymmetric": bore}
    scene.contact(("pad_xmin", "pad_xmax") if plane == "strain" else "pad_xmax", walled[plane], name="wall")
    scene.contact("pad_ymax", rigid_plane((0, 40, 0), (0, -1, 0), name="sky"), name="above")
    if plane == "strain":
        scene.contact("pad_ymax", rigid_cylinder(1.0, (7, 3, 0), (0, 0, 1), name="roll"), name="roll")
    result = solve(scene, steps=1)
    drawn, figure, above = result.drawing(), result.plot("contact_pressure"), result.drawing("above_gap")
    if ROOT:
        assert not any(len(tiles) for tiles in above.tools)  # the others are no matter of this contact
        assert above.title.endswith("beyond the picture: sky")
        assert "nothing touches, beyond the picture: sky" in drawn.title
        reach = {"axisymmetric": (11.0, 11.0), "strain": (-2.0, 11.0)}[plane]
        groove = drawn.tools[0][np.abs(drawn.tools[0][..., 2]).min(axis=1) < 1.0]
        np.testing.assert_allclose((groove[..., 0].min(), groove[..., 0].max()), reach, atol=0.05)
        low, high = figure.axes[0].get_xlim()
        assert (low > -1.0 if plane == "axisymmetric" else low < -2.0) and 11.0 < high < 13.0
        if plane == "strain":
            assert groove[..., 1].min() > -2.5  # its floor is
            assert len(drawn.tools[2]) and np.hypot(drawn.tools[2][..., 0] - 7, drawn.tools[2][..., 1] - 3).max() < 1.01
        assert not len(drawn.tools[1])
        holds(figure)


@pytest.mark.parametrize("cells", [(4, 8), (8, 8)])
def test_the_shaft_in_a_rings_bore_is_drawn(cells):
    """The ring ends at its bore and not on the axis, which is its plane of symmetry."""
    mesh = read_gmsh(rectangles.build, rectangles={"ring": ((1.0, 0.0), (0.5, 1.0), cells)})
    scene = Scene(Body(mesh, "ring", neo_hooke(mu=1.0, K=5.0)), plane="axisymmetric")
    scene.fix("ring_ymin", "y")
    scene.swell("ring", 0.9)
    scene.contact("ring_xmin", rigid_cylinder(1.0, (0, 0, 0), axis=(0, 1, 0), name="shaft"))
    drawn = solve(scene, steps=1).drawing()
    if ROOT:
        assert len(drawn.tools[0]) and "beyond" not in drawn.title
        assert drawn.tools[0][..., 0].min() < 0.98  # a strip of it, not its outline alone


def test_the_band_of_a_field_stays_in_a_thin_body():
    """Of a pad thirty times as long as thick."""
    figure = pad(rigid_cylinder(2.0, (15, 2, 0), (0, 0, 1), name="roll"), "strain", length=30.0, thickness=1.0).plot()
    if ROOT:
        _, band = (c for c in figure.axes[0].collections if isinstance(c, PolyCollection))
        places = np.concatenate([path.vertices for path in band.get_paths()])
        assert -0.8 < places[:, 1].min() < -0.4


def test_a_plane_scene_has_the_components_of_a_plane():
    """And says which: of an axisymmetric one zz is that around the axis; xz and yz there are none of."""
    result = pad(rigid_sphere(2.0, (0, 2, 0), name="ball"), "axisymmetric")
    for name in ("stress_xz", "stress_zy", "displacement_z"):
        refused("displacement_x, _y, stress_xx, _yy, _zz, _xy", lambda name=name: result.plot(name))
    labels = [result.drawing(f"stress_{which}") for which in ("zz", "xy")]
    if ROOT:
        assert [drawn.colours.label for drawn in labels] == [
            "Cauchy stress zz, around the axis [MPa]",
            "Cauchy stress xy [MPa]",
        ]


def test_a_status_map_has_a_legend_of_its_four_words(rolled, punched):
    slice_map, whole = rolled.plot("status"), punched.plot("status", mirror="x", backend="matplotlib")
    if not ROOT:
        return
    for figure in (slice_map, whole):
        legend = figure.axes[0].get_legend()
        assert [text.get_text() for text in legend.get_texts()][:4] == ["open", "closed", "stick", "slip"]
        assert len(figure.axes) == 1  # no colour bar
        holds(figure)
    image = whole.axes[0].images[0].get_array().reshape(-1, 3) / 255.0
    known = np.array([[int(colour[i : i + 2], 16) / 255 for i in (1, 3, 5)] for colour in STATUS])
    share = [np.mean(np.abs(image - colour).max(axis=1) < 0.01) for colour in known]
    assert min(share[0], share[2], share[3]) > 1e-3  # under the rough punch some stick and some slip, the rim is open


def flat_facet(corners, values):
    """A body of one facet with a contact field."""
    corners = np.array([corners], dtype=float)
    return DrawnSkin(corners, corners, np.array([values]), np.array([True]), np.zeros(1, dtype=np.int64))


def test_what_is_nearer_hides_pixel_by_pixel():
    """A tilted tool cuts through a facet along x = 0.5: its near half tints the facet, its far half does not, and along the
    whole cut no pixel is on the wrong side by more than what counts as touching. An opaque facet before hides all."""
    view, square = from_angles(90.0, -90.0), np.array([[0, 0], [1, 0], [1, 1], [0, 1]], dtype=float)
    facet = flat_facet(np.column_stack([square, np.zeros(4)]), np.ones(4))
    tint = colours("", "amount", True, np.ones(1))
    for turned in (1, -1):  # the tool's facet looks at the eye, and away from it
        tool = np.column_stack([square, square[:, 0] - 0.5])[None, ::turned]
        parts = layers(facet, [tool], view, tint, 1.0)
        image = rasterised(parts, view, np.zeros(2), np.ones(2), 200)[5:-5, 5:-5].astype(float)
        plain = np.abs(image - image[:, :1]).max(axis=2) == 0.0  # as at the left, where the tool lies behind
        change = np.argmin(plain, axis=1) + 5
        assert np.ptp(change) <= 1  # a straight cut
        assert abs(change[0] - 100) <= 1 + 200 * (APART if turned < 0 else 0.0)
    lid = flat_facet(np.column_stack([square, np.full(4, 2.0)]), np.zeros(4))
    both = layers(facet, [tool], view, tint, 1.0) + layers(lid, [], view, tint, 1.0)
    alone = layers(lid, [], view, tint, 1.0)
    np.testing.assert_array_equal(*(rasterised(parts, view, np.zeros(2), np.ones(2), 60) for parts in (both, alone)))


def test_facets_that_share_an_edge_tint_its_pixels_once():
    """Of a fan of triangles seen through, whatever their edges' directions, no seam is seen and no pixel is left out."""
    view, rim = from_angles(90.0, -90.0), np.linspace(0.0, 2 * np.pi, 24)
    around = np.column_stack([0.5 + 0.37 * np.cos(rim), 0.5 + 0.37 * np.sin(rim), np.zeros(len(rim))])
    middle = np.broadcast_to([0.5, 0.5, 0.0], around[1:].shape)
    fan = np.stack([middle, around[:-1], around[1:], around[1:]], axis=1)
    colour = np.broadcast_to([0.0, 0.0, 0.0, 0.2], (*fan.shape[:2], 4))
    image = rasterised([Layer("glass", fan, colour)], view, np.zeros(2), np.ones(2), 150)
    row, column = np.indices(image.shape[:2])
    inside = np.hypot(row - 74.5, column - 74.5) < 0.35 * 150
    assert np.unique(image[inside]).tolist() == [204]
    assert np.unique(image[np.hypot(row - 74.5, column - 74.5) > 0.39 * 150]).tolist() == [255]


def test_the_legend_beside_a_square_picture_is_not_cut_off():
    mesh = read_gmsh(rectangles.build, rectangles={"block": ((0, 0), (10, 20), (2, 4))})
    scene = Scene(Body(mesh, "block", neo_hooke(mu=0.4, K=2.0)), plane="strain")
    scene.fix("block_ymin")
    scene.fix("block_xmin", "x")
    lid = rigid_plane((0, 20, 0), (0, -1, 0), name="lid")
    scene.contact("block_ymax", lid, 0.3, name="grip")
    figure = solve(scene, move={lid: (0, -1, 0)}, steps=1).plot("grip_status", mirror="x")
    if ROOT:
        holds(figure)


def test_a_picture_is_the_one_that_matplotlib_saves(punched, tmp_path):
    """In a folder each rank has of its own; the figure goes on as it was."""
    seen = drawing(Fields(punched.scene, punched.system))
    if ROOT:
        figure, kinds = seen.figure(), {}
        for name in ("png", "again"):
            save(figure, tmp_path / name)
            kinds[name] = np.array(Image.open(tmp_path / name))
        figure.savefig(tmp_path / "plain", dpi=DOTS, format="png")
        kinds["plain"] = np.array(Image.open(tmp_path / "plain"))
        assert kinds["png"].shape[1] == pytest.approx(DOTS * WIDTH, abs=DOTS) and np.ptp(kinds["png"]) > 200
        for name in ("again", "plain"):
            np.testing.assert_array_equal(kinds[name], kinds["png"])


@pytest.mark.parametrize("off", [np.nan, 0.0])
def test_values_off_the_slave_surfaces_are_not_drawn(punched, off):
    """NaN or zero there, what is drawn is the same; NaN on a slave surface is grey."""
    fields = Fields(punched.scene, punched.system)
    fields.update()
    z = fields.of("").pressure.function_space.tabulate_dof_coordinates()[:, 2]
    inside = (z > 1e-9) & (z < 10.0 - 1e-9)
    fields.of("").pressure.x.array[inside] = off
    drawn, plain = drawing(fields), punched.drawing()
    fields.of("").pressure.x.array[:] = np.nan
    empty = drawing(fields)
    if ROOT:
        np.testing.assert_array_equal(drawn.body.values, plain.body.values)
        assert drawn.colours == plain.colours
        assert np.isnan(empty.body.values).all()
        np.testing.assert_allclose(empty.colours.of(empty.body.values[:, 0])[:, :3], np.tile(BODY, (len(empty.body.x), 1)))
        holds(empty.figure())


def test_a_scene_without_contacts_shows_its_displacement():
    mesh = read_gmsh(box.build, size=(2.0, 2.0, 2.0), cells=(2, 2, 2))
    scene = Scene(Body(mesh, "box", neo_hooke(mu=0.4, K=2.0)), units=Units("m", "kN", "kPa"))
    scene.fix("zmin")
    scene.prescribe("zmax", "z", 0.2)
    result = solve(scene, steps=1)
    drawn, figure = result.drawing(), result.plot()
    stress, ratio = result.drawing("stress_zz"), result.drawing("J")
    refused("no contacts", lambda: result.plot("contact_pressure"))
    refused("there are none", lambda: result.plot(mirror="x"))
    if ROOT:
        assert drawn.colours.label == "displacement [m]" and not drawn.tools
        assert drawn.colours.low == 0.0 and 0.2 <= drawn.colours.high < 0.25  # the sides move inwards too
        assert stress.colours.label == "Cauchy stress zz [kPa]" and ratio.colours.low > 0.9
        holds(figure)


def test_a_contact_between_bodies_is_seen_through_one_of_them():
    mesh = read_gmsh(two_blocks.build, lower_cells=(4, 4, 1), upper_cells=(3, 3, 1))
    scene = Scene(*(Body(mesh, name, mooney_rivlin(**RUBBER)) for name in ("lower", "upper")))
    scene.fix("lower_bottom")
    scene.fix("upper_top", "xy")
    scene.prescribe("upper_top", "z", -0.5)
    scene.contact("upper_bottom", "lower_top", name="interface")
    result = solve(scene, steps=1)
    drawn, whole = result.drawing(), result.drawing("von_mises")
    if ROOT:
        assert drawn.hidden.tolist() == [True, False] and not whole.hidden.any()
        assert drawn.view.towards[2] < 0.0 and "seen from below" in drawn.title
        assert set(drawn.body.body[drawn.body.slave]) == {1}
        holds(drawn.figure())


@pytest.mark.parametrize("axis", [0, 1, 2])
def test_what_weight_acts_against_is_up(axis):
    """A block on a floor, whose normal is one axis or another: weight draws it down in the picture."""
    up = np.eye(3)[axis]
    scene = Scene(Body(read_gmsh(box.build, size=(2.0, 2.0, 2.0), cells=(2, 2, 2)), "box", neo_hooke(mu=0.4, K=2.0)))
    scene.fix(f"{'xyz'[axis]}max")
    scene.body_force(-0.05 * up)
    floor = rigid_plane((0, 0, 0), up, name="floor")
    scene.contact(f"{'xyz'[axis]}min", floor, name="foot")
    result = solve(scene, steps=1)
    drawn, told, turned = result.drawing("displacement"), result.drawing(view=(30, -60)), result.drawing()
    if ROOT:
        across, along = drawn.view.flat(up)
        assert abs(across) < 1e-12 and along > 0.5
        frame = np.array([drawn.view.right, drawn.view.up, drawn.view.towards])
        np.testing.assert_allclose(frame @ frame.T, np.eye(3), atol=1e-12)
        assert np.linalg.det(frame) == pytest.approx(1.0)  # no mirror image
        assert told.view.up @ [0, 0, 1] > 0.5  # angles are about z
        assert ("seen from below" in turned.title) == (turned.view.towards @ up < -0.1)


def test_a_huge_tool_leaves_the_body_its_size():
    mesh = read_gmsh(box.build, size=(2.0, 2.0, 1.0), cells=(3, 3, 2))
    scene = Scene(Body(mesh, "box", neo_hooke(mu=0.4, K=2.0)))
    scene.fix("zmin")
    ball = rigid_sphere(50.0, (1.0, 1.0, 51.0), name="ball")
    scene.contact("zmax", ball, name="lid")
    result = solve(scene, move={ball: (0, 0, -0.05)}, steps=1)
    drawn = result.drawing()
    if ROOT:
        (tiles,) = drawn.tools
        assert len(tiles) > 10 and tiles.min() > -0.5 and tiles.max() < 2.5
        np.testing.assert_allclose(np.linalg.norm(tiles.mean(axis=1) - [1.0, 1.0, 50.95], axis=1), 50.0, atol=0.02)


def tetrahedra():
    gmsh.model.occ.addBox(0, 0, 0, 1, 1, 1)
    gmsh.model.occ.synchronize()
    gmsh.option.setNumber("Mesh.MeshSizeMin", 0.5)
    gmsh.option.setNumber("Mesh.MeshSizeMax", 0.5)
    gmsh.model.mesh.generate(3)
    gmsh.model.setPhysicalName(3, gmsh.model.addPhysicalGroup(3, [1]), "cube")
    for tag in range(1, 7):
        gmsh.model.setPhysicalName(2, gmsh.model.addPhysicalGroup(2, [tag]), f"face{tag}")


@pytest.mark.parametrize("degree", [1, 2])
def test_pressure_of_any_degree_is_drawn(degree):
    mesh = read_gmsh(box.build, size=(2.0, 2.0, 1.0), cells=(2, 2, 1))
    scene = Scene(Body(mesh, "box", neo_hooke(0.4, 2.0)), degree=degree)
    scene.fix("zmin")
    lid = rigid_plane((0, 0, 1), (0, 0, -1), name="lid")
    scene.contact("zmax", lid, name="top")
    result = solve(scene, move={lid: (0, 0, -0.1)}, steps=1)
    drawn = result.drawing()
    if ROOT:
        assert "nothing" not in drawn.title and drawn.colours.high == pytest.approx(
            result.history[-1]["top_peak_pressure_MPa"], rel=0.5
        )
        assert np.isfinite(drawn.body.values[drawn.body.slave]).all()


@pytest.mark.parametrize("degree", [1, 2])
def test_tetrahedra(degree):
    scene = Scene(Body(read_gmsh(tetrahedra), "cube", neo_hooke(mu=0.4, K=2.0)), degree=degree)
    scene.fix("face5")
    scene.prescribe("face6", "z", -0.1)
    result = solve(scene, steps=1)
    drawn, figure = result.drawing("displacement_z"), result.plot("von_mises")
    if ROOT:
        np.testing.assert_allclose(area(drawn.body), 6.0, rtol=1e-12)
        assert (np.einsum("nc,nc->n", normals(drawn.body.X), drawn.body.X.mean(axis=1) - 0.5) > 0.0).all()
        assert (drawn.colours.low, drawn.colours.high) == (pytest.approx(-0.1), pytest.approx(0.0))
        holds(figure)


def test_curves_have_names_and_units(punched):
    figure = punched.plot_history(
        "punch_travel_z_mm", ["top_force_z_N", "bottom_force_z_N", "top_area_mm2"], factors=(-1, 1)
    )
    with pytest.raises(KeyError, match="top_force_z_N"):
        punched.plot_history("t", "top_force")
    assert words("limit_point", Units()) == ("limit point", "")
    if not ROOT:
        return
    forces, contact_area = figure.axes
    assert forces.get_xlabel() == "−punch travel z [mm]" and contact_area.get_ylabel() == "top area [mm²]"
    assert [text.get_text() for text in forces.get_legend().get_texts()] == ["top force z", "bottom force z"]
    assert (times(1.0), times(-1.0), times(-2.5)) == ("", "−", "−2.5 × ")
    np.testing.assert_allclose(forces.lines[0].get_xdata(), [1.0, 2.0])
    holds(figure)


@pytest.mark.parametrize(
    ("kind", "values", "limits"),
    [
        ("amount", [0.0, 2.0, np.nan], (0.0, 2.0)),
        ("signed", [-1.0, 3.0], (-3.0, 3.0)),  # zero in the middle
        ("signed", [-0.01, 3.0], (-0.01, 3.0)),  # one side is all there is
        ("amount", [np.nan], (0.0, 1.0)),
        ("amount", [2.0, 2.0], (1.9, 2.1)),
        ("amount", [2.0, 2.0 + 3e-15], (1.9, 2.1)),  # equal up to round-off: one colour
        ("signed", [-2.0, -2.0 + 3e-15], (-2.1, -1.9)),
    ],
)
def test_limits_of_colours(kind, values, limits):
    found = colours("", kind, False, np.array(values))
    np.testing.assert_allclose((found.low, found.high), limits)
    assert (found.scale.get_cmap().name == "RdBu_r") is (limits[0] == -limits[1])  # pale in the middle: zero


def test_stages_that_end_together_are_named_above_the_curve():
    """Forth, back and forth again: marks on the curve, their names above it, all within the picture."""
    x = np.array([0.0, 0.5, 1.0, 0.5, 0.0, 0.5, 1.0])
    table = {"face_angle_z_rad": x, "top_force_z_N": 2.0 * x}
    ends = {"there": 2, "back": 4, "and there again": 6}
    figure = history_figure(table, Units(), (1.0, 1.0), ends)
    (axes,) = figure.axes
    assert axes.get_xlabel() == "face angle z [rad]"
    FigureCanvasAgg(figure).draw()
    assert [text.get_text() for text in axes.get_legend().get_texts()] == list(ends)
    assert axes.get_legend().get_window_extent().y0 > axes.get_window_extent().y1
    holds(figure)


@pytest.mark.parametrize(("name", "mirror"), [("status", "xy"), ("contact_pressure", ""), ("contact_pressure", "y")])
def test_nothing_is_cut_off_however_often_a_picture_is_drawn(name, mirror):
    """A quarter of a cord under a lid, and its images: places of the same scale along both axes, a legend or bar beside."""
    scene = Scene(
        Body(read_gmsh(disc.build, radius=1.5, depth=None, cells=3), "disc", neo_hooke(mu=1.0, K=8.0)), plane="strain"
    )
    scene.fix("symmetry_x", "x")
    scene.fix("symmetry_y", "y")
    lid = rigid_plane((0, 1.5, 0), (0, -1, 0), name="lid")
    scene.contact("rim", lid, 0.2, name="lid")
    figure = solve(scene, move={lid: (0, -0.45, 0)}, steps=3).require().plot(name, mirror=mirror)
    if ROOT:
        for _ in range(3):
            holds(figure)


def test_pressure_along_a_line_leaves_out_what_is_not_there():
    axes = Figure().add_subplot()
    along_line(axes, np.array([2.0, 0.0, 1.0, 3.0]), np.array([0.0, 1.0, 2.0, np.nan]), label="a")
    np.testing.assert_array_equal(axes.lines[0].get_xydata(), [[0.0, 1.0], [1.0, 2.0], [2.0, 0.0]])


def ffmpeg(folder):
    """A program that takes frames as ffmpeg does, and writes its arguments and their number of bytes for a film."""
    program = folder / "ffmpeg"
    program.write_text(f"""#!{sys.executable}
import sys
frames = sys.stdin.buffer.read() if len(sys.argv) > 2 else b""
if frames:
    open(sys.argv[-1], "w").write(" ".join([*sys.argv[1:-1], str(len(frames))]))
""")
    program.chmod(0o755)
    return str(program)


def test_a_film_draws_the_steps_of_a_run(tmp_path, monkeypatch):
    path = COMM.bcast(tmp_path) / "press.gif"
    mesh = read_gmsh(box.build, size=(2.0, 2.0, 1.0), cells=(3, 3, 2))
    scene = Scene(Body(mesh, "box", neo_hooke(mu=0.4, K=2.0)))
    scene.fix("zmin")
    plate = rigid_plane((0, 0, 1), (0, 0, -1), name="lid")
    scene.contact("zmax", plate, 0.3, name="top")
    film, seldom = Film(), Film("status", every=3)
    refused("no drawings", lambda: Film().save(path))
    result = solve(scene, move={plate: (0, 0, -0.2)}, steps=4, record={"frame": film, "seldom": seldom}).require()
    last = result.drawing()
    film.save(path)
    COMM.Barrier()
    assert result.column("frame").tolist() == [0.0, 1.0, 2.0, 3.0]
    with Image.open(path) as picture:
        assert picture.n_frames == 4
    refused("animation.*No such file", lambda: film.save(tmp_path / "nowhere" / "a.gif"))
    refused("the ending .gif or .mp4", lambda: film.save(path.with_suffix(".avi")))
    monkeypatch.setitem(rcParams, "animation.ffmpeg_path", "no such program")
    refused("Debian's package ffmpeg", lambda: film.save(path.with_suffix(".mp4")))
    monkeypatch.setitem(rcParams, "animation.ffmpeg_path", ffmpeg(tmp_path))
    film.save(path.with_suffix(".mp4"))
    if ROOT:
        words = path.with_suffix(".mp4").read_text().split()
        width, height = (int(side) for side in words[words.index("-s") + 1].split("x"))
        assert width % 2 == height % 2 == 0  # 4:2:0 halves them
        assert "yuv420p" in words and int(words[-1]) == 4 * 4 * width * height  # four frames of RGBA
    assert (len(film.drawings), len(seldom.drawings)) == ((4, 2) if ROOT else (0, 0))
    if ROOT:
        np.testing.assert_array_equal(film.drawings[-1].body.values, last.body.values)
        lids = [one.tools[0][..., 2].mean() for one in film.drawings]
        np.testing.assert_allclose(lids, [0.95, 0.9, 0.85, 0.8])  # each is of its own step
        assert film.drawings[0].title == "t = 0.25"


def test_a_frame_without_contact_leaves_the_colours_of_a_film_alone():
    """A soft pad is pressed with a thousandth of a MPa, and let go."""
    scene = Scene(Body(read_gmsh(box.build, size=(2.0, 2.0, 1.0), cells=(2, 2, 1)), "box", neo_hooke(mu=1e-3, K=5e-3)))
    scene.fix("zmin")
    lid = rigid_plane((0, 0, 1), normal=(0, 0, -1), name="lid")
    scene.contact("zmax", lid, name="top")
    film = Film("contact_pressure")
    stages = [Stage("press", move={lid: (0, 0, -0.1)}, steps=2), Stage("lift", move={lid: (0, 0, 0.2)}, steps=2)]
    result = solve(scene, stages=stages, record={"frame": film}).require()
    peak = result.column("top_peak_pressure_MPa").max()
    if ROOT:
        assert film.drawings[-1].colours.blank and len(film.drawings) == 4
        low, high = common_limits(film.drawings)
        assert low == 0.0 and 0.3 * peak < high < 3.0 * peak < 0.01


def test_a_tool_at_rest_does_not_travel_in_a_film():
    """A block is dragged over a floor: what is drawn of that grows ahead of the block, and does not follow it."""
    scene = Scene(Body(read_gmsh(box.build, size=(2.0, 2.0, 1.0), cells=(2, 2, 1)), "box", neo_hooke(mu=0.4, K=2.0)))
    scene.prescribe("zmax", "z", -0.05)
    scene.fix("zmax", "y")
    scene.prescribe("zmax", "x", lambda X, t: 3.0 * t)
    scene.contact("zmin", rigid_plane(name="floor"), name="foot")
    film = Film()
    for _ in range(2):  # the second run begins anew
        result = solve(scene, steps=3, record={"frame": film}).require()
        assert result.column("frame").tolist() == [0.0, 1.0, 2.0]
    if ROOT:
        assert len(film.drawings) == 3
        ends = np.array([[one.tools[0].min(axis=(0, 1)), one.tools[0].max(axis=(0, 1))] for one in film.drawings])
        np.testing.assert_allclose(ends[:, 0, 0], ends[0, 0, 0])
        np.testing.assert_allclose(np.diff(ends[:, 1, 0]), 1.0, atol=0.05)


def test_stresses_of_an_unloaded_body_are_zero():
    """Pressed by the lid and let go again, what round-off leaves is no field with hot spots."""
    mesh = read_gmsh(rectangles.build, rectangles={"pad": ((0.0, 0.0), (4.0, 2.0), (4, 2))})
    scene = Scene(Body(mesh, "pad", neo_hooke(mu=0.4, K=2.0)), plane="strain")
    scene.fix("pad_ymin")
    scene.prescribe("pad_ymax", "y", lambda X, t: -0.3 * (1.0 - abs(2.0 * t - 1.0)) * np.ones(len(X)))
    result = solve(scene, steps=4)
    for field in ("von_mises", "stress_yy"):
        drawn = result.drawing(field)
        if ROOT:
            assert drawn.colours.blank and not np.nan_to_num(drawn.body.values).any()
