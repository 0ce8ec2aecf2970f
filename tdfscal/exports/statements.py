"""What every export states: words of origin and uncertainty, thresholds, names of frames."""

from __future__ import annotations

import re
from dataclasses import dataclass
from math import degrees

import numpy as np

from tdfscal.errors import UsageError
from tdfscal.files.calibration.document import Calibration
from tdfscal.files.calibration.parts import SupportResult
from tdfscal.records import ANGLES, FloatArray

_FRAME = re.compile(r"[A-Za-z_][A-Za-z0-9_/-]*")


@dataclass(frozen=True, slots=True)
class ContactThresholds:
    """What a contact-free wrench stays below but for so many stops an hour, on each axis.

    value : (6,), N and N·m, LCS. about : (3,), m, LCS. false_stops : per hour. path : what they
    hold for.
    """

    value: FloatArray
    about: tuple[float, float, float]
    false_stops: float
    path: str

    @property
    def bounded(self) -> bool:
        """Every one of them is known."""
        return bool(np.isfinite(self.value).all())

    @property
    def notes(self) -> tuple[str, ...]:
        """What to know of them."""
        place = ", ".join(f"{x:g}" for x in self.about)
        return (
            "Thresholds of the contact wrench, fx, fy, fz, mx, my, mz, N and N·m, LCS, moments "
            f"about ({place}) m: at most {self.false_stops:g} false stops an hour and axis,",
            f"{self.path}.",
        )


def origin(c: Calibration) -> list[str]:
    """Lines that say what the numbers are, from what, and how to use them."""
    lines = [
        f"Installation rotations of the force sensors of: {c.rig.name}",
        f"{c.software.name} {c.software.version}, method {c.method}, created {c.created}, "
        f"{c.status}",
        c.convention,
        "rotation takes a sensor's frame to the BCS; roll, pitch, yaw in rad, zero in N",
    ]
    if c.undetermined:
        lines.append(f"without {', '.join(c.undetermined)}: its axes determine no mounting")
    if c.status == "rejected":
        lines.append("REJECTED by the quality gate: not for use on a machine")
    return lines


def determined(c: Calibration) -> tuple[SupportResult, ...]:
    """The sensors that have a rotation: the others have no entry."""
    return tuple(support for support in c.supports if support.determined)


def uncertain(support: SupportResult) -> str:
    """Roll, pitch, yaw in degrees and the zero in N, each with its standard uncertainty."""
    angles = [
        f"{name} {degrees(value or 0.0):.4f}° ± "
        + ("not separable" if std is None else f"{1e3 * std:.3f} mrad")
        for name, value, std in zip(ANGLES, support.rpy, support.rpy_std, strict=True)
    ]
    zeros = [
        f"{value:.3f} ± {'open' if std is None else f'{std:.3f}'}"
        for value, std in zip(support.zero, support.zero_std, strict=True)
        if value is not None
    ]
    return f"{', '.join(angles)}; zero {', '.join(zeros)} N (k = 1)"


def number(value: float | None) -> str:
    """Return the shortest text that reads back as the same double; none of what is not known."""
    return "" if value is None else repr(float(value))


def frame(name: str) -> str:
    """Return a frame's name as it is. Raises UsageError for one that URDF or ROS cannot hold."""
    if not _FRAME.fullmatch(name):
        raise UsageError(
            f"{name!r} is no name of a frame",
            where="--parent",
            hint="use letters, digits, _ and /, a letter first",
        )
    return name
