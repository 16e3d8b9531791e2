"""Runs a random scene and judges it: does what converged hold what a solution must, and does what a verdict advises cure?

`python3 tests/scene_judge.py SEED [once]` prints the judgement as JSON; once: without the runs of more steps.
"""

import json
import sys
import time
from dataclasses import replace

import numpy as np
from mpi4py import MPI
from random_scenes import BREAKS, GOOD, build, draw, make_tool, times

from fenics_contact import SceneError, run, solve
from fenics_contact.assembly.exchange import ghosted_vector, sum_to_owners
from fenics_contact.contact import findings
from fenics_contact.contact.tools import RigidTool
from fenics_contact.kernels import rigid_shapes
from fenics_contact.scene import build as building

COMM = MPI.COMM_WORLD
TOLERANCE = 1e-8  # of the force: where steps end
SPRINGS = 1e-7  # of the load: what springs may carry where a step ends
CONE = 1e-8  # of the largest pressure: friction beyond mu N, pressures that pull; return mapping is exact to round-off
NOTHING = 1e-10  # of Young's modulus: a pressure of round-off
DEEP = 0.05  # of a cell's height: where a penetration must be said
SMOOTH = 1e-6  # of the force: what more steps may change where the path does not matter; steps end at 1e-8
ROUGH = 0.02  # of the force: the same with friction
USED, FAINT = 0.9, 0.01  # of mu p: friction that is used up; of the largest pressure: where a point presses
LEAST = 1e-3  # of E d^2: what a tool must press with, by d inside where the body was; a ball's law is 4/3 E* d^1.5 R^0.5
JUMPS = ("jump", "snap", "branch")  # words of notes after which the path decides where it ends
COSTS = 0.03  # of the force: what penalties may change it where a note says that they were raised, or how much they cost


class Probe:
    """Looks at every accepted state of a run: forces, balance, friction. Given to solve as a column of the history."""

    def __init__(self, young):
        self.rows, self.system, self.young = [], None, young

        def watched(*stated):
            built = building.build(*stated)
            self.system = built.system
            return built

        run.build = watched

    def __call__(self, view):
        system, state = self.system, self.system.state
        total, loads = ghosted_vector(system.space), np.zeros(3)
        tools, size = np.zeros_like(system.tool_residual), 0.0
        for term in system.terms:
            if term in (system.grounding, system.damping):
                continue
            local = np.zeros_like(state.u.x.array)
            term.add_residual(state, local, tools)
            size = max(size, COMM.allreduce(float(np.abs(local).sum())))
            if term not in system.contact_terms:
                loads -= COMM.allreduce(local.reshape(-1, 3).sum(axis=0))
            with total.localForm() as whole:
                whole.array_w[:] += local
        sum_to_owners(total)
        owned = total.array.copy()
        held = np.zeros_like(owned)
        held[system.supports.owned] = owned[system.supports.owned]
        owned[system.supports.owned] = 0.0
        owed = np.where(system.tools.free, COMM.allreduce(tools) - system.tools.forces(state.t), 0.0)
        left = np.sqrt(COMM.allreduce(float(owned @ owned)) + np.sum(owed**2))
        forces = {c.name: c.forces.measures(state)["force"] for c in system.contact_terms}
        outside = sum((forces[c.name] for c in system.contact_terms if c.partner.grounded), np.zeros(3))
        sum_of_all = outside + loads + COMM.allreduce(held.reshape(-1, 3).sum(axis=0))
        row = {"t": state.t, "forces": forces, "loads": loads, "left": left, "sum": np.linalg.norm(sum_of_all)}
        row |= {"scale": system.scales.balance, "size": size, "cone": 0.0, "pull": 0.0}
        for contact in system.contact_terms:
            over, pull = beyond_coulomb(contact, state, NOTHING * self.young)
            row["cone"], row["pull"] = max(row["cone"], over), max(row["pull"], pull)
        self.rows.append(row)
        return 0.0


def beyond_coulomb(contact, state, least, share=1.0):
    """Of the largest pressure: friction beyond mu N, and pull, of any point; zeros below that pressure.

    share: of its coefficient of friction. Collective.
    """
    pressure, along = contact.forces.split_traction(state)
    law = contact.trial.law
    mu = law.friction.mu
    crumbs = law.touch * law.eps_n.max(initial=0.0), law.touch * law.eps_t.max(initial=0.0)  # what gaps and ways round off
    over = (np.linalg.norm(along, axis=2) - share * mu * pressure).max(initial=0.0) - mu * crumbs[0] - crumbs[1]
    pull = -pressure.min(initial=0.0) - crumbs[0]
    most, over, pull = np.max(COMM.allgather((pressure.max(initial=0.0), max(over, 0.0), max(pull, 0.0))), axis=0)
    return (over / most, pull / most) if most > least else (0.0, 0.0)


class Run:
    """A Statement carried out: result, probe, and tool."""

    def __init__(self, s, finer=1):
        scene, self.tool, options = build(s)
        self.s, self.scene, self.probe = replace(s, steps=finer * s.steps), scene, Probe(s.young * s.pressure)
        if finer != 1 and not s.arcs:
            options["steps"] = times(s, finer)
        self.result = solve(scene, record={"probe": self.probe}, **options)
        self.rows, self.verdict, self.system = self.probe.rows, self.result.verdict, self.probe.system

    def said(self, *words):
        return any(word in note for note in self.verdict.notes for word in words)

    @property
    def most(self):
        """Largest force of any contact at any time."""
        return max((np.linalg.norm(f) for row in self.rows for f in row["forces"].values()), default=0.0)

    def at_ends(self):
        """Forces (stretches, contacts, 3) at the ends of the path's stretches."""
        ends = BREAKS[self.s.path][0][1:]
        return np.array([list(min(self.rows, key=lambda row: abs(row["t"] - t))["forces"].values()) for t in ends])


# -- what a converged run must hold -----------------------------------------------------------------------------------
def wrongs(run):
    """What is wrong, in words, with a run that says it converged. Collective."""
    out = []
    for row in run.rows:
        # a sum over n nodes is at most sqrt(n) times the norm, which springs raise by what they may carry
        bound = (TOLERANCE + (SPRINGS if run.system.grounding else 0.0)) * row["scale"] * 1.01
        nodes = run.system.vector.getSize() / 3
        if row["left"] > bound:
            out.append(f"t = {row['t']:.4g}: {row['left'] / row['scale']:.1e} of the force out of balance")
        if row["sum"] > np.sqrt(nodes) * bound + 1e-13 * row["size"]:
            out.append(f"t = {row['t']:.4g}: all forces add up to {row['sum'] / row['scale']:.1e} of the force")
        if row["cone"] > CONE:
            out.append(f"t = {row['t']:.4g}: friction exceeds mu N by {row['cone']:.1e} of the pressure")
        if row["pull"] > CONE:
            out.append(f"t = {row['t']:.4g}: a contact pulls with {row['pull']:.1e} of the pressure")
    if (J := min(row["smallest_J"] for row in run.result.history)) <= 0.0:
        out.append(f"smallest J is {J:.3g}")
    return out[:3] + depths(run) + pressing(run) + (lifted(run) if run.s.path == "lift" else [])


def distance(tool, X, travel):
    """Signed distances (n,) of places from an analytic tool, by its own formula; None of a punch or a meshed tool."""
    x = X - tool.origin - travel
    if tool.kind == rigid_shapes.PLANE:
        return x @ tool.axes[:, 2]
    if tool.kind == rigid_shapes.SPHERE:
        return np.linalg.norm(x, axis=1) - tool.shape[0]
    if tool.kind == rigid_shapes.CYLINDER:
        return np.linalg.norm(x - np.outer(x @ tool.axes[:, 2], tool.axes[:, 2]), axis=1) - tool.shape[0]
    return None


def depths(run):
    """Nodes of a body within an analytic tool, and slave points and nodes within any master, that no note speaks of."""
    out, system = [], run.system
    u = system.state.u.x.array.reshape(-1, 3)
    X = run.scene.space.tabulate_dof_coordinates()
    for contact, stated in zip(system.contact_terms, run.scene.contacts, strict=True):
        height, name = contact.surface.cell_height, contact.name
        found = {"a point": findings.deepest_point(contact, system.state)[0]}
        found["a node"] = findings.node_depth(contact, system.state)[0]
        if isinstance(stated.master, RigidTool) and stated.master.kind in (0, rigid_shapes.SPHERE, rigid_shapes.CYLINDER):
            gaps = distance(stated.master, X + u, system.state.travel[run.scene.tools.index(stated.master)])
            slave = np.isin(np.arange(len(X)), contact.surface.nodes)
            deepest = [-min(COMM.allgather(float(gaps[mask].min(initial=0.0)))) for mask in (slave, ~slave)]
            found |= {"a node": deepest[0], "a node beside the slave surface": deepest[1]}
        for what, depth in found.items():
            told = any(f"'{name}'" in note and ("lies" in note or "penalt" in note) for note in run.verdict.notes)
            if depth > DEEP * height and not told:
                out.append(f"contact '{name}': {what} lies {depth / height:.2f} cells deep, and nothing says so")
    return out


def pressing(run):
    """Contacts that carry nothing although the statement makes them press, and no note says that the tool came in between
    slave points: while a path is at its deepest."""
    s, out = run.s, []
    E, L = s.young * s.pressure, s.length
    down = {row["t"]: row for row in run.rows}
    t = min(down, key=lambda t: abs(t - BREAKS[s.path][0][1]))
    forces = {name: -force[2] for name, force in down[t]["forces"].items()}
    if s.what != "tool":
        forces["joint"] = -forces["joint"]
    if s.pushed:
        least = 0.99 * s.force * s.pressure * L**2
    elif s.what == "pair":
        least = LEAST * E * (L * s.depth) ** 2
    else:
        least = LEAST * E * _inside(run) ** 2
    for name in ("top", "joint"):
        if name in forces and forces[name] < least and not run.said("never closed, though"):
            out.append(f"contact '{name}' presses with {forces[name]:.3g} at t = {t:.3g}, and must with {least:.3g}")
    return out


def _inside(run):
    """How far [length] the tool at its deepest lies within slave points of the bodies as they were at the start; zero of a
    punch and of a meshed tool, whose points may lie beside them, if these are not below by the way pressed."""
    s, tool = run.s, make_tool(run.s)
    contact = next(c for c in run.system.contact_terms if c.name == "top")
    travel = np.array([0.0, 0.0, -s.length * (s.gap + s.depth)])
    spots = contact.spots()
    if isinstance(tool, RigidTool) and (gaps := distance(tool, spots, travel)) is not None:
        inside = -float(gaps.min(initial=0.0))
    else:
        inner = np.abs(spots[:, :2] - s.length * np.array(s.place)).max(axis=1, initial=0.0) < 0.5 * s.length * s.half
        inside = s.length * s.depth if "punch" in s.tool and inner.any() else 0.0
    inside = max(COMM.allgather(inside))
    return inside if inside > 0.02 * s.length * s.size[2] else 0.0


def lifted(run):
    """A tool that has been lifted presses no more, and a body that a support holds is as it was, unless loads act on it."""
    s, out = run.s, []
    if s.what == "pair":
        return out  # the bodies adhere by no force: the joint is open
    last, most = run.rows[-1]["forces"], run.most
    if (left := np.linalg.norm(last["top"])) > SMOOTH * most:
        out.append(f"the lifted tool still presses with {left / most:.1e} of the force")
    moved = max(COMM.allgather(float(np.abs(run.system.state.u.x.array).max(initial=0.0))))
    if s.hold == "fixed" and not s.load and moved > SMOOTH * s.length * s.depth:
        out.append(f"the body is left displaced by {moved:.1e}")
    return out


def differs(s, run):
    """In words, how the forces at the ends of the path's stretches change with more steps by more than steps explain."""
    one, most = run.at_ends(), run.most
    if not most:
        return []
    more = Run(s, 2)
    if not more.result.converged:
        return unhelped(more, "with twice the steps")
    if any(r.said(*JUMPS) for r in (run, more)):
        return []
    change = np.abs(more.at_ends() - one).max() / most
    smooth = s.friction == 0.0 and (s.what != "tool" or s.hold != "floor" or s.floor_friction == 0.0)
    bound = SMOOTH if smooth and s.penetration is None else ROUGH
    if any(r.said("penalties raised", "penetration= is not kept", "its penalties") for r in (run, more)):
        bound = max(bound, COSTS)
    if change <= bound:
        return []
    if smooth:
        return [f"twice the steps change the force by {change:.1e}"]
    again = Run(s, 4)
    if not again.result.converged:
        return unhelped(again, "with four times the steps")
    left = np.abs(again.at_ends() - more.at_ends()).max() / most
    if left <= bound or left < 0.7 * change or again.said(*JUMPS):
        return []
    return [f"twice the steps change the force by {change:.1e}, four times by {left:.1e} more"]


# -- verdicts ---------------------------------------------------------------------------------------------------------
def with_options(s, **options):
    return replace(s, method=replace(s.method, **options))


def by_arc_length(s):
    """By arc length, which knows neither springs nor damping, nor steps of the load."""
    return replace(with_options(s, stabilise=False, damping=False, smallest_step=None), arcs=True)


def moved(s):
    """What pushes moved instead, by a way of about the same strains."""
    return replace(s, path={"push": "press", "push aside": "drag"}.get(s.path, s.path))


def more_cells(s):
    return replace(s, cells=tuple(n + 1 for n in s.cells), upper_cells=tuple(n + 1 for n in s.upper_cells))


# words of a remedy -> what they mean of a Statement
ACTIONS = {
    "more steps": lambda s: replace(s, steps=5 * s.steps),
    "smaller steps": lambda s: replace(s, steps=5 * s.steps),
    "smallest_step=": lambda s: with_options(s, smallest_step=1e-7),
    "damping=True": lambda s: with_options(s, damping=True),
    "stabilise=True": lambda s: with_options(s, stabilise=True),
    "points=3": lambda s: replace(s, points=3),
    "Penalty(share=": lambda s: replace(s, tangential_share=0.03),
    "raise penalty": lambda s: replace(s, penalty_factor=500.0),
    "raise the penalty": lambda s: replace(s, penalty_factor=500.0),
    "mesh the place more finely": more_cells,
    "arc length": by_arc_length,
    "instead of pushing": moved,
    "in place of the load": moved,
    "raise friction=": lambda s: replace(s, friction=2.0 * s.friction),
    "symmetry plane": lambda s: replace(s, axes="xy"),
}


def possible(s, verdict):
    """Whether the statement has an answer: a push aside beyond what friction holds has none."""
    return not (verdict.kind == "friction used up" and s.aside > s.friction)


def used_up(run):
    """Whether friction is all that Coulomb allows wherever the contacts that a verdict names press. Collective."""
    ends = []
    for contact in run.system.contact_terms:
        if f"'{contact.name}'" in run.verdict.place:
            pressure, along = contact.forces.split_traction(run.system.state)
            peak = max(COMM.allgather(pressure.max(initial=0.0)))
            pressing, size = pressure > FAINT * peak, np.linalg.norm(along, axis=2)
            held = (size < USED * contact.trial.law.friction.mu * pressure)[pressing].any()
            ends.append(peak > NOTHING * run.probe.young and not any(COMM.allgather(bool(held))))
    return bool(ends) and all(ends)


def cured(run, depth=2):
    """(class, what was done, what is still wrong in words) of a verdict whose remedy is done, where need be that of the
    next verdict too."""
    s, verdict, ends = run.s, run.verdict, []
    if not verdict.remedy:
        return "unclear", "", verdict.reason
    if verdict.kind == "friction used up" and not used_up(run):
        return "wrong", "", f"friction is not used up: {verdict.reason}"
    if not possible(s, verdict):
        return "impossible", "", ""
    for words, action in ACTIONS.items():
        if words not in verdict.remedy or (words == "raise friction=" and not s.pushed):
            continue  # what slides along a tool that moves has an answer with the friction stated
        changed = action(s)
        try:
            again = Run(changed)
        except SceneError as error:
            ends.append(f"{words}: {error}")
            continue
        if again.result.converged:
            found = wrongs(again)
            return ("wrong" if found else "cured"), words, "; ".join(found)
        ends.append(f"{words}: {again.verdict.reason}")
        if again.verdict.remedy != verdict.remedy and depth > 1:
            kind, done, left = cured(again, depth - 1)
            if kind in ("cured", "impossible", "wrong"):
                return kind, f"{words}, {done}", left
    return "uncured", "", "; ".join(ends)


def unhelped(run, where):
    """Nothing, or in words that a verdict is neither true of the statement nor cured by its remedy."""
    kind, _, left = cured(run)
    return [] if kind in GOOD else [f"{where}: {run.verdict.reason} || {kind}: {left}"]


# -- judgement --------------------------------------------------------------------------------------------------------
def judge(seed, thorough=True):
    """What a seed's scene comes to, as plain values. Collective."""
    s, start = draw(seed), time.perf_counter()
    out = {"seed": seed, "kind": "", "by": "", "says": "", "statement": in_words(s)}
    try:
        run = Run(s)
    except SceneError as error:
        return out | {"class": "refused", "says": str(error), "seconds": round(time.perf_counter() - start, 1)}
    out["kind"] = run.verdict.kind
    out["t"] = [row["t"] for row in run.rows]
    out["forces"] = [np.concatenate(list(row["forces"].values())).tolist() for row in run.rows]
    if run.result.converged:
        found = wrongs(run)
        if thorough and not found:
            found = differs(s, run)
        out |= {"class": "wrong" if found else "converged", "says": "; ".join(found)}
    else:
        out["class"], out["by"], left = cured(run)
        out["says"] = run.verdict.reason + (f" || {left}" if left else "")
    return out | {"seconds": round(time.perf_counter() - start, 1), "notes": run.verdict.notes}


def in_words(s):
    bodies = {"tool": "one body", "pair": "two bodies", "both": "two bodies under a tool"}[s.what]
    cells = "tetrahedra" if s.tetrahedra else "hexahedra"
    held = "" if s.what != "tool" else f", {s.hold}"
    more = f", {s.load}" if s.load else ""
    more += f", penetration {s.penetration:.1g} cells" if s.penetration else ""
    return (
        f"{bodies}{held}, {s.tool or 'upper top'} {s.path}, mu {s.friction:.2f}, K/mu {s.ratio:.3g}, {cells} {s.degree} "
        f"{s.element}, points {s.points}, {s.steps} steps{more}, unit {s.length:g}"
    )


if __name__ == "__main__":
    judgement = judge(int(sys.argv[1]), thorough="once" not in sys.argv[2:])
    if COMM.rank == 0:
        print(json.dumps(judgement))
