"""The pictures of when_a_run_fails.md whose scenes are not in tests/test_verdicts.py: `python3 docs/pages.py failures`."""

import contextlib
import json
import re
import subprocess
import sys
import tempfile
from pathlib import Path

import matplotlib.pyplot as plt
import numpy as np

from fenics_contact import (
    ArcSteps,
    Body,
    Displacement,
    Method,
    Motion,
    Output,
    Scene,
    SceneError,
    Stage,
    coulomb,
    neo_hooke,
    read_gmsh,
    rigid_hub,
    rigid_plane,
    solve,
)
from fenics_contact.meshes import box, rectangles

sys.path.insert(0, str(Path(__file__).parent.parent / "tests"))
from test_verdicts import crushed

MU, K = 1.0, 5.0


def block(cells=(2, 2, 2), size=(2.0, 2.0, 2.0)):
    scene = Scene(Body(read_gmsh(box.build, size=size, cells=cells), "box", neo_hooke(MU, K)))
    scene.fix("zmax", "xy")
    return scene


@contextlib.contextmanager
def chart(path, x, y):
    """Axes of a chart that is then written."""
    figure, axes = plt.subplots(figsize=(5.6, 3.2), layout="constrained")
    axes.set_xlabel(x)
    axes.set_ylabel(y)
    yield axes
    figure.savefig(path, dpi=110)
    plt.close(figure)


def too_stiff(path):
    """Penetration over the typed penalty of a block 2 mm high that is pressed on a floor by 0.2 mm."""
    penalties, depths = 10.0 ** np.arange(2, 17), []
    for penalty in penalties:
        scene = block()
        scene.prescribe("zmax", "z", -0.2)
        scene.contact("zmin", rigid_plane(), penalty=penalty, name="floor")
        result = solve(scene, steps=1, out=Output(progress=False))
        depths.append(result.column("floor_peak_pressure_MPa")[-1] / penalty if result.converged else np.nan)
    with chart(path, "typed penalty [MPa/mm]", "penetration [mm]") as axes:
        depths = np.array(depths)
        axes.loglog(penalties, depths, "o-", color="tab:blue")
        ends = penalties[np.isnan(depths)].min()
        axes.axvspan(ends, penalties[-1], color="0.85")
        axes.text(ends, np.nanmax(depths), " refused:\n round-off\n of the places", va="top")
        axes.axhline(2.0 * np.finfo(float).eps, color="tab:red", linestyle="--")
        axes.text(penalties[0], 3.0 * np.finfo(float).eps, "last digit of a coordinate of 2 mm", color="tab:red")
    return "penalty too stiff"


def outside_a_law(path):
    """A law of friction, how far it was given, and the pressures of a block that is pressed beyond."""

    def law(p):
        return 0.3 / (1.0 + p / 0.5)

    scene = block()
    scene.prescribe("zmax", "z", -0.6)
    scene.contact("zmin", rigid_plane(), coulomb(law, up_to=0.5), name="floor")
    result = solve(scene, steps=8, out=Output(progress=False))
    assert result.verdict.kind == "outside a law", result.verdict.reason
    with chart(path, "pressure over the area at the start [MPa]", "friction μ(p)") as axes:
        p = np.linspace(0.0, 0.8, 100)
        axes.plot(p[p <= 0.5], law(p[p <= 0.5]), color="tab:blue", label="given: up_to=0.5")
        axes.plot(p[p >= 0.5], law(p[p >= 0.5]), ":", color="0.5", label="not known to the run")
        pressed = result.column("floor_load_N") / 4.0  # mm^2: the law takes pressures over the area at the start
        axes.plot(pressed, law(pressed), "o", color="tab:red", label="accepted steps")
        axes.set_ylim(bottom=0.0)
        axes.legend()
    return result.verdict.kind


def out_of_memory(path):
    """Largest memory of a step of a block of cells, direct and iterative, each in a process of its own."""
    with chart(path, "unknowns", "memory of one process [GB]") as axes:
        for linear, marker in (("direct", "o-"), ("iterative", "s-")):
            found = []
            for n in (10, 16, 22, 28, 34):
                done = subprocess.run([sys.executable, __file__, linear, str(n)], capture_output=True, text=True, check=True)
                found.append([float(word) for word in done.stdout.split()[-2:]])
            axes.plot(*np.transpose(found), marker, label=f'linear="{linear}"')
            print(linear, found)
        axes.legend()
    return "out of memory"


def one_step(linear, n):
    """Unknowns, and the largest memory [GB] of a step with so many cells along each edge."""
    scene = block((n, n, n))
    scene.prescribe("zmax", "z", -0.1)
    scene.contact("zmin", rigid_plane(), name="floor")
    solve(scene, steps=1, method=Method(linear=linear), out=Output(progress=False)).require()
    most = re.search(r"VmHWM:\s+(\d+) kB", Path("/proc/self/status").read_text())
    print(3 * (n + 1) ** 3, int(most[1]) / 1e6)


def out_of_steps(path):
    """A cube under a pressure that follows it, past its largest load; eight steps, and as many as it takes."""
    with chart(path, "displacement of the top [mm]", "load factor") as axes:
        for most, style, words in ((200, ".:", "ArcSteps(most=200)"), (8, "o-", "ArcSteps(most=8)")):
            scene, _ = crushed()
            steps = ArcSteps(until=Displacement("zmax", "z", -1.0), most=most)
            top = {"top": lambda view: view.at("zmax").displacement[2]}
            result = solve(scene, steps=steps, record=top, out=Output(progress=False))
            axes.plot(np.append(0.0, result.column("top")), np.append(0.0, result.column("t")), style, label=words)
        axes.axvline(-1.0, color="tab:red", linestyle="--")
        axes.text(-1.0, 0.0, " target", color="tab:red")
        axes.legend()
    return result.verdict.kind


def comes_through(path):
    """Two plates bonded to hubs press on each other; a fluid comes in from the right and lifts the upper one."""
    blocks = {"up": ((0, 1), (4, 1), (20, 5)), "low": ((-1, 0), (6, 1), (22, 4))}
    mesh = read_gmsh(rectangles.build, rectangles=blocks)
    scene = Scene(*(Body(mesh, name, neo_hooke(MU, K)) for name in blocks), plane="strain")
    upper, lower = rigid_hub("upper", (2, 2, 0)), rigid_hub("lower", (2, 0, 0))
    scene.tie("up_ymax", upper)
    scene.tie("low_ymin", lower)
    scene.contact("up_ymin", "low_ymax", 0.1, name="joint")
    scene.pressure(("up_ymin", "up_xmax"), 0.0, where="open", from_="up_xmax")
    scene.pressure("low_ymax", 0.0, where="open", from_="low_xmax")
    fluid = {("up_ymin", "up_xmax"): 0.4, "low_ymax": 0.4}
    result = solve(
        scene,
        stages=[Stage("press", move={upper: Motion(y=-0.1)}, steps=2), Stage("fluid", pressures=fluid, steps=4)],
        out=Output(progress=False),
    )
    result.plot("contact_pressure", path)
    return result.verdict.kind


def ended_by_an_error(path):
    """A function of the user's that fails in the fourth of six steps; what the folder holds."""
    scene = block((4, 4, 4))
    scene.prescribe("zmax", "z", -0.6)
    scene.contact("zmin", rigid_plane(), 0.3, name="floor")
    with tempfile.TemporaryDirectory() as folder:
        with contextlib.suppress(SceneError):
            solve(scene, steps=6, out=Output(folder, progress=False), record={"mine": lambda view: 1.0 / int(view.t < 0.6)})
        rows = np.genfromtxt(Path(folder) / "history.csv", delimiter=",", names=True)
        kind = json.loads((Path(folder) / "summary.json").read_text())["verdict"]["kind"]
    with chart(path, "t", "force on the floor [N]") as axes:
        axes.plot(rows["t"], rows["floor_load_N"], "o-", label="accepted steps, in history.csv")
        axes.axvspan(rows["t"][-1] + 1 / 6, 1.0, color="0.85", label="not run: record= has failed")
        axes.set_xlim(0.0, 1.0)
        axes.legend()
    return kind


DRAWN = (too_stiff, outside_a_law, out_of_memory, out_of_steps, comes_through, ended_by_an_error)

if __name__ == "__main__":
    one_step(sys.argv[1], int(sys.argv[2]))
