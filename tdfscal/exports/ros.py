"""ROS 2: static transforms as YAML, parameters of a node, and a launch file that publishes."""

from __future__ import annotations

import re

from tdfscal.errors import visible
from tdfscal.exports.words import child, frame, number, origin
from tdfscal.files.calibration.document import Calibration
from tdfscal.files.calibration.parts import Mounting
from tdfscal.files.saving import to_yaml

_PUBLISHER = "ros2 run tf2_ros static_transform_publisher"


def ros_transforms(c: Calibration, parent: str = "bcs") -> str:
    """Return YAML of geometry_msgs/TransformStamped fields; the commands stand in comments.

    A transform's rotation takes coordinates in child_frame_id to frame_id: sensor to BCS.
    """
    base = frame(parent)
    lines = _comments(c, base)
    lines += [f"# {_PUBLISHER} {' '.join(_arguments(support, base))}" for support in c.mounted]
    transforms = [
        {
            "header": {"frame_id": base},
            "child_frame_id": child(support.name),
            "transform": {
                "translation": {"x": 0.0, "y": 0.0, "z": 0.0},
                "rotation": dict(zip("xyzw", support.quaternion, strict=True)),
            },
        }
        for support in c.mounted
    ]
    document: dict[str, object] = {"convention": c.convention, "static_transforms": transforms}
    document["zero"] = {support.name: list(support.offset) for support in c.supports}
    if any(s.sensitivity for s in c.supports):
        rows = {s.name: [list(row) for row in s.sensitivity or ()] for s in c.supports}
        document["sensitivity"] = rows
    return "\n".join(lines) + "\n" + to_yaml(document)


def ros_parameters(c: Calibration, parent: str = "bcs") -> str:
    """Return a parameter file for any node: rotation by rows, quaternion, rpy and zero per sensor.

    Parameters are flat lists of doubles; a sensor without determined rotation is left out.
    """
    base = frame(parent)
    whole = {support.name: support for support in c.supports}
    mountings: dict[str, dict[str, object]] = {}
    for sensor in c.mounted:
        of = whole[sensor.name]
        mountings[sensor.name] = {
            "frame_id": child(sensor.name),
            "rotation": [v for row in sensor.rotation for v in row],
            "quaternion_xyzw": list(sensor.quaternion),
            "rpy": list(sensor.rpy),
            "zero": list(of.offset),
        }
        if of.sensitivity:
            mountings[of.name]["sensitivity"] = [v for row in of.sensitivity for v in row]
    values = {
        "convention": c.convention,
        "frame_id": base,
        "sensors": list(mountings),
        "mounting": mountings,
    }
    text = to_yaml({"/**": {"ros__parameters": {"tdfs_calibration": values}}})
    return "\n".join(_comments(c, base)) + "\n" + text


def ros_launch(c: Calibration, parent: str = "bcs") -> str:
    """Return a Python launch file with one static transform publisher per sensor."""
    base = frame(parent)
    nodes = [
        f"""        Node(
            package="tf2_ros",
            executable="static_transform_publisher",
            name={_node(support.name)!r},
            arguments={_arguments(support, base)!r},
        ),"""
        for support in c.mounted
    ]
    return "\n".join(
        [
            *_comments(c, base),
            "# A node that turns readings takes the zeros from `--to ros-parameters`:",
            '#     Node(…, parameters=["tdfs_calibration.yaml"])',
            "from launch import LaunchDescription",
            "from launch_ros.actions import Node",
            "",
            "",
            "def generate_launch_description():",
            "    return LaunchDescription([",
            *nodes,
            "    ])",
            "",
        ]
    )


def _comments(c: Calibration, base: str) -> list[str]:
    notes = [
        *origin(c),
        f"Frame {base} has the BCS's axes; the translation is not calibrated and is left at zero.",
        "Subtract a sensor's zero (N) before turning its reading.",
    ]
    return [f"# {visible(note)}" for note in notes]


def _arguments(support: Mounting, base: str) -> list[str]:
    """What static_transform_publisher takes."""
    x, y, z, w = map(number, support.quaternion)
    place = ["--x", "0", "--y", "0", "--z", "0"]
    turn = ["--qx", x, "--qy", y, "--qz", z, "--qw", w]
    return [*place, *turn, "--frame-id", base, "--child-frame-id", child(support.name)]


def _node(support: str) -> str:
    """A node's name: letters, digits and _."""
    return re.sub(r"[^A-Za-z0-9_]", "_", f"mounting_of_{child(support)}")
