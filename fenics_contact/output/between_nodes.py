"""What summary.json and notes say of friction that is linear between nodes, where what slides turns round between them."""

from collections.abc import Mapping

import numpy as np

from fenics_contact.assembly.finding import spot
from fenics_contact.output.history import ROUGH, Summary


def friction_summary(errors: Mapping[str, tuple[float, list[float]]]) -> Summary:
    """By contact how its load would change, over that, did each place between nodes rub by its own way, and around which
    node most."""
    return {name: {"load_change_over_load": share, "most_at": place} for name, (share, place) in errors.items()}


def friction_notes(summary: Summary) -> list[str]:
    """A note per contact whose load would change by more than ROUGH."""
    return [
        f"contact '{name}': friction is linear from node to node, and most around {spot(np.array(e['most_at']))} what "
        "slides turns round between nodes, or comes to rest there: did each place rub by its own way, the load would change "
        f"by about {e['load_change_over_load']:+.1%}: take finer cells of the slave there"
        for name, e in summary.items()
        if abs(e["load_change_over_load"]) > ROUGH
    ]
