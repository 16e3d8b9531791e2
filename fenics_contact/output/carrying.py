"""Notes on what carries a contact: few points of the slave, or facets of the master that do not resolve its pressures."""

from collections.abc import Mapping, Sequence
from typing import NamedTuple

from fenics_contact.output.columns import HistoryRow
from fenics_contact.output.names import plain_name
from fenics_contact.units import Units

# Of the mean squares of pressures, what more of it varies within facets of a softer master: beyond, peak pressures of round
# bodies and of punches on 0.4 ... 4 facets to either side were 1.5 ... 9 times the true ones, below most within two fifths
WITHIN = 0.34
BETWEEN = 3  # nodes of a side: with one between its ends they show a pressure that rises towards these
EVEN = 0.01  # of the peak pressure: a mean that is less below it is the same all over


class Carriers(NamedTuple):
    """Of a contact, what tells whether few points carry it: area of its slave [length^2], up to how many points are few, and
    what they are, in words."""

    area: float
    few: int
    points: str = "slave node"


def sparse_notes(history: Sequence[HistoryRow], contacts: Mapping[str, Carriers], units: Units) -> list[str]:
    """A note on those of these contacts that no more than so many points carry where its load is greatest, and not zero.
    Not where three or more, which would show how pressure varies, carry the same pressure all over it."""
    few = []
    for name, (area, most, points) in contacts.items():
        plain = plain_name(name)
        heaviest = max(history, key=lambda row: row[f"{plain}_load_{units.force}"])
        carrying, whole = heaviest[f"{plain}_active_points"], area * heaviest[f"{plain}_peak_pressure_{units.pressure}"]
        even = carrying >= BETWEEN and heaviest[f"{plain}_load_{units.force}"] > (1.0 - EVEN) * whole
        if carrying <= most and not even:
            carry = f"{points} carries" if carrying == 1 else f"{points}s carry"
            few.append(f"contact '{name}': {carrying:.0f} {carry} all of its greatest load")
    advice = (
        "so few know the force, pressures and friction roughly, and what sticks or slips may be chance; mesh more finely "
        "where bodies touch"
    )
    return [f"{', '.join(few)}: {advice}"] if few else []


def unresolved_notes(shares: Mapping[str, float]) -> list[str]:
    """A note on those of these contacts of whose pressures more than WITHIN varies within facets of the master, which has to
    be finer, not the slave."""
    names = [f"'{name}'" for name, share in shares.items() if share > WITHIN]
    text = (
        f"contact{'s' * (len(names) > 1)} {', '.join(names)}: pressures jump from point to point within facets of the "
        "master, too wide to follow a slave that is stiffer: the force may be right, peak pressures are up to several times "
        "too great; mesh the master more finely than the slave where bodies touch, or state the softer body as the slave, "
        "unless an edge of it digs in"
    )
    return [text] if names else []
