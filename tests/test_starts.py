"""What a process imports."""

import subprocess
import sys
from importlib.machinery import FileFinder

import numpy as np
import pytest
import ufl

from fenics_contact import compat, neo_hooke, read_gmsh
from fenics_contact.meshes import box
from fenics_contact.solid import virtual_power

pytestmark = pytest.mark.serial


def test_a_run_and_a_study_s_case_import_nothing_that_draws_or_fits():
    code = "import sys, fenics_contact.studies; print({'matplotlib', 'scipy.optimize'} & set(sys.modules))"
    assert subprocess.run([sys.executable, "-c", code], capture_output=True, text=True, check=True).stdout == "set()\n"


def test_no_form_has_the_whole_cache_looked_through(monkeypatch):
    """A cache of forms grows with the user's scenes; what is compiled is found in it by name."""
    mesh = read_gmsh(box.build)

    def form():
        return compat.compile_form(virtual_power.energy_density(neo_hooke(0.4, 2.0), u) * ufl.dx(degree=2))

    u = compat.Function(compat.lagrange_space(mesh.domain, 1, (3,)))
    u.x.array[:] = np.random.default_rng(0).uniform(-0.01, 0.01, u.x.array.size)
    energy = compat.assemble_scalar(form())  # may compile it
    monkeypatch.setattr(FileFinder, "find_spec", lambda self, name, target=None: pytest.fail(f"{name} is looked for"))
    assert compat.assemble_scalar(form()) == energy > 0.0
