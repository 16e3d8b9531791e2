"""Elements near incompressibility: Cook's membrane, a bonded strip and a thick sphere over K / mu = 1 ... 10 000.

Every element of the package, hexahedra of degree 1 and 2 with the same number of nodes, on one law (classical Mooney-Rivlin,
only K varies). The error of one displacement or force per problem: against the exact radial solution for the sphere,
computed here, and against a mixed mesh of degree 2 twice as fine for the others. Units: mm, N, MPa.

    mpirun -n 2 python3 demos/locking.py   # --quick: half the cells and two K / mu, seconds
"""

import sys
from pathlib import Path

import numpy as np
from matplotlib.figure import Figure
from mpi4py import MPI
from numpy.polynomial import Polynomial
from scipy.optimize import minimize

from fenics_contact import Body, Method, Output, Scene, compat, mooney_rivlin, read_gmsh, solve
from fenics_contact.meshes import box, cook, sphere_shell
from fenics_contact.solid.materials import moderate_pressure

OUT = Path("results/locking")
A1, A2 = 0.1863, 0.0098
MU = 2 * (A1 + A2)
RATIOS = 10.0 ** np.arange(5)  # K / mu
CELLS = {"membrane": 16, "strip": 4, "sphere": 4}  # of degree 1, half as many of degree 2
ELEMENTS = [("displacement", 1), ("mixed", 1), ("displacement", 2), ("mixed", 2)]
INNER, OUTER, PRESSURE = 50.0, 100.0, 0.15  # of the sphere
COMM = MPI.COMM_WORLD


def rubber_scene(mesh, K, element, degree):
    bulk = compat.Constant(mesh.domain, K)  # one compiled form serves all K
    law = mooney_rivlin(A1, A2, K, volumetric=lambda J, _: moderate_pressure(J, bulk))
    return Scene(Body(mesh, *mesh.volumes, law), degree=degree, element=element, accept_locking=True)


def computed(scene, steps):
    result = solve(scene, steps=steps, out=Output(progress=False), method=Method(linear="direct"))
    if not result.converged:
        raise SystemExit(f"{scene.element}, degree {scene.degree}: {result.verdict.reason}")
    return result, result.u.function_space.tabulate_dof_coordinates()


def displacement(result, X, place, axis):
    here = result.u.x.array[axis::3][np.linalg.norm(X - place, axis=1) < 1e-6]
    return COMM.allreduce(here.max(initial=-np.inf), op=MPI.MAX)


def membrane(K, element, degree, finer=1):
    """Deflection of the upper corner of Cook's membrane under 20 kPa."""
    scene = rubber_scene(read_gmsh(cook.build, cells=CELLS["membrane"] // degree * finer), K, element, degree)
    scene.fix("left")
    scene.fix(("front", "back"), "z")
    scene.traction("right", (0.0, 0.02, 0.0))
    result, X = computed(scene, 1)
    return displacement(result, X, (48, 60, 0), 1), result.verdict


def strip(K, element, degree, finer=1):
    """Force per depth of a strip 80 x 10 mm, bonded to two plates that squeeze it by 5 %."""
    cells = CELLS["strip"] // degree * finer
    mesh = read_gmsh(box.build, size=(40.0, 5.0, 5.0 / cells), cells=(8 * cells, cells, 1))
    scene = rubber_scene(mesh, K, element, degree)
    scene.fix(("xmin", "ymax"), "x")
    scene.fix("ymin", "y")
    scene.fix(("zmin", "zmax"), "z")
    scene.prescribe("ymax", "y", -0.25)
    (result, X), forces = computed(scene, 1), np.zeros(3 * len(scene.space.tabulate_dof_coordinates()))
    result.system.terms[0].add_residual(result.system.state, forces, None)
    return -2 * COMM.allreduce(forces[1::3][X[:, 1] > 5.0 - 1e-9].sum()) / (5.0 / cells), result.verdict


def sphere(K, element, degree):
    """Radial displacement of the inner surface of a thick sphere under a pressure that follows it."""
    cells = CELLS["sphere"]
    mesh = read_gmsh(sphere_shell.build, inner=INNER, thickness=OUTER - INNER, cells=cells, layers=cells // degree)
    scene = rubber_scene(mesh, K, element, degree)
    for axis in "xyz":
        scene.fix(f"symmetry_{axis}", axis)
    scene.pressure("inner", PRESSURE)
    result, X = computed(scene, 2)
    return displacement(result, X, (INNER, 0, 0), 0), result.verdict


def exact_sphere(K):
    """The same of the compressible sphere: least energy over the inner radius and J(R) = 1 + a polynomial."""
    x, w = np.polynomial.legendre.leggauss(40)
    half = (OUTER - INNER) / 2
    radius = Polynomial([INNER + half, half])  # R(x), -1 < x < 1
    R = radius(x)

    def energy(z):
        J = Polynomial([1.0]) + Polynomial(z[1:]) / max(K / MU, 1.0)
        swept = (3 * half * radius**2 * J).integ(lbnd=-1)
        hoop = np.cbrt((INNER * z[0]) ** 3 + swept(x)) / R
        q = hoop**3 / J(x)  # hoop over radial stretch
        first, second = q ** (-4 / 3) + 2 * q ** (2 / 3), 2 * q ** (-2 / 3) + q ** (4 / 3)
        W = A1 * (first - 3) + A2 * (second - 3) + moderate_pressure(J(x), K)
        return ((half * w * R**2) @ W - PRESSURE / 3 * (INNER * z[0]) ** 3) / INNER**3

    return INNER * (minimize(energy, [1.0, *np.zeros(8)], options={"gtol": 1e-10, "maxiter": 2000}).x[0] - 1)


PROBLEMS = {
    "Cook's membrane": (membrane, lambda K: membrane(K, "mixed", 2, finer=2)[0]),
    "bonded strip": (strip, lambda K: strip(K, "mixed", 2, finer=2)[0]),
    "thick sphere": (sphere, exact_sphere),
}


def picture(errors, ratios, path):
    figure = Figure(figsize=(6.3, 5.5), layout="constrained")
    *panels, corner = figure.subplots(2, 2).flat
    for axes, name in zip(panels, PROBLEMS, strict=True):
        for element, degree in ELEMENTS:
            mark, colour = ("o--", "s-")[degree - 1], f"C{['displacement', 'mixed'].index(element)}"
            line = np.abs(errors[name, element, degree])
            axes.loglog(ratios, line, f"{colour}{mark}", fillstyle="none", label=f"{element}, degree {degree}")
        axes.set_title(name)
        axes.set_xlabel("K / μ")
        axes.set_ylabel("relative error")
    corner.set_axis_off()
    corner.legend(*panels[0].get_legend_handles_labels(), loc="center")
    figure.savefig(path, dpi=150)


def main(quick=False):
    errors, lines, ratios = {}, [], RATIOS[::4] if quick else RATIOS
    if quick:
        CELLS.update(membrane=8, strip=2, sphere=2)

    def say(line):
        lines.append(line)
        if COMM.rank == 0:
            print(line, flush=True)

    say(f"error [%] (Newton iterations, with cut-backs)   K / mu = {' '.join(f'{ratio:14g}' for ratio in ratios)}")
    for name, (problem, reference) in PROBLEMS.items():
        exact = np.array([reference(ratio * MU) for ratio in ratios])
        for element, degree in ELEMENTS:
            values, verdicts = zip(*(problem(ratio * MU, element, degree) for ratio in ratios), strict=True)
            errors[name, element, degree] = np.array(values) / exact - 1
            cells = [
                f"{100 * e:8.3f} ({v.iterations:2d}{f', {v.cuts}' if v.cuts else ''})".ljust(17)
                for e, v in zip(errors[name, element, degree], verdicts, strict=True)
            ]
            say(" ".join([f"{name:16} {element:13} degree {degree}", *cells]))
    if COMM.rank == 0:
        OUT.mkdir(parents=True, exist_ok=True)
        picture(errors, ratios, OUT / "locking.png")
        (OUT / "table.txt").write_text("\n".join(lines) + "\n")
    say(f"picture: {OUT / 'locking.png'}")
    # against exact_sphere: without locking the error does not double over four decades of K
    for degree in (1, 2):
        assert abs(errors["thick sphere", "mixed", degree][-1]) < 2 * abs(errors["thick sphere", "mixed", degree][0])


if __name__ == "__main__":
    main(quick="--quick" in sys.argv)
