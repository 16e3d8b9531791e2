"""A rubber tube is inflated by a following pressure until it fills a wider one and swells with it.

Plane strain, quarter of both tubes: 80 to 90 mm and 100 to 110 mm, the paper's Mooney material, meshes that do not match.
The reference is the exact solution of the radial problem, which this script computes itself. Units: mm, N, MPa.

    mpirun -n 2 python3 demos/nested_tubes.py   # --quick: the coarsest mesh, seconds
"""

import sys
from pathlib import Path

import numpy as np
from matplotlib.figure import Figure
from mpi4py import MPI
from scipy.integrate import solve_ivp
from scipy.optimize import brentq

from fenics_contact import Body, Output, Scene, compat, mooney_paper, read_gmsh, solve
from fenics_contact.meshes import tubes

OUT = Path("results/nested_tubes")
A1, A2, K = 0.1863, 0.0098, 5.0
INNER, OUTER = (80.0, 90.0), (100.0, 110.0)
LARGEST = 140.0  # mm, inner radius at whose pressure the run ends; the pressure rises all the way, so it can be the load
FIRM = 100.0  # mm, inner radius beyond which errors are taken relative to a contact pressure that starts at zero
STEPS = 16
MESHES = ((16, 12), (32, 24), (64, 48))  # cells around the inner and the outer tube
LABELS = {"corners": "facets' corners", 3: "3 x 3 Gauss points", "averages": "averages"}


def stress(radial, hoop):
    """Nominal stresses (radial, hoop) [MPa] in plane strain at principal stretches, of Psi in (22)."""
    J = radial * hoop
    B = np.array([radial**2, hoop**2, 1.0 + 0.0 * J]) * J ** (-2 / 3)
    tau = 2 * A1 * (B - B.sum() / 3) + 4 * A2 * (B**2 - (B**2).sum() / 3) + K * J * (J - 1)
    return tau[0] / radial, tau[1] / hoop


def through_wall(tube, inside, radial):
    """Integrate dP/dR = (Q - P)/R from radius `inside` [mm] and its radial stretch: outer radius, stress at both."""

    def slope(R, y):
        hoop, tiny = y[0] / R, 1e-30  # derivatives by a complex step are exact
        P, Q = stress(y[1], hoop)
        by_radial = stress(y[1] + 1j * tiny, hoop)[0].imag / tiny
        by_hoop = stress(y[1], hoop + 1j * tiny)[0].imag / tiny
        return y[1], ((Q - P) / R - by_hoop * (y[1] - hoop) / R) / by_radial

    ends = solve_ivp(slope, tube, (inside, radial), rtol=1e-10, atol=1e-10).y
    cauchy = [stress(s, r / R)[0] * R / r for R, r, s in zip(tube, ends[0, [0, -1]], ends[1, [0, -1]], strict=True)]
    return ends[0, -1], *cauchy


def exact(m):
    """Pressure inside and contact pressure [MPa] at inner radius m [mm]: nothing presses outside, nor before they touch."""

    def contact(interface):
        if interface <= OUTER[0]:
            return 0.0
        free = brentq(lambda s: through_wall(OUTER, interface, s)[2], 0.3, 1.2)
        return -through_wall(OUTER, interface, free)[1]

    def unbalanced(s):
        interface, _, outside = through_wall(INNER, m, s)
        return outside + contact(interface)

    interface, inside, _ = through_wall(INNER, m, brentq(unbalanced, 0.3, 1.2))
    return -inside, contact(interface)


def radius(scene, group):
    """Mean distance [mm] of a surface's nodes from the axis, as a function of the state."""
    space, comm = scene.space, scene.mesh.comm
    nodes = compat.locate_blocks(space, scene.mesh.facets(group))
    nodes = nodes[nodes < space.dofmap.index_map.size_local]
    X = space.tabulate_dof_coordinates()[nodes]

    def mean(state):
        x = X + state.u.x.array.reshape(-1, 3)[nodes]
        total, count = comm.allreduce(np.array([np.hypot(x[:, 0], x[:, 1]).sum(), len(x)]))
        return total / count

    return mean


def inflate(around, points):
    """Result, and by step inner radius [mm], pressure and contact pressure [MPa]; around: cells of each tube."""
    size = {name: (*tube, n, n // 8) for name, tube, n in zip(("inner", "outer"), (INNER, OUTER), around, strict=True)}
    depth = 100.0 / max(around)
    mesh = read_gmsh(tubes.build, tubes=size, depth=depth)
    rubber = mooney_paper(A1, A2, K)
    scene = Scene(Body(mesh, "inner", rubber), Body(mesh, "outer", rubber))
    scene.fix("symmetry_x", "x")
    scene.fix("symmetry_y", "y")
    scene.fix("ends", "z")
    scene.pressure("inner_inside", exact(LARGEST)[0])
    scene.contact("inner_outside", "outer_inside", points=points, name="interface")
    record = {"inner": radius(scene, "inner_inside"), "interface": radius(scene, "outer_inside")}
    result = solve(
        scene, steps=STEPS, out=Output(OUT / f"{points}_{around[0]}", overwrite=True, progress=False), record=record
    ).require()
    # the interface's pressure on a quarter of its length is balanced by radius times pressure on the symmetry plane
    contact = -result.column("interface_force_x_N") / result.column("interface") / depth
    inside = result.column("t") * exact(LARGEST)[0]
    return result, np.array([result.column("inner"), inside, contact])


def figure(curves, errors, both):
    picture = Figure(figsize=(6.3, 7.5), layout="constrained")
    places = picture.subplot_mosaic([["curves", "tubes"], ["rates", "rates"]])
    axes, rates, tubes_at_end = places["curves"], places["rates"], places["tubes"]
    m = np.linspace(INNER[0], LARGEST, 25)
    axes.plot(m, 1e3 * np.array([exact(x) for x in m]), "k-", linewidth=0.8, label=["exact", "_"])
    axes.plot(curves[0], 1e3 * curves[1:].T, "o", markersize=4, label=["pressure inside", "contact pressure"])
    axes.set_xlabel("inner radius [mm]"), axes.set_ylabel("pressure [kPa]")
    axes.set_ylim(None, 125), axes.legend(loc="upper left")
    for points, rows in errors.items():
        cells, inside, contact = np.transpose(rows)
        rates.loglog(cells, inside, "o--", label=f"inside, {LABELS[points]}")
        rates.loglog(cells, contact, "o-", label=f"contact, {LABELS[points]}")
    rates.set_xticks(cells, [f"{n:.0f}" for n in cells]), rates.minorticks_off()
    rates.set_xlabel("cells around a quarter of the inner tube"), rates.set_ylabel("relative error of pressure")
    rates.legend(fontsize=9, loc="lower left")
    both.draw(tubes_at_end).explain(tubes_at_end, 9, location="bottom")
    picture.savefig(OUT / "nested_tubes.png", dpi=150)


def main(quick=False):
    errors, root = {}, MPI.COMM_WORLD.rank == 0
    for points in list(LABELS)[-1:] if quick else LABELS:
        for around in MESHES[:1] if quick else MESHES:
            result, curves = inflate(around, points)
            touching = curves[:, curves[0] > FIRM]
            row = np.abs(touching[1:] / np.transpose([exact(m) for m in touching[0]]) - 1).max(axis=1)
            errors.setdefault(points, []).append((around[0], *row))
            if root:
                print(f"{LABELS[points]}, {around} cells: errors p_inner {row[0]:.2%}, p_contact {row[1]:.2%}")
    both = result.drawing("contact_pressure")
    if root:
        figure(curves, errors, both)
        if not quick:
            order = {points: -np.polyfit(*np.log(np.array(rows)[:, ::2]).T, 1)[0] for points, rows in errors.items()}
            print(f"orders of convergence in p_contact {order}")
        print(f"picture: {OUT / 'nested_tubes.png'}")
    assert quick or row[1] < 0.01


if __name__ == "__main__":
    main(quick="--quick" in sys.argv)
