"""Valid MCAP files in every combination of the features that the format's conformance set has.

The files are put together here from the specification's tables (https://mcap.dev/spec), record by
record, as the set's own generator describes its cases: chunks, message index, statistics, repeated
schemas and channels, indexes of chunks, attachments and metadata, summary offsets, and records that
later versions have extended by fields unknown today.
"""

import struct
import zlib
from dataclasses import dataclass
from pathlib import Path
from typing import Final

import pytest

from tdfscal.logs.messages.mcap import McapFile

MAGIC: Final = b"\x89MCAP0\r\n"
FEATURES: Final = ("ch", "mx", "st", "rsh", "rch", "ax", "mdx", "chx", "sum", "pad", "crc")
INPUTS: Final = {
    "NoData": (),
    "OneMessage": ("schema", "channel", "message"),
    "OneSchemalessMessage": ("bare", "message"),
    "TenMessages": ("schema", "channel", *("message",) * 10),
    "OneAttachment": ("attachment",),
    "OneMetadata": ("metadata",),
}
HEADER, FOOTER, SCHEMA, CHANNEL, MESSAGE, CHUNK, MESSAGE_INDEX, CHUNK_INDEX = range(1, 9)
ATTACHMENT, ATTACHMENT_INDEX, STATISTICS, METADATA, METADATA_INDEX, OFFSET, DATA_END = range(9, 16)
FIXED: Final = (FOOTER, MESSAGE)  # by the specification these are never extended


def text(value: str) -> bytes:
    return struct.pack("<I", len(value)) + value.encode()


def pairs(items: dict[int, int]) -> bytes:
    data = b"".join(struct.pack("<HQ", key, value) for key, value in items.items())
    return struct.pack("<I", len(data)) + data


SIMPLE: Final = {
    "schema": (SCHEMA, struct.pack("<H", 1) + text("Example") + text("c") + text("\4\5\6")),
    "channel": (CHANNEL, struct.pack("<HH", 1, 1) + text("example") + text("a") + bytes(4)),
    "bare": (CHANNEL, struct.pack("<HH", 1, 0) + text("example") + text("a") + bytes(4)),
    "metadata": (METADATA, text("myMetadata") + struct.pack("<I", 0)),
}


@dataclass
class Built:
    """A file while it is put together."""

    features: frozenset[str]
    data: bytearray

    def add(self, kind: int, content: bytes) -> tuple[int, int]:
        start = len(self.data)
        self.data += packed(kind, content, padded="pad" in self.features)
        return start, len(self.data) - start


def packed(kind: int, content: bytes, *, padded: bool) -> bytes:
    extra = b"\1\2\3" if padded and kind not in FIXED else b""
    return struct.pack("<BQ", kind, len(content + extra)) + content + extra


def record(name: str, number: int) -> tuple[int, bytes]:
    if name == "message":
        return MESSAGE, struct.pack("<HIQQ", 1, number, 2 + number, 1 + number) + b"\1\2\3"
    if name == "attachment":
        head = struct.pack("<QQ", 2, 1) + text("myFile") + text("application/octet-stream")
        body = head + struct.pack("<Q", 3) + b"\1\2\3"
        return ATTACHMENT, body + struct.pack("<I", zlib.crc32(body))
    return SIMPLE[name]


def build(records: tuple[str, ...], features: frozenset[str]) -> bytes:
    file = Built(features, bytearray(MAGIC))
    file.add(HEADER, text("") + text(""))
    chunk = bytearray()
    index: list[tuple[int, int]] = []
    groups: dict[int, list[bytes]] = {}
    for number, name in enumerate(records):
        kind, content = record(name, number)
        if "ch" in features and kind in (SCHEMA, CHANNEL, MESSAGE):
            if kind == MESSAGE:
                index.append((2 + number, len(chunk)))
            chunk += packed(kind, content, padded="pad" in features)
            continue
        start, length = file.add(kind, content)
        if kind == ATTACHMENT and "ax" in features:
            entry = struct.pack("<QQQQQ", start, length, 2, 1, 3) + text("myFile") + text("x")
            groups.setdefault(ATTACHMENT_INDEX, []).append(entry)
        if kind == METADATA and "mdx" in features:
            entry = struct.pack("<QQ", start, length) + text("myMetadata")
            groups.setdefault(METADATA_INDEX, []).append(entry)
    if "ch" in features:
        times = [t for t, _ in index] or [0]
        crc = zlib.crc32(chunk) if "crc" in features else 0
        head = struct.pack("<QQQI", min(times), max(times), len(chunk), crc) + text("")
        start, length = file.add(CHUNK, head + struct.pack("<Q", len(chunk)) + bytes(chunk))
        offsets: dict[int, int] = {}
        indexed = 0
        if "mx" in features and index:
            entries = b"".join(struct.pack("<QQ", *entry) for entry in index)
            content = struct.pack("<HI", 1, len(entries)) + entries
            offsets[1], indexed = file.add(MESSAGE_INDEX, content)
        if "chx" in features:
            entry = struct.pack("<QQQQ", min(times), max(times), start, length) + pairs(offsets)
            entry += struct.pack("<Q", indexed) + text("") + struct.pack("<QQ", *[len(chunk)] * 2)
            groups[CHUNK_INDEX] = [entry]
    file.add(DATA_END, struct.pack("<I", zlib.crc32(file.data) if "crc" in features else 0))
    finish(file, records, groups)
    return bytes(file.data)


def finish(file: Built, records: tuple[str, ...], groups: dict[int, list[bytes]]) -> None:
    """Add summary, summary offsets and footer."""
    messages = records.count("message")
    repeated = {"rsh": (SCHEMA, ("schema",)), "rch": (CHANNEL, ("channel", "bare"))}
    for feature, (kind, names) in repeated.items():
        if feature in file.features:
            groups[kind] = [record(name, 0)[1] for name in records if name in names]
    if "st" in file.features:
        counts = struct.pack(
            "<QHIIIIQQ", messages, records.count("schema"),
            records.count("channel") + records.count("bare"), records.count("attachment"),
            records.count("metadata"), int("ch" in file.features), 2 if messages else 0,
            1 + len(records) if messages else 0,
        )  # fmt: skip
        groups[STATISTICS] = [counts + pairs({1: messages} if messages else {})]
    start = len(file.data)
    places = {}
    for kind, contents in groups.items():
        begin = len(file.data)
        for content in contents:
            file.add(kind, content)
        places[kind] = (begin, len(file.data) - begin)
    summary = start if len(file.data) > start else 0
    offsets = len(file.data) if "sum" in file.features else 0
    if offsets:
        for kind, (begin, length) in places.items():
            file.add(OFFSET, struct.pack("<BQQ", kind, begin, length))
    ends = struct.pack("<QQ", summary, offsets)
    covered = bytes(file.data[start:]) + struct.pack("<BQ", FOOTER, 20) + ends
    crc = zlib.crc32(covered) if "crc" in file.features else 0
    file.add(FOOTER, ends + struct.pack("<I", crc))
    file.data += MAGIC


def check(path: Path, records: tuple[str, ...], features: frozenset[str]) -> None:
    path.write_bytes(build(records, features))
    container = McapFile(path)
    sequence = [int(t) for messages in container.messages() for t in messages.log_time()]
    expected = [2 + k for k, name in enumerate(records) if name == "message"]
    assert sequence == expected, features
    assert container.counts == ({1: len(expected)} if expected else {})
    assert container.cut_at is None


@pytest.mark.parametrize("name", INPUTS)
def test_valid_files_are_read(tmp_path: Path, name: str) -> None:
    """All features, each alone, each left out, with and without padding."""
    every = frozenset(FEATURES)
    cases = {frozenset[str](), every, *(frozenset({f}) for f in FEATURES)}
    cases |= {every - {f} for f in FEATURES} | {frozenset({f, "pad"}) for f in FEATURES}
    for features in sorted(cases, key=sorted):
        check(tmp_path / "a.mcap", INPUTS[name], features)
