"""This package in a race: `python3 -m fenics_contact.studies.peers.ours SCENE CELLS LAYERS`, also under mpirun."""

import json
import sys

from fenics_contact.contact.tools import rigid_punch
from fenics_contact.mesh_io import read_gmsh
from fenics_contact.meshes import punch_plate
from fenics_contact.options import Output
from fenics_contact.run import solve
from fenics_contact.scene.scene import Scene
from fenics_contact.scene.stage import Moves
from fenics_contact.scene.statements import Body
from fenics_contact.solid.materials import mooney_rivlin
from fenics_contact.studies.peers.plate import A1, A2, FRICTION, HALF, HEIGHT, STEPS, TRAVEL, K


def plate(cells: int, layers: int, patch: bool = False) -> Scene:
    """The plate of plate.py on its symmetry planes and its base; patch: with a group of what the punch covers."""
    mesh = read_gmsh(punch_plate.build, inside=cells, outside=cells, layers=layers, ratio=1.0, patch=patch)
    scene = Scene(Body(mesh, "plate", mooney_rivlin(A1, A2, K)))
    for group, axis in (("symmetry_x", "x"), ("symmetry_y", "y"), ("bottom", "z")):
        scene.fix(group, axis)
    return scene


def pressed(scene: Scene, friction: float, travel: float) -> Moves:
    """State the contact of the plate's top with the punch; the way of the latter."""
    tool = rigid_punch(half_width=HALF, height=HEIGHT, face=(0, 0, HEIGHT))
    scene.contact("top", tool, friction, name="top")
    return {tool: (0, 0, -travel)}


def run(scene_name: str, cells: int, layers: int) -> dict[str, float]:
    """The force on the plate [N], unknowns and tangents of a scene of plate.py."""
    parity, steps = scene_name == "parity", STEPS[scene_name]
    scene, move = plate(cells, layers, patch=parity), None
    if parity:
        scene.prescribe("under_punch", "z", -TRAVEL * steps)
    else:
        move = pressed(scene, FRICTION[scene_name], TRAVEL * steps)
    result = solve(scene, move=move, steps=steps, out=Output(progress=False)).require()
    force = result.history[-1]["under_punch_reaction_z_N" if parity else "top_force_z_N"]
    unknowns, tangents = result.summary["sizes"]["unknowns"], result.verdict.iterations
    return {"force_N": abs(float(force)), "unknowns": unknowns, "tangents": tangents}


if __name__ == "__main__":
    found = run(sys.argv[1], int(sys.argv[2]), int(sys.argv[3]))
    sys.stdout.write(f"{json.dumps(found)}\n")
