"""Small files that state or expand to absurd sizes: an error within bounded memory and time.

Each is read in a process of its own, whose peak memory and processor time are measured.
"""

from __future__ import annotations

import gzip
import re
import struct
import subprocess
import sys
from collections.abc import Callable
from pathlib import Path

import lz4.frame
import pytest
import zstandard
from mcap.writer import CompressionType, Writer

from tests.files.logs.log_making import SUPPORTS, definition

MEMORY, TIME = 1024.0, 60.0
"""MiB and s that no run may need."""

READ = """
import re, resource, sys
from pathlib import Path
from tdfscal.errors import TdfscalError
from tdfscal.logs.describe import describe_logs
from tdfscal.logs import iter_log
from tests.files.logs.log_making import JSON_MAPPING, LOG_TIME, SUPPORTS
path = Path(sys.argv[1])
mapping = JSON_MAPPING if "json" in path.name else LOG_TIME
mapping = mapping if path.suffix in (".bag", ".mcap") else None
try:
    if sys.argv[2] == "info":
        said = str(describe_logs([path]).problems)
    else:
        said = f"read {sum(p.force[0].time.size for p in iter_log([path], mapping, SUPPORTS))}"
except TdfscalError as error:
    said = str(error)
peak = re.search(r"VmHWM:\\s+(\\d+)", Path("/proc/self/status").read_text())[1]
used = resource.getrusage(resource.RUSAGE_SELF)
print(int(peak) / 1024, used.ru_utime + used.ru_stime, said, sep="\\n")
"""

NAMES = [f"{s}.{c}" for s in SUPPORTS for c in ("x", "y", "z", "fx", "fy", "fz")]
HEADER = ("time," + ",".join(NAMES) + "\n").encode()


def text_of_zeros(folder: Path) -> Path:
    path = folder / "zeros.csv.gz"
    with gzip.open(path, "wb") as file:
        file.write(HEADER)
        for _ in range(100):
            file.write((b"0" + b",0" * 18 + b"\n") * 50_000)
    return path


def one_endless_line(folder: Path) -> Path:
    path = folder / "line.csv.zst"
    compressor = zstandard.ZstdCompressor()
    with path.open("wb") as file, compressor.stream_writer(file) as stream:
        stream.write(HEADER)
        for _ in range(2000):
            stream.write(b"0" * (1 << 20))
    return path


def chunk_that_lies(folder: Path) -> Path:
    """A file without summary whose chunk states 1 MiB and holds 4 GiB."""
    compressor = zstandard.ZstdCompressor().compressobj()
    parts = [compressor.compress(bytes(1 << 20)) for _ in range(4096)]
    data = b"".join([*parts, compressor.flush()])
    content = struct.pack("<QQQII", 0, 0, 1 << 20, 0, 4) + b"zstd"
    content += struct.pack("<Q", len(data)) + data
    path = folder / "lies.mcap"
    records = struct.pack("<BQ", 1, 8) + bytes(8) + struct.pack("<BQ", 6, len(content)) + content
    path.write_bytes(b"\x89MCAP0\r\n" + records)
    return path


def recording(path: Path, encoding: str, schema: tuple[str, str, bytes], data: bytes) -> Path:
    with path.open("wb") as file:
        writer = Writer(file, compression=CompressionType.ZSTD)
        writer.start()
        kind = writer.register_schema(*schema)
        for name in SUPPORTS:
            for topic in (f"/{name}/position", f"/{name}/wrench"):
                channel = writer.register_channel(topic, encoding, kind)
                for k in range(3):
                    writer.add_message(channel, k * 10**9, data, k * 10**9)
        writer.finish()  # type: ignore[no-untyped-call]
    return path


def json_of_many_values(folder: Path) -> Path:
    data = b"[" + b"[]," * (20 << 20) + b"0]"
    return recording(folder / "json_many.mcap", "json", ("any", "jsonschema", b"{}"), data)


def json_that_nests(folder: Path) -> Path:
    data = b"[" * (1 << 20)
    return recording(folder / "json_deep.mcap", "json", ("any", "jsonschema", b"{}"), data)


def cdr_of_many_names(folder: Path) -> Path:
    kind = "sensor_msgs/msg/JointState"
    data = bytes([0, 1, 0, 0]) + bytes(12) + struct.pack("<I", 10 << 20) + bytes(40 << 20)
    return recording(folder / "names.mcap", "cdr", (kind, "ros2msg", definition(kind)), data)


def type_that_multiplies(folder: Path) -> Path:
    """Each type has ten members of the next; the last one has none."""
    rule = "\n" + "=" * 80 + "\n"
    members = [
        "\n".join(f"a/T{k + 1} m{j}" for j in range(10)) if k < 20 else "" for k in range(21)
    ]
    parts = ["a/T1 point", *(f"MSG: a/T{k}\n{members[k]}" for k in range(1, 21))]
    text = rule.join(parts).encode()
    data = bytes([0, 1, 0, 0]) + bytes(64)
    return recording(folder / "type.mcap", "cdr", ("a/msg/T0", "ros2msg", text), data)


def ros1_chunk_that_expands(folder: Path) -> Path:
    """A ROS 1 bag, put together record by record: one chunk of 4 GiB of zeros, in LZ4."""

    def record(fields: dict[str, bytes], data: bytes) -> bytes:
        parts = [f"{key}=".encode() + value for key, value in fields.items()]
        head = b"".join(struct.pack("<I", len(part)) + part for part in parts)
        return struct.pack("<I", len(head)) + head + struct.pack("<I", len(data)) + data

    stream = lz4.frame.LZ4FrameCompressor(block_size=lz4.frame.BLOCKSIZE_MAX4MB)
    zeros = bytes(64 << 20)
    packed = stream.begin() + b"".join(stream.compress(zeros) for _ in range(64)) + stream.flush()
    u32, u64 = struct.Struct("<I").pack, struct.Struct("<Q").pack
    topics = [f"/{s}/{what}" for s in SUPPORTS for what in ("position", "wrench")]
    kinds = ["geometry_msgs/PointStamped", "geometry_msgs/WrenchStamped"] * len(SUPPORTS)
    chunk = record({"op": b"\5", "compression": b"lz4", "size": u32(0)}, packed)
    indexes = b"".join(
        record({"op": b"\4", "ver": u32(1), "conn": u32(k), "count": u32(1)}, u64(k) + u32(0))
        for k in range(len(topics))
    )
    text = b"float64 x\nfloat64 y\nfloat64 z\n"
    connections = b"".join(
        record(
            {"op": b"\7", "conn": u32(k), "topic": topic.encode()},
            b"".join(
                struct.pack("<I", len(part)) + part
                for part in (
                    b"topic=" + topic.encode(), b"type=" + kind.encode(), b"md5sum=" + b"0" * 32,
                    b"message_definition=" + text,
                )
            ),
        )
        for k, (topic, kind) in enumerate(zip(topics, kinds, strict=True))
    )  # fmt: skip
    begin = 13 + 4096
    counts = b"".join(u32(k) + u32(1) for k in range(len(topics)))
    info = record(
        {"op": b"\6", "ver": u32(1), "chunk_pos": u64(begin), "start_time": u64(0),
         "end_time": u64(9), "count": u32(len(topics))},
        counts,
    )  # fmt: skip
    fields = {
        "op": b"\3", "index_pos": u64(begin + len(chunk) + len(indexes)),
        "conn_count": u32(len(topics)), "chunk_count": u32(1),
    }  # fmt: skip
    bare = len(record(fields, b""))
    header = record(fields, b" " * (4096 - bare))
    path = folder / "bomb.bag"
    path.write_bytes(b"#ROSBAG V2.0\n" + header + chunk + indexes + connections + info)
    return path


BOMBS: list[Callable[[Path], Path]] = [
    chunk_that_lies,
    cdr_of_many_names,
    type_that_multiplies,
    json_of_many_values,
    text_of_zeros,
    one_endless_line,
    json_that_nests,
    ros1_chunk_that_expands,
]
CASES = [
    pytest.param(bomb, how, id=f"{bomb.__name__}-{how}",
                 marks=[] if k == 0 and how == "read" else pytest.mark.slow)
    for k, bomb in enumerate(BOMBS)
    for how in ("read", "info")
]  # fmt: skip


@pytest.mark.skipif(not Path("/proc/self/status").exists(), reason="peak memory is read from /proc")
@pytest.mark.parametrize(("bomb", "how"), CASES)
def test_bombs(tmp_path: Path, bomb: Callable[[Path], Path], how: str) -> None:
    path = bomb(tmp_path)
    ran = subprocess.run(
        [sys.executable, "-c", READ, str(path), how],
        capture_output=True, text=True, check=False, timeout=4 * TIME,
    )  # fmt: skip
    assert ran.returncode == 0, ran.stderr[-2000:]
    assert not re.search("Warning", ran.stderr)
    memory, seconds, said = ran.stdout.strip().split("\n", 2)
    assert float(memory) < MEMORY
    assert float(seconds) < TIME
    assert said.strip() not in ("", "()")
    assert not said.startswith("read")
