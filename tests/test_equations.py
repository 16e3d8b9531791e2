"""Where the paper's equations are coded: docs/equations.md against the numbers cited in comments and docstrings.

python3 tests/test_equations.py            # the table with file:line
python3 tests/test_equations.py --write    # puts the places cited now into docs/equations.md
"""

import ast
import re
import sys
import tokenize
from functools import cache
from pathlib import Path

import pytest

pytestmark = pytest.mark.serial

ROOT = Path(__file__).parents[1]
PACKAGE, TABLE = ROOT / "fenics_contact", ROOT / "docs" / "equations.md"
EQUATIONS = range(1, 29)
# "(14)", "(26)-(28)"; not the call f(3) nor an exponent x^(2)
CITED = re.compile(r"(?<![\w^\])])\((\d\d?)\)(?:-\((\d\d?)\))?")
ROW = re.compile(r"\| \((\d+)\) \| (.*?) \| (.*?) \|")


def numbers(text):
    """Equations a text cites; (19)(25) are two."""
    text = re.sub(r"\)\(", ") (", text)
    for found in CITED.finditer(text):
        first, last = int(found[1]), int(found[2] or found[1])
        yield from (n for n in range(first, last + 1) if n in EQUATIONS)


def citations(source):
    """(equation, function or "" for the module, line) of every number in the comments and docstrings of a source text."""
    tree = ast.parse(source)
    texts = [(token.start[0], token.string) for token in _tokens(source) if token.type == tokenize.COMMENT]
    spans = [(1, len(source.splitlines()) + 1, "")]
    for node, name in _named(tree):
        if name:
            spans.append((min([node.lineno, *(d.lineno for d in node.decorator_list)]), node.end_lineno, name))
        if ast.get_docstring(node) is not None:
            first = node.body[0].lineno
            texts += [(first + i, line) for i, line in enumerate(source.splitlines()[first - 1 : node.body[0].end_lineno])]
    for line, text in texts:
        inside = min((s for s in spans if s[0] <= line <= s[1]), key=lambda s: s[1] - s[0])
        yield from ((n, inside[2], line) for n in numbers(text))


def _tokens(source):
    return tokenize.generate_tokens(iter(source.splitlines(keepends=True)).__next__)


def _named(node, prefix=""):
    """The module itself and every class and function in it, with dotted names."""
    if isinstance(node, ast.Module):
        yield node, ""
    for child in ast.iter_child_nodes(node):
        if isinstance(child, ast.FunctionDef | ast.ClassDef):
            yield child, prefix + child.name
            yield from _named(child, f"{prefix}{child.name}.")


@cache
def cited():
    """{equation: {place: line}} of the package, places as the table writes them."""
    found = {n: {} for n in EQUATIONS}
    for path in sorted(PACKAGE.rglob("*.py")):
        for n, function, line in citations(path.read_text()):
            place = f"`{path.relative_to(PACKAGE)}`" + f" `{function}`" * bool(function)
            found[n].setdefault(place, line)
    return found


def table():
    """{equation: (what it says, places)} of docs/equations.md."""
    rows = (ROW.match(line) for line in TABLE.read_text().splitlines())
    return {int(row[1]): (row[2], row[3].split(", ") if row[3] else []) for row in rows if row}


@pytest.mark.parametrize("number", EQUATIONS)
def test_the_table_says_where_an_equation_is_coded(number):
    here, (_, there) = cited()[number], table()[number]
    assert here, f"({number}) is cited nowhere: cite it where it is coded"
    missing, new = set(there) - set(here), {f"{place} line {here[place]}" for place in here if place not in there}
    assert not missing and not new, (
        f"docs/equations.md, ({number}): not cited any more in {missing or 'none'}; cited, but not in the table: "
        f"{new or 'none'}; read the formulas, then python3 tests/test_equations.py --write"
    )


def test_citations_are_found_and_calls_are_not():
    source = (
        '"""The law (15)-(17), and (19)(25)."""\n'
        "def f(x):\n"
        "    # gap (1); f(2), x^(3), shape (4,), Johnson (5.1), (77)\n"
        '    return f(6), "(7)"\n'
        "class A:\n"
        "    def g(self):\n"
        '        """Of\n        (9)."""\n'
    )
    assert sorted(citations(source)) == [
        (1, "f", 3), (9, "A.g", 8), (15, "", 1), (16, "", 1), (17, "", 1), (19, "", 1), (25, "", 1)]  # fmt: skip


def main():
    places, rows = cited(), table()
    if "--write" in sys.argv:
        lines = TABLE.read_text().splitlines()
        lines = [
            f"| ({row[1]}) | {row[2]} | {', '.join(places[int(row[1])])} |" if (row := ROW.match(line)) else line
            for line in lines
        ]
        TABLE.write_text("\n".join(lines) + "\n")
    for n in EQUATIONS:
        print(f"({n}) {rows[n][0]}")
        for place, line in places[n].items():
            path, *function = place.replace("`", "").split(" ")
            print(f"     fenics_contact/{path}:{line}  {' '.join(function)}")


if __name__ == "__main__":
    main()
