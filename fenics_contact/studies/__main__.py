"""`python3 -m fenics_contact.studies NAME [--quick]`: runs a study, draws its charts, says what they show."""

import argparse
import importlib
from pathlib import Path

from tqdm import tqdm

from fenics_contact.studies.runner import read

NAMES = ("sphere", "tubes", "punch", "cylinder", "hertz", "maps", "economy", "linear", "speed", "pieces")
HERE = Path(__file__).parent


def run(
    name: str, data: Path, charts: Path, quick: bool = False, draw_only: bool = False, progress: bool = True
) -> list[str]:
    """Run what a study's CSV files in `data` lack, draw into `charts`, return the sentences; StudyError where theory is
    contradicted. quick: a small version, all in this process."""
    module = importlib.import_module(f"fenics_contact.studies.{name}")
    charts.mkdir(parents=True, exist_ok=True)
    rows = {}
    for study in module.studies(quick):
        path = data / f"{study.name}.csv" if draw_only else study.run(data, progress, isolated=not quick)
        rows[study.name] = study.mine(read(path))
    return module.report(rows, charts, quick)


def main() -> None:
    parser = argparse.ArgumentParser(prog="python3 -m fenics_contact.studies", description=__doc__)
    parser.add_argument("names", nargs="+", choices=[*NAMES, "all"], metavar="NAME", help=", ".join([*NAMES, "all"]))
    parser.add_argument("--quick", action="store_true", help="a small version, seconds each, into results/studies")
    parser.add_argument("--draw", action="store_true", help="draw again from the CSV files, run nothing")
    asked = parser.parse_args()
    if not asked.quick and not (HERE.parents[1] / "pyproject.toml").exists():
        parser.error("the tables and charts of the full studies belong to a checkout and are written there; add --quick")
    data, charts = (Path("results/studies"),) * 2 if asked.quick else (HERE / "data", HERE / "charts")
    for name in NAMES if "all" in asked.names else asked.names:
        sentences = run(name, data, charts, asked.quick, asked.draw)
        (data / f"{name}.txt").write_text("\n".join(sentences) + "\n")
        tqdm.write("\n".join([f"{name}: {line}" for line in sentences] + [f"{name}: charts in {charts}"]))


if __name__ == "__main__":
    main()
