"""A stage of a run as the user states it: what is moved, pushed and loaded in it, in how many steps and how."""

from collections.abc import Callable, Mapping
from dataclasses import KW_ONLY, dataclass, field
from typing import Any

from fenics_contact.contact.tools import Tool
from fenics_contact.scene.functions import Drive, Place
from fenics_contact.scene.motion import Motion
from fenics_contact.scene.statements import Body
from fenics_contact.types import Floats
from fenics_contact.values import SceneError, axis_letters, group_names, positive, shown, text

Group = str | tuple[str, ...]
Along = str | tuple[float, ...]  # an axis, "normal", or a direction
Way = float | Callable[[Floats, float], Any]  # of a surface: by how much at the end, or a function (X, s) -> (n,)
Moves = Mapping[Tool, Drive | Motion]

ARC_LENGTH = "arc_length"  # method of a stage whose steps are ArcSteps

FORMS = {"prescribe": '("group", "z"): by', "relative": '("first", "second"): (x, y, z)',
         "tractions": '"group": (x, y, z)', "forces": '"group": (x, y, z)',
         "pressures": '"group": value', "moments": '"group": (x, y, z)', "swell": '"volume": ratio'}  # fmt: skip


@dataclass(frozen=True, eq=False)
class Stage:
    """One of the stages that a run goes through one after another, solve(..., stages=[...]).

    Motions count from where the stage before ended: move, {tool: by (3,) [length], or a Motion}; prescribe, {(group, axis):
    by [length]}, in the place of the axis "normal" or a direction (3,) too; relative, {(first, second face of a periodic
    pair): by (3,) [length]}. Loads go from what they were there to a new value: push, {tool: force (3,)}; tractions, forces,
    moments, {group: (3,)}; pressures, {group: value}; body_force, (3,); spin, a speed; swell, {volume: ratio}. What is not
    named stays as it is. A function in the place of a number gets the stage's own s, 0 ... 1, a surface's (X, s): motions
    are zero at s = 0, loads there what the stage before left. The scene states what there is: supports, pairs and loads that
    stages name are its own. Its own numbers and functions are those of the first stage, where that does not name them.

    steps: as of `solve`, whose own hold where nothing is said; in ArcSteps Load(1.0) as a target means s = 1. method:
    "newton", "incremental" or "snes", likewise. duration: how much t grows; arc length ends where its target is.
    """

    name: str
    _: KW_ONLY
    move: Moves = field(default_factory=dict)
    push: Mapping[Tool, Drive] = field(default_factory=dict)
    prescribe: Mapping[tuple[Group, Along], Way] = field(default_factory=dict)
    relative: Mapping[tuple[Group, Group], Drive] = field(default_factory=dict)
    tractions: Mapping[Group, Drive | Place] = field(default_factory=dict)
    forces: Mapping[Group, Drive] = field(default_factory=dict)
    pressures: Mapping[Group, Drive | Place] = field(default_factory=dict)
    moments: Mapping[Group, Drive] = field(default_factory=dict)
    swell: Mapping[str | Body, Drive] = field(default_factory=dict)
    body_force: Drive | Place | None = None
    spin: Drive | None = None
    steps: object = None
    method: str | None = None
    duration: float = 1.0

    def __post_init__(self) -> None:
        text(self.name, "stage: name")
        positive(self.duration, f"{self}: duration")
        for word, form in FORMS.items():
            stated = vars(self)[word]
            if not isinstance(stated, Mapping):
                raise SceneError(f"{self}: {word} = {shown(stated)}: give {{{form}}}")
        for faces in self.relative:
            if not isinstance(faces, tuple) or len(faces) != 2:
                raise SceneError(f'{self}: relative names {shown(faces)}; give ("first", "second"), the faces of a pair')
        for key in self.prescribe:
            if not isinstance(key, tuple) or len(key) != 2:
                raise SceneError(f'{self}: prescribe names {shown(key)}; give ("group", "z")')
            if isinstance(key[1], str) and key[1] != "normal":
                axis_letters(key[1], f"{self}: prescribe '{key[0]}'", most=1)

    def __str__(self) -> str:
        return f"stage '{self.name}'"

    @property
    def loads(self) -> dict[tuple[str, tuple[str, ...] | None], Any]:
        """{(word, surfaces or volume, or None of all bodies): what it says}."""
        words = ("tractions", "forces", "pressures", "moments")
        found: dict[tuple[str, tuple[str, ...] | None], Any] = {
            (word, group_names(group, self.says(word))): value for word in words for group, value in vars(self)[word].items()
        }
        for volume, ratio in self.swell.items():
            name = volume.group if isinstance(volume, Body) else volume
            found["swell", group_names(name, self.says("swell"))] = ratio
        return found | {(word, None): vars(self)[word] for word in ("body_force", "spin") if vars(self)[word] is not None}

    @property
    def idle(self) -> bool:
        """Whether nothing is moved or loaded in it."""
        return not any((self.move, self.push, self.prescribe, self.relative, self.loads))

    def says(self, words: str) -> str:
        """Words on something in this stage."""
        return f"{self}: {words}"


@dataclass(frozen=True, eq=False)
class Only(Stage):
    """The one stage of a run that states none: its name is empty, its s is t, and the scene's loads may be all there is."""

    name: str = ""

    def __post_init__(self) -> None:
        """Nothing to check that is not checked where it is used."""

    def says(self, words: str) -> str:
        return words
