"""Names of the units a scene is stated in; they only label the output."""

import math
from dataclasses import dataclass, fields

from fenics_contact.values import SceneError, text

_PREFIXES = {"": 1.0, "n": 1e-9, "u": 1e-6, "µ": 1e-6, "μ": 1e-6, "m": 1e-3, "k": 1e3, "M": 1e6, "G": 1e9}
CONSISTENT = 1e-6  # of a pressure: conversions have as many digits
# those that are known, in metres, newtons and pascals; others are taken as they are
_KNOWN = {
    "length": {f"{prefix}m": size for prefix, size in _PREFIXES.items()} | {"cm": 1e-2, "in": 0.0254, "ft": 0.3048},
    "force": {f"{prefix}N": size for prefix, size in _PREFIXES.items()} | {"lbf": 4.4482216152605},
    "pressure": {f"{prefix}Pa": size for prefix, size in _PREFIXES.items()} | {"bar": 1e5, "psi": 6894.757293168},
}


@dataclass(frozen=True)
class Units:
    """Consistent units: pressure must be force per length squared. Numbers are never converted."""

    length: str = "mm"
    force: str = "N"
    pressure: str = "MPa"

    def __post_init__(self) -> None:
        """SceneError: one that is known is of another kind, or the pressure is not the force per length squared."""
        for unit in fields(self):
            text(name := getattr(self, unit.name), f"Units: {unit.name}")
            if (kind := next((kind for kind, known in _KNOWN.items() if name in known), unit.name)) != unit.name:
                raise SceneError(f"Units: {unit.name} = '{name}' is a unit of {kind}; give length, force and pressure")
        length, force, pressure = (_KNOWN[unit.name].get(getattr(self, unit.name), math.nan) for unit in fields(self))
        if abs(pressure * length**2 / force - 1.0) > CONSISTENT:  # never of what is not known
            raise SceneError(
                f"Units: {self.pressure} is not {self.force} per {self.length} squared; numbers are never converted, so "
                "name the units in which they are consistent"
            )
