"""The facets that stand for a tool in files and pictures lie on it, look out of it, and are no more than the eye needs."""

import numpy as np
import pytest

from fenics_contact import (
    rigid_cone,
    rigid_cylinder,
    rigid_extrusion,
    rigid_plane,
    rigid_punch,
    rigid_revolution,
    rigid_sphere,
    rigid_surface,
    rigid_torus,
    rigid_union,
)
from fenics_contact.assembly.pose import Pose, rotation
from fenics_contact.contact.master import area_vectors
from fenics_contact.contact.tools import Tool
from fenics_contact.kernels.rigid_element import distances
from fenics_contact.meshes import box
from fenics_contact.output.tool_surfaces import SAG, tool_surface

pytestmark = pytest.mark.serial
SIZE = 12.0
TRAVEL, TURN = np.array([0.3, -0.2, 1.5]), rotation(np.array([0.4, -1.1, 0.7]))
ABOUT = np.array([-1.0, 2.0, 0.5])
POSE = Pose(ABOUT, TRAVEL, TURN, np.eye(3), 1.0)
OBLIQUE = (0.3, -0.5, 0.8)
PLACE = (1.0, 2.0, 3.0)

TOOLS = {
    "plane": rigid_plane(PLACE, OBLIQUE),
    "sharp punch": rigid_punch(3.0, 4.0, PLACE, half_depth=2.0, direction=OBLIQUE),
    "round punch": rigid_punch(3.0, 4.0, PLACE, half_depth=2.0, direction=OBLIQUE, fillet=0.5),
    "rod": rigid_punch(3.0, 4.0, PLACE, half_depth=2.0, direction=OBLIQUE, fillet=2.0),
    "sphere": rigid_sphere(5.0, PLACE),
    "large sphere": rigid_sphere(60.0, PLACE),
    "cylinder": rigid_cylinder(5.0, PLACE, OBLIQUE),
    "sharp cone": rigid_cone(0.4, PLACE, OBLIQUE),
    "blunt cone": rigid_cone(1.3, PLACE, OBLIQUE, tip=2.0),
    "hollow ball": rigid_sphere(5.0, PLACE, hollow=True),
    "bore": rigid_cylinder(5.0, PLACE, OBLIQUE, hollow=True),
    "torus": rigid_torus(5.0, 2.0, PLACE, OBLIQUE),
    "groove": rigid_extrusion(
        [(-3, 0), (-2, 0, 0.5), (-2, -2, 0.6), (2, -2, 0.6), (2, 0), (3, 0)], PLACE, (0.5, 0.3, 0), OBLIQUE
    ),
    "wedge": rigid_extrusion([(-1, -2), (-1, 0.5), (1, 0.0, 0.2), (1, -2)], PLACE, (0.5, 0.3, 0), OBLIQUE, closed=True),
    "gland": rigid_revolution([(0, 0), (2, 0, 0.5), (2, -2, 0.6), (4, -2, 0.6), (4, 0), (5, 0)], PLACE, OBLIQUE),
    "gland in a bore": rigid_revolution([(4, -2), (4, 0, 0.5), (6, 0, 0.6), (6, 2, 0.6), (4, 2), (4, 3)], PLACE, OBLIQUE),
    "plug": rigid_revolution([(0, 1.0, 0.3), (1.1, 0.4, 0.2), (1.2, -1.0), (0, -1.0)], PLACE, OBLIQUE),
    "ring": rigid_revolution([(3, 1, 0.4), (3, -1, 0.4), (2, -1, 0.4), (2, 1, 0.4)], PLACE, OBLIQUE, closed=True),
    "union": rigid_union(rigid_torus(5.0, 2.0, PLACE, OBLIQUE), rigid_cone(0.4, (9.0, 9.0, 9.0), OBLIQUE, tip=0.5)),
}
# where the tool is on the hollow side of its surface: chords lie before it
HOLLOW = ("hollow ball", "bore", "torus", "groove", "gland", "gland in a bore", "ring", "union")


def gaps(tool, points):
    out = np.empty(len(points))
    distances(np.ascontiguousarray(POSE.before(points)), (tool.kind, tool.shape, tool.origin, tool.axes, np.zeros(3)), out)
    return out


@pytest.mark.parametrize("name", TOOLS)
def test_an_analytic_tool(name):
    tool = TOOLS[name]
    points, facets = tool_surface(tool, SIZE, about=(4.0, 4.0, 4.0), pose=POSE)
    assert points.shape[1:] == (3,) and facets.shape[1:] == (4,) and facets.dtype == np.int64
    assert np.array_equal(np.unique(facets), np.arange(len(points))) or name in (
        "sharp cone",
        "blunt cone",
        "gland",
        "plug",
        "union",
    )  # there the apex is left over
    np.testing.assert_allclose(gaps(tool, points), 0.0, atol=1e-12 * max(SIZE, tool.reach))
    corners = points[facets]
    centres, area = corners.mean(axis=1), area_vectors(corners)
    size = np.linalg.norm(area, axis=1, keepdims=True)
    assert size.min() > 1e-6 * size.max(), "no facet is a line"
    middle = gaps(tool, centres)
    assert middle.min() > -1.01 * SAG * SIZE
    assert middle.max() < (1.01 * SAG * SIZE if name in HOLLOW else 1e-12 * max(SIZE, tool.reach))
    step = 1e-3 * SIZE
    rise = gaps(tool, centres + step * area / size) - middle
    # triangles at an apex take their corner twice, so that their centre is off the middle
    assert np.all(rise > 0.95 * step), "normals point out of the tool"
    assert len(facets) < 20_000


def test_endless_tools_lie_before_the_bodies():
    about = np.array([40.0, -30.0, 20.0])
    for name, beyond in (("plane", 0.0), ("cylinder", 5.0)):
        points, _ = tool_surface(TOOLS[name], SIZE, about)
        nearest = np.linalg.norm(points - about, axis=1).min()
        away = gaps(TOOLS[name], POSE.placed(about[None]))[0]
        assert away <= nearest < away + SIZE / 8 + 0.1 * beyond
        extent = np.ptp(points @ TOOLS[name].axes, axis=0)
        np.testing.assert_allclose(extent, (SIZE, SIZE, 0.0) if name == "plane" else (10.0, 10.0, SIZE), atol=1e-10)
    points, _ = tool_surface(TOOLS["plane"], SIZE)
    np.testing.assert_allclose(points.mean(axis=0), PLACE, atol=1e-12)  # where it was stated


def test_a_meshed_tool_is_its_own_surface():
    tool = rigid_surface(box.build, group="zmax", size=(1.0, 2.0, 3.0), cells=(1, 2, 3))
    points, facets = tool_surface(tool, SIZE, pose=POSE)
    np.testing.assert_allclose(points, ABOUT + (tool.X - ABOUT) @ TURN.T + TRAVEL, atol=1e-13)
    np.testing.assert_array_equal(facets, tool.nodes)


def test_an_unknown_tool_is_named():
    class Other(Tool):
        reach = 1.0

    with pytest.raises(TypeError, match="Other"):
        tool_surface(Other("x"), SIZE)
