"""What every export states of its numbers."""

from __future__ import annotations

from math import degrees, isnan

import numpy as np

from tdfscal.catalogue import sentence
from tdfscal.files.calibration.document import Calibration
from tdfscal.files.calibration.parameters import calibrated
from tdfscal.files.calibration.parts import SupportResult
from tdfscal.findings import Finding
from tdfscal.logs.request import signal_of
from tdfscal.records import ANGLES, FloatArray
from tdfscal.reporting.traceability import doubts, measured_on, report_digest
from tdfscal.wrench.contact_wrench import unknown_components


def origin(c: Calibration) -> list[str]:
    """Lines that say what the numbers are, from what, and how to use them."""
    lines = [
        f"Installation rotations of the force sensors of: {c.rig.name}",
        f"{c.software.name} {c.software.version}, {c.method} calibration{measured_on(c)}, created "
        f"{c.created}, {c.status}, {content_digest(c)}",
        c.convention,
        "rotation takes a sensor's frame to the BCS; roll, pitch, yaw in rad, zero in N",
        *cautions(c),
    ]
    if c.status == "rejected":
        lines.append("REJECTED by the quality gate: not for use on a machine")
    return lines


def content_digest(c: Calibration) -> str:
    """The digest of the content; of a file that keeps none it vouches for nothing."""
    own = " as it was read; the file itself keeps none" if c.unsealed else ""
    return f"content SHA-256 {report_digest(c)}{own}"


def cautions(c: Calibration) -> list[str]:
    """What a user of the numbers must know, do without, and do to a reading first."""
    said, given = list(doubts(c)), calibrated(c)
    if c.undetermined:
        said.append(f"without {', '.join(c.undetermined)}: its axes determine no mounting")
    if not given.rig.axes.all():
        said.append(sentence(Finding("wrench-in-part", unknown_components(given))))
    turned: dict[str, list[str]] = {}
    for name, factors in zip(c.support_names, driver_factors(c).tolist(), strict=True):
        if factors != [1.0] * 3:
            each = (f"{axis} by {f:.15g}" for axis, f in zip("xyz", factors, strict=True))
            same = len(set(factors)) == 1
            turned.setdefault(f"by {factors[0]:.15g}" if same else ", ".join(each), []).append(name)
    said += [
        f"MULTIPLY the readings of {', '.join(names)}, as the rig's log has them, {factors}, to "
        "have the force on the terminal in N"
        for factors, names in turned.items()
    ]
    return said


def driver_factors(c: Calibration) -> FloatArray:
    """Return (n, 3), N on the terminal per unit of a reading as the rig's log block has it."""
    factors = np.ones((len(c.supports), 3))
    for log in c.loaded_rig().log:
        for i, fields in enumerate(log.force):
            if fields:
                factors[i] = signal_of(log, "force", i, fields).factors
    return factors


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
        "not measured"
        if value is None
        else f"{value:.3f} ± {'open' if std is None else f'{std:.3f}'}"
        for value, std in zip(support.zero, support.zero_std, strict=True)
    ]
    return f"{', '.join(angles)}; zero {', '.join(zeros)} N (k = 1)"


def gain(support: SupportResult) -> str:
    """The sensor's sensitivity, by rows, in words; empty where none was estimated."""
    rows = [list(map(float, row)) for row in support.sensitivity or ()]
    return f"{support.name}: sensitivity {rows}" if rows else ""


def number(value: float | None) -> str:
    """Return the shortest text that reads back as the same double; none of what is not known."""
    return "" if value is None or isnan(value) else repr(float(value))
