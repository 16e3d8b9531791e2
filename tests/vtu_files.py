"""The fields and tools of a results folder, read by what the format says alone: XML, base64 and zlib."""

import base64
import xml.etree.ElementTree as ET
import zlib

import numpy as np

TYPES = {"Float64": np.float64, "Int32": np.int32, "Int64": np.int64, "UInt8": np.uint8}


def read_vtu(path):
    """{section: {array: values}} of a grid, every array whole and as long as the grid says."""
    root = ET.parse(path).getroot()
    assert (root.get("type"), root.get("header_type")) == ("UnstructuredGrid", "UInt64")
    assert root.get("compressor") == "vtkZLibDataCompressor"
    grid, piece = root.find("UnstructuredGrid"), root.find("UnstructuredGrid/Piece")
    out = {"FieldData": {one.get("Name"): values(one) for one in grid.find("FieldData")}}
    out |= {part.tag: {one.get("Name"): values(one) for one in part} for part in piece}
    points, cells = int(piece.get("NumberOfPoints")), int(piece.get("NumberOfCells"))
    assert len(out["Points"]["Points"]) == points and {len(a) for a in out["PointData"].values()} <= {points}
    assert {len(a) for a in out["CellData"].values()} <= {cells}
    connectivity, offsets, types = (out["Cells"][name] for name in ("connectivity", "offsets", "types"))
    assert len(offsets) == len(types) == cells and len(connectivity) == offsets[-1]
    assert connectivity.min() >= 0 and connectivity.max() < points
    return out


def values(array):
    """(rows,) or (rows, components) of a DataArray in compressed blocks."""
    text = array.text.strip()
    count = int(np.frombuffer(base64.b64decode(text[:12])[:8], dtype=np.uint64)[0])
    end = 4 * -(-8 * (3 + count) // 3)  # characters of the header
    _, size, last, *packed = np.frombuffer(base64.b64decode(text[:end]), dtype=np.uint64).tolist()
    data, out = base64.b64decode(text[end:]), b""
    assert len(data) == sum(packed)
    for length in packed:
        out, data = out + zlib.decompress(data[:length]), data[length:]
    assert len(out) == (count - 1) * size + last
    flat = np.frombuffer(out, dtype=TYPES[array.get("type")])
    components = array.get("NumberOfComponents")
    return flat if components is None else flat.reshape(-1, int(components))


def read_pvd(path):
    """[(time stamp, file)] of a table of contents."""
    return [(float(one.get("timestep")), path.parent / one.get("file")) for one in ET.parse(path).getroot().iter("DataSet")]


def times_of_fields(folder):
    """{field: its time stamps} of the bodies, {"tool NAME": its} of the tools; every file in a table must be whole."""
    out = {}
    for stamp, file in read_pvd(folder / "results.pvd"):
        grid = read_vtu(file)
        assert grid["FieldData"]["TimeValue"].tolist() == [stamp]
        for name in (*grid["PointData"], *grid["CellData"]):
            out.setdefault(name, []).append(stamp)
    for index in (index for index in (folder / "tools").glob("*.pvd") if "of_mine" not in index.name):
        out[f"tool {index.stem}"] = [stamp for stamp, _ in read_pvd(index)]
        for stamp, file in read_pvd(index):
            assert read_vtu(file)["FieldData"]["TimeValue"].tolist() == [stamp]
    return out
