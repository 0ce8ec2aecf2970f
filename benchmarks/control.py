"""The paper's Sections 4 and 5 on the reference rig: every number beside ours, with its error.

    python -m benchmarks.control [RUNS] [CAMPAIGNS] > benchmarks/control.md
    python -m benchmarks.control success [RUNS] >> benchmarks/control.md

RUNS of free space and docking per calibration, CAMPAIGNS of the accuracy; `success`: the
probability of assembly against angle error and contact stiffness.
"""

from __future__ import annotations

import sys
import tempfile
import time
from pathlib import Path

from studies.commands.assembly import success
from studies.commands.paper import paper
from tdfscal.files.writers.campaign import simulate_to_folder
from tdfscal.reporting.layout import Items, Report, Table


def show(report: Report) -> None:
    """Print a report as Markdown."""
    print(f"## {report.title}\n\n{report.subtitle}\n")
    for block in report.brief():
        if isinstance(block, Table):
            print(f"{block.caption}\n")
            rule = ("---",) * len(block.header)
            for row in (block.header, rule, *block.rows):
                print("| " + " | ".join(cell.replace("|", "\\|") for cell in row) + " |")
            print()
        elif isinstance(block, Items):
            print(f"{block.caption}:\n")
            for item in block.items:
                print(f"- {item}")
            print()


def main() -> None:
    """Print the tables."""
    words = sys.argv[1:]
    with tempfile.TemporaryDirectory() as folder:
        rig = Path(folder) / "rig"
        simulate_to_folder(rig, None, postures=9, rows="postures")
        start = time.process_time()
        if "success" in words:
            runs = int(words[-1]) if words[-1] != "success" else 40
            show(success(rig, runs=runs, seed=1, workers=1).to_report())
        else:
            runs, campaigns = (int(w) for w in (words + ["40", "400"][len(words) :])[:2])
            found = paper(rig, runs=runs, campaigns=campaigns, seed=1, workers=1)
            for part in (found, found.free_space, found.docking):
                show(part.to_report())
        print(f"{time.process_time() - start:.0f} s of one core.")


if __name__ == "__main__":
    main()
