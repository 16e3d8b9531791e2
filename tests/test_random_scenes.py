"""Some of the random scenes of `random_scenes.py`, and whether the judge would see what is wrong."""

from dataclasses import replace

import numpy as np
import pytest
from random_scenes import GOOD, child, compared, draw
from scene_judge import CONE, Run, beyond_coulomb, judge, lifted, with_options, wrongs

from fenics_contact.solvers.newton import Newton
from fenics_contact.solvers.verdict import StepFailed

SEEDS = (10, 23, 25, 27, 33, 36, 40, 43, 48, 57, 64, 67, 106, 111, 118, 140)
QUICK = (33, 36, 43, 57)  # on 2 ranks, too; `make nightly` takes all there
LONG = (23,)  # takes longer than the other fifteen together
LIMIT = 120.0  # seconds


def marked(seed):
    marks = [pytest.mark.parallel if seed in QUICK else pytest.mark.serial]
    return pytest.param(seed, marks=[*marks, pytest.mark.slow] if seed in LONG else marks)


@pytest.mark.parametrize("seed", map(marked, SEEDS))
def test_a_random_scene_ends_right_or_with_a_remedy_that_cures(seed):
    found = judge(seed, thorough=False)
    assert found["class"] in GOOD, found["says"]


@pytest.mark.slow
@pytest.mark.serial
@pytest.mark.parametrize("seed", (27, 57))
def test_more_steps_and_ranks_give_the_same(seed):
    one, two = (child(seed, ranks, LIMIT) for ranks in (1, 2))
    assert one["class"] in GOOD, one["says"]
    two = compared(one, two)
    assert two["class"] in GOOD, two["says"]


@pytest.mark.parametrize("seed", [9080, pytest.param(9085, marks=pytest.mark.slow)])
@pytest.mark.serial
def test_bodies_that_a_step_would_have_thrown_away(seed):
    """9080: forces of 1e-13 N were what holds a body far from all tools. 9085: a tool slips in between single points."""
    found = judge(seed, thorough=False)
    assert found["class"] in GOOD, found["says"]


@pytest.mark.parallel
def test_slips_around_a_middle_settle():
    """A block pressed on another one spreads: a node near the middle passed it in each solve and turned its slip around."""
    run = Run(draw(240))
    assert run.result.converged and run.verdict.cuts == 0, run.verdict.reason
    assert wrongs(run) == []


@pytest.mark.serial
def test_a_step_that_softer_penalties_opened_ends_where_others_do(monkeypatch):
    """Without friction the path is no matter: not where the samples of averages were before the step, either."""
    one, step = Run(draw(20052)), Newton.step

    def refused(newton, system, t):
        if t > 0.05:
            raise StepFailed("not solved so")
        return step(newton, system, t)

    monkeypatch.setattr(Newton, "step", refused)
    two = Run(draw(20052))
    assert any("softer penalties" in note for note in two.verdict.notes)
    assert np.abs(one.at_ends() - two.at_ends()).max() < 1e-7 * one.most  # steps end at 1e-8 of the force


@pytest.mark.serial
def test_a_facet_that_comes_into_sight_and_goes_out_of_it_stops_no_step():
    """Near the end of the way, on a coarse punch, the same nodes pressed at each solve, and the residual did not fall."""
    run = Run(draw(20059), finer=2)
    assert run.result.converged and run.verdict.cuts == 0, run.verdict.reason


@pytest.mark.slow
@pytest.mark.serial
def test_samples_that_come_over_the_master_leave_balance_as_it_was():
    """Of a node that sticks, when a step is accepted: anchors of these samples alone changed its mean way."""
    run = Run(with_options(draw(258), stabilise=True))
    assert run.result.converged and wrongs(run) == [], run.verdict.reason


@pytest.mark.slow
@pytest.mark.serial
def test_springs_do_not_hide_a_fold():
    """A ball pushed aside on a block that tips: springs hold what falls, and pull the more the longer they are followed."""
    run = Run(draw(249))
    assert run.verdict.kind == "limit point" and "instead of pushing" in run.verdict.remedy, run.verdict.reason


@pytest.mark.slow
@pytest.mark.serial
def test_a_ball_that_slides_out_of_its_dent_is_said_to():
    """The dent's slope holds it beside friction, and that comes to its end on the way to the rim: where the body gives
    way to the ball, friction alone holds it."""
    found = judge(7061, thorough=False)
    assert found["class"] == "cured" and found["kind"] == "friction used up", found["says"]
    assert "friction alone holds body 'upper', tool 'tool', and it is used up" in found["says"]


@pytest.mark.parallel
def test_the_judge_sees_what_is_wrong():
    run = Run(replace(draw(36), steps=3))
    assert run.result.converged and wrongs(run) == []
    state = run.system.state
    state.u.x.array[:] *= 1.001
    run.probe(state)
    assert any("out of balance" in text for text in wrongs(run))
    contact = run.system.contact_terms[0]
    assert beyond_coulomb(contact, state, 0.0)[0] < CONE
    assert beyond_coulomb(contact, state, 0.0, share=0.5)[0] > CONE  # what slips exceeds half of it
    assert lifted(run)
    for row in run.rows:
        row["forces"] = {name: 0.0 * force for name, force in row["forces"].items()}
    assert any("and must with" in text for text in wrongs(run))
