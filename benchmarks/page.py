"""What a report page costs, in seconds of CPU and in bytes, beside what its libraries cost.

    python -m benchmarks.page [RUNS] > benchmarks/page.md

Seconds of CPU of whole processes, the least of RUNS: other work on the machine slows a process by
half and more, and the imports alike, so that the ratio of the two is what compares.
"""

from __future__ import annotations

import os
import resource
import subprocess
import sys
import tempfile
from pathlib import Path

import numpy as np

from tdfscal.files.calibration.document import load_calibration
from tdfscal.reporting.figures import drawings
from tdfscal.reporting.figures.style import to_svg

LIBRARIES = "import numpy, scipy.special, scipy.linalg, pydantic, jinja2, yaml, matplotlib.figure"
#: Rigs: number of postures, and what `simulate` is told besides.
RIGS = ((24, ()), (30, ()), (200, ()), (30, ("--scenario", "load-cells")))


def seconds(*words: str) -> float:
    """CPU of a Python process, its system's share included."""
    before = resource.getrusage(resource.RUSAGE_CHILDREN)
    subprocess.run([sys.executable, *words], check=True, capture_output=True)
    after = resource.getrusage(resource.RUSAGE_CHILDREN)
    return after.ru_utime + after.ru_stime - before.ru_utime - before.ru_stime


def main() -> None:
    """Print the table."""
    runs = int(sys.argv[1]) if len(sys.argv) > 1 else 5
    os.environ.update(OPENBLAS_NUM_THREADS="1")
    imports = min(seconds("-c", LIBRARIES) for _ in range(runs))
    print(
        "# The report page\n\n"
        f"`python -m benchmarks.page {runs}`: CPU of `tdfscal report FILE --html`, the least of "
        f"{runs} runs.\nThe same libraries, imported and no more: {imports:.2f} s; the ratio is "
        "to that.\n\n| postures | log | page, MB | CPU, s | ratio |\n|---|---|---|---|---|"
    )
    with tempfile.TemporaryDirectory() as place:
        os.chdir(place)
        for k, (postures, more) in enumerate(RIGS):
            name, own = f"c{k}", "".join(more[1:]) or "dwells"
            made = ["simulate", name, "--postures", str(postures), "--squeeze", "100", *more]
            seconds("-m", "tdfscal", *made, "--format", "parquet")
            seconds("-m", "tdfscal", "calibrate", name, "-o", f"{name}.yaml")
            line = ("-m", "tdfscal", "report", f"{name}.yaml", "--html", "page.html")
            spent = min(seconds(*line) for _ in range(runs))
            size = Path("page.html").stat().st_size / 1e6
            print(f"| {postures} | {own} | {size:.2f} | {spent:.2f} | {spent / imports:.1f} |")
        found = drawings(load_calibration(Path("c1.yaml")))
        print("\nFigures of the page of 30 postures, bytes of each:\n")
        sizes = {drawing.name: len(to_svg(drawing).encode()) for drawing in found}
        for name in sorted(sizes, key=lambda name: -sizes[name]):
            print(f"- {name}: {np.round(sizes[name] / 1e3):.0f} kB")


if __name__ == "__main__":
    main()
