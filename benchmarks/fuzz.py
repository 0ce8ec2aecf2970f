"""Damaged and nonsensical files of every kind through the command line.

    python -m benchmarks.fuzz [--cases 20000] [--seed 0] [--keep FOLDER] > benchmarks/fuzz.md

With --keep the outcomes are appended to files, and a run goes on where an earlier one ended.

A file of each kind is mutated and given to a command that reads it, in this process's `main`: bytes
flipped, cut, doubled, put in and spliced with another file's; for text also its cells, words and
lines; for YAML and JSON also their values, keys and types; for Parquet its columns. Each run must
end with a status of the contract, within 20 s of processor time, without traceback, internal error
or a library's warning. Each kind runs in a process of its own, so that one which ends is counted
too.
"""

from __future__ import annotations

import argparse
import copy
import io
import json
import os
import random
import re
import shutil
import signal
import subprocess
import sys
import tempfile
import time
import traceback
from collections import Counter
from collections.abc import Callable
from contextlib import redirect_stderr, redirect_stdout
from dataclasses import dataclass
from pathlib import Path
from types import FrameType
from typing import Any

import pyarrow as pa
import pyarrow.parquet as pq
import yaml

from benchmarks.fuzz_files import KINDS, Kind, build
from tdfscal.cli import main as command_line
from tests.files.edits import edits

STATUSES = (0, 1, 2, 3, 4)
#: Processor time, s, that a run may take, and time by the clock, on a machine that others use too.
PATIENCE, HANGING = 20, 200
ODD_WORDS = (
    "", "nan", "inf", "-inf", "1e999", "1e308", "-0", "0x10", "1_000", "1,5", "٣", "=1+1", "'", '"',
    "#", "null", "~", "yes", "2026-02-30", "2026-11-21T02:00:00+25:00", "\x00", "\u2028", "\ud7ff",
    "-", "1e", "9" * 400, "*a", "&a [*a]", "!!python/object:os.system x", "{", "[", "- ", "\t",
)  # fmt: skip
ODD_VALUES: tuple[Any, ...] = (
    None, True, -1, 0, 1e308, 5e-324, float("nan"), float("inf"), 10**400, "", "x", "nan", [], {},
    [[]], {"a": 1}, [0, 0, 0], [1e308] * 3, "2026-11-21", "../../etc", "\x85",
)  # fmt: skip


TYPES: dict[str, Callable[[Any], Any]] = {
    "text": str,
    "list": lambda value: [value, value],
    "struct": lambda value: {"x": value, "y": value, "z": value},
    "switch": bool,
    "bytes": lambda value: b"\x00",
    "null": lambda value: None,
}


class Stuck(BaseException):
    """A run takes longer than a user waits."""


@dataclass(frozen=True)
class Outcome:
    """Status of a run, seconds, and what is wrong with it, if anything."""

    status: int
    seconds: float
    fault: str | None


def bytes_mutated(raw: bytes, rng: random.Random, others: list[bytes]) -> bytes:
    """One to four changes of a file's bytes."""
    data = bytearray(raw)
    for _ in range(rng.choice((1, 1, 1, 2, 4))):
        at = rng.randrange(len(data) + 1)
        size = rng.choice((1, 2, 4, 8, 64, max(1, len(data) // 4)))
        chunk = rng.choice((b"\x00", b"\xff", b"\x7f\xff\xff\xff", b"\xff\xfe", b"\n", b"\x80")) * 2
        match rng.randrange(8):
            case 0 | 1:
                if at < len(data):
                    data[at] ^= 1 << rng.randrange(8)
            case 2:
                del data[at : at + size]
            case 3:
                data[at:at] = data[at : at + size]
            case 4:
                data[at : at + len(chunk)] = chunk
            case 5:
                data[at:at] = rng.randbytes(size % 65)
            case 6:
                data = data[:at]
            case _:
                other = rng.choice(others)
                start = rng.randrange(len(other) + 1)
                data[at : at + size] = other[start : start + size]
    return bytes(data)


def text_mutated(raw: bytes, rng: random.Random) -> bytes:
    """Words, cells, lines or the encoding of a text changed."""
    text = raw.decode("utf-8")
    lines = text.split("\n")
    for _ in range(rng.choice((1, 1, 2, 5))):
        at = rng.randrange(len(lines))
        cells = re.split(r"([,\s:]+)", lines[at])
        match rng.randrange(8):
            case 0 | 1 | 2:
                cells[rng.randrange(len(cells))] = rng.choice(ODD_WORDS)
            case 3:
                rng.shuffle(cells)
            case 4:
                cells = cells[: rng.randrange(len(cells) + 1)]
            case 5:
                cells = cells * 2
            case 6:
                other = rng.randrange(len(lines))
                lines[at], lines[other] = lines[other], lines[at]
                continue
            case _:
                lines[at:at] = [lines[rng.randrange(len(lines))]] * rng.choice((1, 3))
                continue
        lines[at] = "".join(cells)
    text = "\n".join(lines)
    if rng.random() < 0.1:
        text = text.replace(*rng.choice(((",", ";"), (".", ","), ("\n", "\r\n"), (",", "\t"))))
    coding = rng.choice(("utf-8",) * 9 + ("utf-16", "utf-32", "utf-8-sig", "cp1252"))
    return text.encode(coding, "replace" if coding == "cp1252" else "surrogatepass")


def document_mutated(raw: bytes, rng: random.Random, form: str) -> bytes:
    """Values, keys and types of a document changed."""
    document = yaml.safe_load(raw)
    for _ in range(rng.choice((1, 1, 2, 4))):
        if not document:
            break
        (edit,) = edits(document, 1, rng.randrange(1 << 30))
        document = edit.document
        if rng.random() < 0.6:
            inner: Any = document
            for part in edit.place[:-1]:
                inner = inner[part]
            if isinstance(inner, list) and edit.place[-1] == len(inner):
                continue
            inner[edit.place[-1]] = copy.deepcopy(rng.choice(ODD_VALUES))
    if form == "json":
        return json.dumps(document).encode()
    return str(yaml.safe_dump(document, sort_keys=False, allow_unicode=True)).encode()


def table_mutated(raw: bytes, rng: random.Random) -> bytes:
    """Columns of a Parquet table dropped, doubled, renamed, with other types or odd values."""
    table = pq.read_table(io.BytesIO(raw))
    for _ in range(rng.choice((1, 1, 2))):
        at = rng.randrange(table.num_columns)
        name, column = table.column_names[at], table.column(at).to_pylist()
        match rng.randrange(6):
            case 0:
                table = table.remove_column(at)
            case 1:
                table = table.append_column(name, table.column(at))
            case 2:
                names = list(table.column_names)
                names[at] = rng.choice((*ODD_WORDS[:20], names[at - 1]))
                table = table.rename_columns(names)
            case 3:
                column = [value if rng.random() < 0.5 else None for value in column]
                table = table.set_column(at, name, pa.array(column))
            case 4:
                odd = rng.choice((float("nan"), float("inf"), 1e308, -0.0, 5e-324))
                column[rng.randrange(len(column))] = odd
                table = table.set_column(at, name, pa.array(column))
            case _:
                kind = rng.choice(sorted(TYPES))
                table = table.set_column(at, name, pa.array([TYPES[kind](v) for v in column]))
        if not table.num_columns:
            break
    sink = io.BytesIO()
    pq.write_table(table, sink, compression=rng.choice(("none", "zstd", "snappy")))
    return sink.getvalue()


def mutated(kind: Kind, raw: bytes, rng: random.Random, others: list[bytes]) -> bytes:
    """One mutation of a file, by bytes or by what its kind knows."""
    ways: list[Callable[[], bytes]] = [lambda: bytes_mutated(raw, rng, others)]
    if kind.form in ("yaml", "json"):
        ways += [lambda: document_mutated(raw, rng, kind.form)] * 2
    if kind.form in ("yaml", "json", "text"):
        ways.append(lambda: text_mutated(raw, rng))
    if kind.form == "parquet":
        ways.append(lambda: table_mutated(raw, rng))
    return rng.choice(ways)()


def run(words: list[str]) -> Outcome:
    """Run the command line and look at how it ends."""

    def stop(number: int, frame: FrameType | None) -> None:
        del number, frame
        raise Stuck

    out, err = (io.TextIOWrapper(io.BytesIO(), encoding="utf-8") for _ in range(2))
    sys.argv, status, fault = ["tdfscal", *words], 0, None
    signal.signal(signal.SIGALRM, stop)
    signal.signal(signal.SIGPROF, stop)
    signal.alarm(HANGING)
    signal.setitimer(signal.ITIMER_PROF, PATIENCE)
    begin = time.process_time()
    try:
        with redirect_stdout(out), redirect_stderr(err):
            command_line()
    except SystemExit as end:
        status = int(end.code or 0)
    except Stuck:
        fault = f"takes more than {PATIENCE} s of processor time, or {HANGING} s"
    except BaseException:
        fault = f"an exception: {traceback.format_exc().splitlines()[-1]}"
    finally:
        signal.alarm(0)
        signal.setitimer(signal.ITIMER_PROF, 0)
    err.flush()
    said = err.buffer.getvalue().decode("utf-8", "replace")
    if fault is None and status not in STATUSES:
        fault = f"status {status}: {said.splitlines()[-1][:300] if said else ''}"
    if fault is None and ("Traceback" in said or re.search(r"\w+Warning:", said)):
        fault = f"says: {said[:300]}"
    return Outcome(status, time.process_time() - begin, fault)


def work(kind: Kind, cases: range, seed: int) -> None:
    """Run the cases of a kind; one line of JSON each."""
    shown = sys.stdout
    with tempfile.TemporaryDirectory(prefix="fuzz-") as name:
        home = Path(name)
        build(home)
        os.chdir(home)
        path = home / kind.file
        raw = path.read_bytes()
        others = [p.read_bytes() for p in sorted(home.rglob("*")) if p.is_file()]
        for case in cases:
            rng = random.Random(f"{kind.name} {seed} {case}")
            path.write_bytes(mutated(kind, raw, rng, others))
            seen = run(rng.choice(kind.lines).split())
            if seen.fault is not None and os.environ.get("FUZZ_KEEP"):
                shutil.copy(
                    path, Path(os.environ["FUZZ_KEEP"]) / f"{kind.name}-{case}{path.suffix}"
                )
            line = [seen.status, round(seen.seconds, 3), seen.fault]
            print(json.dumps(line), file=shown, flush=True)


def count(kind: Kind, cases: int, seed: int, kept: Path) -> list[Outcome]:
    """Outcomes of so many cases; a process that ends is one, and the rest follows in another."""
    place = kept / f"{kind.name}-{seed}.jsonl"
    place.touch()

    def outcomes() -> list[Outcome]:
        return [Outcome(*json.loads(line)) for line in place.read_text().splitlines()]

    while (begin := len(outcomes())) < cases:
        words = [sys.executable, "-m", "benchmarks.fuzz", "--worker", kind.name]
        words += ["--cases", str(cases), "--seed", str(seed), "--begin", str(begin)]
        with place.open("a") as sink:
            ran = subprocess.run(words, stdout=sink, stderr=subprocess.PIPE, text=True, check=False)
        reached = len(outcomes())
        if reached < cases:
            if reached == begin and ran.returncode > 0:
                raise RuntimeError(ran.stderr)
            ended = [ran.returncode, 0.0, f"the process ends: {ran.returncode}"]
            with place.open("a") as sink:
                print(json.dumps(ended), file=sink)
    return outcomes()[:cases]


def main() -> None:
    """Print the table."""
    parser = argparse.ArgumentParser(description=__doc__.splitlines()[0] if __doc__ else "")
    parser.add_argument("--cases", type=int, default=20_000, help="of all kinds together")
    parser.add_argument("--seed", type=int, default=0)
    parser.add_argument("--only", nargs="*", help="names of kinds; default all")
    parser.add_argument("--keep", type=Path, help="folder of outcomes so far")
    parser.add_argument("--worker", help=argparse.SUPPRESS)
    parser.add_argument("--begin", type=int, default=0, help=argparse.SUPPRESS)
    options = parser.parse_args()
    if options.worker:
        kind = next(k for k in KINDS if k.name == options.worker)
        work(kind, range(options.begin, options.cases), options.seed)
        return
    kept = options.keep or Path(tempfile.mkdtemp(prefix="fuzz-"))
    kept.mkdir(exist_ok=True)
    total = sum(kind.weight for kind in KINDS)
    rows, faults, done = [], Counter[str](), 0
    for kind in (kind for kind in KINDS if not options.only or kind.name in options.only):
        seen = count(kind, options.cases * kind.weight // total, options.seed, kept)
        by = Counter(outcome.status for outcome in seen)
        bad = [outcome.fault for outcome in seen if outcome.fault]
        faults.update(f"{kind.name}: {fault}" for fault in bad)
        cells = [kind.name, len(seen), *(by[status] for status in STATUSES)]
        cells += [f"{max(outcome.seconds for outcome in seen):.1f}", len(bad)]
        rows.append(f"| {' | '.join(map(str, cells))} |")
        done += len(seen)
        print(rows[-1], file=sys.stderr, flush=True)
    introduction = __doc__.split("\n\n")[-1] if __doc__ else ""
    print(
        f"# Damaged files\n\nMade by `python -m benchmarks.fuzz --cases {options.cases} --seed "
        f"{options.seed}`.\n{introduction}\n{done} cases; columns 0 to 4 are exit statuses.\n"
    )
    heads = ["file", "cases", *map(str, STATUSES), "slowest, s", "faults"]
    print(f"| {' | '.join(heads)} |\n|{'---|' * len(heads)}")
    print("\n".join(rows))
    print(f"\nFaults: {'none' if not faults else ''}")
    for what, times in faults.most_common():
        print(f"- {times} × {what}")


if __name__ == "__main__":
    main()
