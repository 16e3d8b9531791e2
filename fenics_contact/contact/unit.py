"""Vectors in rows, brought to length one."""

import numpy as np

from fenics_contact.types import Floats


def unit(vectors: Floats) -> Floats:
    """Vectors (..., 3) of length one; zero ones stay."""
    return np.asarray(vectors / np.maximum(np.linalg.norm(vectors, axis=-1, keepdims=True), 1e-300))
