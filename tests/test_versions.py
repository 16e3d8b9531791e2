"""The same scalars on every dolfinx: coarse versions of the demos' scenes against values recorded once.

`versions.json` was written on Debian 12 (dolfinx 0.5.2) by `python3 tests/test_versions.py`; the suite runs on Debian 12
and Debian 13 and holds both to it.
"""

import json
from pathlib import Path

import numpy as np
import pytest

from fenics_contact import (
    Body,
    Method,
    Scene,
    compat,
    mooney_paper,
    mooney_rivlin,
    read_gmsh,
    rigid_plane,
    rigid_punch,
    solve,
)
from fenics_contact.meshes import punch_plate, two_blocks

RECORD = Path(__file__).with_name("versions.json")
CASES = [(0.0, 0.0), (0.3, 0.0), (1.0, 0.0), (0.0, 1.0)]  # friction of the demo: punch, floor


def punch_scalars(case, degree=1):
    mesh = read_gmsh(punch_plate.build, inside=5, outside=4, layers=3, ratio=1.2)
    scene = Scene(Body(mesh, "plate", mooney_paper(a1=0.1863, a2=0.0098, K=5.0)), degree=degree)
    scene.fix("symmetry_x", "x")
    scene.fix("symmetry_y", "y")
    punch = rigid_punch(half_width=20.0, height=10.0, face=(0, 0, 10))
    scene.contact("top", punch, case[0], name="top")
    scene.contact("bottom", rigid_plane(), case[1], name="bottom")
    result = solve(scene, move={punch: (0, 0, -0.8)}, steps=4)
    last = result.history[-1]
    return {name: last[name] for name in ("top_force_x_N", "top_force_z_N", "top_moment_x_Nmm", "smallest_J")}


def sliding_scalars():
    """Two blocks pressed by 1 mm, then dragged by 2 mm."""
    mesh = read_gmsh(two_blocks.build, lower_cells=(6, 6, 2), upper_cells=(4, 4, 2))
    rubber = mooney_rivlin(a1=0.1863, a2=0.0098, K=5.0)
    scene = Scene(Body(mesh, "lower", rubber), Body(mesh, "upper", rubber))
    scene.fix("lower_bottom")
    scene.fix("upper_top", "y")
    scene.prescribe("upper_top", "x", lambda X, t: np.full(len(X), 2.0 * max(2 * t - 1, 0.0)))
    scene.prescribe("upper_top", "z", lambda X, t: np.full(len(X), -min(2 * t, 1.0)))
    scene.contact("upper_bottom", "lower_top", friction=0.3, name="interface")
    result = solve(scene, steps=4, method=Method(tolerance=1e-11))
    return {name: result.history[-1][name] for name in ("interface_force_x_N", "interface_force_z_N", "smallest_J")}


def scalars():
    values = {f"punch {a:g} {b:g}": punch_scalars((a, b)) for a, b in CASES}
    return values | {"punch 0.3 0, degree 2": punch_scalars((0.3, 0.0), degree=2)} | {"sliding blocks": sliding_scalars()}


@pytest.mark.parallel
def test_scalars_do_not_depend_on_the_version():
    record, now = json.loads(RECORD.read_text()), scalars()
    assert record["scalars"].keys() == now.keys()
    for scene, values in now.items():
        # 1e-8 is required; Newton stops at 1e-8 of the force and its last quadratic step goes far below
        assert values == pytest.approx(record["scalars"][scene], rel=1e-8), scene


if __name__ == "__main__":
    content = {"dolfinx": compat.versions()["dolfinx"], "scalars": scalars()}
    RECORD.write_text(json.dumps(content, indent=2) + "\n")
