"""Pure Numba functions on float64 arrays: shapes, gaps, normals, laws and contact elements."""
