"""`tdfscal info` on joints: pairs by the joints' names."""

from pathlib import Path

import numpy as np
import pytest

from tdfscal.files.rig.recorders import LogBlock
from tdfscal.logs import read_log
from tdfscal.logs.describe import describe_logs
from tests.files.logs.log_making import STORE, ros, small_mcap, wrench_stamped, write

NCPS = 3
TIME = 1.0 + np.arange(400) * 0.01
HINGES = np.array([[0.0, 0.0, 0.0], [2.0, 0.0, 0.0], [0.0, 1.5, 0.0]])
FORCE = np.array([0.0, 0.0, 600.0])
JOINTS = "sensor_msgs/msg/JointState"


def recorded(path: Path, names: list[str], effort: str) -> tuple[Path, np.ndarray]:
    """Joint positions of three NCPs; forces as efforts, or as wrenches in topics of their own.

    effort : "forces", or "zero" beside the wrenches, or "none".
    """
    drift = np.cumsum(np.random.default_rng(4).normal(size=(TIME.size, 3)), axis=0) * 1e-4
    position, force = HINGES + drift[:, None, :], FORCE + np.arange(NCPS)[:, None]
    efforts = {"forces": force, "zero": 0.0 * force, "none": force[:0]}[effort].ravel()
    make, wrench = STORE.types, "geometry_msgs/msg/WrenchStamped"
    channels = {"/joint_states": ros(JOINTS)}
    channels |= {f"/tdfs{i + 1}/wrench": ros(wrench) for i in range(NCPS)}
    messages = []
    for k, seconds in enumerate(TIME):
        stamp = make["builtin_interfaces/msg/Time"](int(seconds), round(seconds % 1 * 1e9))
        arrays = (position[k].ravel(), np.array([]), efforts)
        state = make[JOINTS](make["std_msgs/msg/Header"](stamp, "b"), names, *arrays)
        ns = round(seconds * 1e9)
        messages.append(("/joint_states", ns, bytes(STORE.serialize_cdr(state, JOINTS))))
        for i in range(NCPS if effort != "forces" else 0):
            data = wrench_stamped(seconds, list(force[i]))
            messages.append((f"/tdfs{i + 1}/wrench", ns, data))
    return write(path, small_mcap(channels, messages)), position


@pytest.mark.parametrize(
    ("form", "effort", "force"),
    [
        ("leg{i}_{a}_joint", "none", "/tdfs3/wrench.wrench.force"),
        ("b/NCP{i}.{a}", "none", "/tdfs3/wrench.wrench.force"),
        ("ncp{i}_{a}", "forces", "/joint_states.effort.ncp3_x"),
        ("ncp{i}_{a}", "zero", "/tdfs3/wrench.wrench.force"),  # no sensor reads nothing but 0
    ],
)
def test_joints_named_by_axis(tmp_path: Path, form: str, effort: str, force: str) -> None:
    names = [form.format(i=i + 1, a=a) for i in range(NCPS) for a in "xyz"]
    path, position = recorded(tmp_path / "log.mcap", names, effort)
    guess = describe_logs([path]).guess
    assert guess.supports == ("ncp1", "ncp2", "ncp3")
    (mapping,) = guess.recorders
    fields = {name: dict(mapping.support_fields(name)) for name in guess.supports}
    assert fields["ncp3"]["force"][0] == force
    assert mapping.time.source == "header"
    # A name that is no word stands in brackets; any name may.
    paths = [f".{j}" if j.isidentifier() else f"[{j}]" for j in names[3:6]]
    assert fields["ncp2"]["position"] == tuple(f"/joint_states.position{p}" for p in paths)
    bracketed = [f"/joint_states.position[{j}]" for j in names]
    for k, own in enumerate(fields.values()):
        own["position"] = bracketed[3 * k : 3 * k + 3]
    for read in (mapping, LogBlock.model_validate({"time": mapping.time, "supports": fields})):
        log = read_log([path], read, guess.supports)
        for i in range(NCPS):
            np.testing.assert_array_equal(log.position[i].value, position[:, i])
            np.testing.assert_array_equal(log.force[i].value, np.tile(FORCE + i, (TIME.size, 1)))
