"""What the residuals, or the distances between hinges, ask for that the rig file does not state."""

from __future__ import annotations

from tdfscal.catalogue.entry import Entry

_HARM = "({p}), which would move {angle} by {shift:.1f} of its standard uncertainties"
_MORE = (
    ("zero", " and the zero {zero} by {zero_shift:.1f}"),
    ("held", "; till it is mended, the stated uncertainty holds that move"),
    ("slip", "; a slip explains it as well"),
)


def _suspected(what: str, cure: str) -> Entry:
    """Something that the residuals ask for; harmful, it rejects."""
    return Entry(
        "warns", f"the residuals say {{tied:about as well that|that}} {what} {_HARM}", cure, _MORE
    )


def _placed(what: str, cure: str) -> Entry:
    """Something that the distances between hinges ask for."""
    said = "the distances between hinges say {tied:about as well that|that}"
    return Entry(
        "warns",
        f"{said} {what} {_HARM}",
        cure,
        (*_MORE, ("elsewhere", "; other distances disagree too")),
    )


def _over_time(name: str, one: str, all_: str, cure: str) -> dict[str, Entry]:
    """Zeros that move: of one sensor, or of all."""
    return {f"zero-{name}": _suspected(one, cure), f"zeros-{name}": _suspected(all_, cure)}


_ALIGN = (
    "align it, or calibrate the positioner; hinge distances show no error that all positioners "
    "share"
)
_FASTEN = (
    "fasten the sensor of {subject}, look at its cable, let it settle, and record the campaign "
    "again"
)

SUSPECTS: dict[str, Entry] = {
    "zero-suspected": _suspected(
        "the zero of {subject} is not what is stated",
        "tare again, or write `zero.std: {stated}` for {subject} in rig.yaml",
    ),
    "sensitivity-suspected": _suspected(
        "gain or crosstalk of {subject} is not what is stated",
        "have the sensor of {subject} checked, or write `uncertainty.force_sensitivity: {stated}` "
        "in rig.yaml",
    ),
    "gain-suspected": _suspected(
        "the gain of {subject} is not what is stated",
        "have the sensor of {subject} checked, or write `uncertainty.force_sensitivity: {stated}` "
        "in rig.yaml",
    ),
    "mounting-suspected": _suspected(
        "the sensor of {subject} is not mounted as stated",
        "see how it sits, and correct `nominal_rpy`, or write `rpy_std: {stated}` for {subject} in "
        "rig.yaml",
    ),
    "mass-suspected": _suspected(
        "the mass is not what is stated",
        "weigh again, or write `terminal.mass.std: {stated}` in rig.yaml",
    ),
    "barycentre-suspected": _suspected(
        "the barycentre is not where it is stated",
        "correct it, or write `terminal.barycenter.std: {stated}` in rig.yaml",
    ),
    "hinge-suspected": _suspected(
        "the hinge of {subject} is not where it is stated",
        "measure the hinges again, or write `uncertainty.hinge: {stated}` in rig.yaml",
    ),
    "datum-suspected": _suspected(
        "the servo coordinates of {subject} are offset",
        "measure the servo datums, or write `uncertainty.datum: {stated}` in rig.yaml",
    ),
    "tilt-suspected": _suspected(
        "gravity is not along -Z of the BCS",
        "level the BCS, or write `gravity.tilt_std: {stated}` in rig.yaml",
    ),
    "compliance-suspected": _suspected(
        "the NCPs give between encoder and hinge",
        "see what is loose, or write `uncertainty.compliance: {{lateral: {stated}, vertical: "
        "{stated}}}` in rig.yaml",
    ),
    "hysteresis-suspected": _suspected(
        "the hinges hold back against the turn by which a posture is reached",
        "see whether the hinges move freely, or write `uncertainty.hinge_moment: {stated}` in "
        "rig.yaml",
    ),
    "hinge-friction-suspected": _suspected(
        "the moments scatter as friction of {stated} N·m in the hinges would make them",
        "see whether the hinges move freely and the NCPs repeat as stated, or write "
        "`uncertainty.hinge_moment: {stated}` in rig.yaml",
    ),
    "force-noise-suspected": _suspected(
        "the forces scatter by {stated} N per axis and posture beyond what is stated",
        "see what shakes or hums, or write `uncertainty.force_noise: {stated}` in rig.yaml",
    ),
    "sensor-noise-suspected": _suspected(
        "the forces of {subject} scatter by {stated} N per axis and posture beyond what is stated",
        "look at the sensor of {subject}, its cable and amplifier, or write "
        "`uncertainty.force_noise: {stated}` in rig.yaml",
    ),
    "positioner-noise-suspected": _suspected(
        "the NCPs repeat {stated} m per axis worse than stated",
        "see what is loose, or write `uncertainty.positioner: {stated}` in rig.yaml",
    ),
    **_over_time(
        "drift",
        "the zero of {subject} drifts over the campaign",
        "the zeros of all sensors drift over the campaign",
        "warm up and tare again, or write `drift.time: .inf` in rig.yaml",
    ),
    **_over_time(
        "temperature",
        "the zero of {subject} follows the temperature",
        "the zeros of all follow the temperature",
        "write `drift.temperature: .inf` in rig.yaml",
    ),
    **_over_time(
        "walk",
        "the zero of {subject} wanders at random",
        "the zeros of all sensors wander at random",
        "let the sensors warm up, tare more often, or write `drift.walk: {stated}` in rig.yaml",
    ),
    **_over_time(
        "parabola",
        "the zero of {subject} drifts other than along a line",
        "the zeros of all sensors drift other than along a line",
        "record faster, or write `drift.walk: {stated}` in rig.yaml",
    ),
    "sensor-slipped": _suspected(
        "the sensor of {subject} turned by {amount:rad} about the BCS's axes before posture "
        "{posture}",
        _FASTEN,
    ),
    "zero-jumped": _suspected(
        "the zero of {subject} jumped by {amount:N} before posture {posture}", _FASTEN
    ),
    "hinge-misplaced": _placed(
        "the hinge of {subject} is not where it is stated, by {size}{or_more: or more|}",
        "measure the hinges again, or write `uncertainty.hinge: {stated}` in rig.yaml",
    ),
    "positions-offset": _placed(
        "the servo coordinates of {subject} are offset, by {size}{or_more: or more|}",
        "measure the servo datums, or write `uncertainty.datum: {stated}` in rig.yaml",
    ),
    "scale-differs": _placed(
        "positions and hinges differ in scale, by {number:.2%}",
        "check the scale of the positioners and of the hinges' survey",
    ),
    "supports-give": _placed(
        "the NCPs give between encoder and hinge, by {size}",
        "see what is loose, or write `uncertainty.compliance: {{lateral: {stated}, vertical: "
        "{stated}}}` in rig.yaml",
    ),
    "frame-turned": _placed(
        "the frame of the positioner of {subject} is turned ({amount:rad} about x, y, z)", _ALIGN
    ),
    "frame-scaled": _placed(
        "the frame of the positioner of {subject} is scaled ({amount:1} along x, y, z)", _ALIGN
    ),
    "frame-not-square": _placed(
        "the frame of the positioner of {subject} is not square ({amount:rad} of yz, xz, xy)",
        _ALIGN,
    ),
}
