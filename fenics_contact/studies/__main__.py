"""`python3 -m fenics_contact.studies NAME [--quick]`: runs a study, draws its charts, says what they show."""

import argparse
import importlib
import sys
from pathlib import Path

from tqdm import tqdm

from fenics_contact.studies.runner import StudyError, read
from fenics_contact.studies.sweep import failures

NAMES = ("sphere", "tubes", "punch", "cylinder", "hertz", "maps", "economy", "linear", "speed", "pieces")
HERE = Path(__file__).parent


def run(
    name: str, data: Path, charts: Path, quick: bool = False, draw_only: bool = False, progress: bool = True
) -> list[str]:
    """Run what a study's CSV files in `data` lack, draw into `charts`, return the sentences; StudyError where theory is
    contradicted, or runs failed without which there is nothing to say. quick: a small version, all in this process."""
    module = importlib.import_module(f"fenics_contact.studies.{name}")
    charts.mkdir(parents=True, exist_ok=True)
    rows, lost = {}, []
    for study in module.studies(quick):
        path = data / f"{study.name}.csv" if draw_only else study.run(data, progress, isolated=not quick)
        if not path.exists():
            raise StudyError(f"{path} is not there: run the study before, without --draw")
        mine = rows[study.name] = study.mine(read(path))
        lost += [f"{path}, {words}" for words in failures(mine, study.parameters)]
        lost += [f"{path} has {len(mine)} of {len(study.runs)} runs"] * (len(mine) < len(study.runs))
    try:
        return module.report(rows, charts, quick)
    except (ArithmeticError, LookupError, TypeError, ValueError) as error:
        if isinstance(error, StudyError) or not lost:
            raise
        more = f" (and {len(lost) - 1} more)" if len(lost) > 1 else ""
        raise StudyError(
            f"no charts without the runs that are lost: {lost[0]}{more}; drop such rows to repeat them"
        ) from error


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
        try:
            sentences = run(name, data, charts, asked.quick, asked.draw)
        except (StudyError, ImportError, OSError) as error:
            sys.exit(f"{name}: {error}")
        (data / f"{name}.txt").write_text("\n".join(sentences) + "\n")
        tqdm.write("\n".join([f"{name}: {line}" for line in sentences] + [f"{name}: charts in {charts}"]))


if __name__ == "__main__":
    main()
