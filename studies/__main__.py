"""`python -m studies NAME RIG -o DIR`: one of the paper's studies, from a checkout."""

from __future__ import annotations

import argparse
import json
import sys
from inspect import signature
from pathlib import Path
from typing import Any

from tdfscal.errors import TdfscalError
from tdfscal.workflows.progress import Progress

#: What each study does, in the order of the paper.
STUDIES = {
    "sensitivity": "contact wrench error against each installation angle (Fig. 4)",
    "accuracy": "Monte Carlo of self-calibration and laser tracker (Figs. 7–9, 12–14, Table 2)",
    "free-space": "deviation in free space under impedance control (Table 4, Fig. 16)",
    "docking": "contact force and torque while the gears are docked (Figs. 17 and 18)",
    "success": "does the assembly succeed, against angle error and contact stiffness",
    "cost": "cost of each method against its accuracy",
    "paper": "the paper's numbers beside this rig's",
}


def parser() -> argparse.ArgumentParser:
    """Return what reads the command line."""
    listed = "\n".join(f"  {name:12} {text}" for name, text in STUDIES.items())
    made = argparse.ArgumentParser(
        prog="python -m studies",
        description="The studies of the paper's Sections 4 and 5, on any rig.",
        epilog=f"studies:\n{listed}",
        formatter_class=argparse.RawDescriptionHelpFormatter,
        allow_abbrev=False,
    )
    made.add_argument("name", choices=tuple(STUDIES), metavar="NAME", help="the study")
    made.add_argument("rig", type=Path, metavar="RIG", help="rig.yaml, or its folder")
    made.add_argument("-o", "--output", type=Path, required=True, metavar="DIR",
                      help="folder for tables, figures and page")  # fmt: skip
    made.add_argument("--calibration", type=Path, nargs="+", metavar="FILE",
                      help="calibrations to judge")  # fmt: skip
    made.add_argument("--runs", type=int, metavar="N", help="simulated runs of each case")
    made.add_argument("--seed", type=int, default=0, metavar="N", help="of all random numbers")
    made.add_argument("--json", action="store_true", help="print one JSON object")
    return made


def run(words: list[str] | None = None) -> int:
    """Run the study that the command line names; return the exit status."""
    # A study and its matplotlib are imported when it is known which.
    import studies.commands

    made = parser()
    asked = vars(made.parse_args(words))
    name, as_json = asked.pop("name"), asked.pop("json")
    study: Any = getattr(studies.commands, name.replace("-", "_"))
    options = {option: value for option, value in asked.items() if value is not None}
    foreign = set(options) - set(signature(study).parameters)
    if foreign:
        made.error(f"{name} takes no --{min(foreign)}")

    def say(text: str) -> None:
        print(f"studies: {text}", file=sys.stderr)

    try:
        result = study(**options, progress=Progress(stage=say, count=say))
    except TdfscalError as error:
        say(str(error))
        return error.exit_status
    if as_json:
        print(json.dumps(result.to_dict(), ensure_ascii=False, allow_nan=False, indent=1))
    else:
        print(f"{result.text}\nwrote {len(result.files)} files to {asked['output']}")
    return 0


if __name__ == "__main__":
    sys.exit(run())
