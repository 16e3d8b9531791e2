"""Slave nodes that supports prescribe along the contact's normal: penalty times overlap acts on them, no body's force."""

import pytest
from mpi4py import MPI

from fenics_contact import Body, Scene, mooney_rivlin, read_gmsh, rigid_plane, rigid_sphere, solve
from fenics_contact.meshes import box

pytestmark = pytest.mark.parallel
COMM = MPI.COMM_WORLD
RUBBER = mooney_rivlin(a1=0.1863, a2=0.0098, K=5.0)


def pressed_beside(slave, **options):
    """A block, held below and at its side xmin, whose edge nodes above are so prescribed, under a plane that comes down."""
    scene = Scene(Body(read_gmsh(box.build, size=(4.0, 2.0, 2.0), cells=(4, 2, 2)), "box", RUBBER))
    scene.fix("zmin")
    scene.fix("xmin")
    plane = rigid_plane((0, 0, 2.0), (0, 0, -1.0), name="plane")
    scene.contact(slave, plane, 0.0, name="c", **options)
    return solve(scene, move={plane: (0, 0, -0.2)}, steps=2)


def led(result):
    return [note for note in result.verdict.notes if "where supports prescribe" in note]


@pytest.mark.parametrize("options", [{}, {"penetration": 1e-4}])
def test_force_on_prescribed_slave_nodes_is_said(options):
    result = pressed_beside("zmax", **options).require()
    (note,) = led(result)
    contact, total = result.system.contacts[0], result.history[0]["c_force_z_N"]
    # the three prescribed nodes: a quarter or half of a facet each, as deep as the plane has come in the first step
    own = max(COMM.allgather(contact.trial.law.eps_n.max(initial=0.0))) * 0.1 * (0.25 + 0.5 + 0.25)
    assert float(note.split(" of the contact's force")[0].split()[-1]) == pytest.approx(own / abs(total), rel=0.01)
    assert note.split("most at ")[1].split(":")[0].endswith(", 1, 2)")  # the middle one, of half a facet
    # what supports hold is no matter of penalties, nor of multipliers
    assert not [other for other in result.verdict.notes if "is not kept" in other or "penalties raised" in other]


def test_prescribed_slave_nodes_that_nothing_touches_are_fine():
    scene = Scene(Body(read_gmsh(box.build, size=(4.0, 2.0, 2.0), cells=(4, 2, 2)), "box", RUBBER))
    scene.fix("zmin")
    scene.fix("xmin")
    ball = rigid_sphere(1.0, (3.0, 1.0, 3.0), name="ball")
    scene.contact("zmax", ball, 0.0, name="c")
    assert not led(solve(scene, move={ball: (0, 0, -0.2)}, steps=2).require())
