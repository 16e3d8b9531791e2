"""Pure Numba functions on float64 arrays: shapes, gaps, normals, laws and contact elements."""

from fenics_contact.kernels import argument_types as argument_types
