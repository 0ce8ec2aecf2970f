"""What `--salvage` reads of an MCAP file whose definitions or summary are damaged."""

from __future__ import annotations

import gzip
import struct
from dataclasses import replace
from pathlib import Path

import numpy as np
import pytest
import zstandard

from tdfscal.errors import DataError
from tdfscal.logs import read_log
from tests.files.logs.log_making import (
    MAPPING,
    SUPPORTS,
    assert_holds,
    make_truth,
    mcap_bytes,
    write,
)

TRUTH = make_truth(60)
CHUNK, CHANNEL, STATISTICS, DATA_END = 6, 4, 0x0B, 0x0F


def starts(content: bytes, kind: int) -> list[int]:
    """Where the records of a kind start, outside the chunks."""
    found, place = [], 8
    while place < len(content) - 8:
        if content[place] == kind:
            found.append(place)
        (length,) = struct.unpack_from("<Q", content, place + 1)
        place += 9 + length
    return found


def first_chunk_damaged(*, summary: bool = True) -> bytearray:
    content = bytearray(mcap_bytes(TRUTH, summary=summary))
    content[starts(bytes(content), CHUNK)[0] + 200] ^= 4
    return content


def topic_spoilt(content: bytearray) -> bytearray:
    """In the summary, a topic that is no UTF-8."""
    place = content.index(b"/ncp2/wrench", starts(bytes(content), DATA_END)[0])
    content[place : place + 2] = b"\xff\xfe"
    return content


def test_definitions_of_a_lost_chunk_are_taken_from_the_summary(tmp_path: Path) -> None:
    path = write(tmp_path / "log.mcap", bytes(first_chunk_damaged()))
    with pytest.raises(DataError, match=r"a chunk is damaged.*`calibrate --salvage` reads"):
        read_log([path], MAPPING, SUPPORTS)
    log = read_log([path], MAPPING, SUPPORTS, salvage=True)
    assert log.inputs[0].integrity == "salvaged"
    for i in range(len(SUPPORTS)):
        count = log.force[i].time.size
        assert 200 < count < 240
        np.testing.assert_array_equal(log.force[i].value, TRUTH.force[i][-count:])
        count = log.position[i].time.size
        np.testing.assert_array_equal(log.position[i].value, TRUTH.position[i][-count:])
    assert "a chunk is damaged" in log.warnings[0]
    assert "/ncp2/position" in log.warnings[1]
    assert "taken from the summary" in log.warnings[1]
    assert "messages are there where the statistics state 900" in log.warnings[2]
    assert len(log.warnings) == 3


def test_a_damaged_summary_loses_no_message(tmp_path: Path) -> None:
    content = topic_spoilt(bytearray(mcap_bytes(TRUTH)))
    path = write(tmp_path / "log.mcap", bytes(content))
    match = r"the summary is damaged \(.*utf-8.*at byte \d+.*`calibrate --salvage` reads"
    with pytest.raises(DataError, match=match):
        read_log([path], MAPPING, SUPPORTS)
    log = read_log([path], MAPPING, SUPPORTS, salvage=True)
    assert_holds(log, TRUTH)
    assert log.inputs[0].integrity == "salvaged"
    (warning,) = log.warnings
    assert "the summary is damaged" in warning


@pytest.mark.parametrize("place", ["topic", "checksum", "absent"])
def test_a_summary_that_cannot_be_believed_defines_nothing(tmp_path: Path, place: str) -> None:
    """The message names the damage, not a mapping that is right."""
    content = first_chunk_damaged(summary=place != "absent")
    if place == "topic":
        topic_spoilt(content)
    elif place == "checksum":  # a topic with another name, in good UTF-8
        spot = content.index(b"/ncp2/wrench", starts(bytes(content), DATA_END)[0])
        content[spot + 4 : spot + 5] = b"7"
    path = write(tmp_path / "log.mcap", bytes(content))
    with pytest.raises(DataError, match="a chunk is damaged") as refused:
        read_log([path], MAPPING, SUPPORTS, salvage=True)
    assert "what is sound holds no topic for /ncp1/position.point" in str(refused.value)
    assert "rig.yaml" not in str(refused.value)


def test_a_wrong_mapping_of_a_sound_file_is_still_named(tmp_path: Path) -> None:
    path = write(tmp_path / "log.mcap", mcap_bytes(TRUTH))
    wrong = replace(MAPPING, position=tuple((f"/{s}/pose.point",) for s in SUPPORTS))
    with pytest.raises(DataError, match=r"no topic for /ncp1/pose.point.*rig\.yaml"):
        read_log([path], wrong, SUPPORTS, salvage=True)


def test_every_chunk_lost_names_the_damage(tmp_path: Path) -> None:
    content = bytearray(mcap_bytes(TRUTH, chunk_size=1 << 20))
    content[starts(bytes(content), CHUNK)[0] + 200] ^= 4
    path = write(tmp_path / "log.mcap", bytes(content))
    with pytest.raises(DataError, match=r"a chunk is damaged.*Copy the recording again\."):
        read_log([path], MAPPING, SUPPORTS, salvage=True)


def test_no_sample_of_a_signal_in_what_is_sound(tmp_path: Path) -> None:
    """Cut off before the last support's first message: its channel alone is there."""
    content = mcap_bytes(TRUTH, chunking=False, summary=False)
    cut = starts(content, CHANNEL)[-1]
    (length,) = struct.unpack_from("<Q", content, cut + 1)
    first = cut + 9 + length
    (length,) = struct.unpack_from("<Q", content, first + 1)
    path = write(tmp_path / "log.mcap", content[: first + 9 + length])
    match = r"there is no sample of .* in what is sound of the file; the file ends.*Copy"
    with pytest.raises(DataError, match=match):
        read_log([path], MAPPING, SUPPORTS, salvage=True)


@pytest.mark.parametrize("name", [b"/ncp2/wrench", b"geometry_msgs/msg/WrenchStamped"])
def test_an_unchunked_definition_that_is_damaged(tmp_path: Path, name: bytes) -> None:
    """A channel's topic, or the name of a schema whose channels are sound."""
    content = bytearray(mcap_bytes(TRUTH, chunking=False))
    place = content.index(name)
    content[place : place + 2] = b"\xff\xfe"
    path = write(tmp_path / "log.mcap", bytes(content))
    with pytest.raises(DataError, match="a schema or channel is damaged"):
        read_log([path], MAPPING, SUPPORTS)
    log = read_log([path], MAPPING, SUPPORTS, salvage=True)
    assert_holds(log, TRUTH)
    assert log.inputs[0].integrity == "salvaged"
    assert any("taken from the summary" in warning for warning in log.warnings)


@pytest.mark.parametrize("salvage", [True, False])
@pytest.mark.parametrize("kind", ["gzip", "zstd"])
def test_a_compressed_file_is_to_be_decompressed(tmp_path: Path, kind: str, salvage: bool) -> None:
    content = mcap_bytes(TRUTH)
    packed = gzip.compress(content) if kind == "gzip" else zstandard.compress(content)
    for name in ("log.mcap", "log.mcap.gz"):
        path = write(tmp_path / name, packed)
        with pytest.raises(DataError, match=rf"compressed with {kind}.*Decompress it first"):
            read_log([path], MAPPING, SUPPORTS, salvage=salvage)
