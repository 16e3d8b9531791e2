"""What an accepted state consists of, as arrays that any number of ranks can take up again."""

from collections.abc import Mapping
from typing import Any

import numpy as np

from fenics_contact.assembly.numbering import gather, node_keys, spread
from fenics_contact.assembly.system import System
from fenics_contact.assembly.term import Term
from fenics_contact.assembly.trail import Accepted
from fenics_contact.types import Array, Floats, Ints64

COORDINATES = 1e-9  # of the mesh's size: what moving nodes between ranks rounds is 1e-16, another mesh is far from it

Arrays = dict[str, Any] | None  # what `collect` gave, on rank 0 alone
Rows = tuple[Ints64, Array]  # a number per row that no partition changes, and the rows


class Memory:
    """Collects and restores the committed state of a System: displacement, poses of tools, the terms' history, scales, and
    the states accepted before it, through which the next step is extrapolated.

    Terms with a history offer key (ne,), a number per element that no partition changes, history() -> {name: (ne, ...)}
    and restore({name: (ne, ...)}, state). fields(): further {name: local array like u} to keep, e.g. a predictor's.
    """

    def __init__(self, system: System) -> None:
        self.system = system
        self.keys = node_keys(system.space)
        self._X = system.space.tabulate_dof_coordinates()

    def collect(self, fields: dict[str, Floats] | None = None, rows: Mapping[str, Rows] | None = None) -> Arrays:
        """{name: array} on rank 0, None elsewhere; rows: of others, {name: (keys, rows)}. Collective."""
        system, comm = self.system, self.system.comm
        owned = system.space.dofmap.index_map.size_local
        nodal = {"X": self._X.ravel(), "u": system.state.u.x.array} | {f"field/{k}": v for k, v in (fields or {}).items()}
        out: dict[str, Any] = {}
        before = system.trail.accepted[:-1]
        nodal |= {f"before/{i}/u": one.u for i, one in enumerate(before)}
        for name, values in nodal.items():
            _put(out, name, gather(comm, self.keys[:owned], values.reshape(-1, 3)[:owned]))
        for term in system.terms:
            for name, values in term.history().items():
                _put(out, f"{_label(term)}/{name}", gather(comm, term.key, values))
        for name, (keys, values) in (rows or {}).items():
            _put(out, f"rows/{name}", gather(comm, keys, values))
        out |= {"q": system.state.q, "t": system.state.t}
        out |= {"counted": system.state.poses.counted, "turns": system.state.poses.turns}
        out |= {"before/q": np.array([one.q for one in before]), "before/t": np.array([one.t for one in before])}
        out |= {"force_scale": system.scales.accepted, "stiffness": system.scales.stiffness}
        out |= {f"most/{term.name}": np.array(list(term.most.values())) for term in system.springs}
        return out if comm.rank == 0 else None

    def restore(self, arrays: Arrays) -> dict[str, Floats]:
        """Put collected arrays back as the committed state; returns the fields. Collective.

        ValueError, on all ranks, if they belong to another mesh or other terms.
        """
        system, comm = self.system, self.system.comm
        self._refuse_other_nodes(arrays)
        system.state.u.x.array[:] = self._nodal(arrays, "u").ravel()
        kept = [
            {name: self._rows(arrays, f"{_label(term)}/{name}", term.key) for name in term.history()}
            for term in system.terms
        ]
        names = ("counted", "turns", "q", "t", "force_scale", "stiffness", "before/q", "before/t")
        counted, turns, *rest = comm.bcast(arrays and [arrays[name] for name in names])
        system.state.poses.resume(counted, turns)
        q, t, largest, stiffness, *before = rest
        system.scales.resume(largest, stiffness)
        for term in system.springs:
            term.recall(comm.bcast(arrays and arrays[f"most/{term.name}"].tolist()))
        places = [self._nodal(arrays, f"before/{i}/u").ravel() for i in range(len(before[1]))]
        system.trail.resume(q, float(t), kept, [Accepted(*one) for one in zip(places, *before, strict=True)])
        system.assemble_residual()  # the terms' tractions and the reactions are those of the state
        fields = comm.bcast(arrays and [name for name in arrays if name.startswith("field/") and not name.endswith("/key")])
        return {name.removeprefix("field/"): self._nodal(arrays, name).ravel() for name in fields}

    def rows(self, arrays: Arrays, keys: Mapping[str, Ints64]) -> dict[str, Array]:
        """The rows of others that were collected, {name: those of these keys}. ValueError, on all ranks, where one is not
        there. Collective."""
        return {name: self._rows(arrays, f"rows/{name}", of) for name, of in keys.items()}

    def place(self, arrays: Arrays) -> None:
        """Put the displacement of another scene's collected arrays in the place of that at rest. Collective.

        ValueError, on all ranks, if the arrays belong to another mesh.
        """
        self._refuse_other_nodes(arrays)
        self.system.state.u.x.array[:] = self._nodal(arrays, "u").ravel()

    def begin(self, arrays: Arrays, q: Floats) -> list[str]:
        """Begin with the displacement placed, coordinates q (tools, 6), and the histories of terms of the same name and
        points in another scene's collected arrays; returns the names of contacts without. Collective."""
        system, comm = self.system, self.system.comm
        there = comm.bcast(arrays and list(arrays)) or []
        kept, left = [], []
        for term in system.terms:
            own = term.history()
            # what of it the other scene had no use for, as multipliers, is as at rest
            known = [name for name in own if f"{_label(term)}/{name}" in there]
            try:
                values = {name: self._rows(arrays, f"{_label(term)}/{name}", term.key) for name in known}
            except ValueError:  # it has other points
                values = {}
            kept.append(own | values)
            left += [term.name] if not values and term in system.contact_terms else []
        system.scales.resume(*comm.bcast(arrays and [arrays["force_scale"], arrays["stiffness"]]))
        system.trail.resume(q, 0.0, kept)
        system.assemble_residual()
        return left

    def _refuse_other_nodes(self, arrays: Arrays) -> None:
        """ValueError, on all ranks, where the arrays' nodes are not those of the mesh."""
        comm, X = self.system.comm, self._nodal(arrays, "X")
        size = np.max(comm.allgather(np.ptp(X, axis=0).max() if len(X) else 0.0))
        same = bool(np.abs(X - self._X).max(initial=0.0) <= COORDINATES * size)
        if not all(comm.allgather(same)):
            raise ValueError("its nodes lie in other places: the mesh was made with other parameters")

    def _nodal(self, arrays: Arrays, name: str) -> Floats:
        return self._rows(arrays, name, self.keys)

    def _rows(self, arrays: Arrays, name: str, keys: Ints64) -> Array:
        try:
            return spread(self.system.comm, None if arrays is None else (arrays[f"{name}/key"], arrays[name]), keys)
        except KeyError:
            raise ValueError(f"it does not hold '{name}' for every point of this scene") from None


def _label(term: Term) -> str:
    """Under what a term's history is kept: contacts bear names of the user's."""
    return f"term/{type(term).__name__} {term.name}"


def _put(out: dict[str, Any], name: str, gathered: tuple[Ints64, Array] | None) -> None:
    if gathered is not None:
        out[f"{name}/key"], out[name] = gathered
