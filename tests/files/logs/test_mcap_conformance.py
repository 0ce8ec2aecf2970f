"""MCAP files with and without each feature that the format's conformance set has."""

import io
from pathlib import Path
from typing import Any, Final

import pytest
from mcap.writer import CompressionType, IndexType, Writer

from tdfscal.logs.messages.mcap import McapFile

PLAIN: Final[dict[str, Any]] = {
    "compression": CompressionType.NONE,
    "index_types": IndexType.NONE,
    **dict.fromkeys(("repeat_channels", "repeat_schemas", "use_chunking", "use_statistics"), False),
    **dict.fromkeys(("use_summary_offsets", "enable_crcs", "enable_data_crcs"), False),
}
#: What each feature is by itself; an index of messages is one of chunks.
FEATURES: Final[tuple[dict[str, Any], ...]] = (
    *({name: True} for name, value in PLAIN.items() if value is False),
    *({"use_chunking": True, "index_types": index} for index in IndexType),
    *({"use_chunking": True, "compression": packed} for packed in CompressionType),
    {"use_chunking": True, "enable_crcs": True},
)
EVERY: Final = {key: value for feature in FEATURES for key, value in feature.items()} | {
    "index_types": IndexType.ALL
}
CASES: Final = ({}, *FEATURES, EVERY, *({**EVERY, key: PLAIN[key]} for key in PLAIN))


def content(messages: int, *, schema: bool, around: bool, **features: Any) -> bytes:
    """A recording; around : with an attachment and metadata before its messages."""
    stream = io.BytesIO()
    writer = Writer(stream, **(PLAIN | features))
    writer.start()
    if around:
        writer.add_attachment(1, 2, "myFile", "application/octet-stream", b"\1\2\3")
        writer.add_metadata("myMetadata", {"key": "value"})
    if messages:
        number = writer.register_schema("Example", "c", b"\4\5\6") if schema else 0
        channel = writer.register_channel("example", "a", number)
        for k in range(messages):
            writer.add_message(channel, 2 + k, b"\1\2\3", 1 + k, k)
    writer.finish()  # type: ignore[no-untyped-call]
    return stream.getvalue()


@pytest.mark.parametrize("around", [False, True])
@pytest.mark.parametrize(("messages", "schema"), [(0, True), (1, False), (10, True)])
def test_valid_files_are_read(tmp_path: Path, messages: int, schema: bool, around: bool) -> None:
    for features in CASES:
        path = tmp_path / "a.mcap"
        path.write_bytes(content(messages, schema=schema, around=around, **features))
        file = McapFile(path)
        times = [int(t) for found in file.messages() for t in found.log_time()]
        assert times == [2 + k for k in range(messages)], features
        assert sum(file.counts.values()) == messages
        assert file.cut_at is None
