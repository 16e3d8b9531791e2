"""Cells that lie on or in others although parts of the mesh share some nodes: said as where they share none."""

import gmsh
import numpy as np
import pytest
from mpi4py import MPI
from refusals import refused

from fenics_contact import Body, Output, Scene, neo_hooke, read_gmsh, solve
from fenics_contact.meshes import rectangles, two_blocks

# But for parts that nodes alone join: dolfinx waits for ever where it puts these on different processes
PARALLEL = pytest.mark.parallel
RUBBER = neo_hooke(0.5, K=5.0)
QUADRILATERAL, CURVED = 3, 10  # gmsh's numbers of their types


def drawn(X, bodies, sides=(), kind=QUADRILATERAL):
    """Plane cells as stated: places (n, 2), {body: rows of nodes}, [(side, rows of two nodes)]."""
    groups = [(2, kind, name, rows) for name, rows in bodies.items()] + [(1, 1, name, rows) for name, rows in sides]
    for tag, (dim, of, name, rows) in enumerate(groups, 1):
        gmsh.model.addDiscreteEntity(dim, tag)
        if tag == 1:
            gmsh.model.mesh.addNodes(2, 1, np.arange(1, len(X) + 1), np.column_stack([X, np.zeros(len(X))]).ravel())
        gmsh.model.mesh.addElementsByType(tag, of, [], np.ravel(rows) + 1)
        gmsh.model.setPhysicalName(dim, gmsh.model.addPhysicalGroup(dim, [tag]), name)


def counts(mesh):
    """(faces that lie on one another, faces that touch or lie in cells)"""
    return tuple(sum(found.count for found in those) for those in (mesh.doubled, mesh.touching))


def unmet(result):
    return [note for note in result.verdict.notes if "without a contact there" in note]


# -- seams of few common nodes -----------------------------------------------------------------------------------------
def seam(below, above, merge, one=False, triangles=False):
    """A block 2 x 1 of two halves of so many cells along their seam, which the nodes in the same places alone join."""
    rectangles.build(
        {"lower": ((0.0, 0.0), (2.0, 0.5), (below, 2)), "upper": ((0.0, 0.5), (2.0, 0.5), (above, 2))}, triangles
    )
    _finish(merge, one, 2)


def seam_in_space(below, above, merge, one=False):
    two_blocks.build((1.0,) * 3, (below, below, 2), (0.0, 0.0, -1.0), (1.0,) * 3, (above, above, 2), (0.0, 0.0, 0.0))
    _finish(merge, one, 3)


def _finish(merge, one, dim):
    if merge:
        gmsh.model.mesh.removeDuplicateNodes()
    if one:
        gmsh.model.removePhysicalGroups(gmsh.model.getPhysicalGroups(dim))
        tags = [tag for _, tag in gmsh.model.getEntities(dim)]
        gmsh.model.setPhysicalName(dim, gmsh.model.addPhysicalGroup(dim, tags), "block")


def pulled(mesh, contact=None):
    scene = Scene(*(Body(mesh, name, RUBBER) for name in mesh.volumes), plane="strain")
    scene.fix("lower_ymin")
    scene.fix("upper_ymax", "x")
    scene.prescribe("upper_ymax", "y", 0.1)
    if contact:
        scene.contact(*contact, name="c")
    return solve(scene, steps=2, out=Output(progress=False))


@pytest.mark.parametrize("one", [False, True])
@pytest.mark.parametrize("cells", [(4, 5), (4, 2), (2, 4), (4, 1), (3, 4)])
def test_a_seam_of_few_common_nodes_is_said_as_without_them(cells, one):
    """The middle of each of its sides lies on another one."""
    assert counts(read_gmsh(seam, below=cells[0], above=cells[1], merge=True, one=one)) == (0, sum(cells))
    assert counts(read_gmsh(seam, below=cells[0], above=cells[1], merge=False, one=one)) == (0, sum(cells))


def test_a_seam_of_triangles():
    assert counts(read_gmsh(seam, below=4, above=5, merge=True, triangles=True)) == (0, 9)
    assert counts(read_gmsh(seam, below=4, above=4, merge=True, triangles=True)) == (0, 0)


@pytest.mark.parametrize("cells", [(4, 2), (2, 4), (4, 5), (1, 3)])
def test_a_seam_in_space(cells):
    for one in (False, True):
        mesh = read_gmsh(seam_in_space, below=cells[0], above=cells[1], merge=True, one=one)
        assert counts(mesh) == (0, cells[0] ** 2 + cells[1] ** 2)
    assert counts(read_gmsh(seam_in_space, below=3, above=3, merge=True)) == (0, 0)


def test_the_note_on_a_seam():
    """Of the force of the bonded block four fifths are gone."""
    bonded, torn = (pulled(read_gmsh(seam, below=4, above=above, merge=True)) for above in (4, 5))
    assert torn.column("lower_ymin_reaction_y_N")[-1] == pytest.approx(
        0.2 * bonded.column("lower_ymin_reaction_y_N")[-1], rel=0.2
    )
    assert not unmet(bonded)
    (note,) = unmet(torn)
    assert "body 'lower' touches or overlaps 'upper'" in note and "9 faces" in note and "(0.25, 0.5, 0)" in note
    (note,) = unmet(pulled(read_gmsh(seam, below=4, above=5, merge=True, one=True)))
    assert "parts of body 'block' touch or overlap" in note and "9 faces" in note
    contact = ("upper_ymin", "lower_ymax")
    assert not unmet(pulled(read_gmsh(seam, below=4, above=5, merge=True), contact))  # what the note advises


# -- cells one by one --------------------------------------------------------------------------------------------------
def grid(slit=0, opening=0.0, third=False):
    """A block 2 x 1 of 4 x 2 cells: with a slit between its layers, so many cells long from x = 0 and open so far there, or
    with a third cell at the underside of a cell of the upper layer, on it."""
    X = np.array([(0.5 * i, 0.5 * j) for j in range(3) for i in range(5)])
    cells = np.array([(n, n + 1, n + 6, n + 5) for j in range(2) for n in range(5 * j, 5 * j + 4)])
    lower = cells[:4, 2:][:, ::-1].copy()
    upper = lower.copy()
    if slit:
        X = np.vstack([X, X[5 : 5 + slit] + [0.0, opening]])
        again = np.arange(15)
        again[5 : 5 + slit] = np.arange(15, 15 + slit)
        cells[4:], upper = again[cells[4:]], again[upper]
    if third:
        X, cells = np.vstack([X, X[[12, 11]]]), np.vstack([cells, [6, 7, 15, 16]])
    sides = {"lower_ymin": [(n, n + 1) for n in range(4)], "upper_ymax": [(n, n + 1) for n in range(10, 14)]}
    sides |= {"below": lower[:slit], "above": upper[:slit]} if slit else {}
    drawn(X, {"block": cells}, sides.items())


@pytest.mark.parametrize("slit", [1, 2, 4])
@PARALLEL
def test_a_slit_whose_end_is_shared(slit):
    """Its last faces have a node in common; where it goes all through they alone join both parts."""
    if slit == 4 and MPI.COMM_WORLD.size > 1:
        refused(lambda: read_gmsh(grid, slit=slit), "nodes in common")
        return
    mesh = read_gmsh(grid, slit=slit)
    assert counts(mesh) == (slit, 0)
    refused(lambda: pulled(mesh), f"{slit} faces", "(0.25, 0.5, 0)", "'block'")
    result = pulled(mesh, ("above", "below"))
    assert result.converged and not unmet(result)
    assert counts(read_gmsh(grid, slit=slit, opening=0.01)) == counts(read_gmsh(grid)) == (0, 0)


@PARALLEL
def test_a_side_of_three_cells_is_refused():
    refused(lambda: read_gmsh(grid, third=True), "more than two cells", "1 of them", "(0.75, 0.5, 0)")


WEDGE = [(0.0, 0.0), (1.0, 0.5), (0.0, 1.0), (-1.0, 0.5)]
SQUARE = [(0.0, 0.0), (1.0, 0.0), (1.0, 1.0), (0.0, 1.0)]


def two(first, second, shift):
    """Two cells by their corners, in one body."""
    drawn(np.vstack([first, np.asarray(second) + shift]), {"block": [range(4), range(4, 8)]})


@pytest.mark.parametrize(
    ("second", "shift", "count"),
    [
        (WEDGE, (0.5, 1.0), 0),  # an edge on the middle of a side
        (WEDGE, (0.5, 0.9), 1),  # in it
        (SQUARE, (1.0, 1.0), 0),  # corner on corner
        (SQUARE, (0.5, 1.0), 2),  # half of the sides on one another, corners on middles
        (SQUARE, (0.5, 0.6), 2),  # half in one another, middles on sides that run across
        (SQUARE, (0.5, 1.0001), 0),
    ],
)
@PARALLEL
def test_what_touches_by_an_edge_is_not_said(second, shift, count):
    assert counts(read_gmsh(two, first=SQUARE, second=second, shift=shift)) == (0, count)


# -- curved cells ------------------------------------------------------------------------------------------------------
def patched(bodies, curved):
    """{body: cells as 3 x 3 places each}; nodes in the same places are one."""
    order = [0, 2, 8, 6, 1, 5, 7, 3, 4] if curved else [0, 2, 8, 6]
    places = np.concatenate([*bodies.values()]).reshape(-1, 9, 2)[:, order]
    X, rows = np.unique(places.reshape(-1, 2).round(9), axis=0, return_inverse=True)
    ends = np.cumsum([len(cells) for cells in bodies.values()])[:-1]
    parts = np.split(rows.reshape(-1, len(order)), ends)
    drawn(X, dict(zip(bodies, parts, strict=True)), kind=CURVED if curved else QUADRILATERAL)


def half_rings(gap, curved):
    """Half rings of 4 and 7 cells, their radii 0.8 ... 1 and 1 + gap ... 1.2, which nothing joins."""
    bodies = {}
    for name, radii, n in (("core", (0.8, 1.0), 4), ("hull", (1.0 + gap, 1.2), 7)):
        angles = np.linspace(np.pi, 0.0, 2 * n + 1)
        at = np.array([[(r * np.cos(a), r * np.sin(a)) for a in angles] for r in np.linspace(*radii, 3)])
        bodies[name] = [at[:, 2 * i : 2 * i + 3] for i in range(n)]
    patched(bodies, curved)


def strips(below, above, shift=0.0):
    """Strips 2 x 0.5 of cells with 9 nodes, one on the other; inner nodes of the upper one are shifted so far."""
    bodies = {}
    for name, low, n, way in (("lower", 0.0, below, 0.0), ("upper", 0.5, above, shift)):
        along = np.linspace(0.0, 2.0, 2 * n + 1)
        along[1:-1] += way
        at = np.array([[(x, y) for x in along] for y in np.linspace(low, low + 0.5, 3)])
        bodies[name] = [at[:, 2 * i : 2 * i + 3] for i in range(n)]
    patched(bodies, curved=True)


def test_a_seam_of_cells_of_order_2():
    assert counts(read_gmsh(strips, below=4, above=5, shift=0.01)) == (0, 9)
    assert counts(read_gmsh(strips, below=4, above=2, shift=0.01)) == (0, 6)
    assert counts(read_gmsh(strips, below=4, above=4)) == (0, 0)


@pytest.mark.parametrize(
    ("below", "above", "nodes", "place"),
    [(4, 5, 1, "(1, 0.5, 0)"), (3, 1, 1, "(1, 0.5, 0)"), (4, 2, 2, "(0.5, 0.5, 0)")],
)
@PARALLEL
def test_a_node_has_one_place_in_cells(below, above, nodes, place):
    """What is a corner of one cell is not the middle of another one's side, and a middle is of one side: dolfinx crashed."""
    refused(lambda: read_gmsh(strips, below=below, above=above), f"{nodes} nodes", "middle of a side", place, "fragment")


def two_middles():
    """Two cells side by side whose common side has a middle node for each of them."""
    order = np.array([0, 2, 8, 6, 1, 5, 7, 3, 4])
    square = np.array([(x, y) for y in (0.0, 0.5, 1.0) for x in (0.0, 0.5, 1.0)])[order]
    second = np.array([1, 9, 10, 2, 11, 12, 13, 14, 15])
    X = np.vstack([square, (square + [1.0, 0.0])[second > 8]])
    drawn(X, {"block": [range(9), second]}, kind=CURVED)


@PARALLEL
def test_a_side_has_one_middle():
    refused(lambda: read_gmsh(two_middles), "1 sides or edges", "(1, 0.5, 0)", "after setOrder(2)")


@PARALLEL
def test_curved_cells_are_taken_as_they_are():
    """An eighth of a circle bulges over the chord between its ends by 0.08; a curved cell follows it to 0.0007."""
    assert counts(read_gmsh(half_rings, gap=0.01, curved=True)) == (0, 0)
    assert counts(read_gmsh(half_rings, gap=-0.01, curved=True))[1] > 0
    assert counts(read_gmsh(half_rings, gap=0.01, curved=False))[1] > 0  # these do overlap


@pytest.mark.parallel
@pytest.mark.parametrize("source", [seam, seam_in_space])
def test_parts_that_nodes_alone_join_are_refused_on_several_processes(source):
    """dolfinx 0.5 waits for ever where processes share them; on one they have their note."""
    if MPI.COMM_WORLD.size == 1:
        assert read_gmsh(source, below=2, above=4, merge=True).touching
    else:
        words = "nodes in common", "the first at (", "run it on one"
        refused(lambda: read_gmsh(source, below=2, above=4, merge=True), *words)
    assert not read_gmsh(source, below=3, above=3, merge=True).touching
    assert read_gmsh(source, below=2, above=4, merge=False).touching
