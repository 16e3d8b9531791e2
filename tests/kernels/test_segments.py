"""Parts of a facet that lie over one facet of the master each: they add up, and their samples integrate what they should."""

import numpy as np
import pytest

from fenics_contact.contact.samples import corner_shapes, gauss
from fenics_contact.kernels.coverage import beyond_edges
from fenics_contact.kernels.segments import facet_parts

pytestmark = pytest.mark.serial

SQUARE = np.array([[0.2, 0.1, 0.05], [1.9, 0.0, 0.05], [2.1, 1.8, 0.05], [0.1, 2.0, 0.05]])[::-1]  # looks down
TRIANGLE = np.array([[0.2, 0.1, 0.05], [0.4, 1.9, 0.05], [2.0, 0.3, 0.05]])


def plate(cells, turn, size=6.0, centre=(1.0, 1.0)):
    """Positions and facets of a square plate that looks up, its grid turned."""
    s = np.linspace(-size / 2, size / 2, cells + 1)
    c, d = np.cos(turn), np.sin(turn)
    x = np.array([[c * a - d * b + centre[0], d * a + c * b + centre[1], 0.0] for b in s for a in s])
    n = cells + 1
    facets = [[i + n * j, i + 1 + n * j, i + 1 + n * (j + 1), i + n * (j + 1)] for j in range(cells) for i in range(cells)]
    return x, (np.array(facets), np.full(len(facets), 4))


def sites(corners, x, surface, part=2, ellipse=True):
    """Places and weights of the samples of one facet that looks down on a surface."""
    m, nf = len(corners), len(surface[0])
    slave = len(x) + np.arange(m)[None, :], np.array([[0.0, 0.0, -1.0]])
    near = (np.array([0, nf]), np.arange(nf)), 1.0
    out = np.empty(2, np.int64), np.empty((500, 2)), np.empty(500)
    rules = gauss(4, part), gauss(3, part), gauss(m, 3), ellipse
    master = surface, beyond_edges(surface)
    count = facet_parts(np.concatenate([x, corners]), slave, master, near, rules, out)
    return out[1][:count], out[2][:count]


@pytest.mark.parametrize("corners", [SQUARE, TRIANGLE], ids=["quadrilateral", "triangle"])
@pytest.mark.parametrize("turn", [0.0, 0.3, np.pi / 4])
@pytest.mark.parametrize("ellipse", [True, False])
def test_what_is_quadratic_on_each_facet_of_the_master_is_integrated(corners, turn, ellipse):
    """Against many samples of the whole facet: a kink where edges cross it, a quadratic function in between."""
    x, surface = plate(5, turn)
    places, weights = sites(corners, x, surface, ellipse=ellipse)
    assert len(weights) > 12 and (weights > 0.0).all()

    def integral(places, weights):
        N, gradients = corner_shapes(len(corners), places)
        (one, two), p = (gradients[:, a] @ corners[:, :2] for a in (0, 1)), N @ corners[:, :2]
        c, d = np.cos(turn), np.sin(turn)
        along = np.array([c * (p[:, 0] - 1.0) + d * (p[:, 1] - 1.0), c * (p[:, 1] - 1.0) - d * (p[:, 0] - 1.0)]) / 1.2 + 0.5
        within = along - np.floor(along)
        f = (within * (1.0 - within)).sum(axis=0)  # quadratic in a cell, and continuous over its edges
        return (f * weights * np.abs(one[:, 0] * two[:, 1] - one[:, 1] * two[:, 0])).sum()

    s = (np.arange(2000) + 0.5) / 2000
    if len(corners) == 4:
        fine = np.stack(np.meshgrid(2 * s - 1, 2 * s - 1), axis=-1).reshape(-1, 2)
        reference = integral(fine, np.full(len(fine), 4.0 / len(fine)))
    else:
        a, b = (part.ravel() for part in np.meshgrid(s, s))
        reference = integral(np.column_stack([a, (1 - a) * b]), (1 - a) / len(a))
    assert abs(integral(places, weights) / reference - 1) < 1e-5  # the reference's own error
    with_gauss = abs(integral(*gauss(len(corners), 3)) / reference - 1)
    assert with_gauss > 1e-3


@pytest.mark.parametrize("corners, area", [(SQUARE, 4.0), (TRIANGLE, 0.5)], ids=["quadrilateral", "triangle"])
def test_samples_lie_inside_and_weigh_as_much_as_the_facet(corners, area):
    for turn in np.linspace(0.0, np.pi / 2, 23):
        x, surface = plate(5, turn)
        places, weights = sites(corners, x, surface)
        inside = corner_shapes(len(corners), places)[0]
        assert abs(places).max() < 1.0 and inside.min() > 0.0
        if area == 0.5:
            np.testing.assert_allclose(
                weights.sum(), area, rtol=1e-12
            )  # seen area and that of coordinates are in proportion


def test_a_facet_over_one_facet_has_the_samples_of_a_whole_one():
    x, surface = plate(1, 0.2)
    for corners in (SQUARE, TRIANGLE):
        places, weights = sites(corners, x, surface)
        np.testing.assert_array_equal(places, gauss(len(corners), 3)[0])
        np.testing.assert_array_equal(weights, gauss(len(corners), 3)[1])


def test_facets_at_the_end_of_the_master_go_on_beyond_it():
    """A little of the slave's facet overhangs: it is cut along the edges that go on, not along the end."""
    x, surface = plate(4, 0.0, size=4.0, centre=(0.0, 1.0))  # ends at x = 2
    square = np.array([[0.5, 0.0, 0.0], [0.5, 1.6, 0.0], [2.1, 1.6, 0.0], [2.1, 0.0, 0.0]])
    places, weights = sites(square, x, surface)
    assert len(weights) == 4 * 4  # edges at x = 1 and y = 1
    np.testing.assert_allclose(weights.sum(), 4.0, rtol=1e-12)
