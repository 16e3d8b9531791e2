"""What summary.json and notes say of friction that is linear between nodes, where it turns round between them."""

from collections.abc import Mapping

import numpy as np

from fenics_contact.assembly.finding import spot
from fenics_contact.output.history import ROUGH, Summary


def friction_summary(errors: Mapping[str, tuple[float, list[float]]]) -> Summary:
    """By contact how its load would change, over that, were friction at its limit where it turns round between nodes, and
    around which node that is most."""
    return {name: {"load_change_over_load": share, "most_at": place} for name, (share, place) in errors.items()}


def friction_notes(summary: Summary) -> list[str]:
    """A note per contact whose load would change by more than ROUGH."""
    return [
        f"contact '{name}': friction is linear from node to node, and most around {spot(np.array(e['most_at']))} it turns "
        "round between nodes that slide: were it at its limit there, too, up to where it turns, the load would change by "
        f"{e['load_change_over_load']:+.1%}, and by less where a part of that sticks: take finer cells of the slave there"
        for name, e in summary.items()
        if abs(e["load_change_over_load"]) > ROUGH
    ]
