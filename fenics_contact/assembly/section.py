"""What a plane mesh stands for: a cut through bodies in plane strain, or the half-plane that turns about y."""

from dataclasses import dataclass

import numpy as np

from fenics_contact.types import Bools, Floats

ON_AXIS = 1e-9  # of the largest coordinate: nodes that near to the axis of turning are on it


@dataclass(frozen=True)
class Section:
    """The plane z = 0 of bodies as thick as `thickness` [length] that cannot move along z (plane strain), or, axisymmetric,
    the half-plane x = R >= 0 of bodies that are all the way round the axis y. Forces are those of the whole thickness, or
    of the full turn."""

    axisymmetric: bool = False
    thickness: float = 1.0

    @property
    def resultants(self) -> tuple[str, str]:
        """Axes along which forces, and about which moments, add up to something: all the way round they cancel."""
        return ("y", "") if self.axisymmetric else ("xy", "z")

    @property
    def ways(self) -> str:
        """Axes along which tools move."""
        return "y" if self.axisymmetric else "xy"

    def depth(self, X: Floats) -> Floats:
        """How deep the bodies are (...) behind places X (..., 3) of the plane [length]: the thickness, or the way round."""
        return 2.0 * np.pi * X[..., 0] if self.axisymmetric else np.full(X.shape[:-1], self.thickness)


def adding_up(section: Section | None) -> Bools:
    """Along which of the three axes forces (3,) add up to something; None: in space, along all."""
    return np.array([section is None or axis in section.resultants[0] for axis in "xyz"])
