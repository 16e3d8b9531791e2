"""A catalogue of scenes that must fail, each for a reason of its own: the verdict names it, its place and the remedy."""

import json
import subprocess
import sys
from pathlib import Path

import gmsh
import numpy as np
import pytest
from drawn import quadrilateral, ring
from mpi4py import MPI
from petsc4py import PETSc
from test_damping import stumbling

from fenics_contact import (
    ArcSteps,
    Body,
    Displacement,
    Method,
    Motion,
    Penalty,
    Scene,
    SceneError,
    Stage,
    from_elastic,
    mooney_rivlin,
    neo_hooke,
    read_gmsh,
    rigid_cylinder,
    rigid_hub,
    rigid_plane,
    rigid_sphere,
    solve,
)
from fenics_contact.assembly.finding import CYCLING
from fenics_contact.meshes import box, dome, rectangles, rod, two_blocks
from fenics_contact.solvers import diagnosis
from fenics_contact.solvers.diagnosis import diagnose
from fenics_contact.solvers.holding import MOSTLY, sliding
from fenics_contact.solvers.overdrawn import overdrawn
from fenics_contact.solvers.softness import fold_ahead, moved_instead
from fenics_contact.solvers.verdict import StepFailed, Verdict
from fenics_contact.studies.punch import punched_plate

COMM = MPI.COMM_WORLD
HELD = Method(stabilise=True)
RUBBER = mooney_rivlin(a1=0.1863, a2=0.0098, K=5.0)
TIPPING = {"lower_origin": (0, 0, -2), "upper": (4, 5, 3), "upper_origin": (1.5, 1, 0)}
CRUSHING = 0.6 * 0.4 ** (2 / 3)  # largest dead pressure over K on a cube: (1 - J) J^(2/3) is greatest at J = 0.4


def cube(cells=(2, 2, 2), size=(2.0, 2.0, 2.0), origin=(0.0, 0.0, 0.0), material=RUBBER):
    return Scene(Body(read_gmsh(box.build, size=size, cells=cells, origin=origin), "box", material))


def crushed():
    """Dead pressure 0.4 K on a cube of stiff shear: at CRUSHING it caves in."""
    scene = cube(material=neo_hooke(5.0, 5.0))
    for i, axis in enumerate("xyz"):
        scene.fix(f"{axis}min", axis)
        scene.traction(f"{axis}max", -2.0 * np.eye(3)[i])
    return scene, {}


def squeezed_through():
    """The top of a block is led through its bottom."""
    scene = cube(size=(10.0, 10.0, 10.0))
    scene.fix("zmin")
    scene.fix("zmax", "xy")
    scene.prescribe("zmax", "z", -12.0)
    return scene, {}


def squeezed_pad():
    """Between plates that hold it a pad loses three quarters of its height: cells at its corners are crushed."""
    mesh = read_gmsh(rectangles.build, rectangles={"pad": ((0.0, 0.0), (20.0, 10.0), (16, 8))})
    scene = Scene(Body(mesh, "pad", neo_hooke(0.5, 10.0)), plane="strain")
    scene.fix("pad_ymin")
    scene.fix("pad_ymax", "x")
    scene.prescribe("pad_ymax", "y", -9.0)
    return scene, {"steps": 9}


def hanging():
    """A block pulled down by a force, 1 mm above the rough floor that is to hold it."""
    scene = cube(origin=(0.0, 0.0, 1.0))
    scene.contact("zmin", rigid_plane(), 0.3)
    scene.traction("zmax", (0, 0, -0.1))
    return scene, {}


def holding_each_other(floor=True):
    """Two blocks, each in contact with nothing but the other; the floor that is to hold them is 2 mm away, if any."""
    mesh = read_gmsh(two_blocks.build, lower_cells=(4, 4, 1), upper_cells=(3, 3, 1))
    scene = Scene(Body(mesh, "lower", RUBBER), Body(mesh, "upper", RUBBER))
    scene.contact("upper_bottom", "lower_top", 0.3)
    if floor:
        scene.contact("lower_bottom", rigid_plane((0, 0, -12.0)), 0.3)
    scene.traction("upper_top", (0, 0, -0.1))
    return scene, {}


def on_ice():
    """A block that its support holds along z only, and a rough wall 1 mm away is to hold sideways."""
    scene = cube()
    scene.fix("zmin", "z")
    scene.contact("xmin", rigid_plane((-1.0, 0, 0), (1.0, 0, 0)), 0.3)
    scene.traction("xmax", (-0.1, 0, 0))
    return scene, {}


def tool_in_the_air():
    scene = cube()
    scene.fix("zmin")
    ball = rigid_sphere(1.0, (1.0, 1.0, 4.0), name="ball")
    scene.contact("zmax", ball)
    return scene, {"push": {ball: (0, 0, -1.0)}}


def drawn_off(drive="push", end=1.0, stabilise=True):
    """A ball pressed into a block by a force that turns round, is zero at t = 0.5 and then draws, or does not get there."""
    scene = cube(cells=(4, 4, 2), size=(4.0, 4.0, 2.0), origin=(-2.0, -2.0, -2.0))
    scene.fix("zmin")
    ball = rigid_sphere(2.0, (0, 0, 2.0), name="ball")
    scene.contact("zmax", ball, name="c")

    def path(t):
        return 0, 0, -2.0 * min(t, 0.25) + 2.0 * end * max(t - 0.25, 0.0)

    return scene, {drive: {ball: path}, "method": Method(smallest_step=0.05, stabilise=stabilise)}


def on_one_ball(held=False):
    """A beam that lies on one ball beside its middle; or one whose end is held."""
    scene = cube(cells=(8, 2, 2), size=(8.0, 2.0, 1.0), origin=(0.0, -1.0, 0.0))
    scene.contact("zmin", rigid_sphere(1.5, (5.0, 0, -1.5), name="ball"), 0.3, name="c")
    scene.body_force((0, 0, -0.002))
    if held:
        scene.fix("xmin", "z")
    return scene, {}


def tower(lean, cells=3):
    """Three bars on one another under their weight, each farther over the end of the one below by `lean`."""
    bars = {f"b{i}": ((lean * i, 2.0 * i), (4.0, 2.0), (cells + i % 2, 2)) for i in range(3)}
    mesh = read_gmsh(rectangles.build, rectangles=bars)
    scene = Scene(*[Body(mesh, name, neo_hooke(mu=1.0, K=4.0)) for name in bars], plane="strain")
    scene.fix("b0_ymin")
    for i in range(2):
        scene.contact(f"b{i}_ymax", f"b{i + 1}_ymin", 0.4, name=f"c{i}")
    scene.body_force((0, -0.02, 0))
    return scene, {"steps": 4, "method": Method(smallest_step=1e-3)}


def pressed(penalty):
    scene = cube()
    scene.fix("zmax", "xy")
    scene.prescribe("zmax", "z", -0.2)
    scene.contact("zmin", rigid_plane(), 0.3, penalty=penalty, name="floor")
    return scene, {}


def ball_through(cells=(6, 6, 2), penalty=0.05):
    """A penalty so soft that the ball sinks in to its middle before it is held: on high cells not deep by their size."""
    scene = cube(cells=cells, size=(10.0, 10.0, 4.0), origin=(-5.0, -5.0, -4.0))
    scene.fix("zmin")
    ball = rigid_sphere(3.0, (0, 0, 3.0))
    scene.contact("zmax", ball, penalty=penalty, name="ball")
    return scene, {"push": {ball: (0, 0, -8.0)}}


def block_through(penalty=0.05):
    """A block pressed by a dead load into the one it lies on, which hardly holds it: before it is through it topples."""
    mesh = read_gmsh(two_blocks.build, lower=(8, 7, 2), lower_cells=(6, 5, 2), upper_cells=(3, 4, 2), **TIPPING)
    scene = Scene(Body(mesh, "lower", RUBBER), Body(mesh, "upper", RUBBER))
    scene.fix("lower_bottom")
    scene.contact("upper_bottom", "lower_top", 0.3, penalty=penalty, name="joint")
    scene.traction("upper_top", (0, 0, -0.3))
    return scene, {"method": HELD}


def over_the_edge():
    """A block under a press of given force is dragged over the end of the one it lies on."""
    lower = {"lower": (40, 10, 4), "lower_cells": (10, 3, 1), "lower_origin": (0, 0, -4)}
    mesh = read_gmsh(two_blocks.build, **lower, upper=(10, 8, 5), upper_cells=(3, 3, 1), upper_origin=(25, 1, 0))
    scene = Scene(Body(mesh, "lower", RUBBER), Body(mesh, "upper", RUBBER))
    scene.fix("lower_bottom")
    scene.fix("upper_top", "y")
    scene.prescribe("upper_top", "x", 20.0)
    scene.contact("upper_bottom", "lower_top", name="c")
    press = rigid_plane((0, 0, 5.0), (0, 0, -1.0), name="press")
    scene.contact("upper_top", press, name="top")
    return scene, {"push": {press: lambda t: (0, 0, -4.0 * min(5.0 * t, 1.0))}, "method": Method(smallest_step=1e-3)}


def driven_roller():
    """A roller on a strip turned by a moment, its way left free: nothing but the strip's few nodes keeps it from rolling."""
    mesh = read_gmsh(rectangles.build, rectangles={"strip": ((0, 0), (20, 3), (20, 2))})
    scene = Scene(Body(mesh, "strip", neo_hooke(mu=1.0, K=5.0)), plane="strain")
    scene.fix("strip_ymin")
    roller = rigid_cylinder(3.0, point=(6, 6, 0), axis=(0, 0, 1), name="roller")
    scene.contact("strip_ymax", roller, friction=1.0, name="c")
    driven = Motion(force=(0, -2, 0), moment=(0, 0, -3), free="x")
    stages = [Stage("press", move={roller: (0, -0.3, 0)}, steps=1), Stage("roll", move={roller: driven}, steps=20)]
    return scene, {"steps": None, "stages": stages, "method": Method(smallest_step=0.01)}


def no_room():
    scene = cube(cells=(10, 10, 10))
    scene.fix("zmin")
    scene.prescribe("zmax", "z", -0.2)
    return scene, {"method": Method(linear="direct")}


def tall_block():
    """A tall block dragged over a rough floor in steps too long for Newton's method, which turns elements inside out."""
    return dragged(size=(0.8, 1.0, 5.0), cells=(3, 2, 8), friction=0.8, press=0.8, drag=6.0, steps=6)


def dragged(size, cells, friction, press, drag, steps):
    """A block pressed on a rough floor until t = 0.2 and then dragged by its top."""
    scene = cube(cells=cells, size=size)
    scene.prescribe("zmax", "z", lambda X, t: np.full(len(X), -press * min(t / 0.2, 1.0)))
    scene.prescribe("zmax", "x", lambda X, t: np.full(len(X), drag * max(t - 0.2, 0.0)))
    scene.fix("zmax", "y")
    scene.contact("zmin", rigid_plane(), friction, name="floor")
    return scene, {"steps": steps}


def dragged_by_force(friction=0.3, drive="force"):
    """A block on a rough floor, pushed by 101 % of what friction holds at 0.3; or drawn by its top as far as it likes."""
    scene = cube(cells=(3, 3, 2), size=(4.0, 4.0, 2.0))
    scene.traction("zmax", lambda t: (0, 0, -0.1 * min(2 * t, 1)))
    scene.contact("zmin", rigid_plane(), friction, name="floor")
    if drive == "force":
        scene.body_force(lambda t: (1.01 * 0.3 * 0.1 / 2.0 * max(2 * t - 1, 0), 0, 0))
    else:
        scene.prescribe("xmax", "x", lambda X, t: np.full(len(X), 0.5 * max(2 * t - 1, 0)))
    return scene, {}


def dragged_by_a_hub(friction=0.3, drive="force"):
    """The same block, tied to a hub by its top, which pushes it or is moved."""
    rubber, hub = neo_hooke(2.0, K=10.0), rigid_hub("hub", (2, 2, 2))
    scene = cube(cells=(3, 3, 2), size=(4.0, 4.0, 2.0), material=rubber)
    scene.contact("zmin", rigid_plane(), friction, name="floor")
    scene.tie("zmax", hub)
    push = lambda t: 1.01 * 0.3 * 1.6 * max(2 * t - 1, 0) if drive == "force" else 0.0  # noqa: E731
    x = None if drive == "force" else lambda t: 0.5 * max(2 * t - 1, 0)
    return scene, {"move": {hub: Motion(x=x, force=lambda t: (push(t), 0, -1.6 * min(2 * t, 1)))}}


def clutch(over=1.1, drive="moment", **options):
    """A disc pressed on a rough floor, then turned about its axis, on which nothing slips, by so much of what friction can
    hold, or as far as it likes. Without Poisson's ratio the pressure is the same everywhere: 2/3 mu F R."""
    mesh = read_gmsh(rod.build, radius=10.0, height=4.0, cells=2, layers=1)
    scene = Scene(Body(mesh, "rod", from_elastic(10.0, 0.0)))
    scene.contact("bottom", rigid_plane(name="floor"), 0.3, name="c")
    scene.tie("top", hub := rigid_hub("hub", (0, 0, 4)))
    later = lambda t: max(2 * t - 1, 0)  # noqa: E731
    turned = {"moment": lambda t: (0, 0, over * 40.0 * later(t))} if drive == "moment" else {"rz": lambda t: 0.2 * later(t)}
    way = Motion(force=lambda t: (0, 0, -20.0 * min(2 * t, 1)), free="z rz" if drive == "moment" else "z", **turned)
    return scene, {"move": {hub: way}, "steps": 10, "method": Method(smallest_step=1e-3), **options}


def clutch_of_blocks():
    """A block pressed on another one by a hub and turned by it about the node in the middle of its sole."""
    upper = {"upper": (4, 4, 2), "upper_cells": (4, 4, 1), "upper_origin": (2, 2, 0)}
    mesh = read_gmsh(two_blocks.build, lower=(8, 8, 2), lower_cells=(5, 5, 1), lower_origin=(0, 0, -2), **upper)
    scene = Scene(Body(mesh, "lower", from_elastic(10.0, 0.3)), Body(mesh, "upper", from_elastic(10.0, 0.3)))
    scene.fix("lower_bottom")
    scene.contact("upper_bottom", "lower_top", 0.3, name="c")
    scene.tie("upper_top", hub := rigid_hub("hub", (4, 4, 2)))
    load = lambda t: (0, 0, -8.0 * min(2 * t, 1))  # noqa: E731
    way = Motion(force=load, moment=lambda t: (0, 0, 5.0 * max(2 * t - 1, 0)), free="z rz")
    return scene, {"move": {hub: way}, "steps": 10, "method": Method(smallest_step=1e-3)}


def tipping(drive="force"):
    """A block pressed on another one by a dead load, then pushed aside at its top until it tips: with the node that lifts
    last goes all that holds it, or drawn aside."""
    mesh = read_gmsh(two_blocks.build, lower=(8, 7, 2), lower_cells=(6, 5, 3), upper_cells=(3, 4, 2), **TIPPING)
    scene = Scene(Body(mesh, "lower", neo_hooke(0.86, 1.8)), Body(mesh, "upper", neo_hooke(0.86, 1.8)))
    scene.fix("lower_bottom")
    scene.contact("upper_bottom", "lower_top", 0.5, name="joint")
    scene.traction("upper_top", lambda t: (0, 0, -0.37 * min(2 * t, 1)))
    if drive == "force":
        scene.traction("upper_top", lambda t: (-0.15 * max(2 * t - 1, 0), 0, 0))
    else:
        scene.prescribe("upper_top", "x", lambda X, t: np.full(len(X), -1.3 * max(2 * t - 1, 0)))
    return scene, {"steps": 8, "method": HELD}


def wedge():
    """Between y = 0 and a slope of 20 degrees that meet at x = 20, which narrows from x = 0 to 12."""
    slope = np.tan(np.radians(20.0))
    corners = [(0, 0), (12, 0), (12, 8 * slope), (0, 20 * slope)]
    quadrilateral("wedge", corners, (8, 4), ("floor", "tip", "slope", "back"))


def drawn_wedge(drive="forces", penalty=None, **options):
    """A wedge that is pushed in, let go, which friction holds, and drawn out, to which that resists by a fifteenth of the
    push and ever less once it slides."""
    scene = Scene(Body(read_gmsh(wedge), "wedge", from_elastic(100.0, 0.3)), plane="strain")
    angle = np.radians(20.0)
    top = rigid_plane((20, 0, 0), (-np.sin(angle), -np.cos(angle), 0), name="top")
    scene.contact("floor", rigid_plane((0, 0, 0), (0, 1, 0), name="bottom"), 0.3, name="f", penalty=penalty)
    scene.contact("slope", top, 0.3, name="s", penalty=penalty)
    if drive == "forces":
        scene.force("back", (0, 0, 0))
        ways = {"in": {"back": (60.0, 0, 0)}, "let go": {"back": (0, 0, 0)}, "out": {"back": (-5.0, 0, 0)}}
    else:
        scene.fix("back", "x")
        ways = {"in": {("back", "x"): 0.3}, "out": {("back", "x"): -0.4}}
    return scene, {"stages": [Stage(name, **{drive: way}) for name, way in ways.items()], "steps": 6, **options}


def between_plates():
    """A block between a rough floor and a rough lid that is drawn over it: nothing but the friction of both holds it."""
    scene = cube(cells=(3, 3, 2), size=(4.0, 4.0, 2.0))
    scene.contact("zmin", rigid_plane(), 0.3, name="floor")
    lid = rigid_plane((0, 0, 2.0), (0, 0, -1.0), name="lid")
    scene.contact("zmax", lid, 0.3, name="top")
    return scene, {"move": {lid: lambda t: (2.0 * max(t - 0.2, 0.0), 0, -0.5 * min(t, 0.2))}}


def on_a_node(points="nodes", smallest=0.05):
    """A ball pushed down and a little aside, on a surface that it touches at one node alone."""
    scene = cube(cells=(4, 4, 2), size=(4.0, 4.0, 2.0), origin=(-2.0, -2.0, -2.0))
    scene.fix("zmin")
    ball = rigid_sphere(0.75, (0, 0, 0.75), name="ball")
    scene.contact("zmax", ball, points=points, name="c")
    return scene, {"push": {ball: (0.003, 0, -0.03)}, "method": Method(smallest_step=smallest, stabilise=True)}


def on_an_incline(friction=0.3):
    """A block that its weight presses on a plane, and pulls along it half as much, from the first step on."""
    scene = cube()
    scene.contact("zmin", rigid_plane(name="slope"), friction, name="c")
    scene.body_force(lambda t: (0.01 * t, 0.0, -0.02 * t))
    return scene, {"method": HELD}


def on_a_steep_slope(**options):
    """As on_an_incline, in the plane, from the first step on: its tangent is singular, and nothing presses before it."""
    mesh = read_gmsh(rectangles.build, rectangles={"box": ((0.0, 0.0), (10.0, 5.0), (16, 8))})
    scene = Scene(Body(mesh, "box", neo_hooke(1.0, 5.0)), plane="strain")
    scene.contact("box_ymin", rigid_plane(normal=(0, 1, 0), name="slope"), 0.5, name="c")
    scene.body_force((0.0094, -0.0177, 0.0))
    return scene, options


def on_rough_ground(push, twist):
    """A block of 2 by 2 on a plane, pressed on it by 0.2, pushed aside and twisted, all at once; friction is 0.3."""
    scene = cube(cells=(4, 4, 2), material=neo_hooke(1.0, 5.0))
    scene.contact("zmin", rigid_plane(), 0.3, name="c")
    scene.force("zmax", (push, 0.0, -0.2))
    scene.moment("zmax", (0.0, 0.0, twist))
    return scene


def two_in_one_group():
    """Two blocks that nothing joins, as one volume group."""
    two_blocks.build(lower_cells=(4, 4, 1), upper_cells=(3, 3, 1), upper_origin=(5.0, 10.0, 1.0))
    gmsh.model.removePhysicalGroups(gmsh.model.getPhysicalGroups(3))
    volumes = [tag for _, tag in gmsh.model.getEntities(3)]
    gmsh.model.setPhysicalName(3, gmsh.model.addPhysicalGroup(3, volumes), "box")


def loose_half():
    """The lower half of a body is fixed, the upper one, not joined to it, hangs 1 mm above."""
    scene = Scene(Body(read_gmsh(two_in_one_group), "box", RUBBER))
    scene.fix("lower_bottom")
    scene.contact("upper_bottom", "lower_top", 0.3, name="c")
    scene.traction("upper_top", (0, 0, -0.1))
    return scene, {}


def pushed_through(drive="push", smallest=5e-3):
    """A ball pushed onto a dome by more than the dome can bear, or moved so far."""
    mesh = read_gmsh(dome.build, thickness=1.0, boss=5.0, cells=2)
    scene = Scene(Body(mesh, "dome", RUBBER), degree=2)
    scene.fix("symmetry_x", "x")
    scene.fix("symmetry_y", "y")
    scene.fix("rim")
    ball = rigid_sphere(8.0, (0, 0, 48.5), name="ball")
    scene.contact("outer", ball, 0.3, name="top")
    way = {"push": -2.0, "move": -16.0}[drive]
    return scene, {drive: {ball: (0, 0, way)}, "steps": 10, "method": Method(smallest_step=smallest)}


def snapping():
    """Nodes of a coarse mesh snap over a punch's fillet: a kink that no step is short enough for. It is no fold, although
    the softest motion there has little stiffness, and less than none."""
    scene, tool = punched_plate(4, 0.0, 1.0, points=3)
    return scene, {"move": {tool: (0, 0, -2.0)}, "method": Method(smallest_step=2e-3)}


def arch_let_go(damping=False):
    """Half a clamped arch that a tool presses through: it lets go of the tool and snaps away, for no force holds it back."""
    mesh = read_gmsh(rectangles.build, rectangles={"arch": ((0.0, 0.0), (20.0, 0.3), (10, 1))})
    x = mesh.domain.geometry.x
    x[:, 1] += 8.0 * np.cos(np.pi * x[:, 0] / 40.0)
    scene = Scene(Body(mesh, "arch", from_elastic(10.0, 0.3)), degree=2, plane="strain")
    scene.fix("arch_xmin", "x")
    scene.fix("arch_xmax")
    tool = rigid_cylinder(3.0, point=(0, 11.3, 0), axis=(0, 0, 1), name="tool")
    scene.contact("arch_ymax", tool, name="c")
    method = Method(damping=damping, smallest_step=None if damping else 1e-4)
    return scene, {"move": {tool: (0, -12, 0)}, "steps": 24, "method": method}


CATALOGUE = {
    "limit point": (crushed, "limit point", "body 'box'", "arc length"),
    "inverted": (squeezed_through, "element inverted", "body 'box' at (", "mesh the place more finely"),
    "pad": (squeezed_pad, "element inverted", "body 'pad' at (", "end the path before"),
    "gap": (hanging, "rigid-body motion", "body 'box'", "close the gap of contact 'zmin on plane', which is open"),
    "pair": (holding_each_other, "rigid-body motion", "body 'lower, upper'", "contact 'lower_bottom on plane'"),
    "ice": (on_ice, "rigid-body motion", "body 'box'", "stabilise=True"),
    "tool": (tool_in_the_air, "rigid-body motion", "tool 'ball'", "bring it into contact before the force acts, or solve"),
    "drawn off": (
        drawn_off,
        "rigid-body motion",
        "tool 'ball'",
        "end the path where the force vanishes, or move the tool away",
    ),
    "drawn off unheld": (lambda: drawn_off(stabilise=False), "rigid-body motion", "tool 'ball'", "or move the tool away"),
    "toppling": (on_one_ball, "rigid-body motion", "body 'box'", "fix a surface or use a symmetry plane"),
    "tower": (lambda: tower(1.0), "rigid-body motion", "bodies 'b1, b2'", "support them by another contact"),
    "tower at once": (lambda: tower(1.1), "rigid-body motion", "b2'", "by another contact"),
    "tower that slips as it tips": (lambda: tower(0.9, 5), "rigid-body motion", "b2'", "by another contact"),
    "stiff": (lambda: pressed(1e15), "penalty too stiff", "contact 'floor' at (", "lower penalty="),
    "soft": (ball_through, "penalty too soft", "contact 'ball' at (", "raise penalty="),
    "soft on high cells": (
        lambda: ball_through((4, 4, 1), 0.2),
        "penalty too soft",
        "contact 'ball' at (",
        "raise penalty=",
    ),
    "soft by thirty": (lambda: ball_through(penalty=2.0), "penalty too soft", "contact 'ball' at (", "raise penalty="),
    "soft under a block": (block_through, "penalty too soft", "contact 'joint' at (", "raise penalty="),
    "long steps": (
        lambda: stumbling(0.1, friction=0.6, press=0.3, drag=6.0),
        "no convergence",
        "most at (",
        "take more steps, or allow shorter ones (Method(smallest_step=...))",
    ),
    "too great a push": (
        dragged_by_force,
        "friction used up",
        "contact 'floor'",
        "raise friction=, fix a surface, or prescribe",
    ),
    "too great a push on a hub": (
        dragged_by_a_hub,
        "friction used up",
        "contact 'floor'",
        "raise friction=, fix a surface, or prescribe",
    ),
    "clutch": (clutch, "friction used up", "contact 'c'", "or prescribe this motion"),
    "clutch of blocks": (clutch_of_blocks, "friction used up", "contact 'c'", "or prescribe this motion"),
    "on an incline": (on_an_incline, "friction used up", "contact 'c'", "raise friction="),
    "on a steep slope": (on_a_steep_slope, "friction used up", "contact 'c'", "raise friction="),
    "pushed and twisted": (
        lambda: (on_rough_ground(0.05, 0.03), {"steps": 1}),
        "friction used up",
        "contact 'c'",
        "raise friction=",
    ),
    "wedge on springs": (
        lambda: drawn_wedge(method=HELD),
        "friction used up",
        "contact 'f', contact 's'",
        "raise friction=",
    ),
    "wedge on springs in short steps": (
        lambda: drawn_wedge(steps=20, method=HELD),
        "friction used up",
        "contact 'f', contact 's'",
        "raise friction=",
    ),
    "soft wedge": (
        lambda: drawn_wedge(penalty=Penalty(share=0.02)),
        "friction used up",
        "contact 'f', contact 's'",
        "raise friction=",
    ),
    "seen to slide": (lambda: on_a_steep_slope(method=HELD), "friction used up", "contact 'c'", "raise friction="),
    "on a node": (on_a_node, "rigid-body motion", "contact 'c'", "take more of them, points=3 (Gauss points), or mesh"),
    "pushed over a limit": (pushed_through, "limit point", "tool 'ball', body 'dome' at (", "or move tool 'ball' instead"),
    "driven roller": (driven_roller, "limit point", "tool 'roller'", "move tool 'roller' instead of pushing or"),
    "tipping": (tipping, "limit point", "body 'upper' at (", "prescribe a displacement in place of the load"),
    "arch": (arch_let_go, "limit point", "contact 'c'", "let damping carry it on: solve(..., method=Method(damping=True))"),
    "loose half": (loose_half, "rigid-body motion", "body 'box", "stabilise=True"),
    "edge": (over_the_edge, "projection lost", "contact 'c' at (", "larger where the slave leaves"),
    "cycling": (
        lambda: stumbling(0.1, friction=0.25, press=0.4, drag=10.0),
        "status cycling",
        "contact 'floor' at (1.5, 0.5, 0)",
        "take more steps",
    ),
}


def failed(name, **options):
    scene, more = CATALOGUE[name][0]()
    result = solve(scene, **{"steps": 5} | more | options)
    assert not result.converged
    assert len(set(COMM.allgather(result.verdict.reason))) == 1  # all ranks say the same
    return result


SLOW = {"wedge on springs in short steps"}


@pytest.mark.parallel
@pytest.mark.parametrize("name", [pytest.param(name, marks=[pytest.mark.slow] * (name in SLOW)) for name in CATALOGUE])
def test_verdict_names_cause_place_and_remedy(name):
    _, kind, place, remedy = CATALOGUE[name]
    verdict = failed(name).verdict
    assert (verdict.kind, verdict.step > 0) == (kind, True), verdict.reason
    assert place in verdict.place and remedy in verdict.remedy, verdict.reason
    for part in (verdict.kind, verdict.place, verdict.remedy, f"step {verdict.step}"):
        assert part in verdict.reason


def test_what_a_run_has_is_no_remedy():
    """Of a body that may snap past the end of another one."""
    result = failed("edge", method=Method(smallest_step=0.1))
    system, goal = result.system, result.verdict.t + 0.1
    for system.damped in (False, True):
        remedy = diagnose(system, StepFailed("left"), goal).remedy
        assert "larger where the slave leaves" in remedy and ("damping" in remedy) != system.damped


def with_options(scene, **options):
    """A failing scene of the catalogue with other options of solve."""
    stated, drive = scene()
    return stated, drive | options


# what the verdict advises, done
CURES = {
    "limit point": [lambda: with_options(crushed, steps=ArcSteps(until=Displacement("zmax", "z", -1.0), first=0.2))],
    "gap": [lambda: with_options(hanging, method=HELD)],
    "ice": [lambda: with_options(on_ice, method=HELD)],
    "tool": [lambda: with_options(tool_in_the_air, method=HELD)],
    "toppling": [lambda: on_one_ball(held=True)],
    "drawn off": [lambda: drawn_off(end=0.3), lambda: drawn_off("move", stabilise=False)],
    "stiff": [lambda: pressed(None)],
    "soft": [lambda: ball_through(penalty=None)],
    "soft on high cells": [lambda: ball_through((4, 4, 1), penalty=None)],
    "soft under a block": [lambda: block_through(penalty=None)],
    "long steps": [lambda: stumbling(None, friction=0.6, press=0.3, drag=6.0)],
    "too great a push": [lambda: dragged_by_force(friction=0.31), lambda: dragged_by_force(drive="prescribe")],
    "too great a push on a hub": [lambda: dragged_by_a_hub(friction=0.31), lambda: dragged_by_a_hub(drive="move")],
    "clutch": [lambda: clutch(drive="turn")],
    "loose half": [lambda: with_options(loose_half, method=HELD)],
    "wedge on springs": [lambda: drawn_wedge("prescribe")],
    "on an incline": [lambda: on_an_incline(0.6)],
    "on a node": [lambda: on_a_node(3, None)],
    "pushed over a limit": [lambda: pushed_through("move")],
    "tipping": [lambda: tipping("prescribe")],
    "arch": [lambda: arch_let_go(damping=True)],
}


@pytest.mark.parallel
@pytest.mark.parametrize("name", CURES)
def test_remedy_cures(name):
    for cure in CURES[name]:
        scene, options = cure()
        result = solve(scene, **{"steps": 5} | options)
        assert result.converged, result.verdict.reason
        assert not any("snap" in note for note in result.verdict.notes)


@pytest.mark.parallel
def test_only_what_is_pushed_is_to_be_moved_instead():
    """A hub that is free to turn, and that nothing turns, is not pushed."""
    scene = cube()
    scene.fix("xmin")
    hub, ball = rigid_hub("hub", (2, 1, 1)), rigid_sphere(2.0, (1, 1, 4), name="ball")
    scene.tie("xmax", hub)
    scene.contact("zmax", ball, name="c")
    system = solve(scene, move={hub: Motion(free="ry")}, push={ball: (0, 0, -0.05)}, steps=1).require().system
    assert moved_instead(system) == ["move tool 'ball' instead of pushing"]


@pytest.mark.parallel
def test_limit_point_is_reached_before_it_is_reported():
    result = failed("limit point")
    # the run stops within two of its smallest steps of the closed form, in units of the pressure reached at t = 1
    assert 0.0 < 5.0 * CRUSHING / 2.0 - result.verdict.t < 3 * result.verdict.smallest


@pytest.mark.parallel
def test_a_fold_is_foreseen_where_it_is():
    """From the last step and the rate at its end, against the closed form; what comes
    after the square root is smaller by the square root of the share of the load that is left."""
    system = failed("limit point").system
    left = 5.0 * CRUSHING / 2.0 - system.state.t
    np.testing.assert_allclose(fold_ahead(system), left, rtol=3 * np.sqrt(left))


@pytest.mark.parallel
def test_a_soft_motion_is_no_limit_point():
    scene, drive = snapping()
    result = solve(scene, steps=5, **drive)
    assert not result.converged and result.verdict.kind == "no convergence", result.verdict.reason


@pytest.mark.parallel
def test_only_what_is_free_is_named():
    reason = failed("ice").verdict.reason
    for axis, free, held in (("x", "moves", "turns"), ("y", "moves", "turns"), ("z", "turns", "moves")):
        place = {"moves": f"moves along {axis}", "turns": f"turns about {axis}"}
        assert place[free] in reason and place[held] not in reason


@pytest.mark.parallel
def test_what_topples_is_not_to_be_stabilised():
    verdict = failed("toppling").verdict
    assert "turns about y" in verdict.reason and "stabilise" not in verdict.reason


@pytest.mark.parallel
def test_what_slides_along_a_tool_is_not_pushed_beyond_balance():
    """No load does work on the block: it has an answer with the friction stated, once damping lets it slide."""
    scene, drive = between_plates()
    system = solve(scene, steps=10, **drive).require().system
    found = sliding(system)
    assert found.kind == "friction used up" and "no load pushes it" in found.reason and "damping=True" in found.remedy
    assert found.place == "contact 'floor', contact 'top'"
    pushed = sliding(failed("too great a push").system)
    assert "a greater push has no balance" in pushed.reason and "raise friction=" in pushed.remedy


def draw_rollers():
    ring("low", -10.005, (6.0, 10.0), (1, 8), ("low_in", "low_out"))
    ring("up", 15.005, (9.0, 15.0), (1, 8), ("up_in", "up_out"))


@pytest.mark.parallel
def test_a_body_on_a_hub_that_stands_is_not_said_to_be_held_by_friction_alone():
    """The lower roller is soft beside endless friction, and held: what slides is the upper one with its hub, which a moment
    turns."""
    mesh = read_gmsh(draw_rollers)
    scene = Scene(Body(mesh, "low", neo_hooke(1.0, 10.0)), Body(mesh, "up", neo_hooke(2.0, 20.0)), plane="strain")
    low, up = rigid_hub("A", (0, -10.005, 0)), rigid_hub("B", (0, 15.005, 0))
    scene.tie("low_in", low)
    scene.tie("up_in", up)
    scene.contact("low_out", "up_out", 0.3, name="nip")
    turned = Stage("turn", move={low: Motion(rz=0.0), up: Motion(moment=(0, 0, 40.0))}, steps=2)
    pressed = Stage("press", move={up: (0, -0.8, 0)}, steps=2)
    verdict = solve(scene, stages=[pressed, turned], method=Method(smallest_step=0.02)).verdict
    assert verdict.kind == "friction used up" and "holds body 'up', tool 'B'," in verdict.reason, verdict.reason


def spun_tyre(travel, moment):
    """A soft tyre on a hub, pressed on a rough road by 4, led along it, and turned by a moment or, without one, as told."""
    mesh = read_gmsh(ring, name="tyre", middle=0.0, radii=(4.0, 8.0), cells=(3, 12), sides=("rim", "tread"))
    scene, hub = Scene(Body(mesh, "tyre", neo_hooke(1.0, 5.0)), plane="strain"), rigid_hub("hub")
    scene.tie("rim", hub)
    scene.contact("tread", rigid_plane((0, -8.01, 0), (0, 1, 0), name="road"), 0.4, name="c")
    load = {"force": (0, -4.0, 0)}
    spin = {"moment": (0, 0, moment), "free": "rz"} if moment else {"rz": -2.0}
    stages = [Stage("meet", move={hub: Motion(y=-0.2)}, steps=1), Stage("press", move={hub: Motion(**load)}, steps=2)]
    return scene, {"stages": [*stages, Stage("spin", move={hub: Motion(x=travel, **load, **spin)}, steps=12)]}


@pytest.mark.parallel
@pytest.mark.parametrize("travel", [6.0, 0.0, 0.5])
def test_a_soft_tyre_spins_where_friction_is_used_up(travel):
    """Turned as a rigid body it would press its flat into the road, so that more than friction seemed to hold it; it was a
    "limit point", or with a point that sticks "status cycling", though the road pulls with mu N."""
    scene, drive = spun_tyre(travel, -20.0)
    result = solve(scene, **drive)
    np.testing.assert_allclose(result.column("c_friction_x_N")[-1], 0.4 * 4.0, rtol=1e-4)
    verdict = result.verdict
    assert verdict.kind == "friction used up" and "holds body 'tyre', tool 'hub', and" in verdict.reason, verdict.reason
    assert "T / (mu N) = 1;" in verdict.reason and "prescribe this motion" in verdict.remedy


@pytest.mark.parallel
def test_a_tyre_that_spins_as_prescribed_asks_for_the_moment_at_which_friction_was_used_up():
    """The remedy cures; the moment changes by what cells of 7.5 degrees make of a round tread, and the steps miss its peak
    by a part of that. Below it nothing is said."""
    scene, drive = spun_tyre(0.0, -20.0)
    most = -solve(scene, **drive).column("hub_moment_z_Nmm")[-1]
    scene, drive = spun_tyre(0.0, None)
    spun = solve(scene, **drive).require().column("hub_moment_z_Nmm")
    np.testing.assert_allclose(-spun.min(), most, rtol=0.01)
    scene, drive = spun_tyre(0.0, -0.95 * most)
    assert sliding(solve(scene, **drive).require().system) is None


@pytest.mark.parallel
def test_a_clutch_slips_at_its_largest_moment():
    """Although the middle of its sole does not slip: within a hundredth, which the mesh leaves of a circle."""
    verdict = failed("clutch").verdict
    np.testing.assert_allclose(1.1 * (2.0 * verdict.t - 1.0), 1.0, atol=0.01)
    scene, drive = clutch(over=0.95)
    assert sliding(solve(scene, **drive).require().system) is None


@pytest.mark.parallel
@pytest.mark.parametrize(
    ("push", "twist", "least", "most"), [(0.08, 0.0, 1.32, 1.34), (0.05, 0.03, 1.0, 1.49), (0.0, 0.08, 1.5, 1.75)]
)
def test_a_first_step_that_asks_too_much_of_friction(push, twist, least, most):
    """It was "no convergence", as no contact pressed in the state before, while the same in stages was known. Of a push T is
    the push, 4/3 of mu N; a twist asks for at most 1.743 times what an even pressure allows, mu N times the mean distance
    from the middle, 0.765, for at the edges the block presses more; both together for less than the sum."""
    found = overdrawn(on_rough_ground(push, twist).system(), 1e-3)
    assert found.kind == "friction used up"
    assert least < float(found.reason.split("T / (mu N) = ")[1].split(";")[0]) < most
    assert overdrawn(on_rough_ground(0.4 * push, 0.4 * twist).system(), 1e-3) is None


@pytest.mark.serial
@pytest.mark.parametrize("steps", [1, 3])
@pytest.mark.parametrize("push", [0.31, 0.5, 1.0, 3.0])
def test_a_lid_pushed_aside_by_more_than_friction_from_the_first_step_on(push, steps):
    """It lies on the block: whatever single nodes do as it goes, it is friction that does not hold it."""
    scene = Scene(Body(read_gmsh(box.build, size=(4, 4, 1), cells=(4, 4, 2)), "box", neo_hooke(0.5, 5.0)))
    scene.fix("zmin")
    lid = rigid_plane((0, 0, 1), normal=(0, 0, -1), name="lid")
    scene.contact("zmax", lid, 0.3, name="c")
    verdict = solve(scene, push={lid: (push, 0, -1.0)}, steps=steps).verdict
    assert verdict.kind == "friction used up" and "'lid'" in verdict.reason
    assert float(verdict.reason.split("T / (mu N) = ")[1].split(";")[0]) == pytest.approx(push / 0.3, rel=0.02)


@pytest.mark.parallel
def test_a_tool_that_turns_is_judged_by_the_forces_of_the_accepted_state(monkeypatch):
    """Not by those of the iterate that failed, of which the tangent of what is tied to it has the wrenches."""
    scene, drive = clutch(over=0.5)
    system = solve(scene, **drive).require().system
    corners = []

    def corner(of, *_):
        of.assemble_tangent()
        corners.append(of.border.corner.copy())

    corner(system)
    system.begin_step(1.0)
    system.update(system.new_vector(), np.where(system.tools.free, -0.05, 0.0))
    system.assemble_residual()
    monkeypatch.setattr(diagnosis, "sliding", corner)  # the first that asks for a tangent
    diagnose(system, StepFailed("left"), 1.0)
    np.testing.assert_allclose(corners[1], corners[0], atol=1e-9 * np.abs(corners[0]).max())


@pytest.mark.parallel
def test_friction_alone_holds_no_body_that_a_hub_leads():
    """Soft blocks between two hubs on their ways: endless friction would resist them far more than their own ends do."""
    mesh = read_gmsh(two_blocks.build, lower_cells=(6, 6, 2), upper_cells=(4, 4, 2))
    scene = Scene(*(Body(mesh, name, neo_hooke(mu=0.5, K=2.0)) for name in ("lower", "upper")))
    below, above = rigid_hub("below", (0, 0, 0)), rigid_hub("above", (0, 0, 2))
    scene.tie("lower_bottom", below)
    scene.tie("upper_top", above)
    scene.contact("upper_bottom", "lower_top", 0.1, name="c")
    way = lambda t: (6.0 * max(2.0 * t - 1.0, 0.0), 0.0, -1.0 * min(2.0 * t, 1.0))  # noqa: E731
    system = solve(scene, move={below: (0, 0, 0), above: way}, steps=6).require().system
    taken, most = system.comm.allreduce(np.array(system.contact_terms[0].forces.grip(system.state)))
    assert taken > 0.99 * most  # all of it slides
    assert sliding(system) is None
    assert sliding(system, MOSTLY) is None  # nor where nothing else explains a failure


@pytest.mark.parallel
def test_a_good_penalty_gives_no_verdict():
    scene, _ = pressed(None)
    result = solve(scene, steps=5)
    assert result.converged and result.require() is result and result.verdict.kind == "converged"


@pytest.mark.parallel
def test_cycling_is_resolved_by_smaller_steps_and_said():
    scene, _ = stumbling(None, friction=0.3, press=0.3, drag=10.0)
    result = solve(scene, steps=5)
    assert result.converged
    assert any("cut back: the status of" in note for note in result.summary["verdict"]["notes"])
    total = [note for note in result.verdict.notes if note.startswith(f"{result.verdict.cuts} cut-back")]
    assert len(total) == 1 and "status cycling (" in total[0]
    # the size grew again after the cut-backs, to that of the steps asked for
    sizes = np.diff(result.column("t"), prepend=0.0)
    smallest = int(sizes.argmin())
    assert sizes[smallest] < 0.11 and sizes[smallest:].max() == pytest.approx(0.2)


@pytest.mark.serial
def test_notes_on_the_result_come_before_those_on_what_was_overcome():
    cut, jumped, cuts, sunk = (
        "step to t = 1 cut back: x",
        "step 3 to t = 1: it jumped",
        "2 cut-backs, which leave",
        "it sinks",
    )
    verdict = Verdict(notes=[cut, jumped, f"{cuts} nothing in the result: x", sunk])
    verdict.order()
    assert verdict.notes == [jumped, sunk, cut, f"{cuts} nothing in the result: x"]


@pytest.mark.serial
def test_steps_that_are_cut_back_alike_are_one_note():
    verdict = Verdict()
    for i in range(3):
        verdict.cut(StepFailed("the status of 1 point repeats", CYCLING, f"contact 'c' at {i}"), f"step to t = {i}")
    assert len(verdict.notes) == 1 and len(verdict.said) == 2
    assert verdict.last_notes() == ["3 cut-backs, which leave nothing in the result: status cycling (3 of 3)"]


@pytest.mark.parallel
def test_every_cut_back_has_its_reason(capsys):
    """Each in the log, and all of them in one note and in the summary, of a run that goes through too."""
    scene, options = tall_block()
    result = solve(scene, **options)
    verdict = result.verdict
    assert verdict.converged and verdict.cuts > 1
    causes = result.summary["verdict"]["cut_back_causes"]
    assert sum(causes.values()) == verdict.cuts and not any("e-0" in cause for cause in causes)
    (note,) = (note for note in verdict.notes if note.startswith(f"{verdict.cuts} cut-backs"))
    assert all(f"{cause} ({count} of {verdict.cuts})" in note for cause, count in causes.items())
    assert COMM.rank > 0 or capsys.readouterr().err.count(" cut back: ") == verdict.cuts


@pytest.mark.parallel
def test_memory():
    PETSc.Options()["fc_mat_mumps_icntl_23"] = 1  # MB per process
    try:
        scene, options = no_room()
        verdict = solve(scene, steps=5, **options).verdict
    finally:
        PETSc.Options().delValue("fc_mat_mumps_icntl_23")
    assert verdict.kind == "out of memory" and verdict.step == 1 and verdict.cuts == 0
    assert 'linear="iterative"' in verdict.remedy


@pytest.mark.parallel
def test_program_reads_the_verdict_and_a_script_ends_with_it(tmp_path):
    folder = COMM.bcast(tmp_path)
    result = failed("tool", out=folder)
    COMM.Barrier()
    verdict = json.loads((folder / "summary.json").read_text())["verdict"]
    assert verdict["converged"] is False and verdict["kind"] == "rigid-body motion" and verdict["step"] == 1
    assert verdict["place"] == "tool 'ball'" and verdict["t"] == 0.0 and verdict["smallest_step"] > 0.0
    assert verdict["reason"] == result.verdict.reason and verdict["remedy"] == result.verdict.remedy
    with pytest.raises(SystemExit) as left:
        result.require()
    assert left.value.code == (result.verdict.reason if COMM.rank == 0 else 1)


@pytest.mark.serial
def test_a_script_has_a_nonzero_exit_code():
    here = Path(__file__).resolve().parent
    code = f"import sys; sys.path[:0] = ['{here}', '{here.parent}']\nimport test_verdicts as t\nt.failed('tool').require()"
    done = subprocess.run([sys.executable, "-c", code], capture_output=True, text=True, timeout=100)
    assert done.returncode == 1 and "tool 'ball'" in done.stderr and "Traceback" not in done.stderr


@pytest.mark.parallel
def test_smallest_step_is_a_share():
    scene, _ = pressed(None)
    with pytest.raises(SceneError, match="smallest_step = 0.0 must be"):
        solve(scene, method=Method(smallest_step=0.0))


@pytest.mark.parallel
def test_bodies_that_hold_only_each_other_are_refused():
    scene, drive = holding_each_other(floor=False)
    with pytest.raises(SceneError, match="'lower'.*loose together"):
        solve(scene, **drive)


def disc_spring(width=24.5, thick=2.0, rise=4.0, inner=25.5, cells=(16, 3)):
    """Section of a conical disc, its outer edge below; curves disc_bottom, _right, _top, _left."""
    slope = np.arctan2(rise, width)
    along, across = np.array([np.cos(slope), -np.sin(slope)]), np.array([np.sin(slope), np.cos(slope)])
    corner = np.array([inner, rise])
    corners = [corner, corner + along * width / np.cos(slope)]
    corners += [corners[1] + thick * across, corner + thick * across]
    quadrilateral("disc", corners, cells, ("disc_bottom", "disc_right", "disc_top", "disc_left"))


@pytest.mark.parallel
@pytest.mark.parametrize(
    ("friction", "stabilise"), [(0.0, False), (0.0, True), pytest.param(0.3, False, marks=pytest.mark.slow)]
)
def test_a_disc_spring_pushed_past_flat_is_at_a_limit_point(friction, stabilise):
    """Its section turns nearly as a rigid one, but no body of revolution does so without strain. One node carries the
    lid, which is not free to slide off it."""
    body = Body(read_gmsh(disc_spring), "disc", from_elastic(2000.0, 0.3))
    scene = Scene(body, plane="axisymmetric", accept_locking=True)
    lid = rigid_plane((0, 6.0, 0), (0, -1, 0), name="lid")
    scene.contact(("disc_top", "disc_left"), lid, name="l", friction=friction)
    if friction:
        scene.fix("disc_right", "y")
    else:
        floor = rigid_plane((0, -1e-6, 0), (0, 1, 0), name="floor")
        scene.contact(("disc_bottom", "disc_right"), floor, name="f")
    stages = [Stage("seat", move={lid: (0, -0.1, 0)}, steps=1), Stage("push", push={lid: (0, -80.0, 0)}, steps=5)]
    verdict = solve(scene, stages=stages, method=Method(stabilise=stabilise, smallest_step=1e-3)).verdict
    assert verdict.kind == "limit point" and "tool 'lid'" in verdict.place, verdict.reason
    assert ("arc length" in verdict.remedy) != stabilise and "damping=True" in verdict.remedy


@pytest.mark.parallel
def test_bodies_drawn_inside_one_another_that_the_first_step_cannot_part():
    """Named as what they are, with the way that brings them there."""

    def run(start, steps, friction):
        mesh = read_gmsh(
            two_blocks.build, lower=(7, 6, 2.5), lower_cells=(3, 3, 2), lower_origin=(0, 0, -2.5), upper=(4, 4, 2),
            upper_cells=(2, 2, 2), upper_origin=(1.2, 0.9, start),
        )  # fmt: skip
        blocks = Body(mesh, "lower", neo_hooke(0.3, 3.0)), Body(mesh, "upper", neo_hooke(0.5, 3.0))
        scene = Scene(*blocks, degree=2)
        scene.fix("lower_bottom")
        scene.contact("upper_bottom", "lower_top", friction=friction, name="c")
        scene.tie("upper_top", hub := rigid_hub("hub"))
        return solve(scene, move={hub: (0, 0, -0.4 - start)}, steps=steps)

    verdict = run(-0.3, 2, 1.5).verdict
    assert verdict.kind == "no convergence" and "contact 'c'" in verdict.place, verdict.reason
    assert "at the start a point lies 0.3 inside 'lower_top'" in verdict.reason
    assert "start it outside and bring it in along its path" in verdict.remedy
    brought = run(0.0, 4, 0.4).require()
    assert brought.column("c_load_N")[-1] > 0.1
    parted = run(-0.3, 2, 0.4).require()
    assert parted.column("c_load_N")[-1] == pytest.approx(brought.column("c_load_N")[-1], rel=1e-3)


@pytest.mark.parallel
@pytest.mark.parametrize(("friction", "depth", "steps"), [(0.2, 3.2, 3), (0.0, 3.2, 6), (0.2, 3.5, 3)])
def test_a_pad_led_through_the_floor_it_is_glued_to(friction, depth, steps):
    """There is no such state, but a compressible law gives one with half a percent of the volume and a lid that sinks in."""
    mesh = read_gmsh(rectangles.build, rectangles={"pad": ((0, 0), (6, 3), (6, 3))})
    scene = Scene(Body(mesh, "pad", neo_hooke(mu=1.0, K=5.0)), plane="strain")
    scene.fix("pad_ymin")
    lid = rigid_plane((0, 3, 0), normal=(0, -1, 0), name="lid")
    scene.contact("pad_ymax", lid, friction=friction, name="top")
    result = solve(scene, move={lid: (0, -depth, 0)}, steps=steps)
    verdict = result.verdict
    assert (verdict.kind, "body 'pad'" in verdict.place) == ("element inverted", True), verdict.reason
    assert "squeezed to nothing" in verdict.reason and "end the path before" in verdict.remedy
    assert result.column("lid_travel_y_mm")[-1] > -3.0  # it has not come to the floor
    solve(scene, move={lid: (0, -0.8 * result.column("t")[-1] * depth, 0)}, steps=2 * steps).require()


@pytest.mark.parametrize(
    "far, how",
    [
        ((0.0, 0.0, 1.0), "turns about z through (0, 0, 0.5)"),
        ((0.0, 0.0, 0.0), "turns about x, turns about y, turns about z through (0, 0, 0)"),
    ],
)
def test_a_body_that_is_held_at_an_edge_or_a_corner_turns_about_that(far, how):
    def build():
        box.build(size=(2.0, 1.0, 1.0), cells=(4, 2, 2))
        dim = int(any(far))
        found = gmsh.model.getEntitiesInBoundingBox(*[-1e-3] * 3, *(np.array(far) + 1e-3), dim=dim)
        gmsh.model.setPhysicalName(dim, gmsh.model.addPhysicalGroup(dim, [found[0][1]]), "held")

    scene = Scene(Body(read_gmsh(build), "box", neo_hooke(1.0, 5.0)))
    scene.fix("held")
    scene.traction("xmax", (0.0, 0.01, 0.005))
    verdict = solve(scene, steps=1).verdict
    assert verdict.kind == "rigid-body motion" and f"body 'box' {how} without resistance" in verdict.reason, verdict.reason
