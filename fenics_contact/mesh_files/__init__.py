"""Mesh files of other programs, read into the current gmsh model, with their sets as named groups."""
