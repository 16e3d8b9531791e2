"""What Newton's last solve foresaw of the friction of a slave point or node: whether it sticks, and along what it rubs.

A way [length] stands for the traction eps_T times it. The foreseen one is not the way that the point has gone: it leads
where the tangent's friction does.
"""

from numba import njit

from fenics_contact.kernels.law import FREE, Gaps, Law, traction
from fenics_contact.kernels.status import SLIP, STICK
from fenics_contact.kernels.vectors import Vector, dot, norm, planar
from fenics_contact.types import Floats

# Of a body's stiffness beneath its nodes, E/h: what a gap or way still wrong weighs against the traction that was foreseen
# (c of Hueeber & Wohlmuth 2005, doi:10.1016/j.cma.2004.08.006; 0.1 ... 1 E/h alike)
WEIGHT = 1.0
# Cosine of the angle between the way and the foreseen one: a node that slips in a direction further off has passed by the
# middle around which slips turn; it follows what was foreseen, which its own way turns by its weight alone
ASIDE = 0.4


@njit(cache=True, error_model="numpy")
def rubs(law: Law, body: float, judged: Floats, at: int, n: Vector, w: Vector) -> tuple[int, Vector, float]:
    """(STICK or SLIP by what was foreseen, FREE where nothing was; the way along which it rubs, its own way w or the
    foreseen one; the part that its own has in that) of point `at`. What slips there slips where its own way goes there too.

    judged (n, 4) or (0, 4): gaps and ways that were foreseen [length]; n: the normal, zero where ways have no part along it;
    body: E/h of what lies beneath [pressure/length].
    """
    if len(judged) == 0 or law.friction.mu == 0.0:
        return FREE, w, 1.0
    foreseen = judged[at, 1], judged[at, 2], judged[at, 3]
    foreseen, own = planar(foreseen, n), planar(w, n)
    found, onwards = traction(law, Gaps(judged[at, 0], judged[at, 0]), n, foreseen), dot(foreseen, own)
    if found.status != SLIP or onwards <= 0.0:
        return STICK, w, 1.0
    if onwards > ASIDE * norm(foreseen) * norm(own):
        return SLIP, w, 1.0
    return SLIP, foreseen, min(WEIGHT * body / law.eps_t, 1.0)
