"""Shallow ironing: a stiff round indenter is pressed into a soft block and drawn along it with friction, then lifted.

The scene of Fischer & Wriggers (2006, doi:10.1016/j.cma.2005.09.025) and later papers, whose published forces scatter;
plane strain, one layer of hexahedra. Units: mm, N, MPa.

    mpirun -n 2 python3 demos/ironing.py
"""

from pathlib import Path

import numpy as np

from fenics_contact import Body, Scene, from_elastic, read_gmsh, solve
from meshes import ironing

OUT = Path("results/ironing")
E, HARDER, NU, FRICTION = 689.6, 10.0, 0.32, 0.3  # MPa; indenter over foundation
DEPTH = 0.125  # mm, of the slice
PRESS, DRAW = 1.0, 10.0  # mm
VERTICAL, RATIO = (335.0, 420.0), (0.30, 0.53)  # N/mm and 1: published plateaus


def down(X, time):
    """0 to 1: down; 1 to 2: along; 2 to 3: up."""
    return np.full(len(X), -PRESS * np.interp(3 * time, [0, 1, 2, 3], [0, 1, 1, 0]))


def along(X, time):
    return np.full(len(X), DRAW * np.interp(3 * time, [1, 2], [0, 1]))


def iron(foundation, indenter, slave, master, steps, **contact):
    mesh = read_gmsh(ironing.build, foundation=foundation, indenter=indenter, depth=DEPTH)
    scene = Scene(Body(mesh, "foundation", from_elastic(E, NU)), Body(mesh, "indenter", from_elastic(HARDER * E, NU)))
    scene.fix("foundation_bottom")
    scene.fix("ends", "y")
    scene.prescribe("indenter_top", "x", along)
    scene.prescribe("indenter_top", "z", down)
    scene.contact(slave, master, FRICTION, name="interface", **contact)
    press, draw, lift = steps
    times = (
        np.concatenate([np.linspace(0, 1, press + 1)[1:], np.linspace(1, 2, draw + 1)[1:], np.linspace(2, 3, lift + 1)[1:]])
        / 3
    )
    result = solve(scene, steps=times, out=OUT, progress=False)
    return scene, result
