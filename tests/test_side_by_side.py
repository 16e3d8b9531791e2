"""Masters of several bodies that end on one another under the facets of a slave: there the master goes on."""

import gmsh
import numpy as np
import pytest
from mpi4py import MPI
from taylor import orders, remainders

from fenics_contact import Body, Output, Scene, Stage, neo_hooke, read_gmsh, solve
from fenics_contact.meshes import rectangles

COMM = MPI.COMM_WORLD
RUBBER = neo_hooke(mu=0.5, K=5.0)


def columns(swapped=False, degree=1, gap=0.0, friction=0.0, depth=0.2, aside=0.0, out=None, stages=2, cells=(3, 2, 5)):
    """A lid on two columns, confined, pressed by `depth` in two steps, then drawn aside; stages: how many of both."""
    sizes = {"left": ((0.0, 0.0), (2.0, 2.0), (cells[0], 2)), "right": ((2.0 + gap, 0.0), (2.0, 2.0), (cells[1], 2))}
    mesh = read_gmsh(rectangles.build, rectangles=sizes | {"lid": ((0.0, 2.0), (4.0 + gap, 2.0), (cells[2], 2))})
    scene = Scene(*(Body(mesh, name, RUBBER) for name in ("left", "right", "lid")), plane="strain", degree=degree)
    for side, axis in (("left_ymin", "y"), ("right_ymin", "y"), ("left_xmin", "x"), ("right_xmax", "x")):
        scene.fix(side, axis)
    for side, axis in (("lid_xmin", "x"), ("lid_xmax", "x"), ("lid_ymax", "xy")):
        scene.fix(side, axis)
    if gap < 0.5:
        scene.contact("left_xmax", "right_xmin", name="joint", penetration=1e-6)
    slave, master = "lid_ymin", ("left_ymax", "right_ymax")
    scene.contact(*((master, slave) if swapped else (slave, master)), friction, name="top", penetration=1e-6)
    press = Stage("press", prescribe={("lid_ymax", "y"): -depth}, steps=2)
    sides = ("lid_ymax", "lid_xmin", "lid_xmax")
    draw = [Stage("draw", prescribe={(side, "x"): aside for side in sides}, steps=4)] if aside else []
    return solve(scene, stages=[press, *draw][:stages], out=out or Output(progress=False)).require()


def pressures(result):
    """The least and the greatest on the lid."""
    p = result.system.contact_terms[-1].forces.split_traction(result.system.state)[0]
    return COMM.allreduce(p.min(initial=np.inf), op=MPI.MIN), COMM.allreduce(p.max(initial=0.0), op=MPI.MAX)


def exact(depth=0.2):
    """Pressure of a column 4 high that cannot widen: the slope of its energy with the stretch."""
    stretch = 1.0 - depth / 4.0
    psi = lambda s: 0.25 * (s ** (-2.0 / 3.0) * (s * s + 2.0) - 3.0) + 2.5 * (s - 1.0) ** 2  # noqa: E731
    return -(psi(stretch + 1e-5) - psi(stretch - 1e-5)) / 2e-5


@pytest.mark.parallel
@pytest.mark.parametrize(
    "how", [{}, {"degree": 2}, {"cells": (3, 2, 7)}, {"cells": (4, 5, 3)}, {"friction": 0.3}, {"swapped": True}]
)
def test_an_even_pressure_passes_over_the_joint(how):
    """With samples that count in part at the joint, as over an end, nodes beside it had 0.8 ... 1.25 of it."""
    low, high = pressures(columns(**how))
    assert high / low - 1.0 < (5e-3 if how.get("degree") == 2 else 1e-3)  # of which joints are ends
    np.testing.assert_allclose([low, high], exact(), rtol=3e-3)


@pytest.mark.parallel
def test_a_narrow_gap_costs_what_it_takes_of_the_area():
    """Of 4; beyond a twentieth of a facet the columns have ends."""
    for gap, off in ((1e-3, 1e-3), (0.02, 0.03)):
        low, high = pressures(columns(gap=gap))
        assert high / low - 1.0 < off


@pytest.mark.parallel
def test_a_run_is_resumed_over_the_joint(tmp_path):
    out = COMM.bcast(tmp_path)
    how = {"friction": 0.3, "aside": 0.5}
    columns(**how, stages=1, out=Output(out, checkpoint=True, progress=False))
    resumed = columns(**how, out=Output(out, checkpoint=True, resume=True, progress=False))
    for key in ("top_force_x_N", "top_force_y_N"):
        np.testing.assert_allclose(resumed.column(key), columns(**how).column(key), rtol=1e-7)


@pytest.mark.serial
def test_the_tangent_is_exact_over_the_joint():
    system = columns(friction=0.3, aside=0.3).system
    contact, state = system.contact_terms[-1], system.state
    state.u.x.array[:] += 1e-6 * np.random.default_rng(3).uniform(-1, 1, len(state.u.x.array))
    system.foresight.resample(state)
    assert (contact.places.samples.ends[2][:, 1] >= 0).sum() > (contact.places.ends[2][:, 1] >= 0).sum()
    assert orders(remainders(system, contact, 2e-7)).min() > 1.98  # half of that leaves what is rounded


@pytest.mark.parallel
def test_a_cross_of_four_columns_in_space():
    """Under a lid of 5 x 5: it was 0.6 ... 1.5 of the pressure."""

    def draw():
        geo, groups = gmsh.model.geo, {}
        parts = {f"c{i}{j}": ((2.5 * i, 2.5 * j, 0.0), (2.0, 2.0, 2.0), (2 + i, 2 + j, 1)) for i in (0, 1) for j in (0, 1)}
        for name, (corner, size, cells) in (parts | {"lid": ((0.0, 0.0, 9.0), (4.001, 4.001, 2.0), (5, 5, 1))}).items():
            x, y, z = corner
            p = [geo.addPoint(x + a * size[0], y + b * size[1], z) for a, b in ((0, 0), (1, 0), (1, 1), (0, 1))]
            lines = [geo.addLine(a, b) for a, b in zip(p, p[1:] + p[:1], strict=True)]
            for line, count in zip(lines, 2 * cells[:2], strict=True):
                geo.mesh.setTransfiniteCurve(line, count + 1)
            base = geo.addPlaneSurface([geo.addCurveLoop(lines)])
            geo.mesh.setTransfiniteSurface(base)
            geo.mesh.setRecombine(2, base)
            (_, top), (_, volume), *sides = geo.extrude([(2, base)], 0, 0, size[2], [cells[2]], recombine=True)
            groups[3, name] = [volume]
            groups[2, f"{name}_low"], groups[2, f"{name}_top"] = [base], [top]
            for axis, (first, second) in (("y", (0, 2)), ("x", (1, 3))):
                groups[2, f"{name}_{axis}"] = [sides[first][1], sides[second][1]]
        geo.synchronize()
        for (dim, name), tags in groups.items():
            gmsh.model.setPhysicalName(dim, gmsh.model.addPhysicalGroup(dim, tags), name)
        gmsh.model.mesh.generate(3)
        tags, places, _ = gmsh.model.mesh.getNodes()
        for tag, (x, y, z) in zip(
            tags, places.reshape(-1, 3), strict=True
        ):  # drawn apart, so that none is common: 0.001 are left
            apart = 0.499 * (z < 5.0)
            gmsh.model.mesh.setNode(tag, [x - apart * (x > 2.25), y - apart * (y > 2.25), z - 7.0 * (z > 5.0)], [])

    mesh = read_gmsh(draw)
    names = [name for name in mesh.volumes if name != "lid"]
    scene = Scene(*(Body(mesh, name, RUBBER) for name in mesh.volumes))
    for name in mesh.volumes:
        for axis in "xy":
            scene.fix(f"{name}_{axis}", axis)
    for name in names:
        scene.fix(f"{name}_low", "z")
    scene.fix("lid_top", "z")
    scene.contact("lid_low", tuple(f"{name}_top" for name in names), 0.3, name="top", penetration=1e-6)
    result = solve(scene, stages=[Stage("press", prescribe={("lid_top", "z"): -0.2}, steps=2)]).require()
    low, high = pressures(result)
    assert high / low - 1.0 < 0.02
    np.testing.assert_allclose([low, high], exact(), rtol=0.01)
