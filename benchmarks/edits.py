"""Random edits of calibration files: refused, or without effect on any number that is used.

    nice python -m benchmarks.edits [EDITS] > benchmarks/edits.md

Each file is edited as tdfscal wrote it, and without its digest, as a program would write it that
knows the format alone. What is read all the same is used: exported as CSV and C, applied to a log
and validated on one, with the rig that the file embeds; every number of these is compared.
"""

from __future__ import annotations

import csv
import io
import json
import re
import sys
import tempfile
from collections import Counter, defaultdict
from collections.abc import Iterator
from dataclasses import dataclass, field
from pathlib import Path
from typing import Any

import numpy as np

from tdfscal.commands.apply import apply
from tdfscal.commands.calibrate import calibrate
from tdfscal.commands.update import update
from tdfscal.commands.validate import validate
from tdfscal.errors import TdfscalError
from tdfscal.exports.formats import c_header, csv_table
from tdfscal.files.calibration.document import Calibration, file_content, parse_calibration
from tdfscal.files.writers.campaign import simulate_to_folder
from tdfscal.simulation import Recorder
from tests.files.edits import Place, edits

#: A number with its sign and exponent, in text.
NUMBER = re.compile(r"(?<![\w.])[-+]?\d+\.?\d*(?:[eE][-+]?\d+)?")
Numbers = dict[str, list[float]]


@dataclass
class Tally:
    """How edits ended, and which keys could be changed with what effect."""

    ends: Counter[str] = field(default_factory=Counter)
    keys: dict[str, set[str]] = field(default_factory=lambda: defaultdict(set))


def files(home: Path) -> Iterator[tuple[str, dict[str, Any]]]:
    """Calibration files of several kinds as plain documents."""
    for seed in (0, 1):
        simulate_to_folder(home / f"C{seed}", postures=12, rows="postures", seed=seed + 1,
                           recorder=Recorder(mean_sd=0.05))  # fmt: skip
    own = calibrate([home / "C0"], trials=50)
    tracker = calibrate([home / "C0"], method="tracker", trials=50)
    yield "self", file_content(own)
    yield "tracker", file_content(tracker)
    yield "joint", file_content(calibrate([home / "C0"], method="joint", trials=50))
    yield "update", file_content(update(own, [home / "C1"], trials=0))


def used(c: Calibration, log: Path) -> Numbers:
    """Every number that a controller, `apply` and `validate` take of a calibration."""
    out: Numbers = {}
    table = list(csv.reader(io.StringIO(csv_table(c))))[1:]
    out["export"] = [float(cell) for row in table for cell in row if NUMBER.fullmatch(cell)]
    code = c_header(c).split("*/", 1)[1]  # behind the remarks
    out["export"] += [float(word) for word in NUMBER.findall(code)]
    with tempfile.TemporaryDirectory() as folder:
        target = Path(folder) / "w.csv"
        apply(c, [log], output=target)
        rows = list(csv.reader(target.open(encoding="utf-8")))[1:]
        wrench = np.array(rows, dtype=np.float64)
    out["apply, wrench"] = wrench[:, :7].ravel().tolist()
    out["apply, uncertainty"] = wrench[:, 7:].ravel().tolist()
    result = validate(c, [log]).to_dict()
    out["validate"] = list(numbers(result))
    return out


def numbers(value: Any) -> Iterator[float]:
    """All numbers of a document, in their order."""
    if isinstance(value, dict):
        for inner in value.values():
            yield from numbers(inner)
    elif isinstance(value, list | tuple):
        for inner in value:
            yield from numbers(inner)
    elif isinstance(value, int | float):
        yield float(value)


def effects(now: Numbers, before: Numbers) -> set[str]:
    """What of the numbers that are used is another."""
    return {
        name
        for name, values in before.items()
        if len(now[name]) != len(values) or not np.allclose(now[name], values, rtol=1e-12, atol=0)
    }


def name_of(place: Place) -> str:
    """Keys of a place, without the numbers of entries."""
    return ".".join(part for part in place if isinstance(part, str))


def tried(document: dict[str, Any], count: int, seed: int, log: Path, tally: Tally) -> None:
    """Edit a document so many times and count how each edit ends."""
    before = used(parse_calibration(json.dumps(document).encode(), "c.json"), log)
    for edit in edits(document, count, seed):
        try:
            read = parse_calibration(json.dumps(edit.document).encode(), "c.json")
        except TdfscalError:
            tally.ends["refused when read"] += 1
            continue
        try:
            seen = effects(used(read, log), before)
        except TdfscalError:
            tally.ends["refused when used"] += 1
            continue
        tally.ends["read, a number used is another" if seen else "read, without effect"] += 1
        for name in seen:
            tally.keys[name].add(name_of(edit.place))


def without_digests(document: dict[str, Any]) -> dict[str, Any]:
    """The document as a program would write it that knows the format alone."""
    return {k: v for k, v in document.items() if k != "content_sha256"}


def main() -> None:
    """Print the table."""
    count = int(sys.argv[1]) if len(sys.argv) > 1 else 1000
    print(f"# Edited calibration files\n\n`python -m benchmarks.edits {count}`; one edit each: a "
          "number, a word, a switch,\na key, an order; keys of all depths alike.\n")  # fmt: skip
    ends = ["refused when read", "refused when used", "read, without effect",
            "read, a number used is another"]  # fmt: skip
    print(f"| file | digest | edits | {' | '.join(ends)} |\n|---|---|{'---|' * 5}")
    tallies = {True: Tally(), False: Tally()}
    with tempfile.TemporaryDirectory(prefix="edits-") as name:
        home = Path(name)
        documents = list(files(home))
        log = home / "other.csv"
        log.write_bytes((home / "C1" / "log.csv").read_bytes())
        for digest, whole in tallies.items():
            for seed, (kind, document) in enumerate(documents):
                tally, part = Tally(keys=whole.keys), count // len(documents)
                tried(document if digest else without_digests(document), part, seed, log, tally)
                cells = [kind, "yes" if digest else "no", part, *(tally.ends[e] for e in ends)]
                print(f"| {' | '.join(map(str, cells))} |", flush=True)
    for digest, whole in tallies.items():
        for name, keys in sorted(whole.keys.items()):
            print(
                f"\n{'With' if digest else 'Without'} digest, {name} by: {', '.join(sorted(keys))}"
            )


if __name__ == "__main__":
    main()
