"""How time and memory of `calibrate` grow with postures, supports and dwells.

    python -m benchmarks.supports_size

Rewrites `benchmarks/supports_size.md`. Times are CPU seconds of the whole command, also as
multiples of importing numpy, scipy.optimize and pyarrow on the same machine, in the same minute.
The package's bytecode has to lie beside it, as an installation leaves it.
"""

from __future__ import annotations

import os
import subprocess
import sys
import tempfile
from collections.abc import Sequence
from dataclasses import dataclass, replace
from pathlib import Path

import yaml

from tdfscal.files.writers.campaign import LogFormat, simulate_to_folder
from tdfscal.records import Rows
from tdfscal.simulation import Recorder, make_rig

_IMPORTS = "import numpy, scipy.optimize, pyarrow"
_CALIBRATE = "from tdfscal.cli import main; main()"


@dataclass(frozen=True, slots=True)
class Case:
    """A campaign; scatter : force noise, N, that is there where 0.1 N is stated.

    folder : where it lies already, instead of being simulated.
    """

    name: str
    supports: int
    postures: int
    rows: Rows = "postures"
    format: LogFormat = "csv"
    scatter: float = 0.1
    folder: Path | None = None


CASES = (
    Case("the sample campaign", 3, 16, folder=Path("sample_data/csv")),
    Case("24 dwells, 100 Hz", 3, 24, "timeseries"),
    Case("2,000 postures", 3, 2_000),
    Case("20,000 postures", 3, 20_000),
    Case("40 supports, 200 postures", 40, 200),
    Case("the same, noise understated five times", 40, 200, scatter=0.5),
    Case("1,000 dwells, 100 Hz", 3, 1_000, "timeseries", "parquet"),
)


def cost(code: str, arguments: Sequence[str] = ()) -> tuple[int, float, float]:
    """Exit status, CPU seconds and largest memory in MB of a Python program."""
    child = subprocess.Popen(
        [sys.executable, "-c", code, *arguments],
        stdout=subprocess.DEVNULL,
        stderr=subprocess.DEVNULL,
        env={**os.environ, "OMP_NUM_THREADS": "1", "OPENBLAS_NUM_THREADS": "1"},
    )
    _, status, used = os.wait4(child.pid, 0)
    child.returncode = os.waitstatus_to_exitcode(status)
    return child.returncode, used.ru_utime + used.ru_stime, used.ru_maxrss / 1024


def campaign(case: Case, folder: Path) -> None:
    """Write the campaign of a case, its rig file stating 0.1 N."""
    rig = make_rig(case.supports)
    loud = replace(rig, declared=replace(rig.declared, force_noise=case.scatter))
    simulate_to_folder(
        folder,
        loud,
        postures=case.postures,
        rows=case.rows,
        format=case.format,
        recorder=Recorder(mean_sd=0.0) if case.rows == "postures" else Recorder(),
    )
    path = folder / "rig.yaml"
    content = yaml.safe_load(path.read_text(encoding="utf-8"))
    content["uncertainty"]["force_noise"] = 0.1
    path.write_text(yaml.safe_dump(content, sort_keys=False), encoding="utf-8")


def measured(case: Case) -> tuple[int, float, float, float]:
    """Exit status, CPU seconds, MB, and CPU seconds of the imports just before and after."""
    with tempfile.TemporaryDirectory() as place:
        folder = case.folder or Path(place) / "campaign"
        if case.folder is None:
            campaign(case, folder)
        before = cost(_IMPORTS)[1]
        arguments = ["calibrate", str(folder), "-o", f"{place}/found.json", "-q"]
        status, seconds, size = cost(_CALIBRATE, arguments)
        return status, seconds, size, (before + cost(_IMPORTS)[1]) / 2


def main() -> None:
    """Measure and write the table."""
    rows, found = [], {}
    for case in CASES:
        if sys.argv[1:] and not any(word in case.name for word in sys.argv[1:]):
            continue
        status, seconds, size, imports = found[case.name] = measured(case)
        rows.append(
            f"| {case.name} | {status} | {seconds:.1f} | {seconds / imports:.1f} | {size:.0f} |"
        )
        print(rows[-1], flush=True)
    if sys.argv[1:]:
        return
    few, many = found["2,000 postures"], found["20,000 postures"]
    text = f"""# Sizes

Made by `python -m benchmarks.supports_size`: the whole command `calibrate`, CPU seconds on one
thread of a shared machine, and as multiples of importing numpy, scipy.optimize and pyarrow
({many[3]:.2f} s there). Ten times as many postures cost {many[1] / few[1]:.1f} times the time.
Above 12 sensors no Monte Carlo is made unasked. Status 1: the gate rejects, as it should where the
stated noise is a fifth of what is there.

| campaign | status | CPU s | / imports | MB |
|---|---|---|---|---|
"""
    target = Path(__file__).with_suffix(".md")
    target.write_text(text + "\n".join(rows) + "\n", encoding="utf-8")


if __name__ == "__main__":
    main()
