"""A calibration in the formats of controllers: URDF, ROS 2, CSV."""

from __future__ import annotations

import csv
import io
import re
from collections.abc import Callable
from math import degrees, isnan
from xml.sax.saxutils import quoteattr

import numpy as np

from tdfscal.catalogue import sentence
from tdfscal.catalogue.numbers import estimated, two_digits, with_std
from tdfscal.errors import UsageError, visible
from tdfscal.files.calibration.document import Calibration
from tdfscal.files.calibration.parameters import calibrated
from tdfscal.files.calibration.parts import SupportResult
from tdfscal.files.saving import csv_cell, to_yaml, xml_comment, xml_text
from tdfscal.findings import Finding
from tdfscal.logs.log_file import signal_of
from tdfscal.records import ANGLES, BCS_FRAME, LCS_FRAME, FloatArray, sensor_frame
from tdfscal.reporting.calibration import gain_std
from tdfscal.reporting.headline import exact_names
from tdfscal.reporting.traceability import digest_told, doubts, measured_on, report_digest
from tdfscal.wrench.contact_wrench import unknown_components

_FRAME = re.compile(r"[A-Za-z_][A-Za-z0-9_/-]*")
_URDF = """\
<?xml version="1.0" encoding="utf-8"?>
<!--
{notes}
-->
<robot name={robot}>
  <link name="{base}"/>
{joints}</robot>
"""
_JOINT = """\
  <link name="{sensor}"/>
  <!-- {said} -->
{gain}  <joint name="{sensor}_joint" type="fixed">
    <parent link="{base}"/>
    <child link="{sensor}"/>
    <origin xyz="0 0 0" rpy="{rpy}"/>
  </joint>
"""
_TRANSFORM = (
    "ros2 run tf2_ros static_transform_publisher --x 0 --y 0 --z 0 --qx {} --qy {} --qz {} --qw {} "
    "--frame-id {base} --child-frame-id {sensor}"
)


def frame(name: str, c: Calibration) -> str:
    """A parent frame's name; UsageError where URDF or ROS cannot hold it, or a sensor has it."""
    if not _FRAME.fullmatch(name):
        what, hint = (
            f"{name!r} is no name of a frame",
            "use letters, digits, _ and /, a letter first",
        )
        raise UsageError(what, where="--parent", hint=hint)
    if name in map(sensor_frame, c.support_names):
        what, hint = f"{name} is the frame of a sensor itself", "name the frame that they stand in"
        raise UsageError(what, where="--parent", hint=hint)
    return name


def urdf(c: Calibration, parent: str = BCS_FRAME) -> str:
    """Return a small robot of one base and a link per sensor; its joints are for pasting.

    URDF's rpy are fixed-axis roll, pitch, yaw, so that R = Rz(yaw)·Ry(pitch)·Rx(roll) takes the
    child's frame to the parent's: the same convention as here.
    """
    base = frame(parent, c)
    notes = [
        *origin(c),
        "An NCP only translates, so its link has the BCS's axes: paste each joint under that link. "
        "xyz is not calibrated; set it from the drawing.",
        "A rotation alone does not correct a reading: first subtract the zero, given with each "
        "joint, and multiply by the inverse of the sensitivity where one is given.",
    ]
    joints = [
        _JOINT.format(
            sensor=sensor_frame(support.name),
            gain=f"  <!-- {told}, not applied by URDF -->\n" if (told := gain(c, i)) else "",
            said=xml_comment(f"{support.name}: {uncertain(support)}"),
            base=base,
            rpy=" ".join(map(number, support.rpy)),
        )
        for i, support in enumerate(c.supports)
        if support.determined
    ]
    return _URDF.format(
        notes="\n".join(f"  {xml_comment(note)}" for note in notes),
        robot=quoteattr("_".join(xml_text(c.rig.name).split()) or "rig"),
        base=base,
        joints="".join(joints),
    )


def ros(c: Calibration, parent: str = BCS_FRAME) -> str:
    """Return a parameter file, a `force_torque_sensor_broadcaster` per sensor.

    A broadcaster adds its `offset` to what the driver reads, and multiplies the sum: the offset
    stands as −zero in the driver's own sign and unit. An axis that is not measured has no name, so
    that it is published as not a number. The transforms, whose rotation takes coordinates in the
    sensor's frame to the BCS, stand as commands in comments, and so does an estimated sensitivity.
    """
    base = frame(parent, c)
    notes = [
        *origin(c),
        f"Frame {base} has the BCS's axes; the translation is not calibrated and is left at zero.",
        f"Frame {LCS_FRAME}, in which `tdfscal apply` writes wrenches, moves with the terminal.",
        "A broadcaster adds its offset to the driver's reading, in sign and unit of that reading "
        "as the rig's log has it; then it multiplies by its multiplier, 1 where none stands.",
    ]
    driver, measured = driver_factors(c), c.rig.record().axes
    if np.any(driver != 1.0):
        notes.append("A broadcaster whose release knows no multiplier leaves sign and unit.")
    nodes: dict[str, object] = {}
    for i, support in enumerate(c.supports):
        if not support.determined:
            continue
        name, sensor = support.name, sensor_frame(support.name)
        notes.append(f"{name}: {uncertain(support)}")
        if told := gain(c, i):
            notes.append(f"{told}, not applied by a broadcaster")
        turn = map(number, support.quaternion_xyzw or ())
        notes.append(_TRANSFORM.format(*turn, base=base, sensor=sensor))
        axes = [axis for axis, has in zip("xyz", measured[i], strict=True) if has]
        factors = dict(zip("xyz", driver[i].tolist(), strict=True))
        offset = {
            axis: -zero / factors[axis] + 0.0
            for axis, zero in zip("xyz", support.zero, strict=True)
            if zero is not None
        }
        given: dict[str, object] = {
            "frame_id": sensor,
            "interface_names": {"force": {axis: f"{sensor}/force.{axis}" for axis in axes}},
            "offset": {"force": offset},
        }
        if np.any(driver[i] != 1.0):
            given["multiplier"] = {"force": {axis: factors[axis] for axis in axes}}
        nodes[f"{sensor}_broadcaster"] = {"ros__parameters": given}
    return "\n".join(f"# {visible(note)}" for note in notes) + "\n" + to_yaml(nodes)


def csv_table(c: Calibration) -> str:
    """Return a row per sensor: r_xx … r_zz, zero, inv_sensitivity_xx … _zz, angles, standard
    uncertainties, ends of the angles' 95 % intervals; what is not known stays empty. The rest of a
    row is alike for all.

    F_bcs = r · inv_sensitivity · (F_sensor − zero), inv_sensitivity = (I + S)⁻¹ only where a
    sensitivity was estimated.
    """
    scaled = any(support.sensitivity for support in c.supports)
    entries = [f"{a}{b}" for a in "xyz" for b in "xyz"]
    zeros, angles = [f"zero_{a}_N" for a in "xyz"], [f"{angle}_deg" for angle in ANGLES]
    header = ["sensor", *(f"r_{e}" for e in entries), *zeros]
    header += [f"inv_sensitivity_{e}" for e in entries] if scaled else []
    header += [*angles, *(f"std_{name}" for name in (*angles, *zeros))]
    header += [*(f"{end}_95_{name}" for end in ("low", "high") for name in angles), "k"]
    common = {
        "status": c.status,
        "measured": c.measured.told[1],
        "measured_by": c.measured.source,
        "created": c.created,
        "software": f"{c.software.name} {c.software.version}",
        "content_sha256": report_digest(c) or "",
        "convention": c.convention,
        "taken_as_exact": exact_names(c),
        "remarks": "; ".join(cautions(c)),
    }
    stream = io.StringIO()
    writer = csv.writer(stream, lineterminator="\n")
    writer.writerow([*header, *common])
    for i, support in enumerate(c.supports):
        ends = support.rpy_interval
        interval = [[None] * 3] * 2 if ends is None else [ends.low, ends.high]
        numbers = [
            *(c.rotation[i].ravel() if support.determined else [None] * 9),
            *support.zero,
            *(np.linalg.inv(c.sensitivity[i]).ravel() if scaled else ()),
            *np.degrees(c.rpy[i]),
            *np.degrees(np.array(support.rpy_std, dtype=np.float64)),
            *support.zero_std,
            *np.degrees(np.array(interval, dtype=np.float64).ravel()),
        ]
        cells = map(csv_cell, (support.name, *map(visible, common.values())))
        writer.writerow([next(cells), *map(number, numbers), "1", *cells])
    return stream.getvalue()


def origin(c: Calibration) -> list[str]:
    """Lines that say what the numbers are, from what, and how to use them."""
    lines = [
        f"Installation rotations of the force sensors of: {c.rig.name}",
        f"{c.software.name} {c.software.version}, {c.method} calibration{measured_on(c)}, created "
        f"{c.created}, {c.status}, content {digest_told(c)}",
        c.convention,
        "rotation takes a sensor's frame to the BCS; roll, pitch, yaw in rad, zero in N",
        f"taken as exact: {exact_names(c)}",
        *cautions(c),
    ]
    if c.status == "rejected":
        lines.append("REJECTED by the quality gate: not for use on a machine")
    return lines


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
    for log in c.rig.log or ():
        for i, name in enumerate(c.support_names):
            if fields := log.support_fields(name).force:
                factors[i] = signal_of(log, "force", name, fields).factors
    return factors


def uncertain(support: SupportResult) -> str:
    """Roll, pitch, yaw in degrees and the zero in N, each with its standard uncertainty."""
    angles = [
        f"{name} {degrees(value or 0.0):.4f}° ± not separable"
        if std is None
        else f"{name} {with_std(degrees(value or 0.0), degrees(std))}°"
        for name, value, std in zip(ANGLES, support.rpy, support.rpy_std, strict=True)
    ]
    zeros = map(estimated, support.zero, support.zero_std)
    return f"{', '.join(angles)}; zero {', '.join(zeros)} N (k = 1)"


def gain(c: Calibration, i: int) -> str:
    """A sensor's sensitivity by rows, to 1 ppm, in words; empty where none was estimated."""
    support = c.supports[i]
    if support.sensitivity is None:
        return ""
    rows = ", ".join(f"[{', '.join(f'{x:.6f}' for x in row)}]" for row in c.sensitivity[i])
    most = two_digits(gain_std(c)[i].max())
    return f"{support.name}: sensitivity [{rows}] ± {most} at most (k = 1)"


def number(value: float | None) -> str:
    """Return the shortest text that reads back as the same double; none of what is not known."""
    return "" if value is None or isnan(value) else repr(float(value))


FORMATS: dict[str, Callable[[Calibration, str], str]] = {
    "urdf": urdf,
    "ros": ros,
    "csv": lambda calibration, parent: csv_table(calibration),
}
"""Format → writer of (calibration, parent frame)."""
SUFFIXES = {"urdf": (".urdf", ".xacro", ".xml"), "ros": (".yaml", ".yml"), "csv": (".csv",)}
"""Format → what its file's name may end in."""
