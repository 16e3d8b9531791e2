"""What all competitors are given: a quarter of a plate of rubber, 40 x 40 x 10 mm, on a smooth floor.

parity: the nodes of its top within 20 x 20 mm go down and may slide; punch, friction: a rigid punch with sharp edges of that
size presses on it, without and with friction.
"""

from collections.abc import Mapping

SIDE, HALF, HEIGHT = 40.0, 20.0, 10.0  # of the plate, of the punch, of both [mm]
A1, A2, K = 0.1863, 0.0098, 5.0  # Mooney-Rivlin [MPa]
TRAVEL = 0.2  # per step [mm]
STEPS: Mapping[str, int] = {"parity": 5, "punch": 5, "friction": 5}
FRICTION: Mapping[str, float] = {"punch": 0.0, "friction": 0.3}
