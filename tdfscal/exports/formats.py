"""A calibration in the formats of controllers: URDF, ROS 2, CSV, C; what every export states."""

from __future__ import annotations

import csv
import io
import re
from dataclasses import dataclass
from math import degrees
from xml.sax.saxutils import quoteattr

import numpy as np

from tdfscal.errors import UsageError, visible
from tdfscal.files.calibration.document import Calibration
from tdfscal.files.calibration.parts import SupportResult
from tdfscal.files.saving import c_comment, csv_cell, to_yaml, xml_comment, xml_text
from tdfscal.records import ANGLES, BCS_FRAME, LCS_FRAME, FloatArray, sensor_frame
from tdfscal.reporting.traceability import measured_on

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
  <!-- zero of {name}: {zero} N; {said} -->
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
_HEADER = """\
/*
{notes}
 */
#ifndef TDFSCAL_CALIBRATION_H
#define TDFSCAL_CALIBRATION_H

#define TDFSCAL_SENSORS {count}

static const char *const tdfscal_sensor[TDFSCAL_SENSORS] = {{{names}}};

static const double tdfscal_rotation[TDFSCAL_SENSORS][3][3] = {rotation};

static const double tdfscal_matrix[TDFSCAL_SENSORS][3][3] = {matrix};

/* N, sensor frames */
static const double tdfscal_zero[TDFSCAL_SENSORS][3] = {zero};

{thresholds}
/* Force of sensor i on the terminal in the BCS, N; reading and force may be one array. */
static inline void tdfscal_force_bcs(int i, const double reading[3], double force[3])
{{
    double load[3], sum[3];
    int a, b;
    for (a = 0; a < 3; ++a)
        load[a] = reading[a] - tdfscal_zero[i][a];
    for (a = 0; a < 3; ++a) {{
        sum[a] = 0.0;
        for (b = 0; b < 3; ++b)
            sum[a] += tdfscal_matrix[i][a][b] * load[b];
    }}
    for (a = 0; a < 3; ++a)
        force[a] = sum[a];
}}

#endif
"""


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
        f"{c.software.name} {c.software.version}, {c.method} calibration{measured_on(c)}, created "
        f"{c.created}, {c.status}",
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


def _gain(support: SupportResult) -> str:
    """The sensor's sensitivity, by rows, in words; empty where none was estimated."""
    rows = [list(map(float, row)) for row in support.sensitivity or ()]
    return f"{support.name}: sensitivity {rows}" if rows else ""


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


def urdf(c: Calibration, parent: str = BCS_FRAME) -> str:
    """Return a small robot of one base and a link per sensor; its joints are for pasting.

    URDF's rpy are fixed-axis roll, pitch, yaw, so that R = Rz(yaw)·Ry(pitch)·Rx(roll) takes the
    child's frame to the parent's: the same convention as here.
    """
    base = frame(parent)
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
            name=support.name,
            gain=f"  <!-- {gain}, not applied by URDF -->\n" if (gain := _gain(support)) else "",
            zero=" ".join(map(number, support.offset)),
            said=xml_comment(uncertain(support)),
            base=base,
            rpy=" ".join(map(number, support.rpy)),
        )
        for support in determined(c)
    ]
    return _URDF.format(
        notes="\n".join(f"  {xml_comment(note)}" for note in notes),
        robot=quoteattr("_".join(xml_text(c.rig.name).split()) or "rig"),
        base=base,
        joints="".join(joints),
    )


def ros(c: Calibration, parent: str = BCS_FRAME, limits: ContactThresholds | None = None) -> str:
    """Return a parameter file, a `force_torque_sensor_broadcaster` per sensor.

    A broadcaster adds its `offset`, so that it stands as −zero. The transforms, whose rotation
    takes coordinates in the sensor's frame to the BCS, stand as commands in comments. A
    sensitivity that was estimated is no parameter of a broadcaster: it stands in the comments too.
    """
    base = frame(parent)
    notes = [
        *origin(c),
        f"Frame {base} has the BCS's axes; the translation is not calibrated and is left at zero.",
        f"Frame {LCS_FRAME}, in which `tdfscal apply` writes wrenches, moves with the terminal.",
        "A broadcaster adds its offset, N, to the reading: it is the zero with its sign turned.",
    ]
    nodes: dict[str, object] = {}
    for support in determined(c):
        name, sensor = support.name, sensor_frame(support.name)
        notes.append(f"{name}: {uncertain(support)}")
        if gain := _gain(support):
            notes.append(f"{gain}, not applied by a broadcaster")
        turn = map(number, support.quaternion_xyzw or ())
        notes.append(_TRANSFORM.format(*turn, base=base, sensor=sensor))
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


def csv_table(c: Calibration) -> str:
    """Return a row per sensor: r_xx … r_zz, zero in N, inverse sensitivity u_xx … u_zz; roll,
    pitch, yaw in degrees, their standard uncertainties in rad, the zero's in N; convention.

    F_bcs = r · u · (F_sensor − zero); u = (I + S)⁻¹ stands only where a sensitivity was estimated.
    """
    scaled, entries = _scaled(c), [f"{a}{b}" for a in "xyz" for b in "xyz"]
    header = ["sensor", *(f"r_{e}" for e in entries), *(f"zero_{a}" for a in "xyz")]
    header += [f"u_{e}" for e in entries] if scaled else []
    header += [f"{angle}_deg" for angle in ANGLES] + [f"std_{angle}" for angle in ANGLES]
    header += [f"std_zero_{a}" for a in "xyz"]
    stream = io.StringIO()
    writer = csv.writer(stream, lineterminator="\n")
    writer.writerow([*header, "status", "created", "convention"])
    for support in determined(c):
        scale = np.eye(3) if support.sensitivity is None else np.array(support.sensitivity)
        numbers = [
            *np.ravel(support.rotation),  # type: ignore[arg-type]
            *support.offset,
            *(np.linalg.inv(scale).ravel() if scaled else ()),
            *np.degrees(np.array(support.rpy, dtype=np.float64)),
            *support.rpy_std,
            *support.zero_std,
        ]
        cells = [csv_cell(support.name), *map(number, numbers)]
        writer.writerow([*cells, c.status, c.created, c.convention])
    return stream.getvalue()


def c_header(c: Calibration, limits: ContactThresholds | None = None) -> str:
    """Return a C99 and C++ header without dependencies.

    tdfscal_matrix is the rotation, times the inverse sensitivity where one was estimated.
    """
    rotation = c.rotation[c.determined]
    matrix = rotation @ np.linalg.inv(c.sensitivity[c.determined]) if _scaled(c) else rotation
    notes = [
        *origin(c),
        "For C99 and later, and C++.",
        "Rows of a matrix are the BCS's axes, columns the sensor's.",
        *(f"{support.name}: {uncertain(support)}" for support in determined(c)),
    ]
    thresholds = ""
    if limits is not None and limits.bounded:
        row = _initialiser(limits.value)
        thresholds = f"/*\n{_remarks(limits.notes)}\n */\n"
        thresholds += f"static const double tdfscal_threshold[6] = {row};\n"
    return _HEADER.format(
        notes=_remarks(notes),
        count=len(rotation),
        names=", ".join(f'"{support.name}"' for support in determined(c)),
        rotation=_initialiser(rotation),
        matrix=_initialiser(matrix),
        zero=_initialiser(c.zero[c.determined]),
        thresholds=thresholds,
    )


def _remarks(notes: list[str] | tuple[str, ...]) -> str:
    return "\n".join(f" * {c_comment(note)}" for note in notes)


def _initialiser(values: FloatArray) -> str:
    """An array of C, the rows of a table or matrix on lines of their own."""
    if values.ndim == 1:
        return f"{{{', '.join(map(number, values))}}}"
    if values.ndim == 2:
        return "{\n" + ",\n".join(f"    {_initialiser(row)}" for row in values) + "\n}"
    blocks = (",\n     ".join(map(_initialiser, matrix)) for matrix in values)
    return "{\n" + ",\n".join(f"    {{{block}}}" for block in blocks) + "\n}"


def _scaled(c: Calibration) -> bool:
    """A sensitivity was estimated."""
    return any(support.sensitivity for support in c.supports)
