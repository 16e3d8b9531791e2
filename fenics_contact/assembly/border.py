"""What couples the matrix of the bodies with the coordinates of the rigid tools."""

import numpy as np


class Border:
    """Couplings with the tools' coordinates: columns, rows (6 tools, local dofs) and corner (6 tools, 6 tools)."""

    def __init__(self, tools: int, dofs: int) -> None:
        self.columns = np.zeros((6 * tools, dofs))
        self.rows = np.zeros((6 * tools, dofs))
        self.corner = np.zeros((6 * tools, 6 * tools))

    def clear(self) -> None:
        for part in (self.columns, self.rows, self.corner):
            part[:] = 0.0
