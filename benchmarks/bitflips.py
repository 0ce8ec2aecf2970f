"""Bits of log files flipped at random places: refused, or read to the identical numbers.

    python -m benchmarks.bitflips [TRIES 10000] [SEED 0] > benchmarks/bitflips.md

The files are read in processes of their own, so that a library that ends its process over a damaged
file is counted, and ends no more than one try.

One bit of a file flipped at a random place, then read: refused with an error of tdfscal's own; read
to the identical numbers (times, positions, forces, to the bit); different numbers; another
exception, or the process ended. Parquet files have checksums of their pages; no checksum covers the
headers of pages. Where no page is compressed, optional or of a dictionary, nothing else fails, and
a flip there may change numbers. The slow tests assert zeros in the last two columns for all others.
"""

from __future__ import annotations

import io
import multiprocessing
from collections import Counter
from collections.abc import Callable
from dataclasses import dataclass
from pathlib import Path

import numpy as np
import pyarrow as pa
import pyarrow.parquet as pq
from mcap.writer import CompressionType

from benchmarks.frame import heads, introduce, numbers, scratch, show
from tdfscal.errors import DataError
from tdfscal.logs import read_log
from tests.files.logs.log_making import (
    MAPPING,
    SUPPORTS,
    make_truth,
    mcap_bytes,
    same_numbers,
    table,
)

REFUSED, SAME, DIFFERENT, FAILED, DIED = "refused", "identical", "different", "error", "died"
HEADS = ("format", "written as", "bytes", "tries", REFUSED, SAME, DIFFERENT, "ended otherwise")
BATCH = 1250
TRUTH = make_truth(12)


def _parquet(*, stamps: bool = False, nullable: bool = True, **options: object) -> bytes:
    frame = table(TRUTH)
    if stamps:
        frame["time"] = (frame["time"] * 1e9).astype("datetime64[ns]")
    whole = pa.Table.from_pandas(frame, preserve_index=False)
    if not nullable:
        whole = whole.cast(pa.schema([field.with_nullable(False) for field in whole.schema]))
    target = io.BytesIO()
    pq.write_table(whole, target, write_page_checksum=True, **options)
    return target.getvalue()


@dataclass(frozen=True)
class Kind:
    """One way to write a log. suffix : of the file. make : its bytes."""

    name: str
    suffix: str
    make: Callable[[], bytes]


KINDS = (
    Kind("chunks, zstd", ".mcap", lambda: mcap_bytes(TRUTH)),
    Kind("chunks, lz4", ".mcap", lambda: mcap_bytes(TRUTH, compression=CompressionType.LZ4)),
    Kind("chunks, plain", ".mcap", lambda: mcap_bytes(TRUTH, compression=CompressionType.NONE)),
    Kind("no chunks, CRC", ".mcap", lambda: mcap_bytes(
        TRUTH, use_chunking=False, enable_data_crcs=True)),
    Kind("snappy, dictionaries", ".parquet", _parquet),
    Kind("zstd, pages v2", ".parquet", lambda: _parquet(
        compression="zstd", data_page_version="2.0", use_dictionary=False)),
    Kind("plain, required", ".parquet", lambda: _parquet(
        compression="none", nullable=False, use_dictionary=False, row_group_size=5)),
    Kind("snappy, time as ns", ".parquet", lambda: _parquet(
        stamps=True, use_dictionary=False)),
)  # fmt: skip


def places(content: bytes, tries: int, seed: int) -> list[tuple[int, int]]:
    """(byte, bit) of each try; none in the footer of Parquet, which no checksum covers."""
    rng = np.random.default_rng(seed)
    footer = 8 + int.from_bytes(content[-8:-4], "little") if content.endswith(b"PAR1") else 0
    byte, bit = rng.integers(0, len(content) - footer, tries), rng.integers(0, 8, tries)
    return [(int(a), int(b)) for a, b in zip(byte, bit, strict=True)]


def attempt(kind: Kind, chosen: list[tuple[int, int]], tell: Callable[[str], object]) -> None:
    """Flip one bit at a time and tell what comes of it."""
    mapping = MAPPING if kind.suffix == ".mcap" else None
    with scratch() as folder:
        path = folder / f"log{kind.suffix}"
        content = kind.make()
        path.write_bytes(content)
        sound = read_log([path], mapping, SUPPORTS)
        for byte, bit in chosen:
            damaged = bytearray(content)
            damaged[byte] ^= 1 << bit
            path.write_bytes(damaged)
            try:
                log = read_log([path], mapping, SUPPORTS)
            except DataError:
                tell(REFUSED)
            except Exception:  # what is counted here must not happen, whatever it is
                tell(FAILED)
            else:
                tell(SAME if same_numbers(log, sound) else DIFFERENT)


def part(name: str, tries: int, seed: int, portion: slice, told: Path) -> None:
    """Some of the tries of a kind; what comes of them is written to a file."""
    kind = next(k for k in KINDS if k.name == name)
    chosen = places(kind.make(), tries, seed)[portion]
    with told.open("w", encoding="ascii") as file:
        attempt(kind, chosen, lambda what: print(what, file=file, flush=True))


def count(kind: Kind, tries: int, seed: int) -> Counter[str]:
    """What became of so many tries, in processes of their own."""
    found: Counter[str] = Counter()
    done = 0
    with scratch() as folder:
        while done < tries:
            batch, path = min(BATCH, tries - done), folder / "told"
            path.write_text("")
            asked = (kind.name, tries, seed, slice(done, done + batch), path)
            process = multiprocessing.get_context("spawn").Process(target=part, args=asked)
            process.start()
            process.join()
            told = path.read_text(encoding="ascii").split()
            found.update(told)
            if len(told) < batch:
                if (process.exitcode or 0) >= 0:  # not by a signal: it has not even begun
                    raise RuntimeError(f"the tries of {kind.name} ended early")
                found[DIED] += 1
            done += len(told) + (len(told) < batch)
    return found


def main() -> None:
    """Print the table."""
    tries, seed = numbers(10_000, 0)
    introduce("Flipped bits", f"bitflips {tries} {seed}` with `pyarrow {pa.__version__}", __doc__)
    print(heads(*HEADS))
    for kind in KINDS:
        share = tries // sum(k.suffix == kind.suffix for k in KINDS)
        found = count(kind, share, seed)
        ends = found[REFUSED], found[SAME], found[DIFFERENT], found[FAILED] + found[DIED]
        show(kind.suffix[1:], kind.name, len(kind.make()), share, *ends)


if __name__ == "__main__":
    main()
