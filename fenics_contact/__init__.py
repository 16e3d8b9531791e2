"""Large-deformation frictional contact of rubber-like bodies on FEniCSx."""

import gc

from fenics_contact import packages  # noqa: F401 - first, so that a missing module is named with its package
from fenics_contact.contact.friction import coulomb
from fenics_contact.contact.penalties import Penalty
from fenics_contact.contact.profiles import rigid_extrusion, rigid_revolution
from fenics_contact.contact.tools import (
    rigid_cone,
    rigid_cylinder,
    rigid_hub,
    rigid_plane,
    rigid_punch,
    rigid_sphere,
    rigid_torus,
    rigid_union,
)
from fenics_contact.mesh_io import NamedMesh, read_gmsh, read_mesh
from fenics_contact.options import Method, Output
from fenics_contact.output.film import Film
from fenics_contact.result import Result
from fenics_contact.run import solve
from fenics_contact.scene.motion import Motion
from fenics_contact.scene.scene import Scene
from fenics_contact.scene.stage import Stage
from fenics_contact.scene.statements import Body
from fenics_contact.scene.targets import Branch, Displacement, Load, Travel
from fenics_contact.scene.tool_mesh import rigid_curve, rigid_surface
from fenics_contact.solid.materials import (
    arruda_boyce,
    from_elastic,
    mooney_paper,
    mooney_rivlin,
    neo_hooke,
    ogden,
    user_energy,
    yeoh,
)
from fenics_contact.solvers.course import ArcSteps
from fenics_contact.uncaught import install as _install
from fenics_contact.units import Units
from fenics_contact.values import FolderError, SceneError

gc.freeze()  # as in `packages`: in a small run the collector would look through all of it once, for 45 ms
_install()  # of wrong statements that end a script only the message and the script's own lines are printed

__version__ = "0.1.0"

__all__ = [
    "ArcSteps",
    "Body",
    "Branch",
    "Displacement",
    "Film",
    "FolderError",
    "Load",
    "Method",
    "Motion",
    "NamedMesh",
    "Output",
    "Penalty",
    "Result",
    "Scene",
    "SceneError",
    "Stage",
    "Travel",
    "Units",
    "arruda_boyce",
    "coulomb",
    "from_elastic",
    "mooney_paper",
    "mooney_rivlin",
    "neo_hooke",
    "ogden",
    "read_gmsh",
    "read_mesh",
    "rigid_cone",
    "rigid_curve",
    "rigid_cylinder",
    "rigid_extrusion",
    "rigid_hub",
    "rigid_plane",
    "rigid_punch",
    "rigid_revolution",
    "rigid_sphere",
    "rigid_surface",
    "rigid_torus",
    "rigid_union",
    "solve",
    "user_energy",
    "yeoh",
]
