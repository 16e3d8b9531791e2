"""One short gmsh script per geometry: copy one to make a new scene."""
