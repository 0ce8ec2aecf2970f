"""Random kills over all commands: nothing of an earlier output is lost, nothing is left behind.

Run: python -m benchmarks.kills [kills] > benchmarks/kills.md
"""

from __future__ import annotations

import random
import shutil
import signal
import subprocess
import sys
import tempfile
import time
from collections import Counter
from pathlib import Path

SAMPLES = Path(__file__).parents[1] / "sample_data"
SIGNALS = ("SIGKILL", "SIGTERM", "SIGHUP", "SIGINT")
#: Command lines; what each writes is the folder `out`.
LINES = (
    "calibrate C --trials 2000 -o out/c.yaml --html out/c.html",
    "validate c.yaml C --html out/v.html",
    "apply c.yaml C -o out/w.csv",
    "plan C -o out/p.csv --postures 6 --candidates 60",
    "report c.yaml --html out/r.html --figures out/figures",
    "export c.yaml --to urdf -o out/x.urdf",
    "study sensitivity C -o out",
    "study accuracy C -o out --runs 2 --postures 6 --workers 1",
    "simulate out/s --postures 8 --rate 20 --force",
    "schema out/schemas",
)


def files(folder: Path) -> dict[str, bytes]:
    """Content of every file by its name."""
    return {str(p.relative_to(folder)): p.read_bytes() for p in folder.rglob("*") if p.is_file()}


def started(home: Path, line: str) -> subprocess.Popen[bytes]:
    """Begin a command in a folder."""
    words = [sys.executable, "-m", "tdfscal", *line.split()]
    return subprocess.Popen(
        words, cwd=home, stdout=subprocess.DEVNULL, stderr=subprocess.PIPE, start_new_session=True
    )


def whole(before: bytes, now: bytes | None) -> bool:
    """An earlier output is as it was, or a later one has taken its place whole."""
    return now is not None and (now == before or len(now) > len(before) // 2)


def main() -> None:
    """Print the table."""
    count = int(sys.argv[1]) if len(sys.argv) > 1 else 500
    rng = random.Random(1)
    home = Path(tempfile.mkdtemp(prefix="kills-"))
    shutil.copytree(SAMPLES / "parquet", home / "C")
    started(home, "calibrate C --trials 0 -o c.yaml").communicate()
    lasting, seen, faults = {}, Counter[str](), Counter[str]()
    for line in LINES:
        (home / "out").mkdir(exist_ok=True)
        begin = time.monotonic()
        started(home, line).communicate()
        lasting[line] = time.monotonic() - begin
    inputs = files(home / "C")
    for _ in range(count):
        line, name = rng.choice(LINES), rng.choice(SIGNALS)
        before = files(home / "out")
        run = started(home, line)
        time.sleep(rng.uniform(0.05, 1.0) * lasting[line])
        run.send_signal(getattr(signal, name))
        said = run.communicate()[1].decode(errors="replace")
        now = files(home / "out")
        left = [key for key in now if key.endswith(".part")]
        seen[name] += 1
        if any(not whole(content, now.get(key)) for key, content in before.items()
               if not key.endswith(".part")):  # fmt: skip
            faults["an earlier output is damaged"] += 1
        if left and name != "SIGKILL":
            faults["leftovers of a signal"] += 1
        if "Traceback" in said and "tdfscal" in said:
            faults["traceback"] += 1
        if name != "SIGKILL" and run.returncode not in (0, 128 + getattr(signal, name)):
            faults[f"status {run.returncode} after {name}"] += 1
        if left:
            started(home, line).communicate()
            if any(key.endswith(".part") for key in files(home / "out")):
                faults["leftovers after the next run"] += 1
    if files(home / "C") != inputs:
        faults["an input is changed"] += 1
    shutil.rmtree(home)
    print(
        f"# Kills\n\nMade by `python -m benchmarks.kills {count}`: {count} runs of "
        f"{len(LINES)} command lines, each ended by a\nsignal at a random moment of its usual "
        "time.\n"
    )
    print("| signal | runs |\n|---|---|")
    for name in SIGNALS:
        print(f"| {name} | {seen[name]} |")
    print("\n| fault | times |\n|---|---|")
    for what, times in sorted(faults.items()):
        print(f"| {what} | {times} |")
    if not faults:
        print("| none | 0 |")


if __name__ == "__main__":
    main()
