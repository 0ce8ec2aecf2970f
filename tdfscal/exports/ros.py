"""ROS 2: static transforms as YAML, and the commands that publish them."""

from __future__ import annotations

from tdfscal.exports.words import child, frame, number, origin
from tdfscal.files.calibration.document import Calibration
from tdfscal.files.escaping import yaml_comment
from tdfscal.files.saving import to_yaml

_PUBLISHER = "ros2 run tf2_ros static_transform_publisher"


def ros_transforms(c: Calibration, parent: str = "bcs") -> str:
    """Return YAML of geometry_msgs/TransformStamped fields; the commands stand in comments.

    A transform's rotation takes coordinates in child_frame_id to frame_id: sensor to BCS.
    """
    base = frame(parent)
    notes = [
        *origin(c),
        f"Frame {base} has the BCS's axes; the translation is not calibrated and is left at zero.",
        "Subtract a sensor's zero (N) before turning its reading.",
    ]
    lines = [f"# {yaml_comment(note)}" for note in notes]
    for support in c.mounted:
        x, y, z, w = map(number, support.quaternion)
        lines.append(
            f"# {_PUBLISHER} --x 0 --y 0 --z 0 --qx {x} --qy {y} --qz {z} --qw {w} "
            f"--frame-id {base} --child-frame-id {child(support.name)}"
        )
    return "\n".join(lines) + "\n" + to_yaml(_document(c, base))


def _document(c: Calibration, base: str) -> dict[str, object]:
    return {
        "convention": c.convention,
        "static_transforms": [
            {
                "header": {"frame_id": base},
                "child_frame_id": child(support.name),
                "transform": {
                    "translation": {"x": 0.0, "y": 0.0, "z": 0.0},
                    "rotation": dict(zip("xyzw", support.quaternion, strict=True)),
                },
            }
            for support in c.mounted
        ],
        "zero": {support.name: list(support.zero) for support in c.supports},
        **(
            {
                "sensitivity": {
                    s.name: [list(row) for row in s.sensitivity or ()] for s in c.supports
                }
            }
            if any(s.sensitivity for s in c.supports)
            else {}
        ),
    }
