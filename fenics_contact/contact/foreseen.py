"""Contact pressures as unknowns of Newton's own, each kept as the gap (np,) that has it, p = -eps_N gap."""

import numpy as np

from fenics_contact.kernels.closest_point import NONE

BARELY = 1e-300  # [length]: closed, but under no pressure


def carried_gaps(gaps, decided, pairs, shift, touch, share):
    """Gaps (np,) whose pressures the last solve foresees, if `share` of its increment was taken.

    gaps: linearised there, shifts added; decided: those that decided between open and closed in the tangent; pairs: its
    projection; shift, touch: see kernels/laws.py. A point that the tangent held open comes with no pressure: its gap says
    that it closes and not what it will carry; the pressure of a deep overlap would make a tangent of huge geometric terms.
    """
    held = (decided <= touch) & (pairs[1] != NONE)
    carried = np.maximum(gaps, -BARELY)
    # the part of the increment that was not taken leaves its part of the pressures where they were
    carried[held] = gaps[held] + (1.0 - share) * (decided[held] - pairs[4][held] - shift[held])
    return carried


def eased_law(law, judged, projection, yielding):
    """(law, judged gaps) that press with the foreseen pressure and `yielding` times the penalty on the gap's error.

    yielding (np,): stiffness of the body over the penalty. A full penalty makes of a gap's error the force that would push
    the point back by it, were the body a hundred times as stiff; eased, it is the force that does so.
    """
    *law, shift = law
    there, held = projection[1] != NONE, judged <= law[3]
    gaps = np.where(there, projection[4], 0.0) + shift
    pressing = np.where(there, yielding * gaps, np.inf)
    pressing[held] = judged[held] + yielding[held] * (gaps[held] - judged[held])
    eased = np.where(there, pressing, 0.0) - gaps + shift
    return (*law, eased), np.where(held, judged, pressing)
