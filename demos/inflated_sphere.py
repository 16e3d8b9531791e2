"""The paper's first example: a closed Mooney shell under inner pressure, past the limit point of its load.

One eighth of the shell in three patches of 9 x 9 x 4 mixed hexahedra (972, where 16 x 16 x 4 are 1024), K = 1, 5, 200 MPa
and both readings of the second invariant; beneath the computed points the exact curves of the radial problem, solved here.
Units: mm, N, MPa. About a minute on two quiet cores.

    mpirun -n 2 python3 demos/inflated_sphere.py   # --quick: one case on 3 cells per edge, seconds
"""

import sys
from dataclasses import replace
from pathlib import Path

import numpy as np
from matplotlib.figure import Figure
from mpi4py import MPI
from scipy.integrate import solve_ivp
from scipy.optimize import brentq, minimize_scalar

from fenics_contact import ArcSteps, Body, Film, Output, Scene, compat, mooney_paper, mooney_rivlin, read_gmsh, solve
from fenics_contact.meshes import sphere_shell

OUT = Path("results/inflated_sphere")
A1, A2 = 0.1863, 0.0098
BULK = (1.0, 5.0, 200.0)
RADIUS, WALL = 95.0, 1.0
LAST = 2 * RADIUS  # radial displacement of the inner points: stretch 3
SCALE = 0.005  # pressure at t = 1 [MPa]
READINGS = {"A": mooney_paper, "B": mooney_rivlin}
ROOT = MPI.COMM_WORLD.rank == 0


def distortion(reading, q):
    """Energy of the shape change at hoop over radial stretch q, with its first two derivatives [MPa]."""
    # I1 = q^(-4/3) + 2 q^(2/3); I2 = q^(-8/3) + 2 q^(4/3) (A) or 2 q^(-2/3) + q^(4/3) (B)
    second = {"A": [(1, -8 / 3), (2, 4 / 3)], "B": [(2, -2 / 3), (1, 4 / 3)]}[reading]
    powers = [(A1, -4 / 3), (2 * A1, 2 / 3), *[(A2 * factor, n) for factor, n in second]]
    slope = sum(c * n * q ** (n - 1) for c, n in powers)
    return slope, sum(c * n * (n - 1) * q ** (n - 2) for c, n in powers)


def exact_pressure(reading, K, u):
    """Inner pressure [MPa] of the compressible sphere whose inner points have moved outwards by u [mm].

    Equilibrium P_r' + 2 (P_r - P_h) / R = 0 of the nominal stresses, shot from the inner radial stretch at which the outer
    surface is free.
    """

    def stress(radial, hoop):
        q, J = hoop / radial, radial * hoop**2
        slope, curvature = distortion(reading, q)
        P_r = -slope * q / radial + K * (J - 1) * hoop**2
        P_h = slope / (2 * radial) + K * (J - 1) * radial * hoop
        by_radial = (curvature * q**2 + 2 * slope * q) / radial**2 + K * hoop**4
        by_hoop = -(curvature * q + slope) / radial**2 + 2 * K * hoop * (2 * J - 1)
        return P_r, P_h, by_radial, by_hoop

    def rates(R, y):
        r, radial = y
        P_r, P_h, by_radial, by_hoop = stress(radial, r / R)
        return radial, -(2 * (P_r - P_h) + by_hoop * (radial - r / R)) / (R * by_radial)

    def outer_stress(radial):
        end = solve_ivp(rates, (RADIUS, RADIUS + WALL), (RADIUS + u, radial), rtol=1e-10, atol=1e-12).y[:, -1]
        return stress(end[1], end[0] / (RADIUS + WALL))[0]

    hoop = 1 + u / RADIUS
    membrane = brentq(lambda radial: stress(radial, hoop)[0], 0.1 * hoop**-2, 1.1)  # of a wall without thickness
    radial = brentq(outer_stress, 0.8 * membrane, 1.2 * membrane, xtol=1e-13)
    return -stress(radial, hoop)[0] / hoop**2


def exact_limit(reading, K):
    """Largest pressure [MPa] and the displacement [mm] at it."""
    found = minimize_scalar(lambda u: -exact_pressure(reading, K, u), bounds=(20, 80), method="bounded")
    return -found.fun, found.x


def inner_radial(scene):
    """Function of the state: mean radial displacement of the shell's inner points [mm]."""
    nodes = compat.locate_blocks(scene.space, scene.mesh.facets("inner"))
    nodes = nodes[nodes < scene.space.dofmap.index_map.size_local]
    direction = scene.space.tabulate_dof_coordinates()[nodes] / RADIUS
    comm = scene.mesh.comm
    count = comm.allreduce(len(nodes))
    return lambda state: comm.allreduce(float(np.sum(state.u.x.array.reshape(-1, 3)[nodes] * direction))) / count


def inflate(mesh, reading, K, out=None):
    """Displacements [mm] and pressures [MPa] of all steps, the limit point's number, a drawing of the shell there."""
    scene = Scene(Body(mesh, "shell", READINGS[reading](a1=A1, a2=A2, K=K)), element="mixed")
    for axis in "xyz":
        scene.fix(f"symmetry_{axis}", axis)
    scene.pressure("inner", SCALE)
    radial = inner_radial(scene)
    arcs = ArcSteps(until=lambda state: radial(state) - LAST, first=0.1, largest=10.0)
    film = Film("displacement", mirror="xz", view=(25, -70))  # half of it, cut open
    record = {"inner_radial_mm": radial, "frame": film}
    result = solve(scene, steps=arcs, record=record, out=Output(out, overwrite=True, progress=False))
    if not result.converged:
        raise SystemExit(f"reading {reading}, K = {K}: {result.verdict.reason}")
    peak = int(np.argmax(result.column("limit_point") == 1))
    shell = film.drawings[peak] if ROOT else None
    return result.column("inner_radial_mm"), SCALE * result.column("t"), peak, shell


def row(reading, K, u, p, peak, _=None):
    """A line of the table, and (largest error of the curve, of p_crit)."""
    exact, (p_limit, u_limit) = [exact_pressure(reading, K, x) for x in u], exact_limit(reading, K)
    errors = np.abs(p / exact - 1).max(), abs(p[peak] / p_limit - 1)
    line = f"{reading:>7} {K:6g} {1e3 * p[peak]:10.5f} {1e3 * p_limit:10.5f} {errors[1]:8.2%} {u[peak]:9.3f} {u_limit:9.3f}"
    return f"{line} {errors[0]:11.2%} {len(u):6}", errors


def picture(curves, path):
    figure = Figure(figsize=(6.3, 7), layout="constrained")
    above, below = figure.subfigures(2, 1, height_ratios=[1.2, 1])
    at_limit = below.subplots()
    for axes, reading in zip(above.subplots(1, 2, sharey=True), READINGS, strict=True):
        places = np.concatenate([np.linspace(0.2, 20, 25), np.linspace(22, LAST, 60)])
        for K, colour in zip(BULK, ("tab:blue", "tab:orange", "tab:green"), strict=True):
            if (reading, K) not in curves:
                continue
            u, p, peak, shell = curves[reading, K]
            axes.plot(places, [1e3 * exact_pressure(reading, K, x) for x in places], color=colour, linewidth=1)
            axes.plot(u, 1e3 * p, "o", color=colour, markersize=3, label=f"K = {K:g} MPa")
            axes.plot(u[peak], 1e3 * p[peak], "v", color=colour, markersize=8)
            if (reading, K) == ("A", 5.0):
                then = replace(shell, tools=[shell.body.X])  # the start as a shell of glass about it
                then.draw(at_limit, limits=(0.0, u[peak])).explain(at_limit, 9)
                at_limit.set_title(f"reading A, K = 5 MPa: half of the shell at its limit point, {1e3 * p[peak]:.2f} kPa;\n"
                                   "grey: at the start", fontsize=10)  # fmt: skip
        axes.set_title(f"reading {reading}: " + ("I₂ = tr(B·B)" if reading == "A" else "classical I₂"))
        axes.set_xlabel("radial displacement of\nthe inner points [mm]")
    above.axes[0].legend(
        title="points: computed,\n▼ limit point,\nlines: exact", loc="lower right", fontsize=9, title_fontsize=9
    )
    above.axes[0].set_ylabel("pressure [kPa]")
    figure.savefig(path, dpi=150)


def statements(curves):
    """What is true of the paper's sentence: with growing K the critical pressure grows and its displacement falls."""
    for reading in READINGS:
        p, u = np.transpose([(c[1][c[2]], c[0][c[2]]) for c in (curves[reading, K] for K in BULK)])
        grows = "grows" if np.all(np.diff(p) > 0) else "does not grow"
        ways = ", then ".join("falls" if step < 0 else "rises" for step in np.diff(u))
        yield f"reading {reading}: with K = 1, 5, 200 MPa the critical pressure {grows}; the displacement at it {ways}"


def main(quick=False):
    curves, errors = {}, {}
    cases = [("A", 5.0)] if quick else [(reading, K) for reading in READINGS for K in BULK]
    cells, layers, coarser = (3, 1, ()) if quick else (9, 4, ((3, 1), (6, 2)))
    lines = ["reading      K  p_crit kPa      exact    error  u_crit mm     exact  curve error  steps"]
    mesh = read_gmsh(sphere_shell.build, inner=RADIUS, thickness=WALL, cells=cells, layers=layers)
    for case in cases:
        curves[case] = inflate(mesh, *case, OUT / "{}_K{:g}".format(*case))
        line, errors[case] = row(*case, *curves[case])
        lines.append(line)
    for size in coarser:
        coarse = read_gmsh(sphere_shell.build, inner=RADIUS, thickness=WALL, cells=size[0], layers=size[1])
        _, (curve, limit) = row("A", 5.0, *inflate(coarse, "A", 5.0))
        patches = "{0} x {0} x {1}".format(*size)
        lines.append(f"A, K = 5 on 3 patches of {patches}: p_crit off by {limit:.2%}, curve by {curve:.2%}")
    if not quick:
        lines += ["the paper: with growing K the critical pressure grows and its displacement falls; here:"]
        lines += statements(curves)
    if ROOT:
        picture(curves, OUT / "inflated_sphere.png")
        (OUT / "table.txt").write_text("\n".join(lines) + "\n")
        print("\n".join(lines), f"picture: {OUT / 'inflated_sphere.png'}", sep="\n", flush=True)
    for (reading, K), (curve, limit) in errors.items():
        # the project's bounds on 9 cells per edge; what is left is the facets' size: it falls with its square (table)
        larger = (9 / cells) ** 2
        assert curve < 5e-3 * larger and limit < 3e-3 * larger, f"reading {reading}, K = {K}: {curve:.2%}, {limit:.2%}"


if __name__ == "__main__":
    main(quick="--quick" in sys.argv)
