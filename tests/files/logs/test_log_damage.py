"""Damaged files: refused, or read to the identical numbers; never silently different."""

import functools
import gzip
import io
import math
import re
import struct
import tempfile
from collections.abc import Callable
from pathlib import Path
from typing import Literal

import numpy as np
import pyarrow as pa
import pyarrow.parquet as pq
import pytest
import zstandard
from rosbags.rosbag1 import Writer
from rosbags.rosbag2 import StoragePlugin

from benchmarks.bitflips import KINDS, REFUSED, SAME, Kind, attempt, places
from tdfscal.errors import DataError
from tdfscal.files.rig.recorders import LogBlock
from tdfscal.logs import read_log
from tdfscal.logs.describe import describe_logs
from tdfscal.records import Log
from tests.files.logs.log_making import (
    MAPPING,
    SUPPORTS,
    Truth,
    assert_holds,
    make_truth,
    mcap_bytes,
    rosbag2,
    table,
    write,
)
from tests.files.logs.test_log_bag_kinds import ros1_bag

ONE = ("a",)
Packed = Writer.CompressionFormat


def cut_at(log: Log) -> int:
    """The byte from which on a log is not whole."""
    (found,) = (f for f in log.findings if f.code == "log-truncated")
    byte = found.values["byte"]
    assert isinstance(byte, int)
    return byte


def record_starts(content: bytes) -> list[int]:
    starts = [8]
    while starts[-1] < len(content) - 8:
        (length,) = struct.unpack_from("<Q", content, starts[-1] + 1)
        starts.append(starts[-1] + 9 + length)
    return starts


@pytest.mark.parametrize("kind", KINDS, ids=lambda kind: kind.name)
def test_bit_flips(kind: Kind) -> None:
    found: list[str] = []
    attempt(kind, places(kind.make(), 30, seed=7), found.append)
    assert len(found) == 30
    assert set(found) == {REFUSED, SAME} or set(found) == {REFUSED}


@pytest.mark.parametrize(("chunking", "summary"), [(True, True), (False, False)])
def test_an_mcap_file_cut_anywhere(tmp_path: Path, chunking: bool, summary: bool) -> None:
    content = mcap_bytes(make_truth(3), use_chunking=chunking, summary=summary)
    path = tmp_path / "log.mcap"
    starts = record_starts(content)
    whole = read_log([write(path, content)], MAPPING, SUPPORTS)
    count = 0
    for end in sorted({0, 4, *starts, *(s + 5 for s in starts[:-1]), len(content) - 1}):
        path.write_bytes(content[:end])
        try:
            log = read_log([path], MAPPING, SUPPORTS)
        except DataError:
            assert not count  # not before the first message of every topic
            continue
        assert cut_at(log) <= end
        assert log.inputs[0].integrity == "unverified"
        found = log.force[0].value
        assert len(found) >= count
        count = len(found)
        np.testing.assert_array_equal(found, whole.force[0].value[:count])
    assert count == len(whole.force[0].value)
    path.write_bytes(content + bytes(100_000))
    assert read_log([path], MAPPING, SUPPORTS).findings == whole.findings
    for extra in (b"\0", content):
        path.write_bytes(content + extra)
        with pytest.raises(DataError, match="bytes follow the end"):
            read_log([path], MAPPING, SUPPORTS)


def text_bytes(truth: Truth) -> bytes:
    return table(truth).to_csv(index=False).encode()


def parquet_bytes(truth: Truth) -> bytes:
    buffer = io.BytesIO()
    pq.write_table(pa.Table.from_pandas(table(truth)), buffer)
    return buffer.getvalue()


def sqlite_bytes(truth: Truth) -> bytes:
    with tempfile.TemporaryDirectory() as folder:
        (path,) = rosbag2(Path(folder, "bag"), truth, StoragePlugin.SQLITE3).glob("*.db3")
        return path.read_bytes()


def bag_bytes(truth: Truth, packed: Packed | None = None, chunk: int = 1 << 20) -> bytes:
    with tempfile.TemporaryDirectory() as folder:
        return ros1_bag(Path(folder, "log.bag"), packed, truth, chunk).read_bytes()


FORMATS: dict[str, tuple[Callable[[Truth], bytes], LogBlock | None, bool]] = {
    "log.csv": (text_bytes, None, True),
    "log.csv.gz": (lambda truth: gzip.compress(text_bytes(truth)), None, True),
    "log.csv.zst": (lambda truth: zstandard.compress(text_bytes(truth)), None, True),
    "log.mcap": (mcap_bytes, MAPPING, True),
    "log.parquet": (parquet_bytes, None, False),
    "log.db3": (sqlite_bytes, MAPPING, True),
    "log.bag": (bag_bytes, MAPPING, True),
    "lz4.bag": (lambda truth: bag_bytes(truth, Packed.LZ4, 1 << 12), MAPPING, True),
    "bz2.bag": (lambda truth: bag_bytes(truth, Packed.BZ2, 1 << 12), MAPPING, True),
}
"""The bytes, their mapping, and whether one that was cut short is read to its sound end."""


#: Positions of a log; forces come four times as often.
SAMPLES = 800


@functools.cache
def whole(name: str) -> bytes:
    return FORMATS[name][0](make_truth(SAMPLES))


@pytest.mark.parametrize("share", [0.0, 1e-9, 0.5, 0.71, 0.98])
@pytest.mark.parametrize("name", FORMATS)
def test_a_file_cut_short_is_read_to_its_end(tmp_path: Path, name: str, share: float) -> None:
    _, mapping, to_sound_end = FORMATS[name]
    content, truth = whole(name), make_truth(SAMPLES)
    path = write(tmp_path / name, content[: math.ceil(share * len(content))])
    if share >= 0.5 and to_sound_end:
        log = read_log([path], mapping, SUPPORTS)
        assert [finding.code for finding in log.findings] == ["log-truncated"]
        force = truth.force if mapping else truth.force[:, ::4]
        for series, true in zip(
            (*log.position, *log.force), (*truth.position, *force), strict=True
        ):
            assert len(series.value) > 0.5 * share * len(true)
            np.testing.assert_array_equal(series.value, true[: len(series.value)])
        return
    said = {0.0: "the file is empty. Record or copy it again.",
            1e-9: "the file was cut short in its first bytes. Record or copy it again.",
            }.get(share, "cut short")  # fmt: skip
    for look in (lambda: read_log([path], mapping, SUPPORTS), lambda: describe_logs([path])):
        with pytest.raises(DataError, match=rf"{re.escape(str(path))}: .*{said}") as caught:
            look()
        assert "copy" in str(caught.value)


@pytest.mark.parametrize("end", [b"", bytes(1000)], ids=["stopped", "never written"])
def test_a_ros1_recorder_that_was_stopped(tmp_path: Path, end: bytes) -> None:
    """The bag's head has no index, and the last chunk's head says 0 bytes: their place holders."""
    content, truth = bytearray(bag_bytes(make_truth(), None, 1 << 14)), make_truth()
    index, *_ = re.finditer(rb"index_pos=(.{8})", content, re.S)
    (stop,) = struct.unpack("<Q", index[1])
    content[index.start(1) : index.end(1)] = bytes(8)
    *_, chunk = re.finditer(rb"compression=none\x09\0{3}size=.{4}(.{4})", content, re.S)
    content[chunk.start(1) : chunk.end(1)] = bytes(4)
    log = read_log([write(tmp_path / "log.bag", bytes(content[:stop]) + end)], MAPPING, SUPPORTS)
    assert_holds(log, truth)
    assert cut_at(log) == stop


def test_damage_within_is_refused_with_its_place(tmp_path: Path) -> None:
    content = bytearray(mcap_bytes(make_truth(60)))
    chunks = [s for s in record_starts(bytes(content))[:-1] if content[s] == 6]
    path = tmp_path / "log.mcap"
    for place in (60, 200):  # in the compressor's frame, and in what it holds
        content[chunks[2] + place] ^= 4
        with pytest.raises(DataError, match=rf"a chunk is damaged \(.*\) at byte {chunks[2]}\b"):
            read_log([write(path, bytes(content))], MAPPING, SUPPORTS)
        content[chunks[2] + place] ^= 4
    content[chunks[2] + 3] ^= 0x40  # its length
    with pytest.raises(DataError, match=f"the record at byte {chunks[2]} runs beyond"):
        read_log([write(path, bytes(content))], MAPPING, SUPPORTS)


@pytest.mark.parametrize(
    ("rows", "last", "whole"),
    [
        ("postures", lambda k: f"{1300 + k}.{k % 5}5", 1),
        ("timeseries", lambda k: f"{1300 + k / 7:.3f}", 1),
        ("timeseries", lambda k: f"{round(1300 + k / 7, 2)}", 1),  # 1300.0 among 1300.14
        ("timeseries", lambda k: f"{1300 + k / 7!r}", 3),  # whatever its last digits say
        ("timeseries", lambda k: f"{1300 + k},{k % 4}", 1),  # a counter behind
    ],
)
def test_a_table_cut_within_its_last_row_lacks_that_row(
    tmp_path: Path, rows: Literal["postures", "timeseries"], last: Callable[[int], str], whole: int
) -> None:
    lines = [f"{k},1.5,2.25,3.125,{10 + k}.5,-20.25,{last(k)}" for k in range(40)]
    head = "time,a.x,a.y,a.z,a.fx,a.fy,a.fz" + ",n" * (lines[0].count(",") > 6)
    path, text = tmp_path / "log.csv", "\n".join([head, *lines])
    for cut in range(whole, len(lines[-1])):
        path.write_text(text[:-cut])
        log = read_log([path], LogBlock(rows=rows), ONE)
        assert len(log.force[0].time) == 39
        assert [finding.code for finding in log.findings] == ["log-truncated"]
    for end in ("", "\n", "\r\n"):
        path.write_text(text + end)
        log = read_log([path], LogBlock(rows=rows), ONE)
        assert (len(log.force[0].time), log.findings) == (40, ())


def test_damage_within_a_bag_that_was_cut_is_refused(tmp_path: Path) -> None:
    content = bytearray(whole("log.bag"))
    *_, message = re.finditer(rb"conn=", content[: len(content) // 3])
    content[message.end() - 1] ^= 4  # no name ends there any more
    path = write(tmp_path / "log.bag", bytes(content[: len(content) // 2]))
    with pytest.raises(DataError, match=r"the record at byte \d+ cannot be read"):
        read_log([path], MAPPING, SUPPORTS)
