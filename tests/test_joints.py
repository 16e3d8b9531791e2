"""Feet on an edge between two facets: one of these speaks for both sides."""

import numpy as np
import pytest

from fenics_contact import Body, Scene, SceneError, coulomb, neo_hooke, read_gmsh, solve
from fenics_contact.contact.joints import NEAR, Joints
from fenics_contact.meshes import two_blocks

WAY = np.array([1.0, 0.0, 0.0])


def grid(n=3):
    """Nodes, sizes and places of n x n quadrilaterals, the last one cut into two triangles."""
    number = np.arange((n + 1) ** 2).reshape(n + 1, n + 1)
    quads = [(number[i, j], number[i + 1, j], number[i + 1, j + 1], number[i, j + 1]) for i in range(n) for j in range(n)]
    a, b, c, d = quads.pop()
    nodes = np.array([*quads, (a, b, c, -1), (a, c, d, -1)])
    x, y = np.meshgrid(np.arange(n + 1.0), np.arange(n + 1.0), indexing="ij")
    return nodes, np.array([4] * len(quads) + [3, 3]), np.column_stack([x.ravel(), y.ravel(), np.zeros(x.size)])


def foot(nodes, size, X, place):
    """All (facet, xi) in which a place of the plane lies, on the border too."""
    found = []
    for f, count in enumerate(size):
        x0, x1, x2 = X[nodes[f, :3], :2]
        if count == 3:
            s, t = np.linalg.solve(np.column_stack([x1 - x0, x2 - x0]), place - x0)
            inside = min(s, t, 1 - s - t) > -1e-9
        else:
            s, t = 2 * (place - 0.5 * (x0 + x2)) / (x2 - x0)
            inside = max(abs(s), abs(t)) < 1 + 1e-9
        if inside:
            found.append((f, (s, t)))
    return found


def test_both_sides_of_an_edge_and_all_around_a_node_have_one_facet():
    nodes, size, X = grid()
    joints, rng = Joints(nodes, size, X, WAY), np.random.default_rng(1)
    places = [np.array(p) for p in ((1.0, 0.5), (1.5, 2.0), (1.0, 1.0), (2.0, 2.0), (2.5, 2.5), (3.0, 1.0), (2.0, 2.4))]
    for place in places:
        shaken = [place] + [place + rng.uniform(-0.2, 0.2, 2) * NEAR for _ in range(20)]
        feet = [one for p in shaken for one in foot(nodes, size, X, np.clip(p, 0.0, 3.0))]
        speaking = joints.speaking(np.array([f for f, _ in feet]), np.array([xi for _, xi in feet]))
        assert len({f for f, _ in feet}) > 1 and len(set(speaking)) == 1, place
    inner = np.array([0, 4, len(nodes) - 1]), np.array([[0.3, -0.9], [0.0, 0.0], [0.3, 0.3]])
    np.testing.assert_array_equal(joints.speaking(*inner), inner[0])
    assert joints.speaking(np.array([-1]), np.zeros((1, 2)))[0] == -1


def test_the_facet_is_the_same_in_another_pose_and_numbering():
    nodes, size, X = grid()
    turn, _ = np.linalg.qr(np.random.default_rng(2).standard_normal((3, 3)))
    turn *= np.sign(np.linalg.det(turn))
    order = np.random.default_rng(3).permutation(len(nodes))
    other = Joints(nodes[order], size[order], X @ turn.T + [5.0, -2.0, 1.0], turn @ WAY)
    facet = np.repeat(np.arange(8), 4)
    xi = np.tile([[1.0, 0.0], [0.0, 1.0], [-1.0, -1.0], [1.0, 1.0]], (8, 1))
    place = np.argsort(order)
    np.testing.assert_array_equal(order[other.speaking(place[facet], xi)], Joints(nodes, size, X, WAY).speaking(facet, xi))


def test_a_direction_may_have_any_length():
    for length in (1e-200, 1e-160, 3.0, 1e200):
        law = coulomb(0.3, across=0.5, along=(0.6 * length, 0.8 * length, 0.0))
        assert law.along == pytest.approx((0.6, 0.8, 0.0), rel=1e-15)


@pytest.mark.parallel
def test_a_direction_normal_to_the_whole_master_is_refused():
    mesh = read_gmsh(two_blocks.build, lower_cells=(3, 3, 1), upper_cells=(2, 2, 1))
    scene = Scene(*(Body(mesh, name, neo_hooke(mu=20.0, K=40.0)) for name in ("lower", "upper")))
    scene.fix("lower_bottom")
    scene.fix("upper_top")
    scene.contact("upper_bottom", "lower_top", friction=coulomb(0.3, across=0.5, along=(0, 0, 2)), name="c")
    with pytest.raises(SceneError, match=r"along=\(0, 0, 1\) is normal to the whole master"):
        solve(scene, steps=1)


@pytest.mark.parallel
@pytest.mark.parametrize(("lower", "upper"), [((6, 4, 1), (4, 3, 1)), ((4, 4, 1), (3, 3, 1))])
@pytest.mark.parametrize(("along", "across"), [(0.1, 0.4), (0.1, 0.05), (0.2, 0.4)])
def test_centred_blocks_can_be_pressed_on_each_other(lower, upper, along, across):
    """The middles of the slave's facets lie on edges of the master, and with them samples: directions that jumped there from
    solve to solve left a millionth of the force out of balance. The law stated the other way round says the same."""
    rubber, found = neo_hooke(mu=20.0, K=40.0), []
    for law in (coulomb(along, across=across, along=(1, 0, 0)), coulomb(across, across=along, along=(0, 1, 0))):
        size = {"lower": (4, 3, 1), "lower_origin": (-2, -1.5, -1), "upper": (2, 2, 0.8), "upper_origin": (-1, -1, 0)}
        mesh = read_gmsh(two_blocks.build, **size, lower_cells=lower, upper_cells=upper)
        scene = Scene(Body(mesh, "lower", rubber), Body(mesh, "upper", rubber))
        scene.fix("lower_bottom")
        scene.fix("upper_top", "xy")
        scene.prescribe("upper_top", "z", -0.03)
        scene.contact("upper_bottom", "lower_top", friction=law, name="c")
        result = solve(scene, steps=2).require()
        assert result.verdict.cuts == 0 and result.verdict.iterations <= 12
        found.append(result.history[-1]["c_force_z_N"])
    assert found[0] == pytest.approx(found[1], rel=5e-5)  # F d and F across it are not quite at a right angle
