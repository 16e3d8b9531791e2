"""Contact surfaces that some ranks know nothing of, and bodies that a step carries through each other."""

import gmsh
import numpy as np
import pytest

from fenics_contact import Body, Output, Scene, mooney_rivlin, read_gmsh, rigid_plane, solve
from fenics_contact.meshes import box, two_blocks

SQUEEZED = 0.1288051 * 400  # N: classical Mooney-Rivlin, uniaxial stretch 0.9, nominal stress [MPa] times area [mm^2]


def stack(lower_cells, upper_cells, gap=0.0):
    """Two blocks of 20 x 20 x 10 mm, one on the other."""
    mesh = read_gmsh(
        two_blocks.build,
        lower=(20.0, 20.0, 10.0),
        lower_origin=(0.0, 0.0, -10.0),
        lower_cells=lower_cells,
        upper=(20.0, 20.0, 10.0),
        upper_origin=(0.0, 0.0, gap),
        upper_cells=upper_cells,
    )
    rubber = mooney_rivlin(a1=0.1863, a2=0.0098, K=5.0)
    scene = Scene(Body(mesh, "lower", rubber), Body(mesh, "upper", rubber))
    for body in ("lower", "upper"):
        scene.fix(f"{body}_xmin", "x")
        scene.fix(f"{body}_ymin", "y")
    scene.fix("lower_bottom", "z")
    return scene


@pytest.mark.parallel
@pytest.mark.parametrize("points", ["nodes", 2])
def test_surfaces_of_one_facet(points):
    """Each block is one cell, so on two ranks each surface is unknown to one of them."""
    scene = stack((1, 1, 1), (1, 1, 1))
    comm = scene.mesh.comm
    for name in ("upper_bottom", "lower_top"):
        assert comm.size == 1 or 0 in comm.allgather(len(scene.mesh.facets(name)))
    scene.prescribe("upper_top", "z", -2.0)
    scene.contact("upper_bottom", "lower_top", penalty=1000.0, points=points, name="c")
    result = solve(scene, steps=2)
    assert result.converged
    # the penalty's 1.3e-4 mm of 2 mm, over the stretch 0.9: 1e-4 of the force
    assert abs(result.history[-1]["c_force_z_N"] / SQUEEZED - 1.0) < 2e-4


@pytest.mark.parallel
def test_lines_and_widths_of_a_face_of_one_facet(tmp_path):
    """Ranks without a facet have no points on the line, and take part."""
    scene = stack((1, 1, 1), (1, 1, 1))
    scene.prescribe("upper_top", "z", -2.0)
    scene.contact("upper_bottom", "lower_top", penalty=1000.0, name="c")
    result = solve(scene, steps=1).require()
    line, side = result.line("c", "x", {"y": 5.0}), 20.0 + result.system.state.u.x.array.max(initial=0.0)
    side = max(scene.mesh.comm.allgather(side))  # of a face that is squeezed evenly
    assert np.abs(line["pressure_MPa"] - result.history[-1]["c_load_N"] / side**2).max() < 1e-6 * line["pressure_MPa"].max()
    assert np.abs(result.widths("c", "x", {"y": 5.0}) - [0.0, side]).max() < 1e-9
    result.plot_line("c", "x", tmp_path / "line.png", cut={"y": 5.0})


@pytest.mark.parallel
def test_tool_on_a_face_of_one_facet():
    scene = stack((1, 1, 1), (1, 1, 1))
    scene.contact("upper_bottom", "lower_top", penalty=1000.0, points=2, name="c")
    tool = rigid_plane(point=(0, 0, 10), normal=(0, 0, -1))
    scene.contact("upper_top", tool, penalty=1000.0, name="top")
    result = solve(scene, move={tool: (0, 0, -2.0)}, steps=2)
    assert result.converged
    assert abs(result.history[-1]["top_force_z_N"] / -SQUEEZED - 1.0) < 3e-4  # two interfaces yield


@pytest.mark.parallel
def test_one_cell_of_degree_2(tmp_path):
    """A rank without cells has no nodes either, and writes and draws all the same; the bottom is held at an edge, too."""

    def cube():
        box.build(size=(1.0, 1.0, 1.0), cells=(1, 1, 1))
        lines = [tag for _, tag in gmsh.model.getEntities(1) if gmsh.model.getBoundingBox(1, tag)[3] < 0.5]
        gmsh.model.setPhysicalName(1, gmsh.model.addPhysicalGroup(1, lines), "edges")

    mesh = read_gmsh(cube)
    assert mesh.comm.size == 1 or 0 in mesh.comm.allgather(mesh.domain.topology.index_map(3).size_local)
    scene = Scene(Body(mesh, "box", mooney_rivlin(a1=0.1863, a2=0.0098, K=5.0)), degree=2)
    scene.fix("zmin", "z")
    scene.fix("ymin", "y")
    scene.fix("edges", "x")  # those of the face xmin
    lid = rigid_plane(point=(0, 0, 1), normal=(0, 0, -1), name="lid")
    scene.contact("zmax", lid, penalty=1000.0, name="top")
    result = solve(scene, move={lid: (0, 0, -0.1)}, steps=2, out=Output(tmp_path, overwrite=True, progress=False)).require()
    assert abs(result.history[-1]["top_force_z_N"] * 400 / -SQUEEZED - 1.0) < 2e-3  # the penalty's share of the way
    result.plot("contact_pressure", tmp_path / "pressure.png")


@pytest.mark.parallel
@pytest.mark.parametrize("points", [3, "averages"])
def test_a_step_does_not_carry_bodies_through_each_other(points):
    """The step's first solve moves the upper block by 8 mm without resistance, deeper than Gauss points seek partners."""
    scene = stack((4, 4, 4), (3, 3, 4), gap=0.5)
    scene.prescribe("upper_top", "z", -8.0)
    scene.contact("upper_bottom", "lower_top", points=points, name="c")
    result = solve(scene, steps=1)
    assert result.converged and (points == "averages" or result.verdict.cuts > 0)
    assert result.history[-1]["c_force_z_N"] > 2 * SQUEEZED  # squeezed by 7.5 of 20 mm, 3.75 times the strain
