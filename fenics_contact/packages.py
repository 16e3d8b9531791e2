"""The modules that the package needs and the Debian packages that bring them: a missing one is named with its package."""

import gc
import sys
from collections.abc import Iterator
from contextlib import contextmanager
from importlib import import_module
from importlib.metadata import distribution
from importlib.util import find_spec
from types import ModuleType

from fenics_contact import blas

# numba and gmsh before dolfinx: it makes the symbols of its hundred libraries global, and every library loaded after them
# looks for each of its own symbols there first (0.65 instead of 0.85 s)
NAMES = ("numpy", "numba", "gmsh", "dolfinx", "ufl", "basix", "petsc4py", "mpi4py", "matplotlib", "tqdm", "scipy", "meshio")
PACKAGES = {name: f"python3-{name}" for name in NAMES}


def require(*names: str) -> None:
    """Import modules of PACKAGES. Raises ImportError that names the first missing one, or the one that it needs itself."""
    for name in names:
        try:
            import_module(name)
        except ImportError as error:
            root = (error.name or _missing_under(name)).partition(".")[0]
            missing = root if root in PACKAGES else name
            told = str(error).splitlines()[0]
            raise ImportError(
                f"{missing} is missing ({told}): install Debian's package {PACKAGES[missing]} and use /usr/bin/python3 or "
                "a virtual environment made from it with --system-site-packages (`make demo` does both)"
            ) from error


def _missing_under(name: str) -> str:
    """What a module needs that cannot be imported, where its error names none: that of Debian 13's dolfinx does not."""
    for needed in ("numpy", "mpi4py", "petsc4py", "ufl", "basix"):
        try:
            import_module(needed)
        except ImportError:
            return needed
    return name


@contextmanager
def _own_versions() -> Iterator[None]:
    """Debian 12's ufl and ffcx ask pkg_resources for their own versions, and for nothing else: here these are looked up
    without what that reads of all installed packages first, an eighth of the import."""
    stub = ModuleType("pkg_resources")
    stub.get_distribution = distribution  # type: ignore[attr-defined]
    known = sys.modules.setdefault("pkg_resources", stub)
    try:
        yield
    finally:
        if known is stub:
            del sys.modules["pkg_resources"]


def module(name: str) -> ModuleType:
    """A module of PACKAGES that few need, imported where it is needed. Raises ImportError as `require` does."""
    require(name)
    return import_module(name)


# those of the studies and of one kind of mesh file are required where they are used; of one that is only loaded once
# something is drawn it is enough that it is there
LATER = ("scipy", "meshio", "matplotlib")
blas.prepare()  # the first of them, NumPy, may load it
collects = gc.isenabled()
gc.disable()  # of hundreds of modules nothing becomes garbage, and the collector need not look through them later either
try:
    with _own_versions():
        require(*(name for name in PACKAGES if name not in LATER))
finally:
    gc.freeze()
    if collects:
        gc.enable()
if find_spec("matplotlib") is None:
    require("matplotlib")
