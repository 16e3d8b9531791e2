"""What a picture shows: the deformed boundary of the bodies with a field on it, the tools' surfaces, the symmetry planes."""

from collections.abc import Callable, Sequence
from dataclasses import dataclass, replace

import basix
import numpy as np

from fenics_contact import compat
from fenics_contact.assembly.pose import Pose
from fenics_contact.assembly.size import bodies_size
from fenics_contact.assembly.system import System
from fenics_contact.output.fields import Fields
from fenics_contact.output.grid import bodies_of_cells
from fenics_contact.output.names import plain_name
from fenics_contact.output.places import corner_weights
from fenics_contact.output.tool_surfaces import tool_surface
from fenics_contact.scene.scene import Scene
from fenics_contact.scene.symmetry import planes_of
from fenics_contact.types import Array, Bools, Floats, Function, Ints, Ints64
from fenics_contact.values import SceneError

AXES = "xyz"
IN_PLANE = ("xx", "yy", "zz", "xy", "yx")  # stresses that a plane scene has
TILES = 24  # tiles of a tool along the bodies' largest length: its facets are cut to about this size
SAG = 1e-4  # of twice the picture's diagonal: how far facets cut below round tools, a thin line at a page's width
MANY = 10_000  # tiles of a tool from which on only the large ones are cut
FINEST = 8  # times at most that facets are halved for it
FACE = -1  # in the place of a facet's number: a plane cell itself
LAYER = 1e-3  # of the bodies' size: how thick a plane mesh is drawn
UNSTRESSED = 1e-8  # of the softest shear modulus: stresses that balance to 1e-8 of the forces may leave in an unloaded body
FLAT = 1e-6  # of the bodies' size: what counts as no distance and no displacement

Part = int | Callable[[Floats], Floats]  # of a Function's values at a node: a component, or what is made of all (n, width)


Values = Callable[[Ints, Ints], Floats]


@dataclass(frozen=True)
class Look:
    """A field to draw.

    label: with its unit; values: function of n cells and the numbers (k,) of nodes in them, of the displacement's degree ->
    values (n, k) there; on_contact: it lives on slave surfaces, of the contact named, or of all; kind: "amount",
    "signed" (zero in the middle of the colours) or "status".
    """

    label: str
    values: Values
    on_contact: bool = False
    kind: str = "amount"
    contact: str = ""


@dataclass(frozen=True)
class DrawnSkin:
    """Boundary facets, or the parts of those of degree 2, on rank 0: corners X, x (n, 4, 3) before and after the deformation
    [length], a triangle repeating its last; values (n, 4) of the field there, NaN where there is none; slave (n,); body
    (n,): number of the facet's body.

    Corners run counter-clockwise seen from outside. A part is cut out of its facet at its second and fourth corner.
    """

    X: Floats
    x: Floats
    values: Floats
    slave: Bools
    body: Ints64
    cut: bool = False

    def part(self, chosen: Array) -> "DrawnSkin":
        """Some of the facets: chosen (n,) are flags or numbers."""
        return replace(self, **{name: getattr(self, name)[chosen] for name in ("X", "x", "values", "slave", "body")})

    @property
    def sides(self) -> list[int]:
        """Of the tiles' sides those that are sides of facets, by their first corners."""
        return [0, 3] if self.cut else [0, 1, 2, 3]


def look(fields: Fields, name: str) -> Look:
    """The field of a name; SceneError lists the names."""
    units = fields.scene.units
    word, _, axis = name.rpartition("_")
    if name == "displacement":
        return Look(f"displacement [{units.length}]", _nodal(fields.system.state.u, _size))
    section = fields.scene.section
    if word == "displacement" and axis in (AXES if section is None else AXES[:2]):
        return Look(
            f"displacement along {axis} [{units.length}]", _nodal(fields.system.state.u, AXES.index(axis)), kind="signed"
        )
    if name == "J":
        return Look("volume ratio J", _per_cell(fields.J.x.array))
    if name == "von_mises":
        return Look(f"von Mises stress [{units.pressure}]", _of_bodies(fields, _von_mises))
    if word == "stress" and len(axis) == 2 and (set(axis) <= set(AXES) if section is None else axis in IN_PLANE):
        row, column = AXES.index(axis[0]), AXES.index(axis[1])
        around = ", around the axis" if section is not None and section.axisymmetric and axis == "zz" else ""
        return Look(
            f"Cauchy stress {axis}{around} [{units.pressure}]",
            _of_bodies(fields, lambda s: s[:, row, column]),
            kind="signed",
        )
    return _look_at_contact(fields, name)


def _look_at_contact(fields: Fields, name: str) -> Look:
    """A field of all contacts, or of one: its name before that of the field, as in the files."""
    units, contacts = fields.scene.units, {plain_name(contact.name): contact.name for contact in fields.scene.contacts}
    plain = next((plain for plain in contacts if name.startswith(f"{plain}_")), "")
    which, word = contacts.get(plain, ""), name.removeprefix(f"{plain}_").removeprefix("contact_")
    of = fields.of(which)
    known: dict[str, tuple[str, Function, Part, str]] = {
        "pressure": (f"contact pressure [{units.pressure}]", of.pressure, 0, "amount"),
        "friction_traction": (f"friction traction [{units.pressure}]", of.friction, _size, "amount"),
        "gap": (f"gap [{units.length}]", of.gap, 0, "signed"),
        "status": ("contact status", of.status, 0, "status"),
    }
    if word not in known or name == "pressure":
        plane = fields.scene.section is not None
        parts = "displacement_x, _y, stress_xx, _yy, _zz, _xy" if plane else "displacement_x, _y, _z, stress_xx, _xy, ..."
        raise SceneError(
            f"no field '{name}' to draw; there are displacement, J, von_mises, {parts}, and on the slave surfaces "
            "contact_pressure, friction_traction, gap, status, of one contact with its name "
            f"before: {', '.join(f'{contact}_gap' for contact in contacts) or 'there are none'}"
        )
    if not contacts:
        raise SceneError(f"field '{name}': the scene has no contacts; draw 'displacement', 'von_mises' or 'J'")
    label, function, column, kind = known[word]
    return Look(f"{which}: {label}" if which else label, _nodal(function, column), True, kind, which)


def _size(values: Floats) -> Floats:
    return np.linalg.norm(values, axis=1)


def _nodal(function: Function, part: Part) -> Values:
    """Values of a Function of the displacement's degree."""
    space = function.function_space
    table = function.x.array.reshape(-1, max(1, space.dofmap.index_map_bs))
    values = part(table) if callable(part) else table[:, part]
    return lambda cells, nodes: values[compat.cell_dofs(space)[cells][:, nodes]]


def _per_cell(values: Floats) -> Values:
    return lambda cells, nodes: np.repeat(values[cells][:, None], len(nodes), axis=1)


def _of_bodies(fields: Fields, part: Callable[[Floats], Floats]) -> Values:
    """What `part` takes of stresses (n, 3, 3) at corners, each body's own, for they jump between bodies; between corners of
    degree 2 what is linear."""
    scene, space = fields.scene, fields.corner_stress.function_space
    least = UNSTRESSED * min(body.material.shear_modulus for body in scene.bodies)
    values = np.zeros((len(scene.bodies), len(fields.corner_stress.x.array) // 9))
    for mine, (nodes, stress) in zip(values, fields.by_body, strict=True):
        mine[nodes] = part(np.where(np.abs(stress) > least, stress, 0.0))
    body, corners = bodies_of_cells(scene)[:, None], compat.cell_dofs(space)
    table = corner_weights(compat.cell_name(scene.mesh.domain), scene.degree)
    return lambda cells, nodes: values[body[cells], corners[cells]] @ table[nodes].T


def _tiles(cell: str, degree: int, facet: int) -> tuple[Ints, Floats]:
    """Numbers (k,) in the cell of a facet's nodes, and the weights (tiles, 4, k) of these in the corners of its tiles, one
    after the other around each: of degree 1 the facet itself, of degree 2 a part around each of its corners.

    A triangle repeats its last corner; of a plane cell the facet is its face, and of a side there and back.
    """
    kind = getattr(basix.CellType, cell)
    dim, element = len(basix.topology(kind)) - 1, compat.basix_element(cell, degree)
    corners, side = basix.geometry(kind), dim - 1
    nodes = np.arange(len(element.points)) if facet == FACE else np.array(element.entity_closure_dofs[side][facet])
    ring = corners if facet == FACE else corners[basix.topology(kind)[side][facet]]
    ring = ring[[0, 1, 3, 2]] if len(ring) == 4 else ring
    if len(ring) == 2:
        middle = ring.mean(axis=0)
        at = ring[None, [0, 1, 1, 0]] if degree == 1 else np.stack([[a, middle, middle, a] for a in ring])
        at[1:] = at[1:, [0, 3, 2, 1]]
    elif degree == 1:
        at = ring[None, [0, 1, 2, len(ring) - 1]]
    else:
        at = quarters(ring[None])
    table = compat.tabulate(element, 0, at.reshape(-1, dim))[0]
    table = np.where(np.abs(table - np.rint(table)) < FLAT, np.rint(table), table)  # at a node its own value, not rounded
    return nodes.astype(np.int32), table[:, nodes].reshape(len(at), 4, len(nodes))


def _von_mises(stress: Floats) -> Floats:
    """Of stresses (n, 3, 3)."""
    deviator = stress - np.trace(stress, axis1=1, axis2=2)[:, None, None] / 3 * np.eye(3)
    return np.sqrt(1.5 * np.einsum("nij,nij->n", deviator, deviator))


def skin(fields: Fields, chosen: Look) -> DrawnSkin | None:
    """The boundary of all bodies on rank 0, in an order that no partition changes; None on the others. Collective."""
    scene, space = fields.scene, fields.system.space
    mesh, X = scene.mesh.domain, space.tabulate_dof_coordinates()
    x = X + fields.system.state.u.x.array.reshape(-1, 3)
    cell, plane = compat.cell_name(mesh), mesh.topology.dim == 2
    shown = [contact for contact in scene.contacts if chosen.contact in ("", contact.name)]
    slaves = sorted({name for contact in shown for name in contact.slave})
    touching = _keys(*compat.cells_of_exterior_facets(mesh, scene.mesh.facets(*slaves))) if slaves else np.empty(0)
    cells, local = compat.cells_of_exterior_facets(mesh)
    body, number = bodies_of_cells(scene), compat.original_cells(mesh).astype(np.int64)
    behind = np.array([0.0, 0.0, -LAYER * bodies_size(space)])  # a plane mesh is drawn as the face of a thin layer
    parts = []
    for facet in [*([FACE] if plane else []), *range(compat.FACETS[cell])]:
        mine = cells[local == facet] if facet != FACE else np.arange(compat.cell_map(mesh).size_local, dtype=np.int32)
        of_cell, (nodes, weights) = compat.cell_dofs(space)[mine], _tiles(cell, scene.degree, facet)
        slave = np.isin(_keys(mine, facet), touching)
        values = chosen.values(mine, nodes)
        values = np.where(slave[:, None], values, np.nan) if chosen.on_contact else values
        nearest = np.eye(len(nodes))[weights.argmax(axis=2)] if chosen.kind == "status" else weights
        at, now = (np.einsum("rjk,nkc->nrjc", weights, place[of_cell[:, nodes]]) for place in (X, x))
        values = np.einsum("rjk,nk->nrj", nearest, values)
        if plane and facet != FACE:
            back = [[2, 3], [1, 2]][: len(weights)]
            for tile, corners in enumerate(back):
                at[:, tile, corners] += behind
                now[:, tile, corners] += behind
        middle = X[of_cell].mean(axis=1)[:, None] + 0.5 * behind * plane
        inside_out = _inside_out(at, middle)
        for corners in (at, now, values):
            corners[inside_out] = _turned(corners[inside_out])
        each = (np.repeat(of, len(weights)) for of in (slave, body[mine], _keys(number[mine], facet)))
        parts.append((*(part.reshape(-1, *part.shape[2:]) for part in (at, now, values)), *each))
    gathered = mesh.comm.gather([np.concatenate(column) for column in zip(*parts, strict=True)])
    if gathered is None:
        return None
    at, now, values, slave, bodies, keys = (np.concatenate(column) for column in zip(*gathered, strict=True))
    return DrawnSkin(at, now, values, slave, bodies, scene.degree == 2).part(np.argsort(keys, kind="stable"))


def _keys(cells: Array, local: Array | int) -> Ints64:
    return np.asarray(cells, dtype=np.int64) * 7 + local + 1


def _inside_out(corners: Floats, middle: Floats) -> Bools:
    """Whether facets (..., 4, 3) run clockwise seen from outside of their cells, whose middles are (..., 3)."""
    return np.einsum("...c,...c->...", normals(corners), corners.mean(axis=-2) - middle) < 0.0


def _turned(corners: Floats) -> Floats:
    """What facets have at their corners (n, 4, ...), the other way round from the same first one."""
    return corners[:, [0, 3, 2, 1]]


def normals(corners: Floats) -> Floats:
    """Normal times area (..., 3) of facets (..., 4, 3)."""
    first, second, third, fourth = np.moveaxis(corners, -2, 0)
    return 0.5 * np.cross(third - first, fourth - second)


# -- tools --------------------------------------------------------------------------------------------------------------
def tool_tiles(scene: Scene, poses: Sequence[Pose], low: Floats, high: Floats) -> list[Floats]:
    """Of each tool the tiles (n, 4, 3) of its surface between the corners low, high (3,) of a box [length].

    poses: of the tools. What leaves the box ends on its faces; tiles are small against the box, for painting by distance.
    """
    size, about = 2.0 * float(np.linalg.norm(high - low)), 0.5 * (low + high)
    found = []
    for tool, pose in zip(scene.tools, poses, strict=True):
        points, facets = tool_surface(tool, size, about, pose, SAG)
        tiles = points[facets]
        for _ in range(FINEST):
            tiles = tiles[_meets(tiles, low, high)]
            sides = np.linalg.norm(tiles - np.roll(tiles, 1, axis=1), axis=2).max(axis=1, initial=0.0)
            large = sides > np.max(high - low) / TILES
            if not large.any():
                break
            if len(tiles) < MANY:
                large[:] = True  # neighbours keep whole edges in common, and those of one tile alone are the surface's ends
            tiles = np.concatenate([tiles[~large], quarters(tiles[large])])
        edge = FLAT * np.max(high - low)  # tiles that only touch the box from outside stay there
        inside = ((tiles > low + edge) & (tiles < high - edge)).all(axis=2).any(axis=1)
        found.append(_cut(tiles[inside], low, high))
    return found


def _cut(tiles: Floats, low: Floats, high: Floats) -> Floats:
    """What of plane tiles (n, 4, 3) lies in a box: tiles, which keep their direction."""
    for axis, place, sign in [(i, *end) for i in range(3) for end in ((low[i], -1.0), (high[i], 1.0))]:
        beyond = sign * (tiles[..., axis] - place)
        out = beyond > 0.0
        crossed = out.any(axis=1) & ~out.all(axis=1)
        three = tiles[crossed][:, [[0, 1, 2], [0, 2, 3]]].reshape(-1, 3, 3)
        three = three[(three[:, 1] != three[:, 2]).any(axis=1)]  # of a triangle the second half is none
        far = sign * (three[..., axis] - place)
        alone = (far > 0.0) == (np.count_nonzero(far > 0.0, axis=1) == 1)[:, None]  # the corner on its own side
        cut = np.flatnonzero((far > 0.0).any(axis=1) & (far < 0.0).any(axis=1))
        turn = (np.argmax(alone[cut], axis=1)[:, None] + np.arange(3)) % 3
        a, b, c = np.moveaxis(three[cut[:, None], turn], 1, 0)
        of_a, of_b, of_c = far[cut[:, None], turn].T[..., None]
        to_b, to_c = a + of_a / (of_a - of_b) * (b - a), a + of_a / (of_a - of_c) * (c - a)
        to_b[:, axis] = to_c[:, axis] = place
        kept = np.where(of_a[..., None] < 0.0, np.stack([a, to_b, to_c, to_c], axis=1), np.stack([to_b, b, c, to_c], axis=1))
        whole = three[(far <= 0.0).all(axis=1) & (far < 0.0).any(axis=1)]
        tiles = np.concatenate([tiles[~out.any(axis=1)], kept, whole[:, [0, 1, 2, 2]]])
    return tiles


def _meets(tiles: Floats, low: Floats, high: Floats) -> Bools:
    """Whether the boxes around tiles meet a box."""
    return ((tiles.max(axis=1) >= low) & (tiles.min(axis=1) <= high)).all(axis=1)


def quarters(corners: Floats) -> Floats:
    """Each of the facets (n, 4, ...) cut into four, or triangles (n, 3, ...) into three; part i of a facet holds its corner
    i, as the first of its own four."""
    middles = 0.5 * (corners + np.roll(corners, -1, axis=1))
    centre = np.broadcast_to(corners.mean(axis=1, keepdims=True), corners.shape)
    cut = np.stack([corners, middles, centre, np.roll(middles, 1, axis=1)], axis=2)
    return cut.reshape(-1, 4, *corners.shape[2:])


# -- symmetry -------------------------------------------------------------------------------------------------------------
def symmetry_planes(scene: Scene, system: System) -> dict[int, float]:
    """{axis: place [length]} of the planes that supports make planes of symmetry: flat ends of the bodies, held along
    their normal alone in all stages. Of two along one axis the one nearer to the origin. Collective."""
    planes = dict[int, float]()
    if scene.section is not None and scene.section.axisymmetric:
        planes[0] = 0.0
    for plane in planes_of(scene, system.supports):
        if abs(plane.place) <= abs(planes.get(plane.axis, np.inf)):
            planes[plane.axis] = plane.place
    return planes


def mirrored(body: DrawnSkin, tiles: Sequence[Floats], planes: dict[int, float]) -> tuple[DrawnSkin, list[Floats]]:
    """Bodies and tools with their images behind planes {axis: place}; what lies in a plane is no surface any more."""
    tiles = list(tiles)
    for axis, place in planes.items():
        span = float(np.ptp(body.X[..., axis]))
        body = body.part(np.abs(body.X[..., axis] - place).max(axis=1) > FLAT * span)
        image = replace(body, X=_image(body.X, axis, place), x=_image(body.x, axis, place), values=_turned(body.values))
        pairs = {name: (getattr(body, name), getattr(image, name)) for name in ("X", "x", "values", "slave", "body")}
        body = replace(body, **{name: np.concatenate(pair) for name, pair in pairs.items()})
        tiles = [np.concatenate([one, _image(one, axis, place)]) for one in tiles]
    return body, tiles


def _image(corners: Floats, axis: int, place: float) -> Floats:
    """Facets behind a plane, their corners the other way round so that they still look out."""
    image = _turned(corners)
    image[..., axis] = 2 * place - image[..., axis]
    return image
