"""What is compiled ahead, once, and that laws of one kind share it."""

import subprocess
import sys

import pytest
import ufl

from fenics_contact import compat, warm
from fenics_contact.mesh_io import read_gmsh
from fenics_contact.meshes import box
from fenics_contact.solid import materials, virtual_power

pytestmark = pytest.mark.serial

LAWS = {
    "neo_hooke": [materials.neo_hooke(mu, K) for mu, K in ((0.4, 5.0), (1.7, 90.0))],
    "mooney_rivlin": [materials.mooney_rivlin(*moduli) for moduli in ((0.19, 0.01, 5.0), (0.01, 0.7, 500.0))],
    "yeoh": [materials.yeoh(*moduli) for moduli in ((0.2, -0.01, 1e-3, 5.0), (1.2, 0.1, -2e-3, 50.0))],
    "ogden": [materials.ogden(*moduli) for moduli in (([1.1, 0.1], [2.0, 1.5], 5.0), ([0.7, 0.3], [2.0, 1.5], 50.0))],
}


@pytest.fixture
def caches(tmp_path, monkeypatch):
    """The caches in folders of their own, and the kinds whose scenes were run, each of which leaves a file."""
    folders, run = (tmp_path / "kernels", tmp_path / "forms"), []
    for folder in folders:
        folder.mkdir()

    def compiled(kind):
        run.append(kind)
        (folders[0] / f"{kind}.nbi").touch()
        (folders[1] / f"{kind}.so").touch()

    monkeypatch.setattr(warm, "cache_folders", lambda: folders)
    monkeypatch.setattr(warm, "compile_kind", compiled)
    return folders, run


def test_scenes_are_run_once(caches):
    _, run = caches
    assert "compiled in" in warm.warm() and sorted(run) == sorted(warm.KINDS)
    assert "nothing to compile" in warm.warm() and len(run) == len(warm.KINDS)


@pytest.mark.parametrize("lost", [(0, "tool.nbi"), (1, "tool.so"), (0, "warm.json")])
def test_what_is_lost_from_a_cache_is_compiled_again(caches, lost):
    folders, run = caches
    warm.warm()
    (folders[lost[0]] / lost[1]).unlink()
    warm.warm()
    assert len(run) == 2 * len(warm.KINDS)


def test_another_text_or_version_is_compiled_again(caches, monkeypatch):
    warm.warm()
    monkeypatch.setattr(compat, "versions", lambda: {"numba": "another"})
    warm.warm()
    assert len(caches[1]) == 2 * len(warm.KINDS)


def test_a_scene_that_fails_is_named(monkeypatch):
    monkeypatch.setattr(warm.sys, "executable", "false")
    with pytest.raises(RuntimeError, match="the scene 'tool' failed"):
        warm.compile_kind("tool")


@pytest.mark.slow
@pytest.mark.parametrize("kind", warm.KINDS)
def test_every_kind_runs(kind):
    done = subprocess.run([sys.executable, "-m", "fenics_contact", "warm", kind], capture_output=True, text=True)
    assert done.stdout == f"compiled: {kind}\n", done.stderr


@pytest.mark.parametrize("laws", LAWS.values(), ids=LAWS)
def test_moduli_are_no_part_of_compiled_code(laws):
    """What FFCx tells apart compiled forms by is the same for other moduli; without numbers set apart it is not."""
    space = compat.lagrange_space(read_gmsh(box.build).domain, 1, (3,))
    u, v, du = compat.Function(space), ufl.TestFunction(space), ufl.TrialFunction(space)
    for form in (
        lambda law: virtual_power.stress_power(law, u, v, ufl.dx),
        lambda law: virtual_power.stress_power_rate(law, u, du, v, ufl.dx),
        lambda law: virtual_power.energy_density(law, u) * ufl.dx,
    ):
        one, other = (form(law) for law in laws)
        assert one.signature() != other.signature()
        assert compat.numbers_apart(one).signature() == compat.numbers_apart(other).signature()
