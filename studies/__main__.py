"""`python -m studies NAME RIG -o DIR`: one of the paper's studies, from a checkout."""

from __future__ import annotations

import argparse
import json
import sys
from collections.abc import Callable, Sequence
from dataclasses import dataclass
from pathlib import Path

import numpy as np

from studies.frame import Study, check_folder
from tdfscal import load_calibration
from tdfscal.commands.calibration_in_use import require_agreement
from tdfscal.commands.campaign import rig_file
from tdfscal.commands.result import Calibration
from tdfscal.commands.simulate import survey_of
from tdfscal.errors import TdfscalError, UsageError
from tdfscal.records import Rig

#: What each study does, and its runs where none are asked for; in the order of the paper.
STUDIES = {
    "sensitivity": ("contact wrench error against each installation angle (Fig. 4)", 0),
    "accuracy": ("errors of self-calibration and laser tracker (Figs. 7–9, 12–14, Table 3)", 200),
    "table2": ("where Eq. 24 is below the tracker, as a map (Table 2)", 40),
    "causes": ("what makes Eq. 24 err, one source and one equation at a time", 60),
    "free-space": ("deviation in free space under impedance control (Table 4, Fig. 16)", 24),
    "docking": ("contact force and torque while the gears are docked (Figs. 17, 18)", 12),
}
#: Fewest runs that have a spread; Student's t does the rest.
_LEAST = 3


@dataclass(frozen=True, slots=True)
class Asked:
    """What the command line asks for; runs : None for the study's own number."""

    name: str
    rig: Path
    output: Path
    calibration: Sequence[Path] = ()
    runs: int | None = None
    seed: int = 0


def perform(
    asked: Asked, progress: Callable[[str], None] = lambda text: None
) -> tuple[Study, tuple[str, ...]]:
    """Run a study and write its folder; return it with the names of its files.

    Raises TdfscalError by cause.
    """
    # matplotlib is imported when it is known that there is something to draw.
    from studies import accuracy, campaigns, causes, docking, free_space, sensitivity, table2
    from studies.controlled import simulated

    runs = STUDIES[asked.name][1] if asked.runs is None else asked.runs
    if runs < _LEAST and asked.name != "sensitivity":
        raise UsageError(f"{runs} runs have no spread", where="--runs", hint=f"{_LEAST} or more")
    if asked.seed < 0:
        raise UsageError("a seed is not negative", where="--seed")
    if asked.calibration and asked.name != "sensitivity":
        raise UsageError(f"{asked.name} judges no calibration", where="--calibration")
    loaded = rig_file(asked.rig)
    rig, survey = campaigns.require_whole(loaded), survey_of(loaded)
    check_folder(asked.output)
    given = [(path.stem, _calibration(path, rig)) for path in asked.calibration]
    if asked.name == "sensitivity":
        study = sensitivity.run(rig, given)
    elif asked.name in ("accuracy", "table2", "causes"):
        of = {"accuracy": accuracy, "table2": table2, "causes": causes}[asked.name]
        study = of.run(rig, survey, runs, asked.seed, progress)
    else:
        first, second = np.random.SeedSequence(asked.seed).spawn(2)
        rng = np.random.default_rng(first)
        progress(f"{runs} campaigns and surveys, simulated and calibrated")
        own = simulated(rig, survey, runs, rng, campaigns.usual(rig))
        if asked.name == "docking":
            study = docking.run(rig, own, second, progress)
        else:
            alone, leading = campaigns.papers_sources(rig), campaigns.LEADING
            other = simulated(alone, survey, runs, rng, leading)
            study = free_space.run(rig, {"rig": own, "paper": other}, second, progress)
    return study, study.write(asked.output)


def _calibration(path: Path, rig: Rig) -> Calibration:
    found = load_calibration(path)
    require_agreement(found.rig.record(), rig, str(path))
    return found


def parser() -> argparse.ArgumentParser:
    """Return what reads the command line."""
    listed = "\n".join(f"  {name:12} {text}" for name, (text, _) in STUDIES.items())
    made = argparse.ArgumentParser(
        prog="python -m studies",
        description="The studies of the paper's Sections 2, 4 and 5, on any rig.",
        epilog=f"studies:\n{listed}",
        formatter_class=argparse.RawDescriptionHelpFormatter,
        allow_abbrev=False,
    )
    made.add_argument("name", choices=tuple(STUDIES), metavar="NAME", help="the study")
    made.add_argument("rig", type=Path, metavar="RIG", help="rig.yaml, or its folder")
    made.add_argument("-o", "--output", type=Path, required=True, metavar="DIR",
                      help="folder for tables, figures and page")  # fmt: skip
    made.add_argument("--calibration", type=Path, nargs="+", default=(), metavar="FILE",
                      help="calibrations to judge")  # fmt: skip
    made.add_argument("--runs", type=int, metavar="N", help="simulated runs of each case")
    made.add_argument("--seed", type=int, default=0, metavar="N", help="of all random numbers")
    made.add_argument("--json", action="store_true", help="print one JSON object")
    return made


def main(words: Sequence[str] | None = None) -> int:
    """Run the study that the command line names; return the exit status."""
    options = vars(parser().parse_args(words))
    as_json = options.pop("json")
    asked = Asked(**options)

    def say(text: str) -> None:
        print(f"studies: {text}", file=sys.stderr, flush=True)

    try:
        study, files = perform(asked, say)
    except TdfscalError as error:
        say(str(error))
        return error.exit_status
    if as_json:
        print(json.dumps(study.document(), ensure_ascii=False, allow_nan=False, indent=1))
        return 0
    from tdfscal.reporting.text import render

    print(f"{render(study.report())}\nwrote {len(files)} files to {asked.output}")
    return 0


if __name__ == "__main__":
    sys.exit(main())
