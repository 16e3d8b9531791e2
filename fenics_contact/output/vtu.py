"""The VTK XML format: an unstructured grid with data at its points and cells (.vtu), and a table of contents (.pvd)."""

import base64
import re
import sys
import xml.etree.ElementTree as ET
import zlib
from collections.abc import Mapping
from html import escape  # of XML too; xml.sax would bring the protocols of the web along
from pathlib import Path

import numpy as np

from fenics_contact.types import Array, Floats, Ints64

TYPES = {"f8": "Float64", "i4": "Int32", "i8": "Int64", "u1": "UInt8"}
# VTK's codes
VERTEX, TRIANGLE, QUADRILATERAL, TETRAHEDRON, HEXAHEDRON = 1, 5, 9, 10, 12
TRIANGLE_6, TETRAHEDRON_10, QUADRILATERAL_9, HEXAHEDRON_27 = 22, 24, 28, 29
TENSOR = [first + second for first in "XYZ" for second in "XYZ"]  # components of (rows, 9), by rows
LEVEL = 1  # of zlib: 6 takes three to four times as long for a tenth less
ORDER = {"little": "LittleEndian", "big": "BigEndian"}[sys.byteorder]
HEAD = '<?xml version="1.0" encoding="utf-8"?>\n'
UNPRINTED = re.compile(r"[\x00-\x1f\x7f\ud800-\udfff\ufffe\uffff]")  # what XML cannot hold

Data = Mapping[str, Array]  # name -> (rows,) or (rows, components)


class GridFile:
    """Points (n, 3) [length] and cells of one grid, encoded once, for any number of files with other data.

    cells: connectivity (their points, one cell after the other), offsets (m,), where each cell ends in it, types (m,).
    """

    def __init__(self, points: Floats, connectivity: Ints64, offsets: Ints64, types: Array) -> None:
        cells: Data = {"connectivity": connectivity, "offsets": offsets, "types": types.astype(np.uint8)}
        self._size = f'NumberOfPoints="{len(points)}" NumberOfCells="{len(types)}"'
        self._mesh = _section("Points", {"Points": points}) + _section("Cells", cells)

    def write(self, path: Path, points: Data, cells: Data, whole: Data) -> None:
        """Write the grid with data at its points, at its cells, and of the whole grid. OSError where the disk is full."""
        with open(path, "w", encoding="utf-8") as file:
            file.write(f'{HEAD}<VTKFile type="UnstructuredGrid" version="1.0" byte_order="{ORDER}" header_type="UInt64" ')
            file.write('compressor="vtkZLibDataCompressor">\n<UnstructuredGrid>\n')
            file.write(_section("FieldData", whole))
            file.write(f"<Piece {self._size}>\n{self._mesh}{_section('PointData', points)}{_section('CellData', cells)}")
            file.write("</Piece>\n</UnstructuredGrid>\n</VTKFile>\n")


def facets_file(points: Floats, facets: Ints64) -> GridFile:
    """Quadrilaterals (m, 4) and triangles, which repeat their third point, as a grid; of points alone each a cell."""
    if not len(facets):
        numbers = np.arange(len(points))
        return GridFile(points, numbers, numbers + 1, np.full(len(points), VERTEX))
    used = np.ones(facets.shape, dtype=bool)
    used[:, 3] = facets[:, 2] != facets[:, 3]
    types = np.where(used[:, 3], QUADRILATERAL, TRIANGLE)
    return GridFile(points, facets[used], np.cumsum(used.sum(axis=1)), types)


def _section(name: str, arrays: Data) -> str:
    counted = name == "FieldData"  # of which a grid's numbers of points and cells do not tell the length
    return f"<{name}>\n" + "".join(_array(key, values, counted) for key, values in arrays.items()) + f"</{name}>\n"


def _array(name: str, values: Array, counted: bool) -> str:
    """One array as a compressed block: number of blocks, size of each, of the last, and its compressed size before it."""
    raw = np.ascontiguousarray(values).tobytes()
    block = zlib.compress(raw, LEVEL)
    head = np.array([1, len(raw), len(raw), len(block)], dtype=np.uint64).tobytes()
    text = (base64.b64encode(head) + base64.b64encode(block)).decode("ascii")
    tuples = f' NumberOfTuples="{len(values)}"' if counted else ""
    parts = f' NumberOfComponents="{values.shape[1]}"' if values.ndim == 2 else ""
    if values.ndim == 2 and values.shape[1] == len(TENSOR):
        parts += "".join(f' ComponentName{i}="{axes}"' for i, axes in enumerate(TENSOR))
    name = _quoted(UNPRINTED.sub(" ", name))
    return f'<DataArray type="{TYPES[values.dtype.str[1:]]}" Name={name}{parts}{tuples} format="binary">{text}</DataArray>\n'


def _quoted(text: str) -> str:
    return f'"{escape(text)}"'


def write_collection(path: Path, files: Mapping[float, str]) -> None:
    """A table of contents: {time stamp: file, relative to its folder}."""
    with open(path, "w", encoding="utf-8") as file:
        file.write(f'{HEAD}<VTKFile type="Collection" version="1.0" byte_order="{ORDER}">\n<Collection>\n')
        for t, name in files.items():
            file.write(f'<DataSet timestep="{float(t)!r}" group="" part="0" file={_quoted(name)}/>\n')
        file.write("</Collection>\n</VTKFile>\n")


def read_collection(path: Path) -> dict[float, str]:
    """What `write_collection` wrote. ParseError, KeyError or ValueError where that is damaged."""
    sets = ET.parse(path).getroot().iter("DataSet")
    return {float(one.attrib["timestep"]): one.attrib["file"] for one in sets}
