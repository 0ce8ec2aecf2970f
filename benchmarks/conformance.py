"""Files that the formats' own projects made, read as they are meant.

    python -m benchmarks.conformance MCAP PARQUET > benchmarks/conformance.md

MCAP is `tests/conformance/data` of github.com/foxglove/mcap with its files (of Git LFS, or made
anew by `scripts/generate-inputs.ts` there), PARQUET a clone of github.com/apache/parquet-testing.
Every MCAP file must read to the schemas, channels and messages that the JSON beside it states. A
bit at 40 random places between its marks is flipped, which must be refused, and it is cut short
at 40: refused, or read to the messages before. A Parquet file is described with the rows of its
row groups or refused; whole numbers must be those of the CSV beside it.
"""

from __future__ import annotations

import csv
import json
import random
import sys
from collections import Counter
from pathlib import Path
from typing import Any

import numpy as np
import pyarrow.parquet as pq

from benchmarks.frame import heads, introduce, scratch, show
from tdfscal.errors import DataError
from tdfscal.files.rig.recorders import LogBlock
from tdfscal.logs.formats import open_log
from tdfscal.logs.log_file import make_request
from tdfscal.logs.messages.buffer import gather
from tdfscal.logs.messages.mcap import McapFile

PLACES, MARK = 40, 8
#: What of a record is compared.
STATED = {
    "Schema": ("id", "name", "encoding", "data"),
    "Channel": ("id", "topic", "message_encoding", "schema_id", "metadata"),
    "Message": ("channel_id", "sequence", "log_time", "publish_time", "data"),
}
Records = list[tuple[Any, ...]]


def read(path: Path) -> tuple[Records, Records, bool]:
    """Messages of an MCAP file; schemas and channels; whether it was cut short."""
    file, messages = open_log(path), Records()
    assert isinstance(file, McapFile)
    for some in file.messages():
        numbers = some.channel, gather(some.data, some.offset + 11, "<u4")
        columns = [x.tolist() for x in (*numbers, some.log_time(), some.publish_time())]
        messages += zip(*columns, map(some.bytes_of, range(len(some.offset))), strict=True)
    defined = [*file.schemas.values(), *file.channels.values()]
    found = [tuple(getattr(d, key) for key in STATED[type(d).__name__]) for d in defined]
    return messages, found, file.cut_at is not None


def stated(path: Path) -> tuple[Records, Records, bool]:
    """The same, as a JSON file has it; what its summary repeats, once."""
    found: dict[str, Records] = {kind: [] for kind in STATED}
    for record in json.loads(path.read_text(encoding="utf-8"))["records"]:
        kind, fields = record["type"], dict(record["fields"])
        values = tuple(meant(fields[key]) for key in STATED.get(kind, ()))
        if kind == "Message" or (kind in STATED and values not in found[kind]):
            found[kind].append(values)
    return found["Message"], found["Schema"] + found["Channel"], False


def meant(value: Any) -> Any:
    """A value of the JSON, where all numbers are texts."""
    if isinstance(value, list):
        return bytes(map(int, value))
    return int(value) if isinstance(value, str) and value.isdecimal() else value


def damaged(data: bytes, whole: Records, path: Path) -> str:
    """What becomes of a damaged file: refused, cut (and said to be), or anything else."""
    path.write_bytes(data)
    try:
        messages, _, cut = read(path)
    except DataError:
        return "refused"
    return "cut" if cut and messages == whole[: len(messages)] else "other"


def mcap_table(folder: Path) -> None:
    """A row for each of the set's inputs."""
    print(heads("MCAP", "files", "as stated", "flips", "refused", "other", "cuts", "refused",
                       "messages before", "other"))  # fmt: skip
    for part in sorted(path for path in folder.iterdir() if path.is_dir()):
        right, flips, cuts, rng = 0, Counter[str](), Counter[str](), random.Random(0)
        files = sorted(part.glob("*.mcap"))
        with scratch() as place:
            for path in files:
                raw, found = path.read_bytes(), read(path)
                right += found == stated(path.with_suffix(".json"))
                for k in rng.sample(range(MARK, len(raw) - MARK), PLACES):
                    flipped = raw[:k] + bytes([raw[k] ^ 1 << k % 8]) + raw[k + 1 :]
                    flips[damaged(flipped, found[0], place / "a.mcap")] += 1
                    cuts[damaged(raw[:k], found[0], place / "a.mcap")] += 1
        show(part.name, len(files), right, flips.total(), flips["refused"], flips["other"],
             cuts.total(), cuts["refused"], cuts["cut"], cuts["other"])  # fmt: skip


def described(path: Path) -> tuple[str, bool]:
    """What becomes of a Parquet file, and whether pyarrow reads all of it."""
    try:
        whole = pq.read_table(path) is not None
    except (OSError, ValueError, NotImplementedError):
        whole = False
    try:
        (stream,) = open_log(path).contents().streams
    except DataError:
        return "refused", whole
    groups = pq.read_metadata(path)
    rows = sum(groups.row_group(k).num_rows for k in range(groups.num_row_groups))
    return "described" if stream.count == rows else "other", whole


def parquet_table(folder: Path) -> None:
    """A row for each folder, and where pyarrow ends otherwise."""
    print("\n" + heads("Parquet", "files", "described", "refused", "other"))
    apart: dict[tuple[str, bool], list[str]] = {}
    for part in sorted({path.parent for path in folder.rglob("*.parquet")}):
        ends = Counter[str]()
        for path in sorted(part.glob("*.parquet")):
            found = described(path)
            ends[found[0]] += 1
            apart.setdefault(found, []).append(path.name)
        each = ends["described"], ends["refused"], ends["other"]
        show(part.relative_to(folder), ends.total(), *each)
    for said, key in (("Refused, where pyarrow reads", ("refused", True)),
                      ("Described, where pyarrow errs", ("described", False))):  # fmt: skip
        print(f"\n{said}: {', '.join(apart.get(key, ['none']))}.")


def numbers_of(path: Path) -> tuple[int, int]:
    """How many of the whole numbers that lead a table are those of its CSV; of how many."""
    with path.with_name(f"{path.stem}_expect.csv").open(encoding="utf-8") as file:
        rows = list(csv.reader(file))[1:]
    names = pq.read_schema(path).names
    six = range(0, sum(cell.lstrip("-").isdigit() for cell in rows[0]) - 5, 6)
    moves, loads = (tuple(tuple(names[k + j : k + j + 3]) for k in six) for j in (0, 3))
    supports = tuple(map(str, six))
    each = zip(supports, moves, loads, strict=True)
    fields = {name: {"position": move, "force": load} for name, move, load in each}
    asked = make_request(
        LogBlock.model_validate({"rows": "postures", "supports": fields}), supports
    )
    blocks = [block for piece in open_log(path).read(asked) for block in piece]
    read = np.hstack([np.concatenate([b.value[s] for b in blocks]) for s in asked.numbers])
    true = np.array(rows)[:, : read.shape[1]].astype(np.float64)
    return int((read == true).sum()), true.size


def main() -> None:
    """Print the tables."""
    mcap, parquet = map(Path, sys.argv[1:3])
    introduce("Files of others", "conformance MCAP PARQUET", __doc__)
    mcap_table(mcap)
    parquet_table(parquet)
    for name in ("delta_binary_packed", "delta_encoding_required_column"):
        same, count = numbers_of(parquet / "data" / f"{name}.parquet")
        print(f"\n{name}: {same} of {count} numbers are those of its CSV.")


if __name__ == "__main__":
    main()
