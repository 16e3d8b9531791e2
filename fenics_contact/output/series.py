"""Fields over the steps for ParaView: results.xdmf with one file for all steps, or one per step, which a kill spares."""

import xml.etree.ElementTree as ET
from pathlib import Path

from fenics_contact import compat

INCLUDE = "http://www.w3.org/2001/XInclude"
STEPS = "steps"  # folder of the files per step


class Series:
    """results.xdmf and results.h5, open as long as the run."""

    def __init__(self, folder, mesh):
        self._file = compat.XDMFFile(mesh.comm, str(Path(folder) / "results.xdmf"), "w")
        self._file.write_mesh(mesh)

    def write(self, step, fields, t):
        for field in fields:
            self._file.write_function(field, t)

    def close(self):
        self._file.close()


class StepSeries:
    """results.xdmf as a table of contents of steps/*.h5, each written whole and closed before it gets its name.

    A single open HDF5 file is lost with all its steps when the run is killed; here no accepted step is. last: number of
    the step a resumed run goes on from; files of later ones are dropped. The price is a copy of the mesh per step.
    """

    def __init__(self, folder, mesh, last=None):
        self._folder, self._mesh, self._index = Path(folder), mesh, None
        if mesh.comm.rank == 0:
            (self._folder / STEPS).mkdir(exist_ok=True)
            for path in sorted((self._folder / STEPS).iterdir()):
                number = int(path.stem) if path.stem.isdigit() else None
                if last is None or number is None or number > last:
                    path.unlink()
                elif path.suffix == ".xdmf":
                    self._enter(path)
            self._publish()
        mesh.comm.Barrier()

    def write(self, step, fields, t):
        """Write the fields of accepted step number `step`, 0 for the start. Collective."""
        part = self._folder / STEPS / "part.xdmf"
        file = compat.XDMFFile(self._mesh.comm, str(part), "w")
        file.write_mesh(self._mesh)
        for field in fields:
            file.write_function(field, t)
        file.close()
        if self._mesh.comm.rank == 0:
            path = part.with_name(f"{step:06d}.xdmf")
            part.with_suffix(".h5").replace(path.with_suffix(".h5"))
            part.write_text(part.read_text().replace("part.h5:", f"{path.stem}.h5:"))
            part.replace(path)
            self._enter(path)
            self._publish()

    def _enter(self, path):
        """Add one step's grids to the table of contents."""
        root = ET.parse(path).getroot()
        for item in root.iter("DataItem"):
            item.text = f"{STEPS}/{item.text.strip()}" if ".h5:" in (item.text or "") else item.text
        if self._index is None:
            self._index = root
            return
        known = {grid.get("Name"): grid for grid in self._index.find("Domain") if grid.get("GridType") == "Collection"}
        for grid in root.find("Domain"):
            if grid.get("GridType") == "Collection":
                known[grid.get("Name")].extend(grid)

    def _publish(self):
        if self._index is not None:
            ET.register_namespace("xi", INCLUDE)
            draft = self._folder / "results.part"
            ET.ElementTree(self._index).write(draft, encoding="utf-8", xml_declaration=True)
            draft.replace(self._folder / "results.xdmf")

    def close(self):
        """Every step's file is closed already."""
