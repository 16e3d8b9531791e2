"""The audit of a tangent: right on every block of scenes in contact, and wrong where a tangent is spoilt."""

from dataclasses import replace

import numpy as np
import pytest
from mpi4py import MPI

from fenics_contact import Body, Method, Scene, mooney_rivlin, neo_hooke, read_gmsh, rigid_plane, rigid_punch, solve
from fenics_contact.meshes import box, two_blocks

pytestmark = pytest.mark.parallel
COMM = MPI.COMM_WORLD
RUBBER = mooney_rivlin(a1=0.1863, a2=0.0098, K=5.0)


def punched(mu=0.3, **options):
    """A block on a rough floor under a pushed punch and a follower pressure: points stick and slip."""
    mesh = read_gmsh(box.build, size=(10.0, 10.0, 4.0), cells=(5, 5, 2), origin=(-5.0, -5.0, -4.0))
    scene = Scene(Body(mesh, "box", RUBBER))
    tool = rigid_punch(half_width=3.0, height=5.0, fillet=1.0)
    scene.contact("zmax", tool, mu, name="punch", **options)
    scene.contact("zmin", rigid_plane((0, 0, -4.0), name="floor"), 0.3, name="floor", **options)
    scene.fix("xmax", "x")
    scene.fix("ymin", "y")
    scene.pressure("xmin", 0.02)
    return solve(scene, push={tool: (0.5, 0, -4.0)}, steps=2).require()


def blocks():
    mesh = read_gmsh(two_blocks.build, lower_cells=(6, 6, 2), upper_cells=(4, 4, 1))
    scene = Scene(Body(mesh, "lower", RUBBER), Body(mesh, "upper", RUBBER))
    scene.fix("lower_bottom")
    scene.prescribe("upper_top", "x", lambda X, t: np.full(len(X), 1.0 * max(t - 0.5, 0.0)))
    scene.fix("upper_top", "y")
    scene.prescribe("upper_top", "z", lambda X, t: np.full(len(X), -2.0 * min(t, 0.5)))
    scene.contact("upper_bottom", "lower_top", 0.5, name="c")
    return solve(scene, steps=2).require()


@pytest.fixture(scope="module")
def result():
    return punched()


def names(audit):
    return {block.name for block in audit.blocks}


def test_every_block_of_a_right_tangent(result):
    before = result.u.x.array.copy()
    audit = result.audit()
    assert audit.right, str(audit)
    assert {"punch: normal", "floor: normal", "floor: stick", "pressure", "solid"} <= names(audit)
    assert any("slip" in name for name in names(audit))
    assert all(1.8 <= block.order <= 2.2 or np.isinf(block.order) for block in audit.blocks), str(audit)
    np.testing.assert_array_equal(result.u.x.array, before)
    assert result.system.assemble_residual() <= 1e-8 * result.system.scales.accepted  # areas, friction and history are back
    assert "order" in str(audit) and "WRONG" not in str(audit)


@pytest.mark.parametrize("scene", [blocks, lambda: punched(penetration=1e-5)], ids=["bodies", "augmented"])
def test_other_contacts(scene):
    audit = scene().audit()
    assert audit.right and len(audit.blocks) > 2, str(audit)


def test_the_order_of_newton_is_seen():
    """A smooth scene, without contact and with the tolerance of a third quadratic iteration."""
    scene = Scene(Body(read_gmsh(box.build, size=(2.0, 2.0, 2.0), cells=(2, 2, 2)), "box", neo_hooke(0.4, 2.0)))
    scene.fix("zmin")
    scene.traction("zmax", (0.05, 0.0, 0.1))
    result = solve(scene, steps=1, method=Method(tolerance=1e-10)).require()
    assert 1.7 < result.audit().newton_order < 2.6  # two, as far as three numbers tell


@pytest.mark.parametrize("law", ["normal", "stick", "slip", "solid", "pressure"])
def test_a_spoilt_tangent_is_caught(result, law, monkeypatch):
    """One block counts twice in the tangent: that block is named, and those of other laws and terms are not."""
    system = result.system
    kind = law if law in ("solid", "pressure") else "floor"
    term = next(term for term in system.terms if term.name == kind)
    right = term.tangent

    def spoilt(state, trials):
        blocks = right(state, trials)
        if kind != "floor":
            return replace(blocks, forms=2 * blocks.forms)
        codes, (nodes, values) = {"normal": 1, "stick": 2, "slip": 3}, blocks.cells
        trial = trials[term]
        held = term.response(state, trial).status[trial.area > 0.0]
        twice = COMM.allreduce(int((held == codes[law]).sum())) > 0
        return replace(blocks, cells=(nodes, 2.0 * values)) if twice else blocks

    monkeypatch.setattr(term, "tangent", spoilt)
    audit = result.audit()
    wrong = [block.name for block in audit.blocks if not block.right]
    assert not audit.right and "WRONG" in str(audit)
    assert wrong == [f"floor: {law}" if kind == "floor" else law]
    assert all(block.order < 1.2 for block in audit.blocks if not block.right)  # a remainder of first order
