"""Of a wrong statement that ends a script its message and the script's own line are printed, once; of a bug all there is."""

import re
import subprocess
import sys

import pytest
from test_restart import alone, mpirun

from fenics_contact import ArcSteps, Body, Load, Motion, Scene, Stage, neo_hooke, read_gmsh, rigid_punch, solve
from fenics_contact.meshes import box
from fenics_contact.studies import Study
from fenics_contact.uncaught import unknown_word

pytestmark = pytest.mark.serial

SCRIPT = """
import sys
from mpi4py import MPI
import fenics_contact.run
from fenics_contact import Body, Scene, neo_hooke, read_gmsh, rigid_plane, solve
from fenics_contact.meshes import box

what, rank = sys.argv[1], MPI.COMM_WORLD.rank
fenics_contact.uncaught.PATIENCE = 5.0  # seconds that a rank waits for the others before it ends them
scene = Scene(Body(read_gmsh(box.build, cells=(2, 2, 2)), "box", neo_hooke(1.0, 5.0)))
scene.fix("zmin")

def mine(view):
    if what == "everywhere" or rank == 1:
        return {}["no such thing"]
    return 1.0

if what == "name":
    scene.fix("botom")
if what == "word":
    solve(scene, steps=1, tolerance=1e-10)
if what == "folder":
    solve(scene, out="/proc/nothing", steps=1)
if what == "tool":
    rigid_plane((0, 0, 1), normal=(0, 0, 0))
if what in ("one rank", "a bug on one rank") and rank == 1:
    scene.fix("botom" if what == "one rank" else [].index(1))
scene.prescribe("zmax", "z", 0.1)
if what == "bug":
    fenics_contact.run.errors = lambda *a: [].index(1)
    solve(scene, steps=1)
if what in ("everywhere", "somewhere"):
    solve(scene, steps=1, record={"mine": mine})
solve(scene, steps=1)
"""


# mpirun's daemon and its libraries: "[host:pid] PMIX ERROR ...", "[warn] Epoll ADD(4) on fd 30 failed. ..."
LAUNCHER = re.compile(r"^\[.*\n?", re.MULTILINE)


def said(tmp_path, what, ranks=1):
    """Exit code and stderr of the script, without what mpirun says itself."""
    path = tmp_path / "scene.py"
    path.write_text(SCRIPT)
    command = [*(mpirun(ranks) if ranks > 1 else []), sys.executable, str(path), what]
    done = subprocess.run(command, env=alone(), cwd=tmp_path, capture_output=True, text=True, timeout=200)
    return done.returncode, LAUNCHER.sub("", done.stderr.split("-" * 60)[0])


WRONG = [
    ("name", 'scene.fix("botom")', "SceneError: there is no surface, edge or point group 'botom'"),
    ("folder", 'solve(scene, out="/proc/nothing", steps=1)', "FolderError: output folder '/proc/nothing'"),
    (
        "word",
        "solve(scene, steps=1, tolerance=1e-10)",
        "TypeError: solve has no 'tolerance' of its own: give method=Method(",
    ),
    ("tool", "rigid_plane((0, 0, 1), normal=(0, 0, 0))", "SceneError: plane: normal must not be the zero vector"),
]


@pytest.mark.parametrize("what, line, message", WRONG)
def test_a_wrong_statement_shows_its_line_and_message_alone(tmp_path, what, line, message):
    code, text = said(tmp_path, what)
    first, place, shown, last = text.strip().splitlines()
    assert code == 1 and first.startswith("Traceback") and "scene.py" in place
    assert shown.strip() == line and last.startswith(message)


@pytest.mark.parametrize(
    "call",
    [
        lambda: rigid_punch(1.0, 1.0, (0, 0, 0), 0.5),
        lambda: Stage("in", {}),
        lambda: ArcSteps(Load(1.0), None),
        lambda: Motion((0, 0, 0)),
    ],
)
def test_what_no_order_tells_is_named(call):
    """One of many values more or less, or a new one among them, would change what the others mean, in silence."""
    with pytest.raises(TypeError, match="positional"):
        call()


def test_of_a_word_that_a_call_has_not_it_is_said_where_it_lives_or_what_it_resembles():
    """Of the package's functions, called by a script: not of one of the script's own, nor where the package errs itself."""

    def told(call):
        with pytest.raises(TypeError) as error:
            call()
        return unknown_word(error.value)

    scene = Scene(Body(read_gmsh(box.build, cells=(1, 1, 1)), "box", neo_hooke(1.0, 5.0)))
    where = {"method=Method": "tolerance smallest_step stabilise damping linear", "steps=ArcSteps": "until back stations",
             "out=Output": "checkpoint resume overwrite progress folder"}  # fmt: skip
    for place, words in where.items():
        for word in words.split():
            said = told(lambda word=word: solve(scene, **{word: 1}))
            assert said == f"solve has no '{word}' of its own: give {place}({word}=...)"
    said = told(lambda: scene.contact("zmax", "zmin", factor=1.0))
    assert said == "Scene.contact has no 'factor' of its own: give penalty=Penalty(factor=...)"
    assert told(lambda: Stage("in", tolerance=1.0)).startswith("Stage has no 'tolerance'; it has name, ")  # the whole run's
    for call, words in (
        (lambda: solve(scene, tolerence=1.0), "solve has no 'tolerence'; did you mean method=Method(tolerance=...)?"),
        (lambda: solve(scene, step=1), "solve has no 'step'; did you mean steps=...?"),
        (lambda: scene.contact("zmax", "zmin", fricton=1.0), "did you mean friction=...?"),
        (lambda: Body(scene.mesh, "box", materials=1), "Body has no 'materials'; did you mean material=...?"),
        (lambda: Scene(bodies=[]), "Scene has no 'bodies'; it has "),
        (lambda: Study("a", dict, [], output=["F"]), "Study has no 'output'; did you mean outputs=...?"),
    ):
        assert words in told(call)

    exec(
        "def solve(scene, **options): scene.quite_other(**options)\nclass Scene:\n    def quite_other(self): pass",
        mine := {},
    )
    assert told(lambda: mine["solve"](mine["Scene"](), tolerance=1.0)) is None
    assert told(lambda: [].sort(by=1)) is None


def test_on_several_ranks_it_is_said_once(tmp_path):
    code, text = said(tmp_path, "name", ranks=2)
    assert code == 1 and len(text.strip().splitlines()) == 4 and text.count("'botom' in the mesh") == 1


@pytest.mark.parametrize("what, message", [("one rank", "'botom' in the mesh"), ("a bug on one rank", "is not in list")])
def test_what_fails_on_one_rank_alone_ends_all(tmp_path, what, message):
    """The others wait for it, and nothing can tell them."""
    code, text = said(tmp_path, what, ranks=2)
    assert code == 1 and text.count(message) == 1 and "rank 1 has failed" in text


def test_a_bug_keeps_its_traceback(tmp_path):
    """Though it is a ValueError, and the package has called what raised it."""
    code, text = said(tmp_path, "bug")
    assert code == 1 and "run.py" in text and "in solve" in text and "ValueError: 1 is not in list" in text


@pytest.mark.parametrize("what, ranks", [("everywhere", 1), ("everywhere", 2), ("somewhere", 2)])
def test_an_error_in_a_function_of_the_users_shows_where_it_is(tmp_path, what, ranks):
    """Once, whichever rank it is on."""
    code, text = said(tmp_path, what, ranks)
    assert code == 1 and text.count('return {}["no such thing"]') == 1
    assert "SceneError: record 'mine' failed" in text
