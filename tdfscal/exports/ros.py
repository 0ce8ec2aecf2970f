"""ROS 2: parameters of the stock force-torque broadcasters, and the static transforms."""

from __future__ import annotations

import numpy as np

from tdfscal.errors import visible
from tdfscal.exports.thresholds import ContactThresholds
from tdfscal.exports.words import child, frame, number, origin, uncertain
from tdfscal.files.calibration.document import Calibration
from tdfscal.files.calibration.parts import Mounting
from tdfscal.files.saving import to_yaml

_PUBLISHER = "ros2 run tf2_ros static_transform_publisher"


def ros(c: Calibration, parent: str = "bcs", limits: ContactThresholds | None = None) -> str:
    """Return a parameter file, a `force_torque_sensor_broadcaster` per sensor.

    A broadcaster adds its `offset`, so that it stands as −zero. The transforms, whose rotation
    takes coordinates in the sensor's frame to the BCS, stand as commands in comments. A
    sensitivity that was estimated is no parameter of a broadcaster: it stands in the comments too.
    """
    base = frame(parent)
    notes = [
        *origin(c),
        f"Frame {base} has the BCS's axes; the translation is not calibrated and is left at zero.",
        "A broadcaster adds its offset, N, to the reading: it is the zero with its sign turned.",
    ]
    nodes: dict[str, object] = {}
    for support in c.supports:
        if support.mounting is None:
            continue
        sensor = child(support.name)
        notes.append(f"{support.name}: {uncertain(support)}")
        if support.sensitivity is not None:
            rows = [list(map(number, row)) for row in support.sensitivity]
            notes.append(f"{support.name}: sensitivity {rows}, not applied by a broadcaster")
        notes.append(f"{_PUBLISHER} {' '.join(_arguments(support.mounting, base))}")
        offset = {axis: -zero + 0.0 for axis, zero in zip("xyz", support.offset, strict=True)}
        names = {axis: f"{sensor}/force.{axis}" for axis in "xyz"}
        nodes[f"{sensor}_broadcaster"] = {
            "ros__parameters": {
                "frame_id": sensor,
                "interface_names": {"force": names},
                "offset": {"force": offset},
            }
        }
    if limits is not None and limits.bounded:
        notes += limits.notes
        force, torque = (
            dict(zip("xyz", map(float, part), strict=True)) for part in np.split(limits.value, 2)
        )
        nodes["contact_thresholds"] = {"ros__parameters": {"force": force, "torque": torque}}
    return "\n".join(f"# {visible(note)}" for note in notes) + "\n" + to_yaml(nodes)


def _arguments(support: Mounting, base: str) -> list[str]:
    """What static_transform_publisher takes."""
    x, y, z, w = map(number, support.quaternion)
    place = ["--x", "0", "--y", "0", "--z", "0"]
    turn = ["--qx", x, "--qy", y, "--qz", z, "--qw", w]
    return [*place, *turn, "--frame-id", base, "--child-frame-id", child(support.name)]
