"""What every export states in words, and numbers in full precision."""

from __future__ import annotations

import re
from math import degrees

from tdfscal.errors import UsageError
from tdfscal.files.calibration.document import Calibration
from tdfscal.files.calibration.parts import SupportResult
from tdfscal.records import ANGLES

_FRAME = re.compile(r"[A-Za-z_][A-Za-z0-9_/-]*")


def origin(c: Calibration) -> list[str]:
    """Lines that say what the numbers are, from what, and how to use them."""
    program = f"{c.software.name} {c.software.version}"
    lines = [
        f"Installation rotations of the force sensors of: {c.rig.name}",
        f"{program}, method {c.method}, created {c.created}, {c.status}",
        c.convention,
        "rotation takes a sensor's frame to the BCS; roll, pitch, yaw in rad, zero in N",
    ]
    if c.undetermined:
        lines.append(f"without {', '.join(c.undetermined)}: its axes determine no mounting")
    if c.status == "rejected":
        lines.append("REJECTED by the quality gate: not for use on a machine")
    return lines


def uncertain(support: SupportResult) -> str:
    """Roll, pitch, yaw in degrees and the zero in N, each with its standard uncertainty."""
    mounting = support.mounting
    assert mounting is not None  # a sensor without one has no entry
    angles = [
        f"{name} {degrees(value):.4f}° ± "
        + ("not separable" if std is None else f"{1e3 * std:.3f} mrad")
        for name, value, std in zip(ANGLES, mounting.rpy, support.rpy_std, strict=True)
    ]
    zeros = [
        f"{value:.3f} ± {'open' if std is None else f'{std:.3f}'}"
        for value, std in zip(support.zero, support.zero_std, strict=True)
        if value is not None
    ]
    return f"{', '.join(angles)}; zero {', '.join(zeros)} N (k = 1)"


def number(value: float) -> str:
    """Return the shortest text that reads back as the same double."""
    return repr(float(value))


def child(support: str) -> str:
    """Name of a sensor's frame."""
    return f"{support}_tdfs"


def frame(name: str) -> str:
    """Return a frame's name as it is. Raises UsageError for one that URDF or ROS cannot hold."""
    if not _FRAME.fullmatch(name):
        raise UsageError(
            f"{name!r} is no name of a frame",
            where="--parent",
            hint="use letters, digits, _ and /, a letter first",
        )
    return name
