"""Exports read back by readers that share no code with them."""

import csv
import io
import json
import re
import shlex
import xml.etree.ElementTree as ET
from pathlib import Path
from typing import Any

import numpy as np
import pytest
import yaml
from scipy.spatial.transform import Rotation

from tdfscal.errors import UsageError
from tdfscal.exports import FORMATS, cautions, csv_table, ros, urdf
from tdfscal.files.calibration.document import Calibration, file_content
from tdfscal.files.calibration.parts import CONVENTIONS
from tdfscal.records import ANGLES
from tests.cli.running import Cli
from tests.reporting.samples import (
    NASTY,
    changed,
    sample,
    saved,
    with_load_cell,
    without_parameters,
)

PLAIN = sample().calibration
CONVENTION = "rotation = Rz(yaw)·Ry(pitch)·Rx(roll)"
READING = np.array([12.0, -34.0, 1600.0])


def scaled() -> Calibration:
    """With sensitivities, and a rig whose name tries to break out of every comment."""
    content = sample(n=6, name=NASTY + " --> */ ??/").calibration.model_dump()
    content |= without_parameters(content)  # which would contradict
    rng = np.random.default_rng(2)
    for support in content["supports"]:
        S = 0.01 * rng.normal(size=(3, 3))
        support["sensitivity"] = (np.eye(3) + (S + S.T) / 2).tolist()
    content["convention"] = CONVENTIONS[True]
    return Calibration.model_validate(content)


SCALED = scaled()
#: The last sensor measures z alone, which leaves its mounting open.
CELL = with_load_cell()
#: Its driver gives the reaction in kN, but for one of its sensors.
LOG = {"force_unit": "kN", "force_on": "sensor", "supports": {
    s.name: {"position": f"{s.name}.p", "force": f"{s.name}.f"} for s in PLAIN.supports
}}  # fmt: skip
LOG["supports"]["support_2"]["force_scale"] = [1.0, 2.0, 4.0]  # type: ignore[index]
DRIVEN = changed(PLAIN, rig=PLAIN.rig.model_dump() | {"log": LOG})
FACTORS = np.array([[-1e3] * 3, [-1.0, -2.0, -4.0], [-1e3] * 3])
ALL = {"plain": PLAIN, "scaled": SCALED, "cell": CELL, "driven": DRIVEN}
EACH = pytest.mark.parametrize("c", ALL.values(), ids=ALL)
BOTH = pytest.mark.parametrize("c", [PLAIN, SCALED], ids=["plain", "scaled"])


def force(c: Calibration, i: int, reading: np.ndarray) -> np.ndarray:
    """F_bcs = rotation · (I + S)⁻¹ · (F_sensor − zero), from the file's numbers."""
    support = c.supports[i]
    load = reading - np.array(support.zero)
    if support.sensitivity is not None:
        load = np.linalg.solve(np.array(support.sensitivity), load)
    return np.asarray(np.array(support.rotation) @ load)


def gains(c: Calibration) -> list[Any]:
    """The sensitivities that were estimated."""
    return [np.array(s.sensitivity).tolist() for s in c.supports if s.sensitivity is not None]


def gains_stated(text: str) -> list[Any]:
    """Those that stand in a comment, to 1 ppm, as not applied."""
    return [yaml.safe_load(m) for m in re.findall(r"sensitivity (\[\[.*\]\]) .*not applied", text)]


@BOTH
def test_urdf(c: Calibration) -> None:
    robot = ET.fromstring(urdf(c, "base"))
    assert robot.tag == "robot"
    joints = robot.findall("joint")
    assert len(joints) == len(c.supports)
    links = {link.get("name") for link in robot.findall("link")}
    for joint, support in zip(joints, c.supports, strict=True):
        parent, child, origin = (joint.find(tag) for tag in ("parent", "child", "origin"))
        assert parent is not None
        assert child is not None
        assert origin is not None
        assert joint.get("type") == "fixed"
        assert parent.get("link") == "base"
        assert {parent.get("link"), child.get("link")} <= links
        rpy = [float(v) for v in str(origin.get("rpy")).split()]
        # URDF: fixed axes, x then y then z
        R = Rotation.from_euler("xyz", rpy).as_matrix()
        np.testing.assert_allclose(R, np.array(support.rotation), rtol=0, atol=1e-14)
    text = urdf(c)
    assert CONVENTION in text
    np.testing.assert_allclose(gains_stated(text), gains(c), rtol=0, atol=5.1e-7)


@pytest.mark.parametrize("c", [PLAIN, SCALED, DRIVEN], ids=["plain", "scaled", "driven"])
def test_ros(c: Calibration) -> None:
    """A broadcaster publishes multiplier · (reading + offset), the force on the terminal less zero;
    the transforms turn it."""
    text = ros(c, "base")
    document = yaml.safe_load(text)
    commands = [
        shlex.split(line.removeprefix("# "))
        for line in text.splitlines()
        if line.startswith("# ros2 ")
    ]
    assert len(commands) == len(document) == len(c.supports)
    for command, (node, told), support in zip(commands, document.items(), c.supports, strict=True):
        assert command[:4] == ["ros2", "run", "tf2_ros", "static_transform_publisher"]
        options = dict(zip(command[4::2], command[5::2], strict=True))
        given = told["ros__parameters"]
        assert options["--frame-id"] == "base"
        assert options["--child-frame-id"] == given["frame_id"]
        assert node == f"{given['frame_id']}_broadcaster"
        R = Rotation.from_quat([float(options[f"--q{a}"]) for a in "xyzw"]).as_matrix()
        np.testing.assert_allclose(R, np.array(support.rotation), rtol=0, atol=1e-14)
        offset = np.array([given["offset"]["force"][axis] for axis in "xyz"])
        assert {type(v) for v in given["offset"]["force"].values()} == {float}
        factor = FACTORS[c.supports.index(support)] if c is DRIVEN else np.ones(3)
        times = given.get("multiplier", {"force": dict.fromkeys("xyz", 1.0)})["force"]
        published = np.array([times[axis] for axis in "xyz"]) * (READING / factor + offset)
        np.testing.assert_allclose(published, READING - np.array(support.zero), rtol=1e-12)
    np.testing.assert_allclose(gains_stated(text), gains(c), rtol=0, atol=5.1e-7)


def test_ros_names_no_axis_that_is_not_measured() -> None:
    """A broadcaster takes an axis without a name for one that the sensor does not have."""
    *_, last = yaml.safe_load(ros(with_load_cell("xz"))).values()
    assert last["ros__parameters"]["frame_id"] == "support_4_tdfs"
    given = last["ros__parameters"]
    assert set(given["interface_names"]["force"]) == set(given["offset"]["force"]) == {"x", "z"}


@EACH
def test_csv(c: Calibration) -> None:
    rows = list(csv.DictReader(io.StringIO(csv_table(c))))
    assert [row["sensor"] for row in rows] == list(c.support_names)
    for i, (row, support) in enumerate(zip(rows, c.supports, strict=True)):
        zero = [row[f"zero_{a}_N"] for a in "xyz"]
        assert zero == ["" if z is None else repr(z) for z in support.zero]
        if not support.determined:
            assert not any(row[name] for name in row if name.startswith(("r_", "roll_deg")))
            continue
        R = np.array([[float(row[f"r_{a}{b}"]) for b in "xyz"] for a in "xyz"])
        assert R.tolist() == np.array(support.rotation).tolist()
        load = READING - np.array(zero, dtype=np.float64)
        if c is SCALED:
            load = (
                np.array([[float(row[f"inv_sensitivity_{a}{b}"]) for b in "xyz"] for a in "xyz"])
                @ load
            )
        np.testing.assert_allclose(R @ load, force(c, i, READING), rtol=1e-12)
        assert row["convention"] == c.convention
        for angle, value, std in zip(ANGLES, support.rpy, support.rpy_std, strict=True):
            given = [float(row[f"{name}_deg"]) for name in (angle, f"std_{angle}")]
            np.testing.assert_allclose(given, np.degrees(np.array([value, std], float)), 1e-12)
        assert float(row["std_zero_z_N"]) == support.zero_std[2]
        assert row["content_sha256"] == file_content(c)["content_sha256"]


@pytest.mark.parametrize("to", FORMATS)
def test_exports_of_an_edited_file_say_so(to: str, tmp_path: Path, cli: Cli) -> None:
    rig = PLAIN.rig.model_dump(mode="json", exclude_none=True)
    rig["supports"][1]["sensor"] = {"serial": "T-7", "due": "2020-01-31"}
    path = saved(changed(PLAIN, rig=rig), tmp_path, "c.json")
    content = json.loads(path.read_text())
    path.write_text(json.dumps(content | {"content_sha256": None}))
    said = " ".join(cli("export", path, "--to", to, ends=0).out.replace("*", " ").split())
    assert "has no `content_sha256`: it was edited" in said
    assert "certificate of support_2's sensor ended on 2020-01-31" in said
    assert str(content["content_sha256"]) not in said


@pytest.mark.parametrize("name", ["", "1st", "a b", "base\n- x", "ä", '"/><x', "support_1_tdfs"])
def test_names_of_frames_are_checked(name: str) -> None:
    """And no sensor is its own parent."""
    for write in (urdf, ros):
        with pytest.raises(UsageError, match="frame of a sensor" if "tdfs" in name else "no name"):
            write(PLAIN, name)


@pytest.mark.parametrize("to", sorted(FORMATS))
@pytest.mark.parametrize("c", [CELL, DRIVEN], ids=["cell", "driven"])
def test_what_is_lacking_is_said(c: Calibration, to: str, tmp_path: Path, cli: Cli) -> None:
    done = cli("export", saved(c, tmp_path, "c.yaml"), "--to", to, ends=0)
    for said in cautions(c):
        assert said in done.out
        assert said in done.err
    assert len(cautions(c)) == 2
