"""Names of columns and fields: what the scene calls its parts, in letters that every reader takes, and units."""

import re

from fenics_contact.units import Units


def plain_name(name: str) -> str:
    """A name of the scene's as columns and fields carry it."""
    return re.sub(r"[\W_]+", "_", name).strip("_")


def energy_unit(units: Units) -> str:
    """Of energies and moments."""
    return f"{units.force}{units.length}"
