"""URDF: a fixed joint per sensor, whose `<origin rpy>` is the calibration."""

from __future__ import annotations

from xml.sax.saxutils import quoteattr

from tdfscal.exports.words import child, frame, number, origin, uncertain
from tdfscal.files.calibration.document import Calibration
from tdfscal.files.escaping import xml_comment, xml_text


def urdf(c: Calibration, parent: str = "bcs") -> str:
    """Return a small robot of one base and a link per sensor; its joints are for pasting.

    URDF's rpy are fixed-axis roll, pitch, yaw, so that R = Rz(yaw)·Ry(pitch)·Rx(roll) takes the
    child's frame to the parent's: the same convention as here.
    """
    base = frame(parent)
    notes = [
        *origin(c),
        "An NCP only translates, so its link has the BCS's axes: paste each joint under that link. "
        "xyz is not calibrated; set it from the drawing.",
        "A rotation alone does not correct a reading: subtract the zero, given with each joint.",
    ]
    lines = ['<?xml version="1.0" encoding="utf-8"?>', "<!--"]
    lines += [f"  {xml_comment(note)}" for note in notes]
    lines += ["-->", f"<robot name={quoteattr(_name(c.rig.name))}>", f'  <link name="{base}"/>']
    for support in c.supports:
        sensor = child(support.name)
        if support.mounting is None:
            continue
        rpy = " ".join(map(number, support.mounting.rpy))
        zero = " ".join(map(number, support.offset))
        said = xml_comment(uncertain(support))
        lines += [
            f'  <link name="{sensor}"/>',
            f"  <!-- zero of {support.name}: {zero} N; {said} -->",
            f'  <joint name="{sensor}_joint" type="fixed">',
            f'    <parent link="{base}"/>',
            f'    <child link="{sensor}"/>',
            f'    <origin xyz="0 0 0" rpy="{rpy}"/>',
            "  </joint>",
        ]
    lines.append("</robot>")
    return "\n".join(lines) + "\n"


def _name(text: str) -> str:
    return "_".join(xml_text(text).split()) or "rig"
