"""Normal penalty law and Coulomb return mapping of one slave point, with their exact derivatives."""

import math

from numba import njit

from fenics_contact.kernels.status import CLOSED, OPEN, SLIP, STICK

ON_CONE = 1e-8  # round-off of a traction rebuilt from its anchor, relative, where slips are a millionth of the coordinates


@njit(cache=True)
def coulomb_return(size, limit):
    """(status, share of the trial traction of a size that stays): its radial return to the cone |T_T| <= limit (16).

    A point that slipped when the last step was accepted starts the next one on the cone to round-off. It counts as
    slipping, so that the next step's first tangent lets it go on; the traction is that of the law either way.
    """
    if size == 0.0 or size <= limit * (1.0 - ON_CONE):
        return STICK, 1.0
    return SLIP, min(limit / size, 1.0)


@njit(cache=True)
def point_traction(
    gap, press, decides, n, H, elastic_slip, eps_n, deps, eps_t, mu, touch, want_tangent, trial, traction, tangential,
    dtrial, dT,
):  # fmt: skip
    """Contact traction T = N n + T_T of a slave point on a fixed surface, and dT/dx of the slave position.

    gap: signed distance; press: gap and its multiplier's shift; decides: what tells open from closed and stick from slip,
    press itself or the pressure a solve starts from, over eps_n [lengths]; n (3,), H (3, 3): normal and its gradient;
    elastic_slip (3,): x_M - anchor.
    eps_n, eps_t: penalties [pressure/length]; deps (3,): gradient of eps_n, zero away from a sharp edge;
    mu: friction coefficient; touch: decides up to this round-off length counts as closed. Fills traction (3,) and
    its tangential part (3,) [pressure], and dT (3, 3) [pressure/length] if wanted; trial (3,)
    and dtrial (3, 3) are scratch. The virtual power is T . (dv_S - dv_M), (14), so -T acts on the slave.
    """
    tangential[:] = 0.0
    if decides > touch:
        traction[:] = 0.0
        dT[:, :] = 0.0
        return OPEN
    N = eps_n * press  # penalty law before (15), the multiplier eps_n shift added
    traction[:] = N * n
    if want_tangent:
        for i in range(3):
            for j in range(3):
                dT[i, j] = n[i] * (eps_n * n[j] + press * deps[j]) + N * H[i, j]  # (26) for a surface of normal gradient H
    if mu == 0.0:
        return CLOSED

    along = n[0] * elastic_slip[0] + n[1] * elastic_slip[1] + n[2] * elastic_slip[2]
    trial[:] = eps_t * (elastic_slip - along * n)  # P(n) (x_M - x_anchor) replaces xi(k+1) - xi(k), theory section 2
    limit = mu * max(-eps_n * decides, 0.0)
    size = math.sqrt(trial[0] ** 2 + trial[1] ** 2 + trial[2] ** 2)
    if size <= eps_t * touch:  # no way beyond round-off: it has no direction to slip in
        status, share = STICK, 1.0
    else:
        status, share = coulomb_return(size, limit)
        if status == SLIP and decides != press:
            share = -mu * N / size
    tangential[:] = share * trial
    traction[:] += tangential
    if want_tangent:
        _friction_tangent(gap, press, n, H, elastic_slip, along, eps_n, deps, eps_t, mu, limit, status, trial, dtrial, dT)
    return status


@njit(cache=True)
def _friction_tangent(gap, press, n, H, z, along, eps_n, deps, eps_t, mu, limit, status, trial, dtrial, dT):
    """Add d(T_T)/dx: (27) in stick, (28) with the d|N| block in slip."""
    for j in range(3):
        Hz = H[0, j] * z[0] + H[1, j] * z[1] + H[2, j] * z[2]
        for i in range(3):
            # d(x_M)/dx = I - n n - g H and dP z = -(dn (n.z) + n (dn.z))
            dtrial[i, j] = eps_t * (-n[i] * n[j] - gap * H[i, j] - along * H[i, j] - n[i] * Hz)
        dtrial[j, j] += eps_t
    if status == STICK:
        dT[:, :] += dtrial
        return
    size = math.sqrt(trial[0] ** 2 + trial[1] ** 2 + trial[2] ** 2)
    for j in range(3):
        t_dtrial = (trial[0] * dtrial[0, j] + trial[1] * dtrial[1, j] + trial[2] * dtrial[2, j]) / size
        for i in range(3):
            t = trial[i] / size
            dT[i, j] += limit / size * (dtrial[i, j] - t * t_dtrial) - mu * t * (eps_n * n[j] + press * deps[j])


@njit(cache=True)
def edge_penalty(eps, body, cover, dcover, deps):
    """Penalty of a point that lies only by the share `cover` under a sharp edge, and its gradient deps (3,).

    In series with the penalty acts the spring of the body beneath, (1/cover - 1)/body: half the cover carries about half
    the force, whatever eps. A plain eps * cover would hold the point until the cover is nearly gone and then drop it.
    eps, body [pressure/length]; dcover (3,).
    """
    m = cover / eps + (1.0 - cover) / body
    deps[:] = dcover / (body * m * m)
    return cover / m
