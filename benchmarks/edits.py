"""Random edits of calibration files: refused, or without effect on any number that is used.

    nice python -m benchmarks.edits [EDITS] > benchmarks/edits.md

Each file is edited as tdfscal wrote it, and without its digest, as a program would write it that
knows the format alone: a number, a word, a switch, a key or an order. What is read all the same is
exported as CSV, applied to a log and held against one; all numbers of these are compared.
"""

from __future__ import annotations

import copy
import csv
import io
import json
import random
import re
from collections import Counter, defaultdict
from collections.abc import Iterator
from dataclasses import dataclass
from pathlib import Path
from typing import Any

import numpy as np

from benchmarks.frame import heads, introduce, numbers, scratch, show
from tdfscal.commands.apply import apply
from tdfscal.commands.calibrate import calibrate
from tdfscal.commands.update import update
from tdfscal.commands.validate import validate
from tdfscal.errors import TdfscalError
from tdfscal.exports import csv_table
from tdfscal.files.calibration.document import Calibration, file_content, parse_calibration
from tdfscal.files.writers.campaign import simulate_to_folder
from tdfscal.files.writers.logs import COLUMNS
from tdfscal.simulation import Recorder
from tests.files.edits import Place, at, places

#: A number with its sign and exponent, in text.
NUMBER = re.compile(r"(?<![\w.])[-+]?\d+\.?\d*(?:[eE][-+]?\d+)?")
ENDS = ("refused when read", "refused when used", "read, without effect",
        "read, a number used is another")  # fmt: skip
Numbers = dict[str, list[float]]


@dataclass(frozen=True)
class Edit:
    """An edited copy of a document: what was done, and where."""

    kind: str
    place: Place
    document: dict[str, Any]


def edits(document: dict[str, Any], count: int, seed: int) -> Iterator[Edit]:
    """Edits that change the document, one each; keys of all depths are equally likely."""
    rng = random.Random(seed)
    known: dict[tuple[str, ...], list[Place]] = {}
    for place in places(document):  # one of a matrix's hundred entries, not a hundred of them
        known.setdefault(tuple(p for p in place if isinstance(p, str)), []).append(place)
    while count:
        place = rng.choice(rng.choice(list(known.values())))
        other = copy.deepcopy(document)
        inner = at(other, place[:-1])
        kind, value = _other(inner[place[-1]], rng)
        if kind == "dropped":
            del inner[place[-1]]
        else:
            inner[place[-1]] = value
        if other != document:
            count -= 1
            yield Edit(kind, place, other)


def _other(value: Any, rng: random.Random) -> tuple[str, Any]:
    if rng.random() < 0.15:
        return "dropped", None
    if value is None:
        return "null", rng.choice([0.0, 1.0])
    if isinstance(value, bool):
        return "switch", not value
    if isinstance(value, int) and abs(value) > 1e300:
        return "number", value + 1
    if isinstance(value, int | float):
        factor = 1 + rng.choice([-1, 1]) * 10 ** rng.uniform(-6, 0)
        return "number", rng.choice([value * factor, -value, value + 1, 0, value / 1000])
    if isinstance(value, str):
        words = ["", value + "x", value[:-1], value[::-1], "accepted", "2020-01-01T00:00:00Z"]
        return "text", rng.choice(words)
    if isinstance(value, list) and len(value) > 1:
        a, b = rng.sample(range(len(value)), 2)
        value[a], value[b] = value[b], value[a]
        return "swapped", value
    return "emptied", type(value)()


def files(home: Path) -> Iterator[tuple[str, dict[str, Any]]]:
    """Calibration files of several kinds as plain documents."""
    for seed in (0, 1):
        simulate_to_folder(home / f"C{seed}", postures=12, rows="postures", seed=seed + 1,
                           recorder=Recorder(mean_sd=0.05))  # fmt: skip
    own = calibrate([home / "C0"], trials=50)
    yield "self", file_content(own)
    yield "tracker", file_content(calibrate([home / "C0"], method="tracker", trials=50))
    yield "joint", file_content(calibrate([home / "C0"], method="joint", trials=50))
    yield "update", file_content(update(own, [home / "C1"], trials=0))


def used(c: Calibration, log: Path) -> Numbers:
    """Every number that a controller, `apply` and `validate` take of a calibration."""
    exported = csv_table(c).split("\n", 1)[1]
    with scratch() as folder:
        apply(c, [log], output=(target := folder / "w.csv"))
        rows = list(csv.reader(io.StringIO(target.read_text("utf-8"))))[1:]
    # Not when it was judged, by which file.
    told = validate(c, [log]).to_dict()
    judged = {key: told.get(key) for key in ("chi2", "dof", "p_value", "force", "moment", "zeros")}
    wrench = np.array([[float(cell or "nan") for cell in cells[: len(COLUMNS)]] for cells in rows])
    return {
        "export": [float(word) for word in NUMBER.findall(exported)],
        "apply, wrench": wrench[:, :7].ravel().tolist(),
        "apply, uncertainty": wrench[:, 7:].ravel().tolist(),
        "validate": [float(n) for n in NUMBER.findall(json.dumps(judged))],
    }


def tried(
    document: dict[str, Any], count: int, seed: int, log: Path, keys: dict[str, set[str]]
) -> Counter[str]:
    """How so many edits of a document end; keys: which change what of the numbers that are used."""
    before = used(parse_calibration(json.dumps(document).encode(), "c.json"), log)
    ends = Counter[str]()
    for edit in edits(document, count, seed):
        end = ENDS[0]
        try:
            read = parse_calibration(json.dumps(edit.document).encode(), "c.json")
            end = ENDS[1]
            now = used(read, log)
        except TdfscalError:
            ends[end] += 1
            continue
        changed = [
            name
            for name, values in before.items()
            if len(now[name]) != len(values)
            or not np.allclose(now[name], values, 1e-12, 0, equal_nan=True)
        ]
        ends[ENDS[3] if changed else ENDS[2]] += 1
        for name in changed:
            keys[name].add(".".join(part for part in edit.place if isinstance(part, str)))
    return ends


def main() -> None:
    """Print the table."""
    (count,) = numbers(1000)
    introduce("Edited calibration files", f"edits {count}", __doc__)
    print(heads("file", "digest", "edits", *ENDS))
    changing: dict[str, set[str]] = defaultdict(set)
    with scratch() as home:
        documents = list(files(home))
        log = home / "other.csv"
        log.write_bytes((home / "C1" / "log.csv").read_bytes())
        for digest in (True, False):
            for seed, (kind, whole) in enumerate(documents):
                document = {k: v for k, v in whole.items() if digest or k != "content_sha256"}
                part = count // len(documents)
                ends = tried(document, part, seed, log, changing)
                show(kind, "yes" if digest else "no", part, *(ends[end] for end in ENDS))
    for name, keys in sorted(changing.items()):
        print(f"\n{name} is changed by: {', '.join(sorted(keys))}")


if __name__ == "__main__":
    main()
