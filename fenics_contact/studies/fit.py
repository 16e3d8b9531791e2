"""Parameters of a law from tests of a rubber: least squares of the nominal stresses of an incompressible body."""

import inspect
import itertools
import warnings
from collections.abc import Callable, Mapping, Sequence
from dataclasses import dataclass
from pathlib import Path
from typing import TYPE_CHECKING, Any

import numpy as np

from fenics_contact.output.late import Late, figures
from fenics_contact.packages import require
from fenics_contact.solid.materials import Isotropic, energy_parts, isochoric_energy
from fenics_contact.studies.charts import COLOURS, MARKERS
from fenics_contact.studies.runner import StudyError
from fenics_contact.studies.stability import DOTS, LETTERS, WIDTH
from fenics_contact.types import Array, Floats

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
REFUSED = 1e3  # an error that no try with another scale of stress has: a step to parameters that a law refuses is shortened
NEAR = 1e-6  # of a parameter's unit: steps of differences, of which 1e-6 is error, and as much round-off
EDGE = 1e-3  # of a parameter's unit: how near to what a law refuses a search is said to end there
SETTLED = 1e-6  # of what moves the stresses most: a change of parameters that moves them less is not told by the tests
MISSED = 0.5  # of a test's stresses, by root mean squares: a law that misses more is none of this rubber
Parameters = dict[str, Any]  # of a law: numbers, or lists of them


@dataclass(frozen=True)
class Fit:
    """material: the law with the parameters found; parameters: those, as they were stated; errors: {test: root mean square
    of the nominal stress's error over its largest value}; tests: {test: table (n, 2) of stretch and nominal stress
    [pressure]}; unstable: {mode: stretch nearest to 1 from which the nominal stress falls as the body is stretched}, of all
    modes of TESTS up to BEYOND times what was tested, {} of a law that grows stiff everywhere; edge: parameters that end
    next to what the law refuses; unsettled: those that may change together and leave all stresses of the tests."""

    material: Isotropic
    parameters: Parameters
    errors: dict[str, float]
    tests: dict[str, Floats]
    unstable: dict[str, float]
    edge: Sequence[str] = ()
    unsettled: Sequence[str] = ()

    @property
    def warning(self) -> str:
        """What is to be said of parameters that do not describe the tests, and of a law that gives way; "" of others."""
        return "; ".join(filter(None, [self._astray(), self._soft()]))

    def _astray(self) -> str:
        """Where the search found no law of these tests, and the likely cause."""
        shares = {
            name: self.errors[name] * np.abs(table[:, 1]).max() / float(np.sqrt(np.mean(table[:, 1] ** 2)))
            for name, table in self.tests.items()
        }
        missed = [f"{share:.0%} of the stresses of '{name}'" for name, share in shares.items() if share > MISSED]
        found = [f"the law found misses {', '.join(missed)}"] if missed else []
        if self.edge:
            ends = ", ".join(f"{name} = {_words(self.parameters[name])}" for name in self.edge)
            found.append(f"the search ends at the edge of what the law takes, {ends}")
        # of no body that is at rest without stress: as it is deformed it takes up work
        against = [f"'{name}'" for name, table in self.tests.items() if np.sum((table[:, 0] - 1.0) * table[:, 1]) < 0.0]
        if found and against:
            found.append(
                f"stresses of {', '.join(against)} point against the stretch: those of compression are negative, and a "
                "stretch is a length over that at the start, 1 at rest, no strain"
            )
        elif missed:
            found.append(
                "see that the tests have stretches, not strains, and their signs; begin elsewhere, or take another law"
            )
        elif found:
            found.append("add tests of other modes, begin elsewhere, or take another law")
        if self.unsettled:
            found.append(
                f"the tests do not settle {', '.join(self.unsettled)}, other numbers give the same stresses: add tests, at "
                "more stretches or of other modes, or take a law with fewer parameters"
            )
        if self.material.bulk_modulus < self.material.shear_modulus:
            found.append(
                f"K = {self.material.bulk_modulus:.4g} is below the law's shear modulus, {self.material.shear_modulus:.4g}, "
                "where tests are taken for those of incompressible bodies: see that both have one unit"
            )
        return "; ".join(found)

    def _soft(self) -> str:
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
        found = ", ".join(f"{name} = {_words(value)}" for name, value in self.parameters.items())
        axes.set_title(f"{self.material.name.split(',')[0]}: {found}", fontsize=LETTERS + 1)
        figure.savefig(path, dpi=DOTS)
        return figure


def fit(law: Callable[..., Isotropic], tests: Mapping[str, object], K: float, **start: float | Sequence[float]) -> Fit:
    """The parameters of a law, from tests of an incompressible rubber, each of which counts alike.

    law: `neo_hooke`, `yeoh`, ..., or a function of parameters and K that returns an isotropic material; tests: {"uniaxial",
    "equibiaxial" or "shear": table (n, 2) of stretch and nominal stress [pressure]}, shear being pure, of a wide sheet; K:
    bulk modulus that the law is to have [pressure]; start: {parameter: where the search begins, a number, or a list as
    `ogden` takes}, where moduli are brought to the scale of the tests first. StudyError for tables that are none, for
    starts that the law does not take, and where no parameters are found; a warning where the law found does not describe
    the tests, or is unstable, `Fit.warning`.
    """
    tables = {name: _table(name, table) for name, table in tests.items()}
    if not tables or not start:
        raise StudyError("fit: give at least one test, and where the search for each parameter begins: mu=0.4")
    search = _Search(law, K, tables, start)
    values, units = search.begin()

    def errors(at: Floats) -> Floats:
        found = search.stresses(at * units)
        return np.full(len(search.seen), REFUSED) if found is None else found - search.seen

    require("scipy")
    found = optimize.least_squares(
        errors, values / units, lambda at: search.slopes(at * units, NEAR * units) * units,
        xtol=1e-12, ftol=1e-12, gtol=1e-12,
    )  # fmt: skip
    if not found.success or not np.isfinite(found.cost):
        raise StudyError(f"fit: no parameters found from {start} ({found.message}); begin elsewhere, or take another law")
    ends = np.cumsum([len(table) for table in tables.values()])[:-1]
    each = {name: float(np.linalg.norm(part)) for name, part in zip(tables, np.split(found.fun, ends), strict=True)}
    values = found.x * units
    parameters, material = search.parameters(values), search.material(values)
    edge = search.edge(values, EDGE * units)
    unsettled = search.unsettled(found.jac) if not edge else []
    fitted = Fit(material, parameters, each, tables, _unstable(material, tables), edge, unsettled)
    if fitted.warning:
        warnings.warn(f"fit: {fitted.warning}", stacklevel=2)
    return fitted


class _Search:
    """The stresses of a law at the stretches of tests, `seen` in these, over all its parameters as one array; stresses of a
    test are over its largest one and the root of their number."""

    def __init__(
        self, law: Callable[..., Isotropic], K: float, tables: Mapping[str, Floats], start: Mapping[str, object]
    ) -> None:
        self.law, self.K, self.tables = law, K, tables
        _refuse_unfit(law, list(start))
        self._starts = {name: _numbers(name, value) for name, value in start.items()}
        weights = [np.full(len(t), 1.0 / (np.abs(t[:, 1]).max() * len(t) ** 0.5)) for t in tables.values()]
        self._weights = np.concatenate(weights)
        self.seen = self._weights * np.concatenate([table[:, 1] for table in tables.values()])

    def parameters(self, values: Floats) -> Parameters:
        """As the law takes them."""
        ends = np.cumsum([part.size for part in self._starts.values()])[:-1]
        parts = zip(self._starts.items(), np.split(values, ends), strict=True)
        return {name: part.reshape(as_stated.shape).tolist() for (name, as_stated), part in parts}

    def material(self, values: Floats) -> Isotropic:
        return self.law(**self.parameters(values), K=self.K)

    def stresses(self, values: Floats) -> Floats | None:
        """None where the law refuses its parameters, or has no stress at a stretch of the tests."""
        try:
            material = self.material(values)
        except ValueError:
            return None
        parts = [nominal_stress(material, name, table[:, 0]) for name, table in self.tables.items()]
        found = self._weights * np.concatenate(parts)
        return found if np.isfinite(found).all() else None

    def begin(self) -> tuple[Floats, Floats]:
        """Where the search begins, and the parameters' units there: moduli are brought to the scale of the tests."""
        values = np.concatenate([part.ravel() for part in self._starts.values()])
        try:
            energy_parts(self.material(values))  # says what it thinks of the start, before the search does
        except TypeError as error:
            raise StudyError(f"fit: {error}") from None
        steps = NEAR * (np.abs(values) + np.where(values == 0.0, np.abs(values).max(), 0.0))
        slopes, stresses = self.slopes(values, steps), self.stresses(values)
        if stresses is None or not stresses.any():
            raise StudyError(f"fit: the law has no stresses at {self.parameters(values)} in all tests; begin elsewhere")
        moduli = _moduli(values, slopes, stresses)
        share = float(stresses @ self.seen / (stresses @ stresses))
        # the stresses of tests and start may differ in sign, by the start of other parameters: their sizes are then equal
        scale = share if share > 0.0 else float(np.linalg.norm(self.seen) / np.linalg.norm(stresses))
        scaled = np.where(moduli, scale * values, values)
        if (found := self.stresses(scaled)) is not None:
            steps, values, stresses = np.where(moduli | (values == 0.0), scale, 1.0) * steps, scaled, found
            slopes = self.slopes(values, steps)
        sizes = np.linalg.norm(slopes, axis=0)
        # of a parameter that begins at zero: what changes the stresses by as much as they are
        effect = np.divide(np.linalg.norm(stresses), sizes, out=np.ones_like(sizes), where=sizes > 0.0)
        return values, np.where(values == 0.0, effect, np.abs(values))

    def slopes(self, values: Floats, steps: Floats) -> Floats:
        """Derivatives (stresses, n) by differences, of each towards the side that the law takes."""
        here, columns = self.stresses(values), []
        for step in np.diag(np.maximum(steps, NEAR * np.abs(values))):
            tried = ((way, self.stresses(values + way)) for way in (step, -step))
            sides = ((found - here) / way.sum() for way, found in tried if found is not None and here is not None)
            columns.append(next(sides, np.zeros(len(self.seen))))
        return np.transpose(columns)

    def edge(self, values: Floats, steps: Floats) -> list[str]:
        """Names of the parameters that the law refuses a step from where they are."""
        near = np.diag(np.maximum(steps, EDGE * np.abs(values)))
        return self._named([self.stresses(values + step) is None or self.stresses(values - step) is None for step in near])

    def unsettled(self, slopes: Floats) -> list[str]:
        """Names of the parameters that take part in changes which move the stresses not at all, by their slopes (stresses,
        n), each for a change by its unit."""
        *_, sizes, ways = np.linalg.svd(slopes)
        idle = ways[np.append(sizes, np.zeros(len(ways) - len(sizes))) <= SETTLED * sizes.max()]
        return self._named(np.linalg.norm(idle, axis=0) > 0.1)

    def _named(self, which: Sequence[bool] | Array) -> list[str]:
        names = [name for name, part in self._starts.items() for _ in range(part.size)]
        return list(dict.fromkeys(name for name, chosen in zip(names, which, strict=True) if chosen))


def _moduli(values: Floats, slopes: Floats, stresses: Floats) -> Array:
    """Which parameters (n,) are moduli, with which together the stresses grow in proportion: by Euler's theorem those p_i
    with sum p_i ds/dp_i = s; the fewest that do. None of a law that has none, as where one is within it."""
    parts, places = slopes * values, range(len(values))
    for count in range(1, len(values) + 1):
        for chosen in itertools.combinations(places, count):
            if np.linalg.norm(parts[:, chosen].sum(axis=1) - stresses) < 1e-5 * np.linalg.norm(stresses):
                return np.isin(places, chosen)
    return np.zeros(len(values), dtype=bool)


def _words(value: float | list[float]) -> str:
    return f"[{', '.join(map(_words, value))}]" if isinstance(value, list) else f"{value:.4g}"


def _numbers(name: str, value: object) -> Floats:
    try:
        found = np.array(value, dtype=float)
    except (TypeError, ValueError):
        found = np.empty(0)
    if not found.size or not np.isfinite(found).all():
        raise StudyError(f"fit: the search for {name} begins at {value!r}: give a number, or a list of them")
    return found


def _refuse_unfit(law: Callable[..., Isotropic], names: list[str]) -> None:
    """A law that cannot be called with these parameters and K."""
    name, known = getattr(law, "__name__", "the law"), inspect.signature(law)
    if "K" not in known.parameters and all(one.kind is not one.VAR_KEYWORD for one in known.parameters.values()):
        raise StudyError(
            f"fit: {name}({', '.join(known.parameters)}) has no parameter K, the bulk modulus, which tests do not tell: "
            "take neo_hooke(mu, K) or another law with K, or write a function of parameters and K that returns this one"
        )
    try:
        known.bind(**dict.fromkeys([*names, "K"], 1.0))
    except TypeError as error:
        needed = [one.name for one in known.parameters.values() if one.default is one.empty and one.name != "K"]
        starts = ", ".join(f"{one}=..." for one in needed)
        raise StudyError(
            f"fit: {name}: {error}; write where the search begins for all of its parameters: {starts}"
        ) from None


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
    with the stretch, shared by those that do its work; NaN where the law has no energy."""
    ways, share = TESTS[test]

    def energy(stretch: float) -> float:
        b = np.square(ways(stretch))
        try:
            return isochoric_energy(material, float(b.sum()), float((b**2).sum()))
        except ValueError:  # chains that are drawn out: a logarithm of what is below zero
            return float("nan")

    steps = STEP * stretches
    # of fourth order: (8 (W(s + h) - W(s - h)) - (W(s + 2 h) - W(s - 2 h))) / 12 h
    near, far = (np.array([energy(s + k * h) - energy(s - k * h) for s, h in zip(stretches, steps, strict=True)])
                 for k in (1, 2))  # fmt: skip
    return (8 * near - far) / (12 * steps) / share


def _table(name: str, table: object) -> Floats:
    if name not in TESTS:
        raise StudyError(f"fit: no test '{name}'; there are {', '.join(TESTS)}")
    values = np.array(table, dtype=float)
    wrong = ""
    if values.ndim != 2 or values.shape[1] != 2 or len(values) < 2:
        wrong = f"two rows or more, not numbers of the shape {values.shape}"
    elif not np.isfinite(values).all():
        wrong = f"row {int(np.flatnonzero(~np.isfinite(values).all(axis=1))[0]) + 1} has what is no number"
    elif values[:, 0].min() <= 0.0:
        wrong = f"the least stretch is {values[:, 0].min():.4g}; a stretch is a length over that at the start, no strain"
    if wrong:
        raise StudyError(f"fit: test '{name}' needs a table (n, 2) of stretches above zero and nominal stresses: {wrong}")
    if not np.abs(values[:, 1]).max() > 0.0:
        raise StudyError(f"fit: test '{name}' has no stress")
    return values
