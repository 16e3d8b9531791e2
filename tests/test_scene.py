"""Whole scenes against closed forms: two materials in one mesh, .msh files, dead loads."""

import gmsh
import numpy as np
import pytest
from mpi4py import MPI

from fenics_contact import Body, Scene, SceneError, mooney_paper, mooney_rivlin, neo_hooke, read_gmsh, solve

HEIGHTS, MODULI = (1.0, 2.0), ((0.4, 5.0), (1.2, 3.0))  # (mu, K) of the lower and the upper layer


def layers():
    """Two bonded layers of volumes 'lower' and 'upper', 1 x 1 in plan."""
    occ = gmsh.model.occ
    lower, upper = occ.addBox(0, 0, 0, 1, 1, HEIGHTS[0]), occ.addBox(0, 0, HEIGHTS[0], 1, 1, HEIGHTS[1])
    occ.fragment([(3, lower)], [(3, upper)])
    occ.synchronize()
    for _, curve in gmsh.model.getEntities(1):
        gmsh.model.mesh.setTransfiniteCurve(curve, 3)
    for _, face in gmsh.model.getEntities(2):
        gmsh.model.mesh.setTransfiniteSurface(face)
        gmsh.model.mesh.setRecombine(2, face)
    for _, volume in gmsh.model.getEntities(3):
        gmsh.model.mesh.setTransfiniteVolume(volume)
    gmsh.model.mesh.generate(3)
    for _, volume in gmsh.model.getEntities(3):
        name = "lower" if occ.getCenterOfMass(3, volume)[2] < HEIGHTS[0] else "upper"
        gmsh.model.setPhysicalName(3, gmsh.model.addPhysicalGroup(3, [volume]), name)
    for axis, letter in enumerate("xyz"):
        for place, end in ((0.0, "min"), (sum(HEIGHTS) if letter == "z" else 1.0, "max")):
            faces = [f for _, f in gmsh.model.getEntities(2) if abs(occ.getCenterOfMass(2, f)[axis] - place) < 1e-9]
            gmsh.model.setPhysicalName(2, gmsh.model.addPhysicalGroup(2, faces), letter + end)


def confined_stress(stretch, mu, K):
    """Nominal axial stress of neo-Hooke in uniaxial strain, from W(s) = mu/2 (s^(-2/3) (s^2 + 2) - 3) + K/2 (s - 1)^2."""
    return mu / 2 * (4 / 3 * stretch ** (1 / 3) - 4 / 3 * stretch ** (-5 / 3)) + K * (stretch - 1)


def stretch_under(stress, mu, K):
    """Stretch at a nominal stress by bisection: the law is monotone here."""
    low, high = 0.3, 3.0
    for _ in range(60):
        middle = (low + high) / 2
        low, high = (middle, high) if confined_stress(middle, mu, K) < stress else (low, middle)
    return low


def column(mesh):
    scene = Scene(*(Body(mesh, name, neo_hooke(*m)) for name, m in zip(("lower", "upper"), MODULI, strict=True)))
    for side in ("xmin", "xmax"):
        scene.fix(side, "x")
    for side in ("ymin", "ymax"):
        scene.fix(side, "y")
    scene.fix("zmin", "z")
    return scene


def top_displacement(result):
    space = result.u.function_space
    mine = space.tabulate_dof_coordinates()[:, 2] > sum(HEIGHTS) - 1e-9
    values = np.concatenate(space.mesh.comm.allgather(result.u.x.array[2::3][mine]))
    assert np.ptp(values) < 1e-9  # the state is homogeneous in each layer
    return values.mean()


@pytest.mark.parallel
@pytest.mark.parametrize("stress", [-1.0, 0.8])
def test_two_materials_in_series(stress):
    scene = column(read_gmsh(layers))
    scene.traction("zmax", (0, 0, stress))
    result = solve(scene, steps=4)
    expected = sum(h * (stretch_under(stress, *m) - 1) for h, m in zip(HEIGHTS, MODULI, strict=True))
    assert top_displacement(result) == pytest.approx(expected, rel=1e-7)  # the step's own tolerance is 1e-8 of the force


@pytest.mark.parallel
def test_column_under_its_own_weight():
    """Force per reference volume b: the nominal stress at height Z is b (H - Z); linear elements meet the mean of it."""
    scene, weight = column(read_gmsh(layers)), -0.01
    scene.body_force((0, 0, weight))
    result = solve(scene, steps=1)
    Z = np.linspace(0, sum(HEIGHTS), 3001)
    middle = (Z[1:] + Z[:-1]) / 2
    stress = weight * (sum(HEIGHTS) - middle)
    stretch = [stretch_under(s, *MODULI[0 if z < HEIGHTS[0] else 1]) for s, z in zip(stress, middle, strict=True)]
    exact = np.sum(np.array(stretch) - 1) * (Z[1] - Z[0])
    # nodes of a 1-D bar with linear elements are exact but for the law's curvature, of the order of the strain (0.5 %)
    assert top_displacement(result) == pytest.approx(exact, rel=5e-3)


@pytest.mark.parallel
def test_msh_file_gives_the_same_as_its_script(tmp_path_factory):
    comm = MPI.COMM_WORLD
    path = comm.bcast(str(tmp_path_factory.mktemp("mesh") / "layers.msh") if comm.rank == 0 else None)
    if comm.rank == 0:
        gmsh.initialize()
        gmsh.option.setNumber("General.Terminal", 0)
        layers()
        gmsh.write(path)
        gmsh.finalize()
    comm.barrier()
    tops = []
    for mesh in (read_gmsh(layers), read_gmsh(path)):
        scene = column(mesh)
        scene.prescribe("zmax", "z", -0.3)
        tops.append(solve(scene, steps=2).u)
    assert sorted(mesh.volumes) == ["lower", "upper"]
    norms = [comm.allreduce(float(u.x.array[: 3 * u.function_space.dofmap.index_map.size_local].sum())) for u in tops]
    assert norms[0] == pytest.approx(norms[1], rel=1e-10)  # same mesh, same order of sums up to round-off


def test_results_say_which_second_invariant():
    names = [law(0.1863, 0.0098, 5.0).name for law in (mooney_paper, mooney_rivlin)]
    assert "tr(B.B)" in names[0] and "classical" in names[1]


def test_volume_without_material_is_named():
    mesh = read_gmsh(layers)
    with pytest.raises(SceneError, match="upper"):
        Scene(Body(mesh, "lower", neo_hooke(1.0, 5.0)))
