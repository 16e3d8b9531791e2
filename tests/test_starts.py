"""What a process imports, and what it loads with compiled kernels."""

import subprocess
import sys

import pytest

pytestmark = pytest.mark.serial

DEAR = ("scipy.linalg", "numba.np.linalg", "numba.np.arraymath", "numba.cpython.unicode")  # what only compiling needs
RUN = """
import sys
from fenics_contact.warm import warm
warm({kind!r})
print([name for name in {dear} if name in sys.modules])
"""


@pytest.mark.parametrize("kind", ["bodies", "Gauss points", "tool"])
def test_kernels_from_the_cache_bring_nothing_along(kind):
    """The first run compiles what the cache may lack."""
    command = [sys.executable, "-c", RUN.format(kind=kind, dear=DEAR)]
    for _ in range(2):
        said = subprocess.run(command, capture_output=True, text=True, check=True).stdout
    assert said.splitlines()[-1] == "[]"


def test_kernels_that_the_cache_lacks_are_compiled(tmp_path):
    """A function that Numba cannot compile without its own implementations, called after one that was loaded."""
    module = tmp_path / "own.py"
    module.write_text(
        "import numpy as np\nfrom numba import njit\nfrom fenics_contact.kernels.sets import join\n"
        "join(np.array([[0, 1]]), np.arange(2))\n"
        "@njit\ndef total(x):\n    return np.linalg.norm(x) + np.cumsum(x)[-1]\n"
        "print(total(np.array([3.0, 4.0])))\n"
    )
    assert subprocess.run([sys.executable, module], capture_output=True, text=True, check=True).stdout == "12.0\n"


def test_a_run_and_a_study_s_case_import_nothing_that_draws_or_fits():
    code = "import sys, fenics_contact.studies; print({'matplotlib', 'scipy.optimize'} & set(sys.modules))"
    assert subprocess.run([sys.executable, "-c", code], capture_output=True, text=True, check=True).stdout == "set()\n"
