"""What a process imports."""

import subprocess
import sys

import pytest

pytestmark = pytest.mark.serial


def test_a_run_and_a_study_s_case_import_nothing_that_draws_or_fits():
    code = "import sys, fenics_contact.studies; print({'matplotlib', 'scipy.optimize'} & set(sys.modules))"
    assert subprocess.run([sys.executable, "-c", code], capture_output=True, text=True, check=True).stdout == "set()\n"
