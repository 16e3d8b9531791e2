"""Whole runs of one plate against other programs that are installed: CalculiX (`ccx`), FElupe with Intel's PARDISO."""

import importlib.util
import json
import os
import resource
import shutil
import subprocess
import sys
import time
from collections.abc import Iterator
from pathlib import Path
from statistics import median

import numpy as np
from matplotlib.figure import Figure

from fenics_contact.studies.runner import Row, Run, Study
from fenics_contact.studies.stability import DOTS, LETTERS, WIDTH

NAMES = {"ours": "this package", "calculix": "CalculiX", "felupe_plate": "FElupe"}
SIZES = ((10, 5), (20, 10))  # cells to the punch's edge, over the height: 20 x 20 x 5 and 40 x 40 x 10 hexahedra
SCENES = {
    "parity": "nodes led",
    "punch": "sharp punch, no friction",
    "friction": "sharp punch, friction 0.3",
}
QUICK: list[Run] = [{"scene": "parity", "cells": 2, "layers": 1, "code": "ours", "ranks": 1}]
PAGE = Path(__file__).parents[2] / "docs" / "speed.md"
MARKS = "<!-- races: written by `make bench` -->\n", "<!-- end of races -->\n"


def race(scene: str, cells: int, layers: int, code: str, ranks: int) -> Row:
    """Wall and CPU seconds of a run of a scene of peers/plate.py, from the start of its process to the end, that of Python's
    for the peers left out; value: the force [N]. RuntimeError where it fails."""
    script = [sys.executable, "-m", f"fenics_contact.studies.peers.{code}", scene, str(cells), str(layers)]
    command = script if ranks == 1 else ["mpirun", "-n", str(ranks), *script]
    before, start = resource.getrusage(resource.RUSAGE_CHILDREN), time.perf_counter()
    done = subprocess.run(command, capture_output=True, text=True, env=os.environ.copy())
    wall, after = time.perf_counter() - start, resource.getrusage(resource.RUSAGE_CHILDREN)
    if done.returncode:
        raise RuntimeError(done.stderr.strip().splitlines()[-1])
    found = json.loads(done.stdout.splitlines()[-1])
    cpu = after.ru_utime + after.ru_stime - before.ru_utime - before.ru_stime
    return {
        "value": found["force_N"], "iterations": found["tangents"], "unknowns": found["unknowns"],
        "cpu_s": found.get("cpu_s", cpu), "wall_s": found.get("wall_s", wall),
    }  # fmt: skip


def installed() -> list[str]:
    """The codes that can race here, this one first."""
    here = {
        "calculix": shutil.which("ccx") is not None,
        "felupe_plate": all(importlib.util.find_spec(name) for name in ("felupe", "pypardiso")),
    }
    return ["ours", *(code for code, found in here.items() if found)]


def studies(quick: bool) -> list[Study]:
    def runs(size: tuple[int, int]) -> list[Run]:
        return [
            {"scene": scene, "cells": size[0], "layers": size[1], "code": code, "ranks": ranks}
            for scene in SCENES
            for code in installed()
            if scene == "parity" or code != "felupe_plate"  # it has no contact
            for ranks in ((1, 2) if code == "ours" else (1,))
        ]

    def study(name: str, of: list[Run], repeats: int = 1) -> Study:
        return Study(name, race, of, repeats, limit=3000.0, outputs=("cpu_s", "wall_s"))

    if quick:
        return [study("speed", QUICK)]
    # some of the larger ones take many minutes
    return [study("speed", runs(SIZES[0]), repeats=3), study("speed_large", runs(SIZES[1]))]


def _runs(rows: list[Row], **wanted: object) -> list[Row]:
    """Those with these values that came to their end."""
    return [row for row in rows if all(row[key] == value for key, value in wanted.items()) and row["converged"] is True]


def _typical(rows: list[Row], **wanted: object) -> Row | None:
    """The run of median time among the repeats of one."""
    same = _runs(rows, **wanted)
    return sorted(same, key=lambda row: row["cpu_s"])[len(same) // 2] if same else None


def _raced(rows: list[Row]) -> Iterator[tuple[str, Row, dict[str, Row], float]]:
    """Words, our typical run, the peers' ones, and the gain by a second process, of each scene."""
    for scene, words in SCENES.items():
        for cells, layers in SIZES:
            of = {"scene": scene, "cells": cells, "layers": layers}
            ours = _typical(rows, **of, code="ours", ranks=1)
            found = {code: _typical(rows, **of, code=code) for code in NAMES if code != "ours"}
            if ours is None:
                continue
            walls = [median(row["wall_s"] for row in _runs(rows, **of, code="ours", ranks=ranks)) for ranks in (1, 2)]
            size = f"{2 * cells}×{2 * cells}×{layers}"
            yield f"{words}, {size}", ours, {code: row for code, row in found.items() if row}, walls[0] / walls[1]


def report(rows: dict[str, list[Row]], charts: Path, quick: bool) -> list[str]:
    """The chart of the ratios, the table in docs/speed.md, and a sentence for each scene."""
    if quick:
        return [f"parity {row['value']:.6f} N" for row in rows["speed"]]
    raced = list(_raced([*rows["speed"], *rows.get("speed_large", [])]))
    lines = ["| scene | unknowns | CPU s | force [N] | of CalculiX' time (its force) | of FElupe's | two processes |"]
    lines += ["|---|---|---|---|---|---|---|"]
    sentences = []
    for words, ours, peers, gain in raced:
        ratios = {code: ours["cpu_s"] / row["cpu_s"] for code, row in peers.items()}
        cell = {code: f"**{ratios[code]:.2f}**" if code in ratios else "" for code in ("calculix", "felupe_plate")}
        if "calculix" in peers:
            cell["calculix"] += f" ({peers['calculix']['value']:.5g})"
        lines.append(
            f"| {words} | {ours['unknowns']} | {ours['cpu_s']:.2f} | {ours['value']:.5g} | {cell['calculix']} "
            f"| {cell['felupe_plate']} | {gain:.2f} |"
        )
        parts = [f"{ratio:.2f} of {NAMES[code]}'s time" for code, ratio in ratios.items()]
        sentences.append("; ".join([f"{words}: {', '.join(parts)}", f"{gain:.2f} times as fast on two processes"]))
    _draw(raced, charts / "speed.png")
    note = "medians of three runs, of the larger mesh one. FElupe has neo-Hooke's law and no contact."
    lines += ["", f"*{rows['speed'][0]['machine']}; {note}*"]
    written(MARKS, lines)
    return sentences


def written(marks: tuple[str, str], lines: list[str]) -> None:
    """Put lines between marks of docs/speed.md."""
    head, rest = PAGE.read_text().split(marks[0])
    PAGE.write_text(head + marks[0] + "\n".join(lines) + "\n" + marks[1] + rest.split(marks[1])[1])


def _draw(raced: list[tuple[str, Row, dict[str, Row], float]], path: Path) -> None:
    """CPU seconds of all codes, a group of bars for each scene."""
    figure = Figure(figsize=(WIDTH, 0.8 + 0.62 * len(raced)), layout="constrained")
    axis = figure.add_subplot(xscale="log")
    for number, (code, name) in enumerate(NAMES.items()):
        bars = [(place, {"ours": ours, **peers}.get(code)) for place, (_, ours, peers, _) in enumerate(raced)]
        known = [(place + 0.25 * number, row["cpu_s"]) for place, row in bars if row]
        if known:
            places, seconds = np.transpose(known)
            axis.barh(places, seconds, height=0.23, color=f"C{number}", label=name)
            for place, value in known:
                axis.annotate(f" {value:.3g}", (value, place), va="center", fontsize=LETTERS - 1)
    axis.set_yticks(0.25 + np.arange(len(raced)), [words for words, *_ in raced], fontsize=LETTERS - 1)
    axis.invert_yaxis()
    axis.margins(x=0.12)
    axis.set_xlabel("CPU seconds of the whole run", fontsize=LETTERS)
    axis.tick_params(axis="x", labelsize=LETTERS)
    axis.legend(fontsize=LETTERS, loc="lower center", bbox_to_anchor=(0.5, 1.0), ncols=len(NAMES), frameon=False)
    figure.savefig(path, dpi=DOTS)
