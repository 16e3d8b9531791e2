"""Parameters of a law from tests of a rubber: least squares of the nominal stresses of an incompressible body."""

import warnings
from collections.abc import Callable, Mapping
from dataclasses import dataclass
from pathlib import Path
from typing import TYPE_CHECKING, Any

import numpy as np

from fenics_contact.output.late import Late, figures
from fenics_contact.packages import require
from fenics_contact.solid.materials import Isotropic, isochoric_energy
from fenics_contact.studies.charts import COLOURS, MARKERS
from fenics_contact.studies.runner import StudyError
from fenics_contact.studies.stability import DOTS, LETTERS, WIDTH
from fenics_contact.types import Floats

if TYPE_CHECKING:
    from matplotlib.figure import Figure

optimize: Any = Late("scipy.optimize")

# of each test: the three stretches at one of them, and how many of these do the same work
TESTS: dict[str, tuple[Callable[[float], tuple[float, float, float]], int]] = {
    "uniaxial": (lambda s: (s, s**-0.5, s**-0.5), 1),
    "equibiaxial": (lambda s: (s, s, s**-2), 2),
    "shear": (lambda s: (s, 1.0, 1.0 / s), 1),
}
STEP = 1e-3  # relative, of a stretch in differences of the energy, of fourth order: errors of 1e-11, and round-off of 1e-12
BEYOND = 1.5  # times the largest stretch of a test, and as far into compression: how far curves are drawn and looked at
POINTS = 200  # of a curve
REFUSED = 1e3  # stands for parameters that a law refuses, in largest stresses of a test


@dataclass(frozen=True)
class Fit:
    """material: the law with the parameters found; parameters: those; errors: {test: root mean square of the nominal
    stress's error over its largest value}; tests: {test: table (n, 2) of stretch and nominal stress [pressure]}; unstable:
    {mode: stretch nearest to 1 from which the nominal stress falls as the body is stretched}, of all modes of TESTS up to
    BEYOND times what was tested, {} of a law that grows stiff everywhere."""

    material: Isotropic
    parameters: dict[str, float]
    errors: dict[str, float]
    tests: dict[str, Floats]
    unstable: dict[str, float]

    @property
    def warning(self) -> str:
        """What is to be said of a law that gives way, "" of one that does not."""
        if not self.unstable:
            return ""
        ways = {mode: f"{'from' if at > 1.0 else 'below'} a stretch of {at:.3g}" for mode, at in self.unstable.items()}
        where = ", ".join(f"{mode} {way}" for mode, way in ways.items())
        return (
            f"the law found is unstable: its nominal stress falls as the stretch grows in {where}; add tests of these "
            "modes, take a law with fewer parameters, or keep the scene away from there"
        )

    def plot(self, path: str | Path, pressure: str = "MPa") -> "Figure":
        """The tests' points and the law's curves, as a picture; dashed: beyond the tests, and in modes without one;
        pressure: the unit's name."""
        figure = figures.Figure(figsize=(WIDTH, 3.6), layout="constrained")
        axes = figure.subplots()
        for i, (name, table) in enumerate(self.tests.items()):
            at = np.linspace(table[:, 0].min(), table[:, 0].max(), 200)
            axes.plot(at, nominal_stress(self.material, name, at), color=COLOURS[i])
            label = f"{name}, {100 * self.errors[name]:.2g} %"
            axes.plot(*table.T, MARKERS[i], color=COLOURS[i], markersize=4, label=label)
        for i, name in enumerate([*self.tests, *(mode for mode in TESTS if mode not in self.tests)]):
            label = "_" if name in self.tests else f"{name}, not tested"
            at = _reach(self.tests)
            axes.plot(at, nominal_stress(self.material, name, at), "--", color=COLOURS[i], linewidth=0.9, label=label)
        seen = np.concatenate([table[:, 1] for table in self.tests.values()])
        low, high = min(float(seen.min()), 0.0), max(float(seen.max()), 0.0)
        axes.set_ylim(low - 0.6 * (high - low), high + 0.6 * (high - low))  # beyond the tests stresses may be any
        axes.axhline(0.0, color="0.6", linewidth=0.6)
        axes.set_xlabel("stretch", fontsize=LETTERS), axes.set_ylabel(f"nominal stress [{pressure}]", fontsize=LETTERS)
        axes.tick_params(labelsize=LETTERS), axes.grid(alpha=0.3)
        axes.legend(fontsize=LETTERS, title="test, error of its largest stress", title_fontsize=LETTERS)
        found = ", ".join(f"{name} = {value:.4g}" for name, value in self.parameters.items())
        axes.set_title(f"{self.material.name.split(',')[0]}: {found}", fontsize=LETTERS + 1)
        figure.savefig(path, dpi=DOTS)
        return figure


def fit(law: Callable[..., Isotropic], tests: Mapping[str, object], K: float, **start: float) -> Fit:
    """The parameters of a law, from tests of an incompressible rubber, each of which counts alike.

    law: `neo_hooke`, `yeoh`, ..., or a function of parameters and K that returns an isotropic material; tests: {"uniaxial",
    "equibiaxial" or "shear": table (n, 2) of stretch and nominal stress [pressure]}, shear being pure, of a wide sheet; K:
    bulk modulus that the law is to have [pressure]; start: {parameter: where the search begins}. StudyError for tables
    that are none, and where no parameters are found; a warning where the law found is unstable, `Fit.warning`.
    """
    tables = {name: _table(name, table) for name, table in tests.items()}
    names, scale = list(start), {name: float(np.abs(table[:, 1]).max()) for name, table in tables.items()}
    if not tables or not names:
        raise StudyError("fit: give at least one test, and where the search for each parameter begins: mu=0.4")
    law(**start, K=K)  # says what it thinks of the start, before the search does

    def residuals(values: Floats) -> Floats:
        try:
            material = law(**dict(zip(names, values.tolist(), strict=True)), K=K)
            parts = [
                (nominal_stress(material, name, table[:, 0]) - table[:, 1]) / (scale[name] * len(table) ** 0.5)
                for name, table in tables.items()
            ]
            return np.concatenate(parts)
        except ValueError:
            return np.full(sum(map(len, tables.values())), REFUSED)

    first = np.array(list(start.values()), dtype=float)
    require("scipy")
    found = optimize.least_squares(
        residuals, first, x_scale=np.maximum(np.abs(first), 1e-3), xtol=1e-12, ftol=1e-12, gtol=1e-12
    )
    if not found.success or not np.isfinite(found.cost) or found.cost > REFUSED:
        raise StudyError(f"fit: no parameters found from {start} ({found.message}); begin elsewhere, or take another law")
    parameters = dict(zip(names, found.x.tolist(), strict=True))
    material, errors = law(**parameters, K=K), residuals(found.x)
    ends = np.cumsum([len(table) for table in tables.values()])[:-1]
    each = {name: float(np.linalg.norm(part)) for name, part in zip(tables, np.split(errors, ends), strict=True)}
    fitted = Fit(material, parameters, each, tables, _unstable(material, tables))
    if fitted.warning:
        warnings.warn(f"fit: {fitted.warning}", stacklevel=2)
    return fitted


def _reach(tests: Mapping[str, Floats]) -> Floats:
    """Stretches (n,) that all modes are looked at: those of the tests, and beyond."""
    stretches = np.concatenate([table[:, 0] for table in tests.values()])
    least, most = min(float(stretches.min()), 1.0), max(float(stretches.max()), 1.0)
    return np.linspace(min(least / BEYOND, 1.0 / BEYOND), BEYOND * most, POINTS)


def _unstable(material: Isotropic, tests: Mapping[str, Floats]) -> dict[str, float]:
    """Fit.unstable: the stretch nearest to 1 where the force of the body, not its true stress, falls with the stretch."""
    at, found = _reach(tests), dict[str, float]()
    for name in TESTS:
        falls = np.diff(nominal_stress(material, name, at)) < 0.0
        if falls.any():
            where = 0.5 * (at[1:] + at[:-1])[falls]
            found[name] = float(where[np.argmin(np.abs(np.log(where)))])
    return found


def nominal_stress(material: Isotropic, test: str, stretches: Floats) -> Floats:
    """Nominal stress (n,) [pressure] of the incompressible law at stretches (n,) of a test of TESTS: the rate of the energy
    with the stretch, shared by those that do its work."""
    ways, share = TESTS[test]

    def energy(stretch: float) -> float:
        b = np.square(ways(stretch))
        return isochoric_energy(material, float(b.sum()), float((b**2).sum()))

    steps = STEP * stretches
    # of fourth order: (8 (W(s + h) - W(s - h)) - (W(s + 2 h) - W(s - 2 h))) / 12 h
    near, far = (np.array([energy(s + k * h) - energy(s - k * h) for s, h in zip(stretches, steps, strict=True)])
                 for k in (1, 2))  # fmt: skip
    return (8 * near - far) / (12 * steps) / share


def _table(name: str, table: object) -> Floats:
    if name not in TESTS:
        raise StudyError(f"fit: no test '{name}'; there are {', '.join(TESTS)}")
    values = np.array(table, dtype=float)
    is_table = values.ndim == 2 and values.shape[1] == 2 and len(values) > 1
    if not is_table or not np.isfinite(values).all() or values[:, 0].min() <= 0.0:
        raise StudyError(f"fit: test '{name}' needs a table (n, 2) of stretches above zero and nominal stresses")
    if not np.abs(values[:, 1]).max() > 0.0:
        raise StudyError(f"fit: test '{name}' has no stress")
    return values
