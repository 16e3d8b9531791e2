"""Bodies that first touch within a step while they move aside: the step ends about where they touch."""

from fenics_contact.assembly.contact_term import ContactTerm
from fenics_contact.assembly.finding import Finding
from fenics_contact.assembly.system import System

TOUCHES = "first touch of what moves aside"  # the kind of failure
ALL = 0.95  # of a contact's load on points that come in: it had none before
SLIGHT = 0.02  # of the load: friction that is not looked at
FEWEST = 0.01  # of the step that was to be taken: the shortest in which bodies touch


class FirstTouch:
    """What a step's state has friction of a way through the air in.

    Loads are those of the longest step that was tried from the accepted state: in a shorter one that has just touched
    friction is its share of hardly any.
    """

    def __init__(self, system: System) -> None:
        self._contacts = [contact for contact in system.contacts if contact.rough]
        self._loads: dict[ContactTerm, float] = {}
        self._longest = 0.0

    def objection(self, system: System, size: float) -> Finding | None:
        """Why a step of a size [t] to the present state is too long. Collective."""
        self._longest = max(self._longest, size)
        for contact in self._contacts:
            friction, came, load = contact.forces.first_touch(system.state)
            most = self._loads[contact] = max(self._loads.get(contact, 0.0), load)
            if size > FEWEST * self._longest and came > ALL * load and friction > SLIGHT * most:
                reason = "what touches first within the step has friction of its way through the air"
                return Finding(TOUCHES, reason, f"contact '{contact.name}'", "take more steps there")
        return None

    def accepted(self) -> None:
        """The next step begins."""
        self._loads.clear()
        self._longest = 0.0
