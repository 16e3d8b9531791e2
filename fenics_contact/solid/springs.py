"""Springs on all bodies, of a stiffness that goes with their own: what stabilisation and damping are made of."""

from collections.abc import Callable, Sequence
from typing import TypeVar

import ufl

from fenics_contact import compat
from fenics_contact.assembly.size import bodies_size
from fenics_contact.assembly.spring_term import Springs
from fenics_contact.solid import virtual_power as vp
from fenics_contact.solid.body import Body
from fenics_contact.solid.materials import young
from fenics_contact.types import Function, Measure, Space

B = TypeVar("B", bound=Body)


def springs(space: Space, bodies: Sequence[B], dx: Callable[[B], Measure], u: Function) -> Springs:
    """Springs of stiffness share E / L^2 per reference volume between u and the places that they pull to.

    dx: body -> its measure. Returns the share, a Constant; these places, a Function; the forms (residual, tangent);
    the stiffness of those of tools [force/length].
    """
    domain, v, du = space.mesh, ufl.TestFunction(space), ufl.TrialFunction(space)
    share, reference = compat.Constant(domain, 0.0), compat.Function(space)
    size = bodies_size(space)
    soft = [(share * (young(body.material) / size**2), dx(body)) for body in bodies]
    residual = sum(vp.spring_power(k, u - reference, v, dx) for k, dx in soft)
    tangent = sum(vp.spring_power(k, du, v, dx) for k, dx in soft)
    return share, reference, (residual, tangent), size * min(young(body.material) for body in bodies)
