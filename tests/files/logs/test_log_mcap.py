"""MCAP logs: every shape of the container, every layout of a message, against other readers."""

import json
from pathlib import Path
from typing import Any

import numpy as np
import pytest
from rosbags.interfaces import Nodetype

from tdfscal.errors import DataError
from tdfscal.files.rig.recorders import LogBlock
from tdfscal.logs import read_log
from tdfscal.logs.messages.buffer import Path as MessagePath
from tdfscal.logs.messages.cdr import Gatherer
from tdfscal.logs.messages.mcap import messages_of
from tdfscal.logs.messages.topics import definitions
from tests.files.logs.log_making import (
    STAMPED,
    STORE,
    definition,
    point_stamped,
    ros,
    small_mcap,
    wrench_stamped,
    write,
)


def one_support(position: str | list[str], force: str, source: str = "log") -> LogBlock:
    fields = {"position": position, "force": force}
    return LogBlock.model_validate({"time": {"source": source}, "supports": {"a": fields}})


@pytest.mark.parametrize(
    ("kind", "path"),
    [
        ("geometry_msgs/msg/WrenchStamped", (("header", "stamp", "sec"), ("wrench", "force", "y"))),
        (
            "geometry_msgs/msg/PoseStamped",
            (("pose", "orientation", "w"), ("pose", "position", "x")),
        ),
        ("geometry_msgs/msg/Vector3Stamped", (("vector", "z"),)),
        ("geometry_msgs/msg/Wrench", (("torque", "x"),)),
        ("sensor_msgs/msg/Imu", (("angular_velocity_covariance", 4), ("linear_acceleration", "z"))),
        ("geometry_msgs/msg/PoseArray", (("poses", 2, "position", "z"),)),
    ],
)
@pytest.mark.parametrize("little", [True, False])
def test_gathering_is_rosbags(kind: str, path: tuple[MessagePath, ...], little: bool) -> None:
    rng = np.random.default_rng(5)
    raw = [bytes(random_message(kind, rng, little)) for _ in range(50)]
    types = definitions(kind, "ros2msg", definition(kind).decode())
    records = b"".join(b"\x05" + (22 + len(r)).to_bytes(8, "little") + bytes(22) + r for r in raw)
    found = Gatherer(types, kind, path)(messages_of(records, lambda *_: None))
    for row, data in zip(found, raw, strict=True):
        message = STORE.deserialize_cdr(data, kind)
        for value, steps in zip(row, path, strict=True):
            node: Any = message
            for step in steps:
                node = node[step] if isinstance(step, int) else getattr(node, str(step))
            assert value == node


def random_message(kind: str, rng: np.random.Generator, little: bool) -> memoryview:
    def make(name: str) -> Any:
        return STORE.types[name](*(value(*node) for _, node in STORE.fielddefs[name][1]))

    def value(node: Nodetype, detail: Any) -> Any:
        if node == Nodetype.NAME:
            return make(detail)
        if node == Nodetype.BASE:
            if detail[0] == "string":
                return "s" * int(rng.integers(0, 5))
            return float(rng.normal()) if "float" in detail[0] else int(rng.integers(0, 100))
        element, size = detail
        if element[0] == Nodetype.NAME:
            return [value(*element) for _ in range(int(rng.integers(3, 6)))]
        return rng.normal(size=size)

    return STORE.serialize_cdr(make(kind), kind, little_endian=little)


def test_time_sources(tmp_path: Path) -> None:
    messages = [
        ("/p", 2_000_000_000, point_stamped(1.25, [1.0, 2.0, 3.0])),
        ("/f", 3_000_000_000, wrench_stamped(1.5, [4.0, 5.0, 6.0])),
    ]
    path = write(tmp_path / "log.mcap", small_mcap(STAMPED, messages))
    for source, times in (
        ("header", (1.25, 1.5)),
        ("log", (2.0, 3.0)),
        ("publish", (1.999999995, 2.999999995)),
    ):
        log = read_log([path], one_support("/p.point", "/f.wrench.force", source), ("a",))
        assert (log.position[0].time[0], log.force[0].time[0]) == times


def test_messages_logged_out_of_order_are_sorted_by_log_time(tmp_path: Path) -> None:
    channels = {"/p": ("json", "x", b"{}")}
    sample = {
        ns: {"p": dict.fromkeys("xyz", ns), "f": dict.fromkeys("xyz", 1)} for ns in (30, 10, 20)
    }
    messages = [("/p", ns, json.dumps(content).encode()) for ns, content in sample.items()]
    path = write(tmp_path / "log.mcap", small_mcap(channels, messages))
    log = read_log([path], one_support("/p.p", "/p.f"), ("a",))
    np.testing.assert_array_equal(log.position[0].value[:, 0], [10.0, 20.0, 30.0])


@pytest.mark.parametrize(
    ("position", "force", "match"),
    [
        ("/q.point", "/f.wrench.force", r"no topic for /q\.point; .*/f"),
        ("/p.pint", "/f.wrench.force", "no field pint .*it has header, point"),
        ("/p.header", "/f.wrench.force", "no field x in .header; it has stamp"),
        ("/p", "/f.wrench.force", "no field x in .*; it has header, point"),
        ("/p.point.x", "/f.wrench.force", "no field x in .point.x; it has no fields"),
        ("/p.point", "/w.force", "no header with a time.*source: log"),
        (
            ["/p.point.x", "/p.point.y", "/f.wrench.force.x"],
            "/f.wrench.force",
            "spread over the topics /f, /p",
        ),
    ],
)
def test_wrong_paths_are_named(
    tmp_path: Path, position: str | list[str], force: str, match: str
) -> None:
    channels = STAMPED | {"/w": ros("geometry_msgs/msg/Wrench")}
    vector = STORE.types["geometry_msgs/msg/Vector3"]
    kind = "geometry_msgs/msg/Wrench"
    wrench = STORE.types[kind](vector(1.0, 2.0, 3.0), vector(1.0, 2.0, 3.0))
    messages = [
        ("/p", 100, point_stamped(1.0, [1.0, 2.0, 3.0])),
        ("/f", 100, wrench_stamped(1.0, [1.0, 2.0, 3.0])),
        ("/w", 100, bytes(STORE.serialize_cdr(wrench, kind))),
    ]
    path = write(tmp_path / "log.mcap", small_mcap(channels, messages))
    with pytest.raises(DataError, match=match):
        read_log([path], one_support(position, force, "header"), ("a",))


@pytest.mark.parametrize(
    ("data", "match"),
    [
        (
            wrench_stamped(1.0, [1.0, float("nan"), 3.0]),
            r"at 1 s it holds a number that is not finite \(/f\.wrench\.force\.y\)",
        ),
        (wrench_stamped(1.0, [1.0, 2.0, 3.0])[:-8], "shorter than its type"),
        (
            wrench_stamped(1.0, [1.0, 2.0, 3.0]) + bytes(8),
            "92 bytes where its type takes 84|bytes where",
        ),
        (wrench_stamped(1.0, [1.0, 2.0, 3.0], "f" * 40)[:20], "shorter than its type"),
        (b"\x00\x06" + wrench_stamped(1.0, [1.0, 2.0, 3.0])[2:], "not plain CDR"),
        (b"", "not plain CDR"),
    ],
)
def test_wrong_messages_are_refused(tmp_path: Path, data: bytes, match: str) -> None:
    messages = [
        ("/p", 100, point_stamped(1.0, [1.0, 2.0, 3.0])),
        ("/f", 100, wrench_stamped(0.5, [1.0, 2.0, 3.0])),
        ("/f", 2_000_000_000, data),
    ]
    path = write(tmp_path / "log.mcap", small_mcap(STAMPED, messages))
    mapping = one_support("/p.point", "/f.wrench.force", "header")
    which = "(a message of /f|the message of /f logged at 2 s)"
    with pytest.raises(DataError, match=f"{which} cannot be read.*({match})"):
        read_log([path], mapping, ("a",))


def test_topics_with_dots_and_members_of_lists(tmp_path: Path) -> None:
    channels = {"/a": ("json", "x", b"{}"), "/a.b": ("json", "x", b"{}")}
    messages = [
        ("/a", 10, json.dumps({"list": [{"p": {"x": 1, "y": 2, "z": 3}}]}).encode()),
        ("/a.b", 20, json.dumps({"f": {"x": 4, "y": 5, "z": 6}}).encode()),
    ]
    path = write(tmp_path / "log.mcap", small_mcap(channels, messages))
    log = read_log([path], one_support("/a.list[0].p", "/a.b.f"), ("a",))
    np.testing.assert_array_equal(log.position[0].value, [[1.0, 2.0, 3.0]])
    np.testing.assert_array_equal(log.force[0].value, [[4.0, 5.0, 6.0]])
