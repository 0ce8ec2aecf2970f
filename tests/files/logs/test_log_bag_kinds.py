"""rosbag2's folders and SQLite files, ROS 1 bags, by rosbags' writers and by hand."""

import sqlite3
from collections.abc import Callable
from contextlib import closing
from dataclasses import replace
from pathlib import Path
from typing import Any, Literal

import pytest
import yaml
from rosbags.rosbag1 import Writer as Writer1
from rosbags.rosbag2 import StoragePlugin
from rosbags.typesys import Stores, get_typestore

from tdfscal.errors import DataError, UsageError
from tdfscal.logs import is_log, read_log
from tdfscal.logs.describe import describe_logs
from tests.files.logs.log_making import (
    MAPPING,
    STORE,
    SUPPORTS,
    Truth,
    assert_holds,
    events,
    make_truth,
    mcap_bytes,
    rosbag2,
    write,
)
from tests.words import in_words

TRUTH = make_truth()
POINT = "geometry_msgs/msg/PointStamped"
ROS1 = get_typestore(Stores.ROS1_NOETIC)


def altered(path: Path, *statements: str) -> None:
    """Change a SQLite file."""
    with closing(sqlite3.connect(path)) as database:
        for statement in statements:
            database.execute(statement)
        database.commit()


def without_definitions(folder: Path) -> Path:
    """As recorders before ROS 2 Iron, which store none."""
    (path,) = folder.glob("*.db3")
    altered(path, "DROP TABLE message_definitions")
    return path


def sqlite_bag(folder: Path, version: Literal[8, 9] = 9) -> Path:
    return rosbag2(folder, TRUTH, StoragePlugin.SQLITE3, version)


def ros1_bag(
    path: Path,
    compression: Writer1.CompressionFormat | None = None,
    truth: Truth = TRUTH,
    chunk: int = 1 << 20,
    restarts: int = 0,
) -> Path:
    bag = Writer1(path)
    bag.chunk_threshold = chunk
    if compression is not None:
        bag.set_compression(compression)
    with bag:
        topics: dict[tuple[str, str], Any] = {}
        every = list(events(truth))
        for k, (t, topic, kind, data) in enumerate(every):
            caller = str(k * (1 + restarts) // len(every))
            if (topic, caller) not in topics:
                added = bag.add_connection(topic, kind, typestore=ROS1, callerid=caller)
                topics[topic, caller] = added
            bag.write(topics[topic, caller], round(t * 1e6) * 1000, bytes(as_ros1(data, kind)))
    return path


def as_ros1(data: bytes, kind: str) -> Any:
    """The same message as ROS 1 writes it: its header has a number, too."""
    message: Any = STORE.deserialize_cdr(data, kind)
    stamp, frame = message.header.stamp, message.header.frame_id
    types = ROS1.types
    stamp = types["builtin_interfaces/msg/Time"](stamp.sec, stamp.nanosec)
    header = types["std_msgs/msg/Header"](7, stamp, frame)
    if kind == POINT:
        p = message.point
        point = types["geometry_msgs/msg/Point"](p.x, p.y, p.z)
        return ROS1.serialize_ros1(types[kind](header, point), kind)
    vector = types["geometry_msgs/msg/Vector3"]
    force, torque = (vector(v.x, v.y, v.z) for v in (message.wrench.force, message.wrench.torque))
    wrench = types["geometry_msgs/msg/Wrench"](force, torque)
    return ROS1.serialize_ros1(types[kind](header, wrench), kind)


def test_a_sqlite_file_alone_is_a_log(tmp_path: Path) -> None:
    path = without_definitions(sqlite_bag(tmp_path / "bag"))
    assert is_log(path)
    assert_holds(read_log([path], MAPPING, SUPPORTS), TRUTH)


OTHER = "geometry_msgs/msg/Point"
SQLITE_FAULTS: dict[str, Callable[[Path], object]] = {
    "text": lambda p: p.write_text("time,x,y\n1,2,3\n"),
    "head only": lambda p: p.write_bytes(p.read_bytes()[:100]),
    "overwritten": lambda p: p.write_bytes(p.read_bytes()[:200] + bytes(9000) + b"x" * 9000),
    "no messages": lambda p: altered(p, "DROP TABLE messages"),
    "journal": lambda p: p.with_name(p.name + "-wal").write_bytes(b"left over"),
    "other type": lambda p: altered(
        p,
        f"UPDATE topics SET type = '{OTHER}'",
        f"UPDATE message_definitions SET topic_type = '{OTHER}'",
    ),
    "text for bytes": lambda p: altered(p, "UPDATE messages SET data = 'no bytes' WHERE id = 5"),
    "strange topic": lambda p: altered(p, "UPDATE messages SET topic_id = 77 WHERE id = 5"),
}


ROS1_FAULTS: dict[str, Callable[[bytes], bytes]] = {
    "text": lambda b: b"time,x,y\n1,2,3\n",
    "version 1.2": lambda b: b.replace(b"V2.0", b"V1.2", 1),
    "zeros at the end": lambda b: b[:-2000] + bytes(2000),
    "zeros in the middle": lambda b: b[: len(b) // 2] + bytes(3000) + b[len(b) // 2 + 3000 :],
    "type not defined": lambda b: b.replace(b"MSG: geometry_msgs/Wr", b"MSG: geometry_msgs/Vr"),
    "fields renamed": lambda b: b.replace(b"Vector3 force", b"Vector3 farce"),
}  # fmt: skip


@pytest.mark.parametrize(
    ("kind", "fault"),
    [*(("sqlite", f) for f in SQLITE_FAULTS), *(("ros1", f) for f in ROS1_FAULTS)],
)
def test_a_damaged_recording_is_refused(tmp_path: Path, kind: str, fault: str) -> None:
    if kind == "sqlite":
        log = sqlite_bag(tmp_path / "bag")
        (path,) = log.glob("*.db3")
        SQLITE_FAULTS[fault](path)
    else:
        log = path = ros1_bag(tmp_path / "log.bag")
        path.write_bytes(ROS1_FAULTS[fault](path.read_bytes()))
    with pytest.raises(DataError) as caught:
        read_log([log], MAPPING, SUPPORTS)
    assert path.name in str(caught.value)
    assert "\n" not in str(caught.value)


@pytest.mark.parametrize("name", ["log.mcap.zstd", "log.csv.zip"])
def test_what_is_compressed_otherwise(tmp_path: Path, name: str) -> None:
    path = write(tmp_path / name, b"")
    for look in (lambda: read_log([path], MAPPING, SUPPORTS), lambda: describe_logs([path])):
        with pytest.raises(UsageError, match=r"(?i)decompress it first.*\.zst"):
            look()


def test_files_that_the_metadata_does_not_list(tmp_path: Path) -> None:
    folder = sqlite_bag(tmp_path / "bag")
    (path,) = folder.glob("*.db3")
    (folder / "bag_1.db3").write_bytes(path.read_bytes())
    log = read_log([folder], MAPPING, SUPPORTS)
    assert_holds(log, TRUTH)
    assert any("also holds bag_1.db3" in warning for warning in in_words(log.findings))


SPLIT = 36  # of 60 positions, in the first file


def part(truth: Truth, begin: int, end: int) -> Truth:
    forces = slice(4 * begin, 4 * end)
    return replace(
        truth,
        time=truth.time[begin:end],
        position=truth.position[:, begin:end],
        force_time=truth.force_time[forces],
        force=truth.force[:, forces],
    )


def by_hand(folder: Path, **changes: Any) -> Path:
    """Two files, as after a split; changes: of the metadata's entries."""
    folder.mkdir()
    names = ["bag_0.mcap", "bag_1.mcap"]
    (folder / names[0]).write_bytes(mcap_bytes(part(TRUTH, 0, SPLIT)))
    (folder / names[1]).write_bytes(mcap_bytes(part(TRUTH, SPLIT, 60)))
    information = {"version": 9, "storage_identifier": "mcap", "relative_file_paths": names}
    kept = {key: value for key, value in (information | changes).items() if value is not None}
    text = yaml.safe_dump({"rosbag2_bagfile_information": kept})
    (folder / "metadata.yaml").write_text(text)
    return folder


def test_split_in_two(tmp_path: Path) -> None:
    log = read_log([by_hand(tmp_path / "bag")], MAPPING, SUPPORTS)
    assert_holds(log, TRUTH)
    assert in_words(log.findings) == ()
    assert [entry.integrity for entry in log.inputs] == ["verified"] * 2


@pytest.mark.parametrize(
    ("changes", "match"),
    [
        ({"storage_identifier": "rocksdb"}, "stored as rocksdb.*bag convert"),
        ({"relative_file_paths": ["bag_0.mcap", "bag_2.mcap"]}, r"lacks bag_2\.mcap\. Copy"),
        ({"relative_file_paths": []}, "lacks any file"),
        ({"relative_file_paths": ["bag_0.mcap"] * 2}, "names a file twice"),
        ({"relative_file_paths": [["bag_0.mcap"]]}, "no description of a rosbag2 recording"),
        ({"relative_file_paths": 3}, "no description of a rosbag2 recording"),
        ({"storage_identifier": None}, "no description of a rosbag2 recording"),
    ],
)
def test_metadata_that_is_wrong(tmp_path: Path, changes: dict[str, Any], match: str) -> None:
    with pytest.raises(DataError, match=match):
        read_log([by_hand(tmp_path / "bag", **changes)], MAPPING, SUPPORTS)


def test_paths_that_carry_the_name_of_the_folder(tmp_path: Path) -> None:
    """As recorders of metadata version 2 write them."""
    folder = by_hand(tmp_path / "bag", relative_file_paths=["bag/bag_0.mcap", "bag/bag_1.mcap"])
    assert_holds(read_log([folder], MAPPING, SUPPORTS), TRUTH)
