"""This package in a race: `python3 -m fenics_contact.studies.peers.ours SCENE CELLS LAYERS`, also under mpirun."""

import json
import sys

from fenics_contact.contact.tools import rigid_punch
from fenics_contact.mesh_io import read_gmsh
from fenics_contact.meshes import punch_plate
from fenics_contact.run import solve
from fenics_contact.scene.scene import Scene
from fenics_contact.scene.statements import Body
from fenics_contact.solid.materials import mooney_rivlin
from fenics_contact.studies.peers.plate import A1, A2, FRICTION, HEIGHT, STEPS, TRAVEL, K


def run(scene_name: str, cells: int, layers: int) -> dict[str, float]:
    """The force on the plate [N], unknowns and tangents of a scene of plate.py."""
    parity = scene_name == "parity"
    mesh = read_gmsh(punch_plate.build, inside=cells, outside=cells, layers=layers, ratio=1.0, patch=parity)
    scene = Scene(Body(mesh, "plate", mooney_rivlin(A1, A2, K)))
    for group, axis in (("symmetry_x", "x"), ("symmetry_y", "y"), ("bottom", "z")):
        scene.fix(group, axis)
    steps = STEPS[scene_name]
    if parity:
        scene.prescribe("under_punch", "z", -TRAVEL * steps)
        result = solve(scene, steps=steps, progress=False).require()
        force = result.history[-1]["under_punch_reaction_z_N"]
    else:
        tool = rigid_punch(half_width=20.0, height=HEIGHT, face=(0, 0, HEIGHT))
        scene.contact("top", tool, FRICTION[scene_name], name="top")
        result = solve(scene, move={tool: (0, 0, -TRAVEL * steps)}, steps=steps, progress=False).require()
        force = result.history[-1]["top_force_z_N"]
    return {
        "force_N": abs(float(force)), "unknowns": result.summary["sizes"]["unknowns"],
        "tangents": result.verdict.iterations, "ranks": result.system.comm.size,
    }  # fmt: skip


if __name__ == "__main__":
    found = run(sys.argv[1], int(sys.argv[2]), int(sys.argv[3]))
    sys.stdout.write(f"{json.dumps(found)}\n")
