"""An .stl file, text or binary, read by gmsh; what is cut off or no number is refused before, with its place."""

import math
from pathlib import Path

import gmsh
import numpy as np

_HEAD = 84  # bytes before the facets of a binary file: 80 of a title, 4 of their number
_FACET = np.dtype([("normal", "<f4", 3), ("X", "<f4", (3, 3)), ("more", "<u2")])  # 50 bytes
_AGAIN = "export the surface again"


def read_stl(path: str) -> None:
    """Surfaces of triangles. gmsh alone leaves out in silence what it does not find, and takes what is no number."""
    written = Path(path).read_bytes()
    if written.lstrip()[:5].lower() == b"solid" and b"\0" not in written[:_HEAD]:  # a binary file's number has a zero
        _check_text(written.decode("latin-1"))
    else:
        _check_binary(written)
    gmsh.open(path)


def _check_binary(written: bytes) -> None:
    if len(written) < _HEAD:
        raise ValueError(f"it is cut off, or no .stl file: {len(written)} bytes, and no facets; {_AGAIN}")
    count, held = int.from_bytes(written[80:_HEAD], "little"), (len(written) - _HEAD) // _FACET.itemsize
    if count != held:
        raise ValueError(f"it is cut off, or no .stl file: it states {count} facets and holds {held}; {_AGAIN}")
    if not count:
        raise ValueError(f"it has no facets; {_AGAIN}")
    X = np.frombuffer(written, dtype=_FACET, count=count, offset=_HEAD)["X"]
    wrong = np.flatnonzero(~np.isfinite(X).all(axis=(1, 2)))
    if len(wrong):
        raise ValueError(
            f"{len(wrong)} of its {count} facets have a coordinate that is no finite number, the first is facet "
            f"{wrong[0] + 1}; {_AGAIN}"
        )


def _check_text(text: str) -> None:
    """Each facet has three corners of three numbers, and each solid an end."""
    counts = dict.fromkeys(("solid", "facet", "vertex", "endfacet", "endsolid"), 0)
    for number, line in enumerate(text.splitlines(), start=1):
        word, *parts = line.split() or [""]
        if (word := word.lower()) not in counts:
            continue
        counts[word] += 1
        if word == "vertex" and not (len(parts) == 3 and all(map(_is_number, parts))):
            raise ValueError(f"line {number}: '{line.strip()}' is no corner, 'vertex' and three finite numbers; {_AGAIN}")
    facets, corners = counts["facet"], counts["vertex"]
    if corners != 3 * facets or counts["endfacet"] != facets or counts["endsolid"] != counts["solid"]:
        raise ValueError(
            f"it is cut off, or facets are no triangles: it has {facets} facets with {corners} corners and "
            f"{counts['endfacet']} ends, {counts['solid']} solids with {counts['endsolid']} ends; {_AGAIN}"
        )
    if not facets:
        raise ValueError(f"it has no facets; {_AGAIN}")


def _is_number(part: str) -> bool:
    try:
        return math.isfinite(float(part))
    except ValueError:
        return False
