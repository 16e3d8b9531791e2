"""Fields over the steps for ParaView: a file per step, which is whole or not there, and a table of contents."""

import xml.etree.ElementTree as ET
from pathlib import Path
from xml.sax.saxutils import quoteattr

from fenics_contact import compat
from fenics_contact.output.files import FIELDS, IN_FIELDS, STEPS, complete, take_room, writing
from fenics_contact.types import Function, Mesh

INCLUDE = "{*}include"  # of XInclude, whose address has had http and https
HEAD = '<?xml version="1.0" encoding="utf-8"?>\n<Xdmf Version="3.0"><Domain>\n'
TAIL = "</Domain></Xdmf>\n"
METADATA = 1 << 16  # bytes; of HDF5's own a step of seven fields needs 16 kB, on any mesh, and its XDMF 4 kB


class Series:
    """results.xdmf as a table of contents of steps/*.h5, each written whole and closed before it gets its name.

    A single open HDF5 file is lost with all its steps when the run ends in any other way than at its end; here no accepted
    step is. The price is a copy of the mesh per step, whose numbering is that of the number of ranks that wrote it.
    last: number of the step a resumed run goes on from, 0 for none; later ones are dropped.
    """

    def __init__(self, folder: Path, mesh: Mesh, last: int = 0) -> None:
        self._folder, self._mesh = folder, mesh
        self._whole = ""  # XML of the undeformed mesh
        self._grids: dict[str, dict[int, str]] = {}  # of every field, by step
        with writing(mesh.comm, folder, f"{STEPS}/"):
            if mesh.comm.rank == 0:
                (folder / STEPS).mkdir(exist_ok=True)
                if last and (folder / FIELDS).exists():
                    self._take_up(last)

    def write(self, step: int, fields: list[Function], t: float) -> None:
        """Write the fields of accepted step number `step`, 0 for the start. Collective."""
        comm, part = self._mesh.comm, self._folder / STEPS / "part.xdmf"
        with writing(comm, self._folder, f"the fields of step {step}"):
            size = self._size(fields)
            if comm.rank == 0:
                take_room(part.with_suffix(".h5"), size)
        try:
            with writing(comm, self._folder, f"the fields of step {step}"):
                file = compat.XDMFFile(comm, str(part), "w")
                file.write_mesh(self._mesh)
                for field in fields:
                    file.write_function(field, t)
                file.close()
            with writing(comm, self._folder, f"the fields of step {step}"):
                if comm.rank == 0:
                    path = part.with_name(f"{step:06d}.h5")
                    part.with_suffix(".h5").replace(path)
                    self._enter(step, part.read_text().replace("part.h5:", f"{STEPS}/{path.name}:"))
                    self._publish()
        finally:
            if comm.rank == 0:
                part.unlink(missing_ok=True)
                part.with_suffix(".h5").unlink(missing_ok=True)

    def _size(self, fields: list[Function]) -> int:
        """Bytes that a step's file takes at most."""
        cells = self._mesh.topology.index_map(3).size_global * compat.geometry_dofmap(self._mesh).shape[1]
        nodes = 3 * self._mesh.geometry.index_map().size_global
        values = sum(compat.petsc_vector(field).getSize() for field in fields)
        return 8 * (cells + nodes + values) + METADATA

    def _enter(self, step: int, text: str) -> None:
        """Add one step's grids to the table of contents, each with its own mesh."""
        domain = _part(ET.fromstring(text), "Domain")
        mesh = _part(domain, "Grid[@GridType='Uniform']")
        self._whole = self._whole or ET.tostring(mesh, encoding="unicode")
        for collection in domain.findall("Grid[@GridType='Collection']"):
            for grid in collection:
                grid.remove(_part(grid, INCLUDE))
                grid[:0] = list(mesh)
                self._put(collection.attrib["Name"], step, grid)

    def _put(self, name: str, step: int, grid: ET.Element) -> None:
        self._grids.setdefault(name, {})[step] = " ".join(ET.tostring(grid, encoding="unicode").split())

    def _publish(self) -> None:
        with complete(self._folder / FIELDS) as draft, open(draft, "w", encoding="utf-8") as file:
            file.writelines([HEAD, self._whole, "\n"])
            for name, grids in self._grids.items():
                file.write(f'<Grid Name={quoteattr(name)} GridType="Collection" CollectionType="Temporal">\n')
                file.writelines(f"{grid}\n" for grid in grids.values())
                file.write("</Grid>\n")
            file.write(TAIL)

    def _take_up(self, last: int) -> None:
        """The table of contents that a run has left, without the steps after `last`, whose files go."""
        domain, late = _part(ET.parse(self._folder / FIELDS).getroot(), "Domain"), set()
        self._whole = ET.tostring(_part(domain, "Grid[@GridType='Uniform']"), encoding="unicode")
        for collection in domain.findall("Grid[@GridType='Collection']"):
            for grid in collection:
                number = IN_FIELDS.findall(_part(grid, "Attribute/DataItem").text or "")[0]
                if int(number) <= last:
                    self._put(collection.attrib["Name"], int(number), grid)
                else:
                    late.add(number)
        self._publish()
        for number in late:
            (self._folder / STEPS / f"{number}.h5").unlink(missing_ok=True)


def _part(whole: ET.Element, path: str) -> ET.Element:
    """The first part of an XML element at a path; ValueError where there is none."""
    part = whole.find(path)
    if part is None:
        raise ValueError(f"it has no {path}")
    return part
