"""What a run gives back: its history, its verdict, its final state, and pictures of them."""

from collections.abc import Callable, Mapping, Sequence
from dataclasses import dataclass, replace
from os import PathLike
from pathlib import Path
from typing import TYPE_CHECKING

import numpy as np

from fenics_contact.agreement import agreed
from fenics_contact.assembly.memory import Memory
from fenics_contact.assembly.system import System
from fenics_contact.output.columns import HistoryRow
from fenics_contact.output.curves import history_figure, line_figure
from fenics_contact.output.fields import Fields
from fenics_contact.output.history import Summary
from fenics_contact.output.late import figures
from fenics_contact.output.lines import Along, Table, line, zones
from fenics_contact.output.pictures import Drawing, picture_format, save
from fenics_contact.output.plot import drawing, refuse_backend, refuse_limits
from fenics_contact.output.results import Results
from fenics_contact.output.slave_nodes import SlaveNodes
from fenics_contact.output.views import Angles
from fenics_contact.scene.scene import Scene
from fenics_contact.scene.start import Drives, Start
from fenics_contact.solvers.audit import Audit, audit
from fenics_contact.solvers.verdict import Verdict
from fenics_contact.types import Array, Floats, Function
from fenics_contact.values import SceneError, finite, shown

if TYPE_CHECKING:
    from matplotlib.figure import Figure

Target = str | PathLike[str] | None  # of a picture


@dataclass(repr=False)
class Result:
    """What a run gives back, printed as how it ended, its notes, and its last step's columns.

    history: one dict per accepted step (units in the names); verdict: how the run ended; system: the final state;
    summary: what summary.json holds; scene: what was solved; measured: the final state's contacts, reactions and energies;
    columns: names that a step of the run may have in the history; left: the loads and tools that hold the final state.
    `result.u` is the displacement Function."""

    history: list[HistoryRow]
    verdict: Verdict
    system: System
    summary: Summary
    scene: Scene
    measured: Results
    columns: Sequence[str]
    left: Drives

    def __repr__(self) -> str:
        last = self.history[-1] if self.history else {}
        width = max(map(len, last), default=0)
        shown = {name: value if isinstance(value, str) else f"{value:.6g}" for name, value in last.items()}
        return "\n".join([str(self.verdict), *(f"  {name:{width}}  {value}" for name, value in shown.items())])

    @property
    def u(self) -> Function:
        return self.system.state.u

    @property
    def converged(self) -> bool:
        return self.verdict.converged

    def require(self) -> "Result":
        """Itself where the run converged; else the script ends with the reason and a nonzero exit code."""
        if self.converged:
            return self
        raise SystemExit(self.verdict.reason if self.system.comm.rank == 0 else 1)

    def state(self) -> Start:
        """The final state as another run's start. Collective."""
        return Start("the result", Memory(self.system).collect(), self.left)

    def audit(self) -> Audit:
        """Audit of every block of the tangent at the final state; print it, or ask its `right`. Collective."""
        return audit(self.system, self.verdict.residuals[-1] if self.verdict.residuals else ())

    def column(self, name: str, stage: str | None = None) -> Array:
        """A history column at all accepted steps, or at those of a stage, an empty one where there is none; KeyError lists
        the columns, or the stages, and says how the run has ended where it did not come to that one."""
        known = list(self.history[0]) if self.history else self.columns
        if name not in known:
            raise KeyError(f"no column '{name}' in the history; it has: {', '.join(known)}")
        names = list(dict.fromkeys(row.get("stage") for row in self.history))
        if stage is not None and stage not in names:
            there = ", ".join(filter(None, names)) or ("none" if names else "no accepted step")
            if stage in self.system.stages.names:
                why = f"the history has: {there}; the run has ended: {self.verdict.reason}"
                raise KeyError(f"stage '{stage}' has no accepted step, {why}")
            raise KeyError(f"no stage '{stage}' in the history; it has: {there}")
        return np.array([row[name] for row in self.history if stage is None or row["stage"] == stage])

    def table(self, stage: str | None = None) -> Table:
        """All history columns, of a stage or all, as arrays by name: what `pandas.DataFrame` takes. SceneError without an
        accepted step."""
        self._refuse_empty("table()")
        return {name: self.column(name, stage) for name in self.history[0]}

    def _refuse_empty(self, what: str) -> None:
        if not self.history:
            raise SceneError(f"{what}: the run has no accepted step; {self.verdict.reason}")

    def line(self, contact: str, along: Along, cut: Mapping[str, float] | None = None) -> Table:
        """A contact's nodal values along a line of its slave surface at the final state: arrays by name. Collective.

        Columns: arc (way along the deformed line), chain (number of its connected part), reference and current positions,
        pressure and friction on the current area, gap, slip, status (0 open, 1 closed, 2 stick, 3 slip). along: "x", "y",
        "z", or a function of the reference positions X (n, 3) -> (n,): the line starts at its end where that is least, and
        runs from facet to facet; cut: {axis: value}, the plane of the undeformed body that cuts the surface, e.g.
        {"z": 0.0}; of a surface one facet wide, as a slice's, its lower side by default. KeyError lists the contacts;
        SceneError without an accepted step.
        """
        self._refuse_empty(f"line() of contact '{contact}'")
        return line(self._surface(contact), along, cut, self.scene.units)

    def widths(self, contact: str, along: Along, cut: Mapping[str, float] | None = None) -> Floats:
        """Starts and ends (n, 2) [length] of the zones in contact along the arc of such a line. Collective."""
        return zones(self.line(contact, along, cut), self.scene.units, self._surface(contact).least_pressure())

    def _surface(self, contact: str) -> SlaveNodes:
        names = [surface.contact.name for surface in self.measured.surfaces]
        if contact not in names:
            raise KeyError(f"no contact '{contact}'; there is: {', '.join(names) or 'none'}")
        return self.measured.surfaces[names.index(contact)]

    # -- pictures -------------------------------------------------------------------------------------------------
    def drawing(
        self,
        field: str | None = None,
        *,
        mirror: str = "",
        view: str | Angles | None = None,
        backend: str | None = None,
    ) -> Drawing | None:
        """What `plot` draws, for axes of one's own: `drawing.draw(axes)`. On rank 0; None on the others. Collective."""
        refuse_backend(backend, self.system.comm)
        fields = Fields(self.scene, self.system)
        fields.update()
        found = drawing(fields, field, mirror, view)
        if found is None:
            return None
        return replace(found if self.converged else found.stopped_early(), backend=backend)

    def plot(
        self,
        field: str | None = None,
        path: Target = None,
        *,
        mirror: str = "",
        view: str | Angles | None = None,
        limits: tuple[float, float] | None = None,
        title: str | None = None,
        backend: str | None = None,
    ) -> "Figure | None":
        """Picture of the final state: deformed bodies coloured by a field, with the tools.

        field: "contact_pressure" (where the scene has contacts the default), "friction_traction", "gap" or "status" on the
        slave surfaces, "top_contact_pressure" of the contact "top" alone; "displacement" (its size, the default elsewhere),
        "displacement_x", "_y", "_z", "von_mises", "stress_xx", "stress_xy", ..., "J", in a plane scene without what its
        plane does not have, "displacement_z", "stress_xz" and "_yz". path: file to write, by its ending .png, .pdf or .svg;
        mirror: axes of symmetry planes behind which the model is drawn too, "x" or "xy"; view: "x", "y", "z" (along that
        axis) or (elevation, azimuth) in degrees, by default along the thin axis of a plane-strain slice, else from where
        most of the field is seen, with z up, or the axis against which body forces act; limits: of the colours, in the
        field's unit; title: by default t; backend: "pyvista" or "matplotlib" paints models in space, by default the first
        where it is installed and draws without a screen.

        A Matplotlib Figure on rank 0, None on the others. Collective. SceneError, on all ranks, for a field that the scene
        does not have, a mirror without a plane of symmetry, limits that do not rise, an ending that is none and a backend
        that does not work.
        """
        refuse_limits(limits)
        found = self.drawing(field, mirror=mirror, view=view, backend=backend)
        return self._figure(path, lambda: found.figure(limits, title) if found else figures.Figure())

    def plot_history(
        self, x: str, y: str | Sequence[str], path: Target = None, *, factors: tuple[float, float] = (1.0, 1.0)
    ) -> "Figure | None":
        """Curves of history columns y over the column x, as "force over travel"; units come from the columns' names.

        factors: of x and y, (-1, -1) for what goes downwards; names say them. Where the run has stages, the end of each is
        marked with its name. A Figure on rank 0, None on the others. Collective. KeyError lists the columns; SceneError
        without an accepted step.
        """
        columns = [y] if isinstance(y, str) else list(y)
        table = {name: self.column(name) for name in (x, *columns)}
        self._refuse_empty("plot_history()")
        if len(table) == 1:
            raise SceneError(f"plot_history(): y = {shown(y)} names no column but x = '{x}': nothing to draw over it")
        of = finite(factors, "plot_history: factors", (2,))
        ends = {one["name"]: one["steps"][1] - 1 for one in self.summary["stages"]}
        return self._figure(path, lambda: history_figure(table, self.scene.units, (float(of[0]), float(of[1])), ends))

    def plot_line(
        self,
        contact: str,
        along: Along,
        path: Target = None,
        *,
        cut: Mapping[str, float] | None = None,
        whole: bool = False,
    ) -> "Figure | None":
        """Pressure and friction along a line of a contact, see `line`, and where its zones end, with what is near these or
        the whole line. A Figure on rank 0, None on the others. Collective."""
        table, units = self.line(contact, along, cut), self.scene.units
        ends = zones(table, units, self._surface(contact).least_pressure())
        return self._figure(path, lambda: line_figure(table, ends, units, whole))

    def _figure(self, path: Target, make: "Callable[[], Figure]") -> "Figure | None":
        """A figure that rank 0 makes and, given a path, saves; the others wait for it. Collective."""
        comm, figure = self.system.comm, None
        kind = "" if path is None else picture_format(Path(path))
        with agreed(comm, f"picture '{path}'" if path else "picture", SceneError):
            if comm.rank == 0:
                figure = make()
                if path is not None:
                    save(figure, Path(path), kind)
        return figure
