"""Large-deformation frictional contact of rubber-like bodies on FEniCSx."""
