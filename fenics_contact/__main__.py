"""`python3 -m fenics_contact`: versions, a check of the installation, the demos; with a demo's name it runs that, with
`warm` it compiles ahead what scenes run."""

import runpy
import sys
from pathlib import Path

import numpy as np

from fenics_contact import __version__
from fenics_contact.compat import versions
from fenics_contact.contact.tools import rigid_plane
from fenics_contact.mesh_io import read_gmsh
from fenics_contact.meshes import box
from fenics_contact.options import Output
from fenics_contact.run import solve
from fenics_contact.scene.scene import Scene
from fenics_contact.scene.statements import Body
from fenics_contact.solid.materials import neo_hooke
from fenics_contact.warm import warm

DEMOS = Path(__file__).with_name("demos")
SHUT, SIDE, SHARE = 1e-9, 10.0, 0.1  # share of the force that may be out of balance; mm; by which the cube is pressed


def check() -> str:
    """What a bonded cube pressed by a rough plane says of the installation: its verdict, balance and tangents."""
    scene = Scene(Body(read_gmsh(box.build, size=(SIDE, SIDE, SIDE), cells=(2, 2, 2)), "box", neo_hooke(mu=0.5, K=2.0)))
    scene.fix("zmin")
    plate = rigid_plane((0, 0, SIDE), (0, 0, -1), name="plate")
    scene.contact("zmax", plate, 0.3, name="lid")
    result = solve(scene, move={plate: (0, 0, -SHARE * SIDE)}, steps=2, out=Output(progress=False))
    result.require()
    pressed, held = (float(result.column(name)[-1]) for name in ("lid_force_z_N", "zmin_reaction_z_N"))
    if not np.isclose(pressed, -held, rtol=SHUT) or not result.audit().right:
        said = f"the plate presses with {pressed:g} N, the floor with {held:g} N\n{result.audit()}"
        raise SystemExit(f"something is wrong: {said}")
    return f"a cube pressed by a tenth carries {abs(pressed):.4g} N; forces are in balance and all tangents are right"


def demos() -> dict[str, str]:
    """{name: first line of what it says of itself} of the demos."""
    return {path.stem: path.read_text().split('"""')[1].split("\n")[0] for path in sorted(DEMOS.glob("*.py"))}


def _listed(known: dict[str, str]) -> str:
    return "\n".join(f"  python3 -m fenics_contact {demo:16} {words}" for demo, words in known.items())


def main(name: str | None = None, kind: str | None = None) -> None:
    """Run the demo of this name or `warm`, tell what there is (`--help`), or check the installation and list the demos."""
    if name == "warm":
        print(warm(kind))
        return
    known = demos()
    if name in ("-h", "--help"):
        print(__doc__)
        print(_listed(known))
        return
    if name is not None:
        if name not in known:
            raise SystemExit(f"no demo '{name}'; there are: {', '.join(known)}")
        sys.argv = [str(DEMOS / f"{name}.py"), *sys.argv[2:]]
        runpy.run_path(sys.argv[0], run_name="__main__")
        return
    print(f"fenics_contact {__version__}: " + ", ".join(f"{what} {version}" for what, version in versions().items()))
    print(check())
    print(_listed(known))


if __name__ == "__main__":
    main(*sys.argv[1:3])
