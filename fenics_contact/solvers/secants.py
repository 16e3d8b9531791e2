"""What solves with one factorisation learn from one another."""

from fenics_contact.assembly.system import System
from fenics_contact.types import Floats, Vec

# Of a solve's length along the last increment: what is not yet done by it. A solve that goes on as far as the last one has
# learnt nothing, and would be lengthened without an end
LEAST = 0.1


class Secants:
    """The increments since a tangent, by which a later solve with its factorisation follows the state that they have led to.

    Broyden's rank-one updates (1965, doi:10.1090/S0025-5718-1965-0198670-6): with each increment the tangent changes so that
    it would have led there. They need the increments alone (Kelley 1995, doi:10.1137/1.9781611970944, section 7.3), as long
    as each was taken whole and what is solved has not changed since: else `forget`.
    """

    def __init__(self, system: System) -> None:
        self._system = system
        self._increments: list[tuple[Vec, Floats, float]] = []  # of u, of the tools, and the square of the first

    def begin(self, du: Vec, dq: Floats) -> None:
        """The increment of the tangent's own solve, in which supports may move. Collective."""
        own = du.copy()
        self._system.supports.put_forces(own.array_w, 0.0)  # nothing is solved for there
        self.forget()
        self._keep(own, dq)

    def forget(self) -> None:
        self._increments = []

    def improve(self, du: Vec, dq: Floats) -> None:
        """Change what a solve with the factorisation has given, from where the increments so far have led. Collective."""
        kept, plain = self._increments, (du.copy(), dq.copy())
        for (before, _, square), (after, turned, _) in zip(kept, kept[1:], strict=False):
            share = before.dot(du) / square
            du.axpy(share, after)
            dq += share * turned
        if kept:
            last, _, square = kept[-1]
            left = 1.0 - last.dot(du) / square
            if left < LEAST:
                self.forget()
                plain[0].copy(du)
                dq[:] = plain[1]
                return
            du.scale(1.0 / left)
            dq /= left
        self._keep(du, dq)

    def _keep(self, du: Vec, dq: Floats) -> None:
        if (square := du.dot(du)) > 0.0:
            self._increments.append((du, dq, square))
