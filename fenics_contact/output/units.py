"""Names of the units a scene is stated in; they only label the output."""

from dataclasses import dataclass


@dataclass(frozen=True)
class Units:
    """Consistent units: pressure must be force per length squared. Numbers are never converted."""

    length: str = "mm"
    force: str = "N"
    pressure: str = "MPa"
