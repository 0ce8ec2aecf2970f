"""`tdfscal info` on joints: pairs by the joints' names, else what to write."""

from __future__ import annotations

import io
import json
from dataclasses import replace
from pathlib import Path

import numpy as np
import pytest
from mcap.writer import Writer

from tdfscal.logs import read_log
from tdfscal.logs.describe import describe_logs
from tdfscal.records import LogMapping
from tests.files.logs.log_making import STORE, definition, wrench_stamped, write

NCPS = 3
TIME = np.arange(400) * 0.01
HINGES = np.array([[0.0, 0.0, 0.0], [2.0, 0.0, 0.0], [0.0, 1.5, 0.0]])
FORCE = np.array([0.0, 0.0, 600.0])


def joint_state(
    seconds: float, names: list[str], position: np.ndarray, effort: np.ndarray, encoding: str
) -> bytes:
    if encoding == "json":
        value = {
            "header": {"stamp": {"sec": int(seconds), "nanosec": round(seconds % 1 * 1e9)}},
            "name": names,
            "position": position.tolist(),
            "velocity": [],
            "effort": effort.tolist(),
        }
        return json.dumps(value).encode()
    types = STORE.types
    stamp = types["builtin_interfaces/msg/Time"](int(seconds), round(seconds % 1 * 1e9))
    header = types["std_msgs/msg/Header"](stamp, "base")
    kind = "sensor_msgs/msg/JointState"
    message = types[kind](header, names, position, np.empty(0), effort)
    return bytes(STORE.serialize_cdr(message, kind))


def recording(
    path: Path,
    names: list[str],
    *,
    encoding: str = "cdr",
    effort: bool = False,
    unused: bool = False,
) -> tuple[Path, np.ndarray]:
    """Joint positions of three NCPs; forces as efforts, or as wrenches in topics of their own."""
    rng = np.random.default_rng(4)
    drift = np.cumsum(rng.normal(size=(TIME.size, 3)), axis=0) * 1e-4
    position = HINGES + drift[:, None, :]
    target = io.BytesIO()
    writer = Writer(target)
    writer.start(profile="ros2")
    kind = "sensor_msgs/msg/JointState"
    if encoding == "cdr":
        schema = writer.register_schema(kind, "ros2msg", definition(kind))
    else:
        schema = writer.register_schema(kind, "jsonschema", b"{}")
    joints = writer.register_channel("/joint_states", encoding, schema)
    kind = "geometry_msgs/msg/WrenchStamped"
    schema = writer.register_schema(kind, "ros2msg", definition(kind))
    wrenches = [writer.register_channel(f"/tdfs{i + 1}/wrench", "cdr", schema) for i in range(NCPS)]
    for k, seconds in enumerate(TIME):
        ns = round(seconds * 1e9)
        force = FORCE + np.arange(NCPS)[:, None]
        data = joint_state(
            seconds,
            names,
            position[k].ravel(),
            force.ravel() if effort else np.zeros(9 if unused else 0),
            encoding,
        )
        writer.add_message(joints, ns, data, ns)
        if not effort:
            for i, channel in enumerate(wrenches):
                writer.add_message(channel, ns, wrench_stamped(seconds, list(force[i])), ns)
    writer.finish()  # type: ignore[no-untyped-call]
    return write(path, target.getvalue()), position


def assert_reads(path: Path, mapping: LogMapping | None, position: np.ndarray) -> None:
    assert mapping is not None
    log = read_log([path], mapping, mapping.supports)
    for i in range(NCPS):
        np.testing.assert_array_equal(log.position[i].value, position[:, i])
        np.testing.assert_array_equal(log.force[i].value, np.tile(FORCE + i, (TIME.size, 1)))


@pytest.mark.parametrize(
    ("form", "encoding"),
    [
        ("ncp{i}_{a}", "cdr"),
        ("leg{i}_{a}_joint", "json"),
        ("{a}{i}", "cdr"),
        ("b/NCP{i}.{a}", "json"),
    ],
)
def test_joints_named_by_axis_are_paired_with_wrenches(
    tmp_path: Path, form: str, encoding: str
) -> None:
    names = [form.format(i=i + 1, a=a) for i in range(NCPS) for a in "xyz"]
    path, position = recording(tmp_path / "log.mcap", names, encoding=encoding)
    guess = describe_logs([path]).guess
    assert guess.mapping is not None
    assert guess.mapping.supports == ("ncp1", "ncp2", "ncp3")
    joints = [form.format(i=2, a=a) for a in "xyz"]
    # A name that is no word stands in brackets.
    paths = [f".{j}" if j.isidentifier() else f"[{j}]" for j in joints]
    assert guess.mapping.position[1] == tuple(f"/joint_states.position{p}" for p in paths)
    brackets = tuple(
        tuple(f"/joint_states.position[{form.format(i=i + 1, a=a)}]" for a in "xyz")
        for i in range(NCPS)
    )
    assert_reads(path, replace(guess.mapping, position=brackets), position)
    assert guess.mapping.force[1] == ("/tdfs2/wrench.wrench.force",)
    assert guess.mapping.time_source == "header"
    assert_reads(path, guess.mapping, position)


def test_efforts_are_forces(tmp_path: Path) -> None:
    names = [f"ncp{i + 1}_{a}" for i in range(NCPS) for a in "xyz"]
    path, position = recording(tmp_path / "log.mcap", names, effort=True)
    mapping = describe_logs([path]).guess.mapping
    assert mapping is not None
    assert mapping.force[2][0] == "/joint_states.effort.ncp3_x"
    assert_reads(path, mapping, position)


def test_names_that_say_nothing_are_shown(tmp_path: Path) -> None:
    names = [f"joint_{k}" for k in "abcdefghi"]
    path, _ = recording(tmp_path / "log.mcap", names)
    info = describe_logs([path])
    assert info.mapping is None
    (none, note) = info.guess.notes
    assert "0 vectors look like positions and 3 like forces" in none
    assert "the joints of /joint_states are joint_a, joint_b" in note
    assert "write position: [/joint_states.position.joint_a, " in note


def test_efforts_that_are_all_zero_are_no_forces(tmp_path: Path) -> None:
    names = [f"ncp{i + 1}_{a}" for i in range(NCPS) for a in "xyz"]
    path, position = recording(tmp_path / "log.mcap", names, unused=True)
    mapping = describe_logs([path]).guess.mapping
    assert mapping is not None
    assert mapping.force[1] == ("/tdfs2/wrench.wrench.force",)
    assert_reads(path, mapping, position)
