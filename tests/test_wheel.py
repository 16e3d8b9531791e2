"""The wheel as its users have it: built, installed by root, used in another folder by somebody who may not write to it."""

import os
import re
import shutil
import subprocess
import sys
import tempfile
import zipfile
from pathlib import Path

import pytest

from fenics_contact import __version__

pytestmark = pytest.mark.serial

ROOT = Path(__file__).parents[1]
SOURCES = ("pyproject.toml", "README.md", "LICENSE", "LICENSE.GPL", "fenics_contact", "meshes", "demos")
NOBODY = {"user": 65534, "group": 65534, "extra_groups": []} if os.getuid() == 0 else {}  # root may write anywhere
PIP = [sys.executable, "-m", "pip", "--disable-pip-version-check", "--no-input"]
OFFLINE = ["--quiet", "--no-deps", "--no-index"]


def done(command, **options):
    """What a command wrote that ended well; of this environment's variables it sees none that leads to the checkout."""
    env = {name: value for name, value in os.environ.items() if not name.startswith(("PYTHON", "XDG_"))} | options.pop(
        "env", {}
    )
    run = subprocess.run(command, env=env, capture_output=True, text=True, timeout=300.0, **options)
    assert run.returncode == 0, run.stdout + run.stderr
    return run.stdout


@pytest.fixture(scope="module")
def wheel(tmp_path_factory):
    """Built without a network, from a copy without what earlier builds have left."""
    source, out = tmp_path_factory.mktemp("source"), tmp_path_factory.mktemp("wheel")
    for name in SOURCES:
        if (ROOT / name).is_dir():
            shutil.copytree(ROOT / name, source / name, symlinks=True, ignore=shutil.ignore_patterns("__pycache__"))
        else:
            shutil.copy(ROOT / name, source)
    done([*PIP, "wheel", *OFFLINE, "--no-build-isolation", "--wheel-dir", out, "."], cwd=source)
    (path,) = out.glob("*.whl")
    return path


@pytest.fixture(scope="module")
def installed(wheel):
    """(interpreter, its folder of packages) of an environment that holds the wheel and sees the distribution's packages."""
    with tempfile.TemporaryDirectory() as folder:
        os.chmod(folder, 0o755)
        home = Path(folder) / "environment"
        done([sys.executable, "-m", "venv", "--system-site-packages", "--without-pip", home])
        python = home / "bin" / "python"
        done([*PIP, "--python", python, "install", *OFFLINE, wheel])
        (site,) = home.glob("lib/python3*/site-packages")
        for path in [site, *site.rglob("*")]:
            path.chmod(0o555 if path.is_dir() else 0o444)
        yield python, site
        for path in [site, *site.rglob("*")]:
            path.chmod(0o755)


@pytest.fixture(scope="module")
def elsewhere(installed):
    """A function that runs the installation's python in a folder of its own, as a user who has nothing but this."""
    with tempfile.TemporaryDirectory() as folder:
        if NOBODY:
            os.chown(folder, NOBODY["user"], NOBODY["group"])
        env = {"HOME": folder, "MPLCONFIGDIR": folder}

        def python(*arguments):
            return done([installed[0], *arguments], cwd=folder, env=env, **NOBODY), Path(folder)

        yield python


def test_the_wheel_holds_the_package_and_nothing_else(wheel):
    with zipfile.ZipFile(wheel) as archive:
        held = archive.namelist()
        metadata = archive.read(f"fenics_contact-{__version__}.dist-info/METADATA").decode()
    of_package, about = ({name for name in held if name.split("/")[0] == top}
                         for top in ("fenics_contact", f"fenics_contact-{__version__}.dist-info"))  # fmt: skip
    assert of_package | about == set(held), "nothing beside the package: no top-level `meshes`"
    sources = [path for folder in ("fenics_contact", "meshes", "demos") for path in (ROOT / folder).rglob("*.py")]
    wanted = {str(Path("fenics_contact") / str(path.relative_to(ROOT)).removeprefix("fenics_contact/")) for path in sources}
    assert {name for name in of_package if name.endswith(".py")} == wanted
    assert "fenics_contact/py.typed" in held
    assert {"LICENSE", "LICENSE.GPL"} <= {Path(name).name for name in about}
    for line in ("License: LGPL-3.0-or-later", f"Version: {__version__}", "Classifier: Typing :: Typed"):
        assert line in metadata.splitlines()


def test_scripts_import_what_is_installed():
    """`meshes` alone is found in the folder of a checkout only."""
    folders = [ROOT / folder for folder in ("demos", "docs", "fenics_contact", "meshes", "tests")]
    files = [
        ROOT / "README.md",
        *(path for folder in folders for path in folder.rglob("*") if path.suffix in (".py", ".md")),
    ]
    assert not [path for path in files if re.search(r"^\s*(from|import) meshes\b", path.read_text(), re.M)]


def test_it_runs_elsewhere_and_writes_only_there(installed, elsewhere):
    """The check of the installation, a demo, a script of one's own; compiled kernels are kept for the next run."""
    _, site = installed
    before = {path: path.stat().st_mtime for path in site.rglob("*")}
    said, folder = elsewhere("-m", "fenics_contact")
    assert f"fenics_contact {__version__}: dolfinx" in said and "forces are in balance and all tangents are right" in said
    listed = {line.split()[3] for line in said.splitlines() if line.startswith("  python3 -m fenics_contact ")}
    assert listed == {path.stem for path in (ROOT / "demos").glob("*.py")}
    assert list(folder.glob(".cache/numba/**/*.nbi"))
    elsewhere("-m", "fenics_contact", "capstan", "--quick")  # asserts the ratio of its forces
    assert (folder / "results" / "capstan" / "capstan.png").stat().st_size > 10_000
    where, _ = elsewhere("-c", "from fenics_contact.meshes import box; print(box.__file__)")
    assert Path(where.strip()).is_relative_to(site)
    assert {path: path.stat().st_mtime for path in site.rglob("*")} == before


def test_the_full_studies_are_refused_where_their_tables_are_not(elsewhere):
    """They lie beside the sources; a small study goes where it is run."""
    with pytest.raises(AssertionError, match="belong to a checkout.*--quick"):
        elsewhere("-m", "fenics_contact.studies", "sphere")
