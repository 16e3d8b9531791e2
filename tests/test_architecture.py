"""Who may know what: imports, version tests and sizes of every module of the package, read from its syntax."""

import ast
import os
import shutil
import subprocess
import time
from pathlib import Path

import pytest

pytestmark = pytest.mark.serial

PACKAGE = Path(__file__).parents[1] / "fenics_contact"
STANDARD = {"__future__", "abc", "argparse", "ast", "base64", "collections", "compileall", "concurrent", "contextlib",
            "copy", "csv", "ctypes", "dataclasses", "difflib", "errno", "functools", "gc", "hashlib", "html", "importlib",
            "inspect", "io", "itertools", "json", "linecache", "logging", "math", "numbers", "os", "pathlib", "platform",
            "re", "resource", "runpy", "shutil", "statistics", "subprocess", "sys", "sysconfig", "tempfile", "textwrap",
            "time", "traceback", "types", "typing", "warnings", "weakref", "xml", "zipfile", "zlib"}  # fmt: skip
LONGEST_MODULE = 400
MOST_ARGUMENTS = 6
# What takes more today, and how many: the table may only shrink.
MORE_ARGUMENTS = {
    # the user's own calls, whose words are named
    "contact/friction.py: coulomb": 7,
    "contact/tools.py: rigid_punch": 7,
    "result.py: plot": 7,
    "run.py: solve": 9,
    "scene/scene.py: __init__": 7,
    "scene/scene.py: contact": 7,
    "studies/charts.py: work_precision": 7,
    "studies/stability.py: stability_map": 9,
    "studies/sweep.py: curves": 7,
    # the parameters of a study, a column each
    "studies/cylinder.py: cylinder": 14,
    "studies/economy.py: plate": 8,
    "studies/hertz.py: hertz": 9,
    "studies/punch.py: punch": 12,
    "studies/sphere.py: sphere": 7,
    "studies/tubes.py: tubes": 9,
}

MOST_METHODS = 20
LONGEST_FUNCTION = 60  # lines without its docstring

# room: what its modules may import besides the standard library, the room itself, and `types`
TABLE = {
    "blas": set(),
    "form_files": {"ffcx", "fcntl"},
    "packages": {"blas"},
    "types": {"numpy"},
    "compat": {"dolfinx", "basix", "_cffi_backend", "cffi", "ffcx", "numpy", "mpi4py", "numba", "petsc4py", "ufl", "blas",
               "form_files"},
    "values": {"numpy"},
    "units": {"values"},
    "timing": set(),
    "agreement": {"numpy", "mpi4py"},
    "uncaught": {"numpy", "mpi4py", "agreement"},
    "folded": {"gmsh", "basix", "numpy"},
    "curved": {"gmsh", "numpy", "meetings"},
    "meetings": {"numpy", "kernels"},
    "mesh_files": {"gmsh", "numpy", "meetings", "packages"},
    "gmsh_model": {"gmsh", "numpy", "curved", "folded", "meetings", "mesh_files"},
    "mesh_io": {"gmsh", "numpy", "mpi4py", "agreement", "compat", "folded", "gmsh_model", "meetings", "values"},
    "kernels": {"numpy", "numba"},
    "solid": {"numpy", "mpi4py", "basix", "ufl", "assembly", "compat", "values"},
    "contact": {"numpy", "mpi4py", "basix", "kernels", "assembly", "compat", "timing", "values"},
    "assembly": {"numpy", "mpi4py", "petsc4py", "basix", "kernels", "compat", "timing"},
    "solvers": {"numpy", "mpi4py", "petsc4py", "assembly", "compat", "timing"},
    "scene": {"numpy", "mpi4py", "ufl", "agreement", "assembly", "compat", "contact", "meetings", "mesh_io", "solid",
              "timing", "units", "values"},
    "output": {"numpy", "mpi4py", "basix", "matplotlib", "agreement", "compat", "assembly", "contact", "kernels", "solid",
               "scene", "units", "values"},
    "studies": {"numpy", "scipy", "matplotlib", "tqdm", "mpi4py", "petsc4py", "ufl", "meshes", "agreement", "assembly",
                "compat", "solid", "mesh_io", "contact", "packages", "output", "result", "solvers", "scene", "options",
                "plans", "run", "timing", "uncaught", "units"},
    "options": {"numpy", "contact", "scene", "solvers", "values"},
    "restart": {"numpy", "mpi4py", "agreement", "assembly", "solvers", "options", "output", "scene", "values"},
    "recording": {"contact", "tqdm", "options", "output", "scene", "solvers", "restart", "values"},
    "result": {"numpy", "matplotlib", "agreement", "assembly", "output", "scene", "solvers", "values"},
    "plans": {"numpy", "assembly", "solvers", "scene", "options", "values"},
    "costs": {"assembly", "output", "plans", "recording", "scene", "solvers"},
    "run": {"numpy", "tqdm", "agreement", "compat", "timing", "assembly", "contact", "costs", "solvers", "output", "scene",
            "options", "plans", "recording", "restart", "result", "units", "values"},
    # what the package offers to its users
    "warm": {"gmsh", "tqdm", "compat", "contact", "kernels", "mesh_io", "meshes", "options", "run", "scene", "solid"},
    "__main__": {"numpy", "meshes", "__version__", "compat", "contact", "mesh_io", "options", "run", "scene", "solid",
                 "warm"},
    "__init__": {"packages", "values", "mesh_io", "contact", "solid", "scene", "solvers", "options", "output", "result",
                 "run", "uncaught", "units"},
}  # fmt: skip
# narrower than the room: what an outer room may use of another one
ONLY = {
    ("studies", "assembly"): {"system", "term", "pattern", "cell_forms"},  # their names; what a tangent is assembled into
    ("studies", "output"): {"curves", "late", "names"},  # names of columns; what draws
    ("output", "scene"): {"scene", "symmetry"},  # what is drawn and written, and what it stands for
    ("output", "assembly"): {
        "contact_term",
        "entries",
        "exchange",
        "facet_points",
        "finding",
        "numbering",
        "pose",
        "section",
        "size",
        "system",
        "term",
    },
    ("output", "contact"): {"tools"},  # their shapes, to draw them
    ("output", "kernels"): {"pixels", "rigid_profiles", "rigid_shapes", "status"},
    ("output", "solid"): {"body", "virtual_power"},
    ("assembly", "kernels"): {"block_products", "law", "scatter", "sets"},
    ("restart", "scene"): {"start", "stated"},
    ("run", "contact"): {"tools"},  # the keys of move and push
    ("recording", "contact"): {"images", "overlap"},  # what bodies do that no contact holds
    ("options", "contact"): {"tools"},
    ("__init__", "contact"): {"friction", "penalties", "profiles", "tools"},
    ("meetings", "kernels"): {"broad_phase", "sets"},
    ("__init__", "output"): {"film"},
    ("__init__", "solid"): {"materials"},
}
MODULES = sorted(PACKAGE.rglob("*.py"))


def room_of(path):
    return path.relative_to(PACKAGE).with_suffix("").parts[0]


def names_imported(tree):
    """(line, dotted name) of every import; `from a import b` gives a.b."""
    for node in ast.walk(tree):
        if isinstance(node, ast.Import):
            yield from ((node.lineno, alias.name) for alias in node.names)
        elif isinstance(node, ast.ImportFrom):
            base = "." * node.level + (node.module or "")
            yield from ((node.lineno, f"{base}.{alias.name}") for alias in node.names)


def wrong_imports(room, source, table=TABLE):
    """What a source text imports though its room may not."""
    wrong = []
    for line, name in names_imported(ast.parse(source)):
        parts = name.split(".")
        if parts[0] == "fenics_contact":
            target = parts[1] if len(parts) > 1 else ""  # `import fenics_contact` is never right inside it
            allowed = target in table[room] or target in (room, "types")
            only = ONLY.get((room, target))
            allowed = allowed and (only is None or bool(only & set(parts[2:3])))
        else:
            allowed = parts[0] in STANDARD or parts[0] in table[room]  # a relative import has no first part
        if not allowed:
            wrong.append(f"line {line}: {name}")
    return wrong


def private_imports(source):
    """What a source text takes from another module of the package though its name says that it is that one's own."""
    names = [name.split(".") for _, name in names_imported(ast.parse(source))]
    return [".".join(n) for n in names if n[0] == "fenics_contact" and n[-1].startswith("_") and not n[-1].endswith("__")]


def local_imports(source):
    return [n.lineno for f in functions(source) for n in ast.walk(f) if isinstance(n, ast.Import | ast.ImportFrom)]


def prints(source):
    calls = [n for n in ast.walk(ast.parse(source)) if isinstance(n, ast.Call)]
    return [c.lineno for c in calls if isinstance(c.func, ast.Name) and c.func.id == "print"]


LIBRARIES = {"dolfinx", "fem", "basix", "ufl", "io", "mesh", "fem_petsc"}


def version_tests(source):
    """Comparisons of a version, or questions for a capability of dolfinx: `x.__version__ < ...`, hasattr(fem, ...)."""
    found = []
    for node in ast.walk(ast.parse(source)):
        if isinstance(node, ast.Attribute) and node.attr == "__version__":
            of = node.value.id if isinstance(node.value, ast.Name) else ""
            if of in LIBRARIES:
                found.append(node.lineno)
        elif isinstance(node, ast.Compare) and any("version" in ast.unparse(s).lower() for s in ast.walk(node)
                                                   if isinstance(s, ast.Attribute | ast.Name)):  # fmt: skip
            found.append(node.lineno)
        elif isinstance(node, ast.Call) and isinstance(node.func, ast.Name):
            # getattr without a default looks a name up, for instance a cell type's; with one it asks a question
            asks = node.func.id == "hasattr" or (node.func.id == "getattr" and len(node.args) == 3)
            if asks and ast.unparse(node.args[0]).split(".")[0] in LIBRARIES:
                found.append(node.lineno)
            # whether a library's attribute is a method or a property changes between versions
            if node.func.id == "callable" and isinstance(node.args[0], ast.Attribute):
                found.append(node.lineno)
    return found


# What nobody but its own methods changes, however it is reached
CLOSED = {"system", "term", "contact", "fluid", "partner", "places", "surface", "trial", "history", "law", "trail",
          "foresight", "acceptance", "holds", "supports", "border", "damping", "grounding", "results", "scales", "softened",
          "solver", "springs", "stages"}  # fmt: skip


def set_from_outside(source):
    """Attributes that are set on a System, a term or what these consist of, and questions whether an object has one."""
    found = []
    for node in ast.walk(ast.parse(source)):
        targets = node.targets if isinstance(node, ast.Assign) else [getattr(node, "target", None)]
        targets = [part for target in targets for part in (target.elts if isinstance(target, ast.Tuple) else [target])]
        for target in targets:
            while isinstance(target, ast.Subscript):
                target = target.value
            owner = target.value if isinstance(target, ast.Attribute) else ast.Name("")
            of = ast.unparse(owner.func if isinstance(owner, ast.Call) else owner).split(".")[-1].lstrip("_")
            if of in CLOSED:
                found.append(f"line {node.lineno}: {ast.unparse(target)}")
        if isinstance(node, ast.Call) and ast.unparse(node.func) == "hasattr":
            found.append(f"line {node.lineno}: {ast.unparse(node)}")
    return found


MAKERS = {f"np.{name}" for name in ("empty", "zeros", "ones", "full", "arange", "array", "append", "concatenate", "where",
                                    "empty_like", "zeros_like", "full_like")}  # fmt: skip


def made_in_loops(source):
    """Lines on which arrays are made in a loop, but where one has become too short: under `if len(array) < ...`."""
    loops = [n for n in ast.walk(ast.parse(source)) if isinstance(n, ast.For | ast.While)]
    inside = [part for loop in loops for statement in loop.body for part in ast.walk(statement)]
    grown = [n for n in inside if isinstance(n, ast.If) and ast.unparse(n.test).startswith("len(")]
    fine = {part for one in grown for statement in one.body for part in ast.walk(statement)}
    calls = [n for n in inside if isinstance(n, ast.Call) and n not in fine]
    return [n.lineno for n in calls if ast.unparse(n.func) in MAKERS or ast.unparse(n.func).endswith(".copy")]


def arguments(function):
    """Arguments of a function, but self and cls."""
    a = function.args
    several = [one for one in (a.vararg, a.kwarg) if one]
    return [one for one in [*a.posonlyargs, *a.args, *a.kwonlyargs, *several] if one.arg not in ("self", "cls")]


def functions(source):
    return [n for n in ast.walk(ast.parse(source)) if isinstance(n, ast.FunctionDef | ast.AsyncFunctionDef)]


def untyped(source):
    """Lines of functions that leave an argument, or what they return, without a type."""
    return [f.lineno for f in functions(source) if f.returns is None or any(a.annotation is None for a in arguments(f))]


@pytest.mark.parametrize("path", MODULES, ids=lambda p: str(p.relative_to(PACKAGE)))
def test_module(path):
    source, room = path.read_text(), room_of(path)
    assert room in TABLE, f"{room} is a new room: say in the table of this test what it may know"
    assert not wrong_imports(room, source)
    assert not private_imports(source), "what modules share has a public name"
    assert not local_imports(source), "import at the top: an import inside a function hides a dependency"
    if room == "kernels":
        assert not made_in_loops(source), "what a loop works in is made before it"
    if path.name != "__main__.py":
        assert not prints(source), "the package shows its progress through hooks and writes files; scripts print"
    if room != "compat":
        assert not version_tests(source), "differences between versions belong into compat.py"
        assert not set_from_outside(source), "terms change by their own methods; what one can do is declared"
    assert len(source.splitlines()) <= LONGEST_MODULE
    assert not untyped(source), "every argument and every return has its type"
    if source.strip():
        assert ast.get_docstring(ast.parse(source)), "the first line says what the module knows"


def test_functions_take_few_arguments():
    found = [(path, f.name, len(arguments(f))) for path in MODULES for f in functions(path.read_text())]
    more = [(f"{path.relative_to(PACKAGE)}: {name}", count) for path, name, count in found if count > MOST_ARGUMENTS]
    assert sorted(more) == sorted(MORE_ARGUMENTS.items())


def code_lines(function):
    """Lines of a function without its docstring."""
    text = function.body[0] if ast.get_docstring(function) is not None else None
    return function.end_lineno - function.lineno + 1 - (text.end_lineno - text.lineno + 1 if text else 0)


def large_classes(source):
    """Names of classes with more methods than are read at once."""
    classes = [n for n in ast.walk(ast.parse(source)) if isinstance(n, ast.ClassDef)]
    return [c.name for c in classes if sum(isinstance(n, ast.FunctionDef) for n in c.body) > MOST_METHODS]


def test_functions_are_short_and_classes_have_few_methods():
    for path in MODULES:
        source, name = path.read_text(), path.relative_to(PACKAGE)
        assert not large_classes(source), f"{name}: split where an object can be said in one sentence"
        long = [f.name for f in functions(source) if code_lines(f) > LONGEST_FUNCTION]
        assert not long, f"{name}: about 15 lines are good, {LONGEST_FUNCTION} the most"


def test_what_a_system_consists_of_does_not_know_it():
    knowing = {path.name for path in MODULES if room_of(path) == "assembly" and "assembly.system" in path.read_text()}
    assert knowing == {"memory.py"}


TWICE = {"Body", "Findings", "Linearised"}  # a user's body and what is asked of it; what a term's and a contact's are; alike


def test_a_name_of_a_class_stands_for_one():
    classes = [n.name for path in MODULES for n in ast.walk(ast.parse(path.read_text())) if isinstance(n, ast.ClassDef)]
    assert {name for name in classes if classes.count(name) > 1 and not name.startswith("_")} == TWICE


def test_every_room_of_the_table_exists():
    assert {room_of(path) for path in MODULES} == set(TABLE)


def test_rooms_do_not_know_each_other_in_circles():
    waiting = {room: {r for r in allowed if r in TABLE} for room, allowed in TABLE.items()}
    while waiting:
        ready = [room for room, needs in waiting.items() if not needs & set(waiting)]
        assert ready, f"a circle among {sorted(waiting)}"
        for room in ready:
            del waiting[room]


@pytest.mark.parametrize(
    ("check", "source"),
    [
        (lambda s: wrong_imports("kernels", s), "import dolfinx"),
        (lambda s: wrong_imports("contact", s), "from dolfinx import fem"),
        (lambda s: wrong_imports("solvers", s), "from fenics_contact.contact import term"),
        (lambda s: wrong_imports("solvers", s), "from fenics_contact import contact"),
        (lambda s: wrong_imports("solvers", s), "import fenics_contact"),
        (lambda s: wrong_imports("output", s), "from fenics_contact import kernels"),
        (lambda s: wrong_imports("solid", s), "from . import compat"),
        (lambda s: wrong_imports("output", s), "from fenics_contact.kernels.law import traction"),
        (set_from_outside, "for term in terms:\n    term.name = 1.0"),
        (set_from_outside, "contact.law, contact.friction = law, friction"),
        (set_from_outside, "self._contact.trial = trial"),
        (set_from_outside, "system.contact_terms[0].places.search += 1.0"),
        (set_from_outside, "border.corner[mine, mine] += 1.0"),
        (set_from_outside, "_damping(system).share = 0.0"),
        (set_from_outside, "if hasattr(term, 'only'): pass"),
        (made_in_loops, "for i in range(n):\n    a = np.zeros(3)"),
        (made_in_loops, "while True:\n    if n > 0:\n        a = b.copy()"),
        (local_imports, "def f():\n    import os"),
        (private_imports, "from fenics_contact.solvers.newton import _forcing"),
        (prints, "def f():\n    print(1)"),
        (untyped, "def f(a, b: int) -> None: ..."),
        (large_classes, "class A:\n" + "".join(f"    def f{i}(self): ...\n" for i in range(21))),
        (lambda s: code_lines(functions(s)[0]) == 3, 'def f():\n    """Two\n    lines."""\n    a = 1\n    return a'),
        (untyped, "def f(*, a: int): ..."),
        (untyped, "def f(**a) -> None: ..."),
        (version_tests, "if hasattr(fem, 'functionspace'): pass"),
        (version_tests, "f = getattr(fem, 'functionspace', None)"),
        (version_tests, "d = e.degree() if callable(e.degree) else e.degree"),
        (version_tests, "new = dolfinx.__version__"),
        (version_tests, "if compat.DOLFINX_VERSION > '0.9': pass"),
    ],
)
def test_the_checks_find_what_they_look_for(check, source):
    assert check(source)


def test_an_edited_kernel_has_all_of_them_compiled_anew(tmp_path):
    """By make: Numba alone keeps a kernel in whose callees something has changed."""
    kernels = tmp_path / "fenics_contact" / "kernels"
    cache = kernels / "__pycache__"
    cache.mkdir(parents=True)
    shutil.copy(PACKAGE.parent / "Makefile", tmp_path)
    files = [kernels / name for name in ("law.py", "element.py")]
    kept = [cache / name for name in ("element.f-1.py311.nbi", "element.f-1.py311.1.nbc")]
    left = []
    for edited in (files, [], files[:1]):
        for file in edited:
            file.write_text("")
            os.utime(file, (time.time() + 2 * len(left),) * 2)
        for file in kept:
            file.write_text("")
        subprocess.run(["make", "-s", str(cache.relative_to(tmp_path) / "fresh")], cwd=tmp_path, check=True)
        left.append([file.exists() for file in kept])
    assert left == [[False, False], [True, True], [False, False]]
