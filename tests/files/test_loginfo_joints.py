"""`tdfscal info` on joints: pairs by the joints' names."""

import io
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
JOINTS = "sensor_msgs/msg/JointState"


def joint_state(
    seconds: float, names: list[str], position: list[float], effort: list[float]
) -> bytes:
    sec, nanosec = int(seconds), round(seconds % 1 * 1e9)
    types = STORE.types
    header = types["std_msgs/msg/Header"](types["builtin_interfaces/msg/Time"](sec, nanosec), "b")
    arrays = (np.array(values) for values in (position, [], effort))
    return bytes(STORE.serialize_cdr(types[JOINTS](header, names, *arrays), JOINTS))


def recording(path: Path, names: list[str], effort: str = "none") -> tuple[Path, np.ndarray]:
    """Joint positions of three NCPs; forces as efforts, or as wrenches in topics of their own.

    effort : "forces", or "zero" beside the wrenches, or "none".
    """
    drift = np.cumsum(np.random.default_rng(4).normal(size=(TIME.size, 3)), axis=0) * 1e-4
    position = HINGES + drift[:, None, :]
    force = FORCE + np.arange(NCPS)[:, None]
    efforts = {"forces": force, "zero": 0.0 * force, "none": force[:0]}[effort].ravel().tolist()
    target = io.BytesIO()
    writer = Writer(target)
    writer.start(profile="ros2")
    schema = writer.register_schema(JOINTS, "ros2msg", definition(JOINTS))
    joints = writer.register_channel("/joint_states", "cdr", schema)
    kind = "geometry_msgs/msg/WrenchStamped"
    schema = writer.register_schema(kind, "ros2msg", definition(kind))
    wrenches = [writer.register_channel(f"/tdfs{i + 1}/wrench", "cdr", schema) for i in range(NCPS)]
    for k, seconds in enumerate(TIME):
        ns = round(seconds * 1e9)
        data = joint_state(seconds, names, position[k].ravel().tolist(), efforts)
        writer.add_message(joints, ns, data, ns)
        for i, channel in enumerate(wrenches if effort != "forces" else []):
            writer.add_message(channel, ns, wrench_stamped(seconds, list(force[i])), ns)
    writer.finish()  # type: ignore[no-untyped-call]
    return write(path, target.getvalue()), position


def assert_reads(path: Path, mapping: LogMapping | None, position: np.ndarray) -> None:
    assert mapping is not None
    log = read_log([path], mapping, mapping.supports)
    for i in range(NCPS):
        np.testing.assert_array_equal(log.position[i].value, position[:, i])
        np.testing.assert_array_equal(log.force[i].value, np.tile(FORCE + i, (TIME.size, 1)))


@pytest.mark.parametrize("form", ["leg{i}_{a}_joint", "b/NCP{i}.{a}"])
def test_joints_named_by_axis_are_paired_with_wrenches(tmp_path: Path, form: str) -> None:
    names = [form.format(i=i + 1, a=a) for i in range(NCPS) for a in "xyz"]
    path, position = recording(tmp_path / "log.mcap", names)
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


@pytest.mark.parametrize(
    ("effort", "force"),
    [("forces", "/joint_states.effort.ncp3_x"), ("zero", "/tdfs3/wrench.wrench.force")],
)
def test_efforts_are_forces_unless_all_are_zero(tmp_path: Path, effort: str, force: str) -> None:
    names = [f"ncp{i + 1}_{a}" for i in range(NCPS) for a in "xyz"]
    path, position = recording(tmp_path / "log.mcap", names, effort=effort)
    mapping = describe_logs([path]).guess.mapping
    assert mapping is not None
    assert mapping.force[2][0] == force
    assert_reads(path, mapping, position)
