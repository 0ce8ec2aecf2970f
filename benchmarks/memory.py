"""Commands under a limit of memory: the usual result, or one paragraph that says what is short.

    nice python -m benchmarks.memory [--step 50] [--to 1100] > benchmarks/memory.md

Each command runs in a process of its own under `ulimit -v`, and under `ulimit -d`, which limits
what is written to alone. Under the limit it either ends as it does without, or with status 2 and
one line that speaks of memory, within 60 s, and then leaves no file.
"""

from __future__ import annotations

import argparse
import resource
import subprocess
import sys
import tempfile
from dataclasses import dataclass
from pathlib import Path

SAMPLES = Path(__file__).parents[1] / "sample_data"
SECONDS = 60
#: Command lines; @ stands for the sample campaigns; what they write goes to the name after `-o`.
LINES = (
    "calibrate @/csv --trials 0 -q -o out.yaml",
    "calibrate @/mcap --trials 0 -q -o out.yaml --html page.html",
    "calibrate @/parquet --trials 0 -q -o out.yaml",
    "validate own.yaml @/csv -q",
    "apply own.yaml @/mcap -q -o out.mcap",
    "report own.yaml --html out.html",
    "simulate out -q",
    "plan @/csv -q -o out.csv --postures 6 --candidates 50",
    "info @/parquet",
    "monitor own.yaml @/csv -q --html out.html",
)


@dataclass(frozen=True)
class End:
    """How a run ended: its status, what it said, whether it wrote."""

    status: int
    said: str
    wrote: bool


def run(line: str, home: Path, kind: int | None = None, megabytes: int = 0) -> End:
    """Run a command under a limit."""
    words = line.replace("@", str(SAMPLES)).split()
    out = home / (words[words.index("-o") + 1] if "-o" in words else "out.html")
    if words[0] == "simulate":
        out = home / words[1]

    def limit() -> None:
        if kind is not None:
            resource.setrlimit(kind, (megabytes * 1_000_000,) * 2)

    try:
        done = subprocess.run(
            [sys.executable, "-m", "tdfscal", *words],
            cwd=home, capture_output=True, text=True, check=False, timeout=SECONDS,
            preexec_fn=limit,
        )  # fmt: skip
    except subprocess.TimeoutExpired:
        return End(-1, "no end", out.exists())
    end = End(done.returncode, done.stderr, out.exists())
    if out.is_dir():
        subprocess.run(["rm", "-r", str(out)], check=True)
    out.unlink(missing_ok=True)
    return end


def judged(end: End, usual: End) -> str:
    """One word for a run: done, short, or what it must not do."""
    if (end.status, end.wrote) == (usual.status, usual.wrote):
        return "done"
    said = end.said.strip()
    if end.status == 2 and said.count("\n") == 0 and "memory does not suffice" in said:
        return "a file left" if end.wrote else "short"
    return f"**status {end.status}: {' '.join(said.split())[-60:]}**"


def spans(words: list[tuple[int, str]]) -> str:
    """Consecutive limits with one outcome as one span."""
    out: list[tuple[str, int, int]] = []
    for at, word in words:
        if out and out[-1][0] == word:
            out[-1] = (word, out[-1][1], at)
        else:
            out.append((word, at, at))
    return ", ".join(f"{word} {low}–{high}" for word, low, high in out)


def main() -> None:
    parser = argparse.ArgumentParser()
    parser.add_argument("--step", type=int, default=50)
    parser.add_argument("--to", type=int, default=1100)
    parser.add_argument("--only", help="command lines that begin so")
    options = parser.parse_args()
    limits = [25, *range(100, options.to + 1, options.step)]
    print("# Little memory\n")
    print(f"Made by `python -m benchmarks.memory --step {options.step} --to {options.to}`.")
    print(
        "Limits in MB. *short*: status 2 within 60 s, one paragraph that says the memory does not\n"
        "suffice, and no file. *done*: the usual status and output. In bold: what must not be.\n"
    )
    print("| command line | `ulimit -v` | `ulimit -d` |\n|---|---|---|")
    with tempfile.TemporaryDirectory() as folder:
        home = Path(folder)
        words = [sys.executable, "-m", "tdfscal", *LINES[2].replace("out.", "own.").split()]
        subprocess.run([w.replace("@", str(SAMPLES)) for w in words], cwd=home, check=True,
                       stdout=subprocess.DEVNULL)  # fmt: skip
        for line in (one for one in LINES if one.startswith(options.only or "")):
            usual = run(line, home)
            columns = [
                spans([(at, judged(run(line, home, kind, at), usual)) for at in limits])
                for kind in (resource.RLIMIT_AS, resource.RLIMIT_DATA)
            ]
            print(f"| `{line.replace('@', 'C')}` | {' | '.join(columns)} |", flush=True)


if __name__ == "__main__":
    main()
