"""Steps in which a path turns a hub or tool far: a state a whole turn on is in balance, too; sectors that make a turn."""

import math

import gmsh
import numpy as np
import pytest
from drawn import ring

from fenics_contact import Body, Motion, Scene, SceneError, Stage, neo_hooke, read_gmsh, rigid_cylinder, rigid_hub, solve
from fenics_contact.meshes import box, ring_sector

pytestmark = pytest.mark.parallel
FRICTION = 0.3


def turned(angle, steps):
    """A quarter of a ring that swells in a rough bore, and that a hub then turns; history of the second stage's end."""
    scene = Scene(Body(read_gmsh(ring_sector.build, cells=(3, 6)), "ring", neo_hooke(1.0, 5.0)), plane="strain")
    scene.cyclic("ymin", "xmin")
    hub, bore = rigid_hub("hub", (0, 0, 0)), rigid_cylinder(2.0, (0, 0, 0), (0, 0, 1), hollow=True, name="bore")
    scene.tie("inner", hub)
    scene.contact("outer", bore, FRICTION, name="c")
    scene.swell("ring", lambda t: 1.0 + 0.1 * min(t, 1.0))
    stages = [Stage("swell", steps=2), Stage("turn", steps=steps, move={hub: Motion(rz=angle)})]
    return solve(scene, stages=stages).require()


@pytest.mark.parametrize("turns, steps", [(1.0, 1), (2.7, 3)])
def test_no_step_leads_the_shorter_way_round(turns, steps):
    """The bore's friction, mu N R against the turn, and not what a step of a whole turn, or of nine tenths, would leave."""
    result = turned(2.0 * math.pi * turns, steps)
    moment, load = (result.column(name)[-1] for name in ("c_moment_z_Nmm", "c_load_N"))
    assert moment == pytest.approx(-FRICTION * load * 2.0, rel=2e-2)
    slip = result.column("c_greatest_slip_mm")[-1]
    assert slip == pytest.approx(2.0 * 2.0 * math.pi * turns, rel=0.2)  # but for what the ring gives way, and chords
    assert any("a step would turn 'hub'" in note for note in result.verdict.notes)


def test_steps_of_fifteen_degrees_are_taken_as_they_are():
    result = turned(math.pi / 6.0, 2)
    assert len(result.history) == 4 + result.verdict.cuts and not any("a step would turn" in n for n in result.verdict.notes)


def test_steps_that_are_divided_are_told_where_they_are_cut_back_farther():
    scene, hub = (
        Scene(Body(read_gmsh(box.build, size=(4, 4, 6), cells=(2, 2, 3)), "box", neo_hooke(1.0, 10.0))),
        rigid_hub("hub"),
    )
    scene.tie("zmin", hub)
    result = solve(scene, move={hub: Motion(rz=7.0)}, steps=6).require()
    assert result.verdict.cuts > 0
    assert [note for note in result.verdict.notes if "steps of 45 degrees at most are taken" in note]


def bush():
    """A ring from 2 to 3.5, 24 curved cells around."""
    ring("bush", 0.0, (2.0, 3.5), (3, 6), ("inner", "outer"))
    gmsh.model.mesh.setOrder(2)


@pytest.mark.parametrize("angle", [0.0, 0.5])
def test_a_bush_that_its_hub_turns_on_a_smooth_shaft_stays_as_it_is(angle):
    """Swollen and led aside it turns without a moment, in one step stated, too: no fold, no force across."""
    scene = Scene(Body(read_gmsh(bush), "bush", neo_hooke(0.5, 20.0)), plane="strain", degree=2, element="mixed")
    hub, shaft = rigid_hub("hub"), rigid_cylinder(2.0, (0, 0, 0), (0, 0, 1), name="shaft")
    scene.tie("outer", hub)
    scene.contact("inner", shaft, 0.0, name="c")
    scene.swell("bush", lambda t: 1.0 + 0.05 * min(t, 1.0))
    stages = [Stage("swell", steps=2), Stage("lead", steps=2, move={hub: Motion(x=0.05)}),
              Stage("turn", steps=1, move={hub: Motion(rz=angle)})]  # fmt: skip
    result = solve(scene, stages=stages).require()
    ends = [result.column(name)[-1] for name in ("c_load_N", "hub_force_x_N", "smallest_J")]
    np.testing.assert_allclose(ends, [11.8086, 1.4716, 0.990], rtol=1e-3)
    for name in ("hub_force_y_N", "hub_moment_z_Nmm"):
        assert abs(result.column(name)[-1]) < 1e-5 * ends[0]
    assert any("steps of 15 degrees" in note for note in result.verdict.notes) == (angle > 0.0)


@pytest.mark.parametrize("degrees, told", [(360.0 / 7.0, False), (180.0, False), (50.0, True), (360.0 / 7.0 + 1e-3, True)])
def test_sectors_that_make_no_turn_are_refused(degrees, told):
    """Of 50 degrees 7.2 would, which no ring has."""

    def sector():
        ring_sector.build()
        tags, places, _ = gmsh.model.mesh.getNodes()
        for tag, (x, y, _) in zip(tags, places.reshape(-1, 3), strict=True):
            r, angle = np.hypot(x, y), np.arctan2(y, x) * degrees / 90.0
            gmsh.model.mesh.setNode(tag, [r * np.cos(angle), r * np.sin(angle), 0.0], [])

    scene = Scene(Body(read_gmsh(sector), "ring", neo_hooke(1.0, 5.0)), plane="strain")
    scene.cyclic("ymin", "xmin")
    scene.fix("inner")
    if not told:
        scene.system()
        return
    with pytest.raises(
        SceneError, match=f"{degrees:.6g} degrees apart.* {360.0 / degrees:.6g} sectors make no turn"
    ) as found:
        scene.system()
    assert "51.4286 degrees, 7 sectors, or 45, 8 sectors" in str(found.value) or degrees > 51.0
