"""Steps in which a path turns a hub or tool far: a state a whole turn on is in balance, too."""

import math

import pytest

from fenics_contact import Body, Motion, Scene, Stage, neo_hooke, read_gmsh, rigid_cylinder, rigid_hub, solve
from fenics_contact.meshes import ring_sector

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


def test_steps_of_an_eighth_turn_are_taken_as_they_are():
    result = turned(math.pi / 2.0, 2)
    assert len(result.history) == 4 + result.verdict.cuts and not any("a step would turn" in n for n in result.verdict.notes)
