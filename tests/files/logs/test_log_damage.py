"""Damaged files: refused, or read to the identical numbers; never silently different."""

from __future__ import annotations

import io
import json
import struct
import zlib
from dataclasses import replace
from pathlib import Path

import numpy as np
import pyarrow as pa
import pyarrow.parquet as pq
import pytest
from hypothesis import HealthCheck, given, settings
from hypothesis import strategies as st
from mcap.writer import CompressionType, IndexType, Writer

import tdfscal
from benchmarks.bitflips import KINDS, REFUSED, SAME, Kind, attempt, count, places
from tdfscal.errors import DataError, TdfscalError
from tdfscal.logs import read_log
from tdfscal.records import LogMapping
from tests.files.logs.log_making import (
    MAPPING,
    SUPPORTS,
    make_truth,
    mcap_bytes,
    table,
    write,
)

ONE = ("a",)
DEFAULT = LogMapping(ONE, (("a.x", "a.y", "a.z"),), (("a.fx", "a.fy", "a.fz"),))
FUZZ = settings(
    max_examples=100,
    deadline=None,
    derandomize=True,
    suppress_health_check=[HealthCheck.function_scoped_fixture],
)


def record_starts(content: bytes) -> list[int]:
    starts = [8]
    while starts[-1] < len(content) - 8:
        (length,) = struct.unpack_from("<Q", content, starts[-1] + 1)
        starts.append(starts[-1] + 9 + length)
    return starts


@pytest.mark.parametrize("kind", KINDS, ids=lambda kind: kind.name)
def test_bit_flips(kind: Kind) -> None:
    found: list[str] = []
    attempt(kind, places(kind.make(), 60, seed=7), found.append)
    assert len(found) == 60
    assert set(found) == {REFUSED, SAME} or set(found) == {REFUSED}


@pytest.mark.slow
@pytest.mark.parametrize("kind", KINDS, ids=lambda kind: kind.name)
def test_bit_flips_by_the_thousand(kind: Kind) -> None:
    found = count(kind, 2500, seed=1)
    assert found[REFUSED] + found[SAME] == 2500


@pytest.mark.slow
@pytest.mark.parametrize("chunking", [True, False])
@pytest.mark.parametrize("summary", [True, False])
def test_truncation_at_every_record_of_mcap(tmp_path: Path, chunking: bool, summary: bool) -> None:
    content = mcap_bytes(make_truth(3), chunking=chunking, summary=summary)
    path = tmp_path / "log.mcap"
    starts = record_starts(content)
    for end in {0, 4, *starts, *(s + 5 for s in starts[:-1]), len(content) - 1}:
        path.write_bytes(content[:end])
        with pytest.raises(DataError):
            read_log([path], MAPPING, SUPPORTS)
    for extra in (b"\0", content):
        path.write_bytes(content + extra)
        with pytest.raises(DataError, match="bytes follow the end"):
            read_log([path], MAPPING, SUPPORTS)


@pytest.mark.slow
def test_truncation_at_every_byte_of_mcap(tmp_path: Path) -> None:
    content = mcap_bytes(make_truth(3))
    path = tmp_path / "log.mcap"
    for end in range(len(content)):
        path.write_bytes(content[:end])
        with pytest.raises(DataError):
            read_log([path], MAPPING, SUPPORTS)


def test_truncation_of_parquet(tmp_path: Path) -> None:
    path = tmp_path / "log.parquet"
    pq.write_table(pa.Table.from_pandas(table(make_truth(12))), path)
    content = path.read_bytes()
    for end in range(0, len(content), 97):
        path.write_bytes(content[:end])
        with pytest.raises(DataError):
            read_log([path], None, SUPPORTS)


def test_salvage_of_a_truncated_recording(tmp_path: Path) -> None:
    content = mcap_bytes(make_truth(60))
    chunks = [s for s in record_starts(content)[:-1] if content[s] == 6]
    path = write(tmp_path / "log.mcap", content[: chunks[3] + 100])
    with pytest.raises(DataError, match=r"the file ends within a record.*--salvage"):
        read_log([path], MAPPING, SUPPORTS)
    log = read_log([path], MAPPING, SUPPORTS, salvage=True)
    truth = make_truth(60)
    count = log.force[0].time.size
    assert 0 < count < 240
    np.testing.assert_array_equal(log.force[0].value, truth.force[0][:count])
    assert log.inputs[0].integrity == "salvaged"
    assert any("what follows is lost" in w for w in log.warnings)


def test_salvage_passes_over_a_damaged_chunk(tmp_path: Path) -> None:
    content = bytearray(mcap_bytes(make_truth(60)))
    chunks = [s for s in record_starts(bytes(content))[:-1] if content[s] == 6]
    content[chunks[2] + 200] ^= 4
    path = write(tmp_path / "log.mcap", bytes(content))
    with pytest.raises(DataError, match=f"a chunk is damaged.*at byte {chunks[2]}"):
        read_log([path], MAPPING, SUPPORTS)
    log = read_log([path], MAPPING, SUPPORTS, salvage=True)
    truth = make_truth(60)
    lost = 240 - log.force[0].time.size
    assert 0 < lost < 60
    assert set(log.force[0].value[:, 0]) < set(truth.force[0][:, 0])
    assert any("a chunk is damaged" in w for w in log.warnings)
    assert log.inputs[0].integrity == "salvaged"


@pytest.mark.parametrize("declared", [1 << 40, 1 << 30, 0])
def test_declared_sizes_are_bounded(tmp_path: Path, declared: int) -> None:
    content = bytearray(mcap_bytes(make_truth(3)))
    chunk = next(s for s in record_starts(bytes(content))[:-1] if content[s] == 6)
    struct.pack_into("<Q", content, chunk + 9 + 16, declared)
    with pytest.raises(DataError, match="a chunk is damaged"):
        read_log([write(tmp_path / "log.mcap", bytes(content))], MAPPING, SUPPORTS)


def test_statistics_must_agree(tmp_path: Path) -> None:
    content = bytearray(mcap_bytes(make_truth(3)))
    statistics = next(s for s in record_starts(bytes(content))[:-1] if content[s] == 0x0B)
    content[statistics + 9] += 1
    content[-12:-8] = bytes(4)  # without the summary's checksum
    with pytest.raises(DataError, match="45 messages are there where the statistics state 46"):
        read_log([write(tmp_path / "log.mcap", bytes(content))], MAPPING, SUPPORTS)


def test_messages_of_a_channel_that_is_not_defined(tmp_path: Path) -> None:
    content = mcap_bytes(make_truth(3), chunking=False, summary=False)
    starts = record_starts(content)
    channel = next(s for s in starts[:-1] if content[s] == 4)
    (length,) = struct.unpack_from("<Q", content, channel + 1)
    path = write(tmp_path / "log.mcap", content[:channel] + content[channel + 9 + length :])
    with pytest.raises(DataError, match="belong to a channel that is not defined"):
        read_log([path], MAPPING, SUPPORTS)


def test_private_records_are_passed_over(tmp_path: Path) -> None:
    """They count in the checksum of the data, and not as the begin of the record behind them."""
    content = mcap_bytes(make_truth(3), summary=False, index_types=IndexType.NONE, data_crc=True)
    end = next(s for s in record_starts(content)[:-1] if content[s] == 0x0F)
    data = content[:end] + struct.pack("<BQ", 0x90, 3) + b"own"
    closing = struct.pack("<BQI", 0x0F, 4, zlib.crc32(data))
    log = read_log(
        [write(tmp_path / "log.mcap", data + closing + content[end + 13 :])], MAPPING, SUPPORTS
    )
    assert log.force[0].time.size == 12
    assert log.inputs[0].integrity == "verified"


def test_what_is_attached_is_passed_over(tmp_path: Path) -> None:
    """An attachment may be larger than any record that is read."""
    content = mcap_bytes(make_truth(3), summary=False, index_types=IndexType.NONE)
    start = record_starts(content)[1]
    attached = struct.pack("<BQ", 9, 3 << 20) + bytes(3 << 20)
    log = read_log(
        [write(tmp_path / "log.mcap", content[:start] + attached + content[start:])],
        MAPPING, SUPPORTS,
    )  # fmt: skip
    assert log.force[0].time.size == 12


@FUZZ
@given(st.binary(max_size=200))
def test_any_bytes_as_any_format(tmp_path: Path, content: bytes) -> None:
    mcap = b"\x89MCAP0\r\n" + content
    for name, data in (("a.csv", content), ("a.parquet", content), ("a.mcap", mcap)):
        with pytest.raises(TdfscalError):
            read_log([write(tmp_path / name, data)], DEFAULT, ONE)


@FUZZ
@given(
    st.lists(st.text("0123456789.,;-+eE\"'\t nainf\r\0", max_size=30), max_size=8),
    st.sampled_from([".", ","]),
)
def test_any_rows_of_text(tmp_path: Path, lines: list[str], decimal: str) -> None:
    text = "time;a.x;a.y;a.z;a.fx;a.fy;a.fz\n" + "".join(f"{line}\n" for line in lines)
    path = write(tmp_path / "a.csv", text.encode())
    mapping = replace(DEFAULT, decimal="," if decimal == "," else ".")
    try:
        log = read_log([path], mapping, ONE)
    except DataError:
        return
    assert np.isfinite(log.position[0].value).all()
    assert (np.diff(log.position[0].time) > 0.0).all()


@FUZZ
@given(st.data())
def test_any_cdr_message(tmp_path: Path, data: st.DataObject) -> None:
    content = bytearray(mcap_bytes(make_truth(2), compression=CompressionType.NONE))
    # Without the chunk's checksum every damage reaches the messages.
    chunk = next(s for s in record_starts(bytes(content))[:-1] if content[s] == 6)
    struct.pack_into("<I", content, chunk + 9 + 24, 0)
    (length,) = struct.unpack_from("<Q", content, chunk + 1)
    for _ in range(data.draw(st.integers(1, 4))):
        place = data.draw(st.integers(chunk + 60, chunk + length))
        content[place] = data.draw(st.integers(0, 255))
    path = write(tmp_path / "a.mcap", bytes(content))
    for salvage in (False, True):
        try:
            log = read_log([path], MAPPING, SUPPORTS, salvage=salvage)
        except DataError:
            continue
        assert all(np.isfinite(s.value).all() for s in (*log.position, *log.force))


@settings(FUZZ, max_examples=40)
@given(st.data())
def test_any_json_message(tmp_path: Path, data: st.DataObject) -> None:
    numbers = st.one_of(st.floats(), st.integers(), st.booleans(), st.text(max_size=3), st.none())
    tree = st.recursive(
        numbers,
        lambda inner: st.one_of(
            st.lists(inner, max_size=3),
            st.dictionaries(st.sampled_from(["x", "y", "z", "point", "force"]), inner, max_size=4),
        ),
        max_leaves=8,
    )
    target = io.BytesIO()
    writer = Writer(target)
    writer.start()
    schema = writer.register_schema("any", "jsonschema", b"{}")
    for topic in ("/a/p", "/a/f"):
        channel = writer.register_channel(topic, "json", schema)
        content = json.dumps(data.draw(tree)).encode()
        writer.add_message(channel, 1, content, 1)
    writer.finish()  # type: ignore[no-untyped-call]
    path = write(tmp_path / "a.mcap", target.getvalue())
    mapping = LogMapping(ONE, (("/a/p.point",),), (("/a/f.force",),))
    try:
        log = read_log([path], mapping, ONE)
    except DataError:
        return
    assert all(np.isfinite(s.value).all() for s in (*log.position, *log.force))


@settings(FUZZ, max_examples=40)
@given(st.data())
def test_any_parquet_footer(tmp_path: Path, data: st.DataObject) -> None:
    buffer = io.BytesIO()
    pq.write_table(pa.Table.from_pandas(table(make_truth(3))), buffer, write_page_checksum=True)
    content = bytearray(buffer.getvalue())
    for _ in range(data.draw(st.integers(1, 4))):
        place = data.draw(st.integers(4, len(content) - 9))
        content[place] = data.draw(st.integers(0, 255))
    try:
        read_log([write(tmp_path / "a.parquet", bytes(content))], None, SUPPORTS)
    except DataError:
        return


def test_a_page_that_states_too_much_is_refused(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    path = tmp_path / "a.parquet"
    pq.write_table(pa.Table.from_pandas(table(make_truth(3000))), path)
    assert len(read_log([path], None, SUPPORTS).force[0].time) == 3000
    monkeypatch.setattr("tdfscal.logs.parquet.footer.MAX_PAGES", 1 << 12)
    with pytest.raises(DataError, match=r"a page states .* bytes"):
        read_log([path], None, SUPPORTS)


def test_init_names_the_line_that_keeps_a_column_from_being_the_time(tmp_path: Path) -> None:
    path = tmp_path / "log.csv"
    table(make_truth(8000)).to_csv(path, index=False)
    lines = path.read_bytes().split(b"\n")
    lines[7000] = b"\xff\xfe" + lines[7000]
    path.write_bytes(b"\n".join(lines))
    with pytest.raises(DataError, match=r"as a time does.*; line 7001, column time"):
        tdfscal.init(path)
