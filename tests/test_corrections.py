"""What follows a solve next to balance, by the shares of force out of balance alone."""

import pytest

from fenics_contact.solvers.corrections import FOLLOWED, NEARLY, SETTLING, Resampling
from fenics_contact.solvers.newton import HOPE, Patience
from fenics_contact.solvers.out_of_balance import HELD

pytestmark = pytest.mark.serial
FAR, NEAR, NEXT = 2.0 * HELD, 0.5 * HELD, 0.5 * NEARLY * HELD


def solved(samples, *sizes):
    """How often they follow after a solve that leaves the first share, each time to the next one; the last one stays."""
    samples.solved()
    for count, size in enumerate(sizes):
        if not samples.due(size):
            return count
        samples.followed(sizes[min(count + 1, len(sizes) - 1)])
    return len(sizes)


def test_samples_follow_near_balance_and_are_then_held_but_for_once():
    samples = Resampling(1e-8)
    assert solved(samples, FAR) == 0 and samples.free
    assert solved(samples, NEAR, FAR) == 1 and samples.free  # following has led far from balance: on they go
    assert solved(samples, NEAR, NEAR) == 2 and not samples.free
    assert solved(samples, NEXT) == 0  # they have done so when they were held


def test_samples_that_are_held_follow_once_more_next_to_balance():
    samples = Resampling(1e-8)
    assert solved(samples, NEAR, 1e-9) == 1 and not samples.free
    assert solved(samples, NEAR) == 0
    assert solved(samples, NEXT, NEXT) == 1
    assert solved(samples, NEXT) == 0


def test_samples_follow_what_is_balanced_once():
    samples = Resampling(1e-8)
    assert solved(samples, 1e-9, 1e-9, 1e-9) == 1 < FOLLOWED


def test_samples_that_a_correction_has_brought_nearer_follow_later():
    samples = Resampling(1e-8)
    samples.solved()
    samples.corrected()
    assert not samples.due(NEAR) and samples.due(NEXT)


def test_samples_are_held_however_far_from_balance_in_the_end():
    samples = Resampling(1e-8)
    for _ in range(2 * SETTLING):
        assert solved(samples, NEAR, FAR) == 1 and samples.free
    assert solved(samples, NEAR, FAR) == 1 and not samples.free


def test_a_step_is_given_up_where_none_of_its_solves_has_helped():
    patience = Patience(SETTLING, 20, 3)
    hopeless = 2.0 * HOPE
    assert patience.is_out(3, [hopeless] * 3)
    assert not patience.is_out(2, [hopeless] * 2) and not patience.is_out(3, [hopeless, 0.1, hopeless])
    assert patience.is_out(3, [0.1, *[hopeless] * 3])  # of an attempt before
