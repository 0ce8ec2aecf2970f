"""Runs ended at a random moment: nothing of an earlier output is lost, nothing is left behind.

    python -m benchmarks.kills [KILLS [SEED]] > benchmarks/kills.md

Before each trial the results for one campaign lie in the folder; the run for another is ended by a
signal at a random moment of its usual time. Afterwards every file must be the earlier or the new
one, whole, but for the time at which it was written; after TERM, HUP and INT all are of one kind,
and nothing is beside them.
"""

from __future__ import annotations

import os
import random
import re
import shutil
import signal
import subprocess
import sys
import time
from collections import Counter
from dataclasses import dataclass
from pathlib import Path

from benchmarks.frame import heads, introduce, numbers, scratch, show

SIGNALS = ("SIGKILL", "SIGTERM", "SIGHUP", "SIGINT")
#: Command lines; `@` is the number of the campaign, `%` the other; each writes to `out`.
LINES = (
    "calibrate C@ --trials 1000 -o out/c.yaml --html out/c.html --allow-rejected",
    "update c@.yaml C% --trials 0 -o out/u.yaml --html out/u.html --allow-rejected",
    "apply c@.yaml C@ -o out/w.parquet",
    "plan C@ -o out/p.csv --postures 4",
    "monitor c@.yaml C% --html out/m.html",
    "export c@.yaml --to urdf -o out/x.urdf",
    "init C@ -o out/rig.yaml",
)
#: What differs between equal runs: when they ran, and numbers that follow from it.
WHEN = re.compile(rb"\d{4}-\d\d-\d\d[T ]\d\d:\d\d:\d\d|[0-9a-f]{64}|[Rr]eport [0-9a-f]{8}")
#: A line of a traceback in a function of ours.
OURS = re.compile(r"/tdfscal/.*, in (?!<module>)")
Files = dict[str, bytes]


@dataclass(frozen=True)
class Results:
    """What a command line writes for either campaign; its usual status and time, s."""

    line: str
    earlier: Files
    new: Files
    status: int
    seconds: float


def contents(folder: Path) -> Files:
    """Content of every file by its name, without the time at which it was written."""
    paths = [path for path in folder.rglob("*") if path.is_file()]
    return {str(p.relative_to(folder)): WHEN.sub(b"when", p.read_bytes()) for p in paths}


def started(home: Path, line: str, campaign: int) -> subprocess.Popen[str]:
    """Begin a command in a folder; SOURCE_DATE_EPOCH keeps dates out of figures."""
    words = line.replace("@", str(campaign)).replace("%", str(1 - campaign)).split()
    environment = os.environ | {"SOURCE_DATE_EPOCH": "1700000000"}
    return subprocess.Popen([sys.executable, "-m", "tdfscal", *words], cwd=home, text=True,
                            stdout=subprocess.DEVNULL, stderr=subprocess.PIPE,
                            start_new_session=True, env=environment)  # fmt: skip


def laid(home: Path, line: str, campaign: int) -> tuple[Files, int, float]:
    """What a line writes into an empty folder, undisturbed; kept beside it for the trials."""
    shutil.rmtree(home / "out", ignore_errors=True)
    (home / "out").mkdir()
    begin, run = time.monotonic(), started(home, line, campaign)
    run.communicate()
    return contents(home / "out"), run.returncode, time.monotonic() - begin


def known(home: Path, number: int, line: str) -> Results:
    """The results of a line for both campaigns; the earlier ones stay in a folder of their own."""
    new, status, seconds = laid(home, line, 1)
    earlier = laid(home, line, 0)[0]
    if not new or set(new) != set(earlier):
        raise RuntimeError(f"`{line}` does not write the same files for both campaigns")
    shutil.copytree(home / "out", home / f"earlier{number}")
    return Results(line, earlier, new, status, seconds)


def faults(of: Results, name: str, status: int, said: str, now: Files) -> set[str]:
    """What is wrong after a run that a signal has ended."""
    number, found, names = getattr(signal, name), set(), set(of.earlier)
    kept = {key for key in names if now.get(key) == of.earlier[key]}
    replaced = {key for key in names if now.get(key) == of.new[key]}
    if kept | replaced != names:
        found.add("an output is neither the earlier one nor the new one, whole")
    if name != "SIGKILL":
        if names not in (kept, replaced):
            found.add("outputs of two runs side by side")
        if set(now) - names:
            found.add("something is left behind")
        if status not in (of.status, 128 + number, -number):
            found.add(f"status {status} after {name}")
        if "nothing was written" in said and kept != names:
            found.add("`nothing was written` is said though something was")
    # Before our first line Python answers an interruption in its own way.
    if OURS.search(said):
        found.add("traceback")
    return found


def trial(home: Path, table: list[Results], rng: random.Random) -> tuple[str, str, set[str], bool]:
    """One run that is ended: its line, the signal, faults, and whether the new files are there."""
    number, name = rng.randrange(len(table)), rng.choice(SIGNALS)
    of = table[number]
    shutil.rmtree(home / "out")
    shutil.copytree(home / f"earlier{number}", home / "out")
    run = started(home, of.line, 1)
    time.sleep(rng.uniform(0.05, 1.05) * of.seconds)
    run.send_signal(getattr(signal, name))
    said, now = run.communicate()[1], contents(home / "out")
    return of.line, name, faults(of, name, run.returncode, said, now), now == of.new


def main() -> None:
    """Print the table."""
    kills, seed = numbers(500, 0)
    for name in SIGNALS[1:]:  # ignored in the background and under nohup, by what is started too
        signal.signal(getattr(signal, name), signal.SIG_DFL)
    rng, runs, bad, new = random.Random(seed), Counter[str](), Counter[tuple[str, str]](), 0
    with scratch() as home:
        for campaign in (0, 1):
            for line in ("simulate C@ --postures 10 --rate 20 --seed @",
                         "calibrate C@ --trials 0 -o c@.yaml"):  # fmt: skip
                started(home, line, campaign).communicate()
        inputs = [contents(home / f"C{campaign}") for campaign in (0, 1)]
        table = [known(home, number, line) for number, line in enumerate(LINES)]
        for _ in range(kills):
            line, name, found, replaced = trial(home, table, rng)
            if inputs != [contents(home / f"C{campaign}") for campaign in (0, 1)]:
                found.add("an input is changed")
            runs[f"{line} {name}"] += 1
            bad.update((line, fault) for fault in found)
            new += replaced
    introduce("Kills", f"kills {kills} {seed}", __doc__)
    print(f"The new files lay there after {new} of {kills} trials.\n")
    print(heads("command line", *SIGNALS, "faults"))
    for line in LINES:
        said = "; ".join(f"{n} × {what}" for (of, what), n in sorted(bad.items()) if of == line)
        show(f"`{line}`", *(runs[f"{line} {name}"] for name in SIGNALS), said or "none")


if __name__ == "__main__":
    main()
