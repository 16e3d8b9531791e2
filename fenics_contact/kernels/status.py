"""Status codes of a slave point, shared by every contact kernel and by the output."""

OPEN = 0
CLOSED = 1  # in contact without friction
STICK = 2
SLIP = 3

NAMES = ("open", "closed", "stick", "slip")
