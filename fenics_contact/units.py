"""Names of the units a scene is stated in; they only label the output."""

from dataclasses import dataclass, fields

from fenics_contact.values import text


@dataclass(frozen=True)
class Units:
    """Consistent units: pressure must be force per length squared. Numbers are never converted."""

    length: str = "mm"
    force: str = "N"
    pressure: str = "MPa"

    def __post_init__(self) -> None:
        for unit in fields(self):
            text(getattr(self, unit.name), f"Units: {unit.name}")
