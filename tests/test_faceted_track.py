"""A pad led round a faceted drum without friction: over a whole facet no work is done, whatever the facets' edges do."""

import gmsh
import numpy as np
import pytest

from fenics_contact import Body, Motion, Scene, Stage, neo_hooke, read_gmsh, rigid_curve, rigid_hub, rigid_surface, solve
from fenics_contact.meshes import box, rectangles

pytestmark = pytest.mark.parallel

RADIUS, WIDTH, HEIGHT, DEEP = 20.0, 12.0, 6.0, 1.0  # mm
PER_FACET, PRESSING = 17, 4  # steps


def track(facets, depth):
    """A prism about z, or its section, its edges on RADIUS, two of them beside the y axis."""
    geo, angles = gmsh.model.geo, np.pi / 2 + np.pi / facets + 2 * np.pi * np.arange(facets) / facets
    ends = [-depth, depth] if depth else [0.0]
    rings = [[geo.addPoint(RADIUS * np.cos(a), RADIUS * np.sin(a), z) for a in angles] for z in ends]
    around = [[geo.addLine(ring[i], ring[(i + 1) % facets]) for i in range(facets)] for ring in rings]
    for curve in sum(around, []):
        geo.mesh.setTransfiniteCurve(curve, 2)
    tool = around[0]
    if depth:
        along = [geo.addLine(low, up) for low, up in zip(*rings, strict=True)]
        loops = [[around[0][i], along[(i + 1) % facets], -around[1][i], -along[i]] for i in range(facets)]
        tool = [geo.addPlaneSurface([geo.addCurveLoop(loop)]) for loop in loops]
        for curve in along:
            geo.mesh.setTransfiniteCurve(curve, 2)
        for face in tool:
            geo.mesh.setTransfiniteSurface(face)
            geo.mesh.setRecombine(2, face)
    geo.synchronize()
    dim = 2 if depth else 1
    gmsh.model.setPhysicalName(dim, gmsh.model.addPhysicalGroup(dim, tool), "track")
    gmsh.model.mesh.generate(dim)


def led_round(facets, plane):
    """Tangential over normal force of the pad [-] in each step over one facet, after one of them, and solves per step."""
    low = (-WIDTH / 2, RADIUS)
    if plane:
        mesh = read_gmsh(rectangles.build, rectangles={"pad": (low, (WIDTH, HEIGHT), (10, 5))})
        tool, (inside, top) = rigid_curve(track, name="track", facets=facets, depth=0.0), ("pad_ymin", "pad_ymax")
    else:
        mesh = read_gmsh(box.build, size=(WIDTH, HEIGHT, 4.0), cells=(10, 5, 3), origin=(*low, -2.0), name="pad")
        tool, (inside, top) = rigid_surface(track, name="track", facets=facets, depth=5.0), ("ymin", "ymax")
    scene = Scene(Body(mesh, "pad", neo_hooke(1.0, 10.0)), plane="strain" if plane else None)
    scene.tie(top, hub := rigid_hub("hub"))
    scene.contact(inside, tool, name="c")
    angle = 4 * np.pi / facets
    # about the drum's axis: the hub's point has been led down from there
    turn = Motion(rz=lambda s: angle * s, x=lambda s: DEEP * np.sin(angle * s), y=lambda s: DEEP * (1 - np.cos(angle * s)))
    stages = [
        Stage("press", move={hub: Motion(y=-DEEP)}, steps=PRESSING),
        Stage("turn", move={hub: turn}, steps=2 * PER_FACET),
    ]
    result = solve(scene, stages=stages).require()
    x, y, phi = (result.column(f"hub_{name}", "turn") for name in ("travel_x_mm", "travel_y_mm", "angle_z_rad"))
    fx, fy, m = (result.column(f"hub_{name}", "turn") for name in ("force_x_N", "force_y_N", "moment_z_Nmm"))
    normal = np.sin(phi) * fx - np.cos(phi) * fy
    ratio = (m + x * fy - y * fx) / RADIUS / normal
    return ratio[-PER_FACET:], result.column("iterations", "turn").mean()


@pytest.mark.parametrize("plane", [True, False])
@pytest.mark.parametrize("facets, ripple", [(17, 0.05), (40, 0.008)])
def test_a_pad_led_round_a_faceted_drum_feels_no_friction(facets, ripple, plane):
    ratio, solves = led_round(facets, plane)
    assert abs(ratio.mean()) < 1e-9  # a sum over one period of what is periodic: no work is left but the solver's
    assert 0.0 < np.ptp(ratio) / 2 < ripple
    assert solves < 5.0
