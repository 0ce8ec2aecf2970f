"""Time and memory from a log file to dwells, beside the plain readers of each format.

    python -m benchmarks.logs [--seconds 3600] [--keep DIR] [--ten-fold]

Writes its own logs: three supports, 1 kHz, 19 columns (CSV, Parquet), and as MCAP (CDR, zstd)
positions and forces at half that rate each in six topics. Rewrites `benchmarks/logs.md`.
Each measurement runs in a process of its own, for its peak memory; both sides run in turn, so that
a slow spell of the machine meets both, and the fastest of five rounds counts (MCAP: of one).
With --ten-fold the peak memory on logs ten times as long follows (9 GB of disk for 3600 s).
"""

from __future__ import annotations

import argparse
import json
import os
import platform
import struct
import subprocess
import sys
import tempfile
import time
from collections.abc import Iterator
from pathlib import Path

import numpy as np
import pyarrow as pa
import pyarrow.csv as pa_csv
import pyarrow.parquet as pq
from mcap.writer import CompressionType, Writer

from tdfscal.files.rig.recorders import LogBlock
from tdfscal.records import FloatArray

RATE, STOP, MOVE, BLOCK = 1000, 4.0, 2.0, 60.0
NAMES = ("ncp1", "ncp2", "ncp3")
COLUMNS = ["time", *(f"{n}.{c}" for c in ("x", "y", "z", "fx", "fy", "fz") for n in NAMES)]
FIELDS = {
    n: {"position": f"/{n}/position.point", "force": f"/{n}/wrench.wrench.force"} for n in NAMES
}
TOPICS = LogBlock.model_validate({"time": {"source": "header"}, "supports": FIELDS})
#: What the reading of each format is held against, and the goal.
PLAIN = {
    "csv": ("pyarrow.csv.read_csv", "at most 1.5×"),
    "parquet": ("pyarrow.parquet.read_table", "at most 2×"),
    "mcap": ("mcap-ros2-support", "at least 15×"),
}


def blocks(seconds: float) -> Iterator[tuple[FloatArray, FloatArray]]:
    """Times (N,) and values (N, 18): stops and moves in turn, a minute at a time."""
    rng = np.random.default_rng(0)
    level = rng.normal(size=(int(seconds / (STOP + MOVE)) + 2, 18))
    for begin in np.arange(0.0, seconds, BLOCK):
        t = begin + np.arange(int(min(BLOCK, seconds - begin) * RATE)) / RATE
        k, phase = np.divmod(t, STOP + MOVE)
        u = np.clip((phase - STOP) / MOVE, 0.0, 1.0)
        u = (u**3 * (10 - 15 * u + 6 * u**2))[:, None]
        value = level[k.astype(int)] * (1 - u) + level[k.astype(int) + 1] * u
        value[:, :9] = 0.5 + 0.05 * value[:, :9] + 3e-7 * rng.standard_normal((len(t), 9))
        value[:, 9:] = 800 + 200 * value[:, 9:] + rng.standard_normal((len(t), 9))
        value[:, :9] = np.round(value[:, :9], 7)  # recorders write to 0.1 µm and 0.01 N
        value[:, 9:] = np.round(value[:, 9:], 2)
        yield t, value


def write_tables(folder: Path, seconds: float) -> None:
    """The same log as CSV and as Parquet with page checksums."""
    schema = pa.schema([(name, pa.float64()) for name in COLUMNS])
    with (
        pa_csv.CSVWriter(folder / "log.csv", schema) as text,
        pq.ParquetWriter(folder / "log.parquet", schema, write_page_checksum=True) as columns,
    ):
        for t, value in blocks(seconds):
            table = pa.table([t, *value.T], schema=schema)
            text.write(table)
            columns.write(table)


def write_mcap(folder: Path, seconds: float) -> None:
    """Six topics, half of the samples each: as many messages as 3/6 of the table's cells."""
    from tests.files.logs.log_making import definition

    point, wrench = struct.Struct("<4xiII5s3x4x3d"), struct.Struct("<4xiII5s3x4x6d")
    with (folder / "log.mcap").open("wb") as file:
        writer = Writer(file, compression=CompressionType.ZSTD)
        writer.start(profile="ros2", library="tdfscal benchmark")
        names = [f"geometry_msgs/msg/{kind}Stamped" for kind in ("Point", "Wrench")]
        kinds = [writer.register_schema(name, "ros2msg", definition(name)) for name in names]
        channels = [
            writer.register_channel(f"/{name}/{topic}", "cdr", kind)
            for topic, kind in zip(("position", "wrench"), kinds, strict=True)
            for name in NAMES
        ]
        for t, value in blocks(seconds):
            for when, row in zip(t[::12].tolist(), value[::12].tolist(), strict=True):
                ns = round(when * 1e9)
                sec, sub = divmod(ns, 10**9)
                for i in range(3):
                    data = point.pack(sec, sub, 5, b"base\0", *row[i:9:3])
                    writer.add_message(channels[i], ns, b"\0\1" + data[2:], ns)
                    data = wrench.pack(sec, sub, 5, b"tdfs\0", *row[9 + i : 18 : 3], 0, 0, 0)
                    writer.add_message(channels[3 + i], ns, b"\0\1" + data[2:], ns)
        writer.finish()  # type: ignore[no-untyped-call]


def work(name: str, folder: Path) -> int:
    """One measurement; what it counted: rows, dwells or messages."""
    if name == "pyarrow.csv.read_csv":
        return len(pa_csv.read_csv(folder / "log.csv"))
    if name == "pyarrow.parquet.read_table":
        return len(pq.read_table(folder / "log.parquet"))
    if name == "mcap-ros2-support":
        from mcap.reader import make_reader
        from mcap_ros2.decoder import DecoderFactory

        with (folder / "log.mcap").open("rb") as file:
            reader = make_reader(file, decoder_factories=[DecoderFactory()])
            return sum(1 for _ in reader.iter_decoded_messages())
    from tdfscal.dwells import find_dwells
    from tdfscal.logs import iter_log

    suffix = name.removeprefix("tdfscal ")
    mapping = TOPICS if suffix == "mcap" else None
    return len(find_dwells(iter_log([folder / f"log.{suffix}"], mapping, NAMES)))


MEASURE = """
import json, resource, sys, time
from pathlib import Path
sys.path.insert(0, sys.argv[3])
from benchmarks.logs import work
from threadpoolctl import threadpool_limits
import pyarrow.csv, pyarrow.parquet, tdfscal.dwells, tdfscal.logs.text
import tdfscal.logs.parquet, tdfscal.logs.messages.mcap
start, cpu = time.perf_counter(), time.process_time()
with threadpool_limits(1, "blas"):  # as every command
    count = work(sys.argv[1], Path(sys.argv[2]))
took, cpu = time.perf_counter() - start, time.process_time() - cpu
print(json.dumps([took, cpu, resource.getrusage(resource.RUSAGE_SELF).ru_maxrss / 1024, count]))
"""


def measured(name: str, folder: Path) -> tuple[float, float, float, int]:
    """Seconds by the clock and of CPU, peak memory in MB, and the count."""
    root = str(Path(__file__).parents[1])
    command = [sys.executable, "-c", MEASURE, name, str(folder), root]
    out = subprocess.run(command, check=True, capture_output=True, text=True).stdout
    took, cpu, peak, count = json.loads(out)
    return float(took), float(cpu), float(peak), int(count)


def peak_of(suffix: str, folder: Path) -> float:
    """Peak memory in MB, the median of three runs: what the allocator keeps varies."""
    return sorted(measured(f"tdfscal {suffix}", folder)[2] for _ in range(3))[1]


def made(folder: Path, seconds: float) -> Path:
    """The logs, written where they are not there yet."""
    folder.mkdir(parents=True, exist_ok=True)
    for name, write in (("log.csv", write_tables), ("log.mcap", write_mcap)):
        if not (folder / name).exists():
            start = time.perf_counter()
            write(folder, seconds)
            print(f"wrote {folder / name} in {time.perf_counter() - start:.0f} s", file=sys.stderr)
    return folder


def table(folder: Path) -> list[str]:
    """Rows of the table."""
    rows = []
    for suffix, (plain, limit) in PLAIN.items():
        slow = suffix == "mcap"
        rounds = [
            (measured(plain, folder), measured(f"tdfscal {suffix}", folder))
            for _ in range(1 if slow else 5)
        ]
        reference, ours = (min(runs) for runs in zip(*rounds, strict=True))
        ratio, of_cpu = (reference[k] / ours[k] if slow else ours[k] / reference[k] for k in (0, 1))
        each = sorted(b[0] / a[0] for a, b in rounds)
        spread = "" if slow else f"{each[0]:.2f} to {each[-1]:.2f}"
        size = (folder / f"log.{suffix}").stat().st_size / 1e6
        rows.append(
            f"| {suffix} | {size:.0f} | {plain} | {reference[0]:.2f} | {ours[0]:.2f} "
            f"| {ratio:.2f}× | {spread} | {of_cpu:.2f}× | {limit} "
            f"| {reference[2]:.0f} | {ours[2]:.0f} | {ours[3]} |"
        )
    return rows


PAGE = """\
# From a log file to dwells

Made by `python -m benchmarks.logs {flags}` with Python {python}.
Three supports at 1 kHz, 19 columns; MCAP in six topics of 83 Hz.
The plain reader reads all columns (its message loop: all messages) and does nothing
else; tdfscal's time goes from the file to the dwells, checks and SHA-256 included.
The ratio is of the fastest of five rounds (MCAP: of one), for both apart. The plain
reader takes up to 1.7 GB, which the machine hands out now fast, now slowly.
{cores} cores, under a load of {load:.1f} when this began.

| format | MB | plain reader | its s | tdfscal s | ratio | in single rounds \
| ratio of CPU | goal | its peak MB | peak MB | dwells |
|---|---|---|---|---|---|---|---|---|---|---|---|
{rows}

{notes}"""


def main() -> None:
    """Measure and write the table."""
    parser = argparse.ArgumentParser()
    parser.add_argument("--seconds", type=float, default=3600.0)
    parser.add_argument("--keep", type=Path, help="folder for the logs, kept and used again")
    parser.add_argument("--ten-fold", action="store_true", help="also logs ten times as long")
    arguments = parser.parse_args()
    load = os.getloadavg()[0]
    with tempfile.TemporaryDirectory() as temporary:
        base = arguments.keep or Path(temporary)
        rows = table(made(base / f"{arguments.seconds:g}", arguments.seconds))
        notes = ""
        if arguments.ten_fold:
            long = 10 * arguments.seconds
            folder = made(base / f"{long:g}", long)
            shown = ", ".join(
                f"{s} {peak:.0f} MB, {peak / peak_of(s, base / f'{arguments.seconds:g}'):.2f}×"
                for s, peak in ((s, peak_of(s, folder)) for s in PLAIN)
            )
            notes = (
                f"Peak memory on logs ten times as long ({long:g} s), medians of three runs: "
                f"{shown}; goal: 1.2×.\n"
            )
    flags = f"--seconds {arguments.seconds:g}" + (" --ten-fold" if arguments.ten_fold else "")
    text = PAGE.format(
        flags=flags, python=platform.python_version(), cores=os.cpu_count(), load=load,
        rows="\n".join(rows), notes=notes,
    )  # fmt: skip
    Path(__file__).with_suffix(".md").write_text(text.rstrip("\n") + "\n", encoding="utf-8")
    print(text)


if __name__ == "__main__":
    main()
