"""Random kills over all commands: nothing of an earlier output is lost, nothing is left behind.

    python -m benchmarks.kills [--kills 500] [--seed 0] > benchmarks/kills.md

Every command line is made for two campaigns, and its results are known to the byte. Before each
trial the results for the one lie in the folder; the run for the other is ended by a signal at a
random moment. Afterwards every file must be one of the two, whole, and after a signal that can be
caught all of them must belong together.
"""

from __future__ import annotations

import argparse
import os
import random
import re
import shutil
import signal
import subprocess
import sys
import tempfile
import time
from collections import Counter
from collections.abc import Iterator
from dataclasses import dataclass
from pathlib import Path
from typing import Literal

SIGNALS = ("SIGKILL", "SIGTERM", "SIGHUP", "SIGINT")
#: Command lines; `@` is the number of the campaign, `%` the other; each writes to `out`.
LINES = (
    "calibrate C@ --trials 1000 -o out/c.yaml --html out/c.html --allow-rejected",
    "update c@.yaml C% --trials 0 -o out/u.yaml --html out/u.html --allow-rejected",
    "validate c@.yaml C@ --html out/v.html",
    "apply c@.yaml C@ -o out/w.csv",
    "apply c@.yaml C@ -o out/w.parquet",
    "plan C@ -o out/p.csv --postures 4",
    "report c@.yaml --html out/r.html",
    "monitor c@.yaml C% --html out/m.html",
    "export c@.yaml --to urdf -o out/x.urdf",
    "init C@ -o out/rig.yaml",
    "simulate out/s --postures 4 --rate 20 --seed @ --force",
    "schema out/schemas",
)
#: What differs between equal runs: when they ran.
WHEN = re.compile(rb"\d{4}-\d\d-\d\d[T ]\d\d:\d\d:\d\d|content_sha256: [0-9a-f]{64}")
Files = dict[str, bytes]


@dataclass(frozen=True)
class Results:
    """What a command line writes for each of the two campaigns; its usual status and time, s."""

    line: str
    files: tuple[Files, Files]
    status: int
    seconds: float


def contents(folder: Path) -> Files:
    """Content of every file by its name."""
    return {str(p.relative_to(folder)): p.read_bytes() for p in folder.rglob("*") if p.is_file()}


def timeless(files: Files) -> Files:
    """The same, but for the time at which it was written."""
    return {name: WHEN.sub(b"when", content) for name, content in files.items()}


def started(home: Path, line: str, campaign: int) -> subprocess.Popen[bytes]:
    """Begin a command in a folder; SOURCE_DATE_EPOCH keeps dates out of figures."""
    line = line.replace("@", str(campaign)).replace("%", str(1 - campaign))
    words = [sys.executable, "-m", "tdfscal", *line.split()]
    return subprocess.Popen(
        words,
        cwd=home,
        stdout=subprocess.DEVNULL,
        stderr=subprocess.PIPE,
        start_new_session=True,
        env=os.environ | {"SOURCE_DATE_EPOCH": "1700000000"},
    )


def lay(folder: Path, files: Files) -> None:
    """Fill an empty folder."""
    shutil.rmtree(folder, ignore_errors=True)
    folder.mkdir()
    for name, content in files.items():
        place = folder / name
        place.parent.mkdir(parents=True, exist_ok=True)
        place.write_bytes(content)


def known(home: Path, line: str) -> Results:
    """Run a line for both campaigns without a signal."""
    made = []
    for campaign in (0, 1):
        lay(home / "out", {})
        begin = time.monotonic()
        run = started(home, line, campaign)
        run.communicate()
        made.append(contents(home / "out"))
    if not made[0] or set(made[0]) != set(made[1]):
        raise RuntimeError(f"`{line}` does not write the same files for both campaigns")
    return Results(line, (made[0], made[1]), run.returncode, time.monotonic() - begin)


def faults(results: Results, name: str, status: int, said: str, now: Files) -> set[str]:
    """What is wrong after a run that a signal has ended."""
    number = getattr(signal, name)
    found = set()
    old, new, now = timeless(results.files[0]), timeless(results.files[1]), timeless(now)
    kept = {key for key in old if now.get(key) == old[key]}
    replaced = {key for key in old if now.get(key) == new[key]}
    if kept | replaced != set(old):
        found.add("an output is neither the earlier one nor the new one, whole")
    if name != "SIGKILL":
        if kept != set(old) and replaced != set(old):
            found.add("outputs of two runs side by side")
        if set(now) - set(old):
            found.add("something is left behind")
        if status not in (results.status, 128 + number, -number):
            found.add(f"status {status} after {name}")
        if "nothing was written" in said and replaced == set(old) and old != new:
            found.add("`nothing was written` is said though everything was")
    # Before our first line Python answers an interruption in its own way.
    if "Traceback" in said and "/tdfscal/" in said:
        found.add("traceback")
    return found


def trial(home: Path, results: Results, name: str, moment: float) -> set[str]:
    """End a run for the second campaign over the results for the first one."""
    out = home / "out"
    lay(out, results.files[0])
    run = started(home, results.line, 1)
    time.sleep(moment)
    run.send_signal(getattr(signal, name))
    said = run.communicate()[1].decode(errors="replace")
    now = contents(out)
    found = faults(results, name, run.returncode, said, now)
    if found:
        print(f"{results.line}: {name}: {found}: {said}", file=sys.stderr, flush=True)
    return found


def main() -> None:
    """Print the table."""
    parser = argparse.ArgumentParser(description=__doc__.splitlines()[0] if __doc__ else "")
    parser.add_argument("--kills", type=int, default=500)
    parser.add_argument("--seed", type=int, default=0)
    options = parser.parse_args()
    runs, bad, ends = Counter[tuple[str, str]](), Counter[tuple[str, str]](), Counter[str]()
    with tempfile.TemporaryDirectory(prefix="kills-") as folder:
        for line, name, found, end in trials(Path(folder), options.kills, options.seed):
            runs[line, name] += 1
            bad.update((line, fault) for fault in found)
            ends[end] += 1
    _print(options, runs, bad, ends)


def trials(
    home: Path, kills: int, seed: int
) -> Iterator[tuple[str, str, set[str], Literal["earlier outputs", "new ones"]]]:
    """Run the trials: line, signal, faults, end."""
    for campaign in (0, 1):
        for line in ("simulate C@ --postures 10 --rate 20 --seed @",
                     "calibrate C@ --trials 0 -o c@.yaml"):  # fmt: skip
            started(home, line, campaign).communicate()
    inputs = [contents(home / f"C{campaign}") for campaign in (0, 1)]
    table, rng = [known(home, line) for line in LINES], random.Random(seed)
    for _ in range(kills):
        results, name = rng.choice(table), rng.choice(SIGNALS)
        found = trial(home, results, name, rng.uniform(0.05, 1.05) * results.seconds)
        if inputs != [contents(home / f"C{campaign}") for campaign in (0, 1)]:
            found.add("an input is changed")
        earlier = timeless(contents(home / "out")) == timeless(results.files[0])
        yield results.line, name, found, "earlier outputs" if earlier else "new ones"


def _print(
    options: argparse.Namespace,
    runs: Counter[tuple[str, str]],
    bad: Counter[tuple[str, str]],
    ends: Counter[str],
) -> None:
    print(
        f"""# Kills

Made by `python -m benchmarks.kills --kills {options.kills} --seed {options.seed}`.
{options.kills} runs over the results of an earlier run with other inputs, each ended by a signal at
a random moment of its usual time (up to 5 % beyond it). Afterwards every file must be, to the byte
(times of writing apart),
the earlier or the new one; after TERM, HUP and INT all of one kind, and nothing beside them. The
folder held the earlier outputs after
{ends["earlier outputs"]} trials, the new ones after {ends["new ones"]}.
"""
    )
    print(f"| command line | {' | '.join(SIGNALS)} | faults |\n|---|{'---|' * len(SIGNALS)}---|")
    for line in LINES:
        counts = " | ".join(str(runs[line, name]) for name in SIGNALS)
        found = "; ".join(f"{n} × {what}" for (of, what), n in sorted(bad.items()) if of == line)
        print(f"| `{line}` | {counts} | {found or 'none'} |")


if __name__ == "__main__":
    main()
