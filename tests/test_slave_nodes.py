"""Slave nodes on a body, which look along the normals of their facets: far sliding, tributary areas, borders."""

import numpy as np
import pytest
from test_sliding_far import strip

from fenics_contact import Body, Scene, mooney_rivlin, read_gmsh, solve
from fenics_contact.contact.surface import slave_surface
from fenics_contact.meshes import two_blocks, two_cylinders
from fenics_contact.studies import tubes

RUBBER = mooney_rivlin(a1=0.1863, a2=0.0098, K=5.0)
DOWN, STEPS = 0.25, 16


@pytest.mark.parallel
def test_nodes_slide_over_the_master_without_hooking():
    """The blocks of demos/block_on_block.py on a coarser mesh, over four facets.

    A closest point on the facet that bends up over the leading edge holds the row that leads by the facet's slope: force
    ratios up to 0.33 and five times the tangents.
    """
    mesh = read_gmsh(two_blocks.build, lower_cells=(12, 12, 2), upper_cells=(8, 8, 2))
    scene = Scene(Body(mesh, "lower", RUBBER), Body(mesh, "upper", RUBBER))
    scene.fix("lower_bottom")
    scene.prescribe("upper_top", "x", lambda X, t: np.full(len(X), 10.0 * max(t - DOWN, 0.0) / (1.0 - DOWN)))
    scene.fix("upper_top", "y")
    scene.prescribe("upper_top", "z", lambda X, t: np.full(len(X), -2.0 * min(t / DOWN, 1.0)))
    scene.contact("upper_bottom", "lower_top", 0.3, points="corners", name="c")
    result = solve(scene, steps=STEPS).require()
    assert result.verdict.cuts == 0 and result.verdict.iterations <= 5 * STEPS  # what the sliding blocks may take per step
    ratio = -result.column("c_force_x_N") / result.column("c_force_z_N")
    sliding = ratio[result.column("t") > 0.5]
    assert sliding.min() >= 0.28 and sliding.max() <= 0.30  # the finer blocks in another code
    assert np.abs(result.column("c_force_y_N")).max() < 1e-4  # N of 100: symmetry, to the solver's tolerance


@pytest.mark.serial
@pytest.mark.parametrize(
    "build, bodies, group", [(two_cylinders.build, ("lower", "upper"), "upper_rim"), (strip, ("strip", "block"), "foot")]
)
def test_corners_share_the_tributary_areas_of_their_nodes(build, bodies, group):
    """On quadrilaterals that grow away from the middle, and on unstructured triangles."""
    mesh = read_gmsh(build)
    scene = Scene(*(Body(mesh, body, RUBBER) for body in bodies), accept_locking=True)
    modulus = np.ones(mesh.domain.topology.index_map(3).size_local)
    corners, nodes = (slave_surface(scene.space, mesh.facets(group), modulus, points) for points in ("corners", "nodes"))
    shares = np.bincount(corners.nodes.ravel(), np.einsum("eqk,eq->ek", corners.a, corners.area).ravel())
    assert np.abs(shares[nodes.nodes[:, 0]] - nodes.area[:, 0]).max() < 1e-13 * nodes.area.max()
    at = np.einsum("eqk,ekc->eqc", corners.a, corners.X)
    assert np.abs(at - corners.X).max() < 1e-13 * np.abs(corners.X).max()  # a point is its node


@pytest.mark.serial
def test_nodes_on_planes_of_symmetry_stay_in_contact(monkeypatch):
    """There the normals of polygons lean out of the tubes, and miss the other one."""
    found = []
    monkeypatch.setattr(tubes, "solve", lambda *args, **options: found.append(solve(*args, **options)) or found[-1])
    base = {name: value for name, value in tubes.BASE.items() if name != "processes"}
    row = tubes.tubes(**base | {"points": "nodes"})
    assert row["converged"] and row["error"] < 0.005  # 0.4 % is what Gauss points leave on this mesh
    contact, state = found[0].system.contact_terms[0], found[0].system.state
    x, pressure = contact.spots(), contact.forces.split_traction(state)[0].ravel()
    angle = np.degrees(np.arctan2(x[:, 1], x[:, 0]))
    # four slave facets cover three of the master: the pattern repeats every 15 degrees
    like = [pressure[np.abs(angle - place) < 0.1].mean() for place in (0.0, 45.0, 90.0)]
    assert np.ptp(like) < 5e-3 * like[1]  # normals that lean by 1.9 degrees cost 0.05 %, the mesh the rest
