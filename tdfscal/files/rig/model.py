"""The rig file `tdfscal-rig/1` as models: every key, unit, default and bound."""

import math
from collections.abc import Sequence
from itertools import combinations
from typing import Annotated, Any, Literal, Self

import numpy as np
from pydantic import AfterValidator, BeforeValidator, field_validator, model_validator
from typing_extensions import TypeAliasType

from tdfscal.files import field_types as kind
from tdfscal.files.field_types import Known, Strict, block, fault, key
from tdfscal.files.rig.recorders import LogBlocks, TrackerBlock, check_recorders
from tdfscal.records import FloatArray

RIG_FORMAT = "tdfscal-rig/1"

Axis = Literal["x", "y", "z"]
#: Hinges nearer to one line than this part of their extent do not fix the terminal's posture.
_STRAIGHT = 1e-4

_FARTHEST = 100.0
"""m; no terminal reaches farther, and 600 is a millimetre figure."""


def _near(given: tuple[float, float, float]) -> tuple[float, float, float]:
    farthest = max(map(abs, given))
    if farthest > _FARTHEST:
        raise fault(
            f"lies {farthest:g} m from the LCS, too far for a terminal", hint="write it in m"
        )
    return given


PlaceOnTerminal = TypeAliasType("PlaceOnTerminal", Annotated[kind.Vector, AfterValidator(_near)])


class Gravity(Strict):
    """Gravity along −Z of the BCS: magnitude in m/s², tilt_std in rad per horizontal axis."""

    magnitude: kind.PositiveAmount = key("m/s²: along −Z of the BCS", 9.80665)
    tilt_std: kind.Amount = key("rad: levelness of the BCS, per horizontal axis", 0.0)


def check_inertia(given: Any) -> Any:
    """Refuse a (3, 3) that is the inertia of no body: symmetric, positive, triangle inequality."""
    matrix = np.array(given)
    scale = float(np.abs(matrix).max())
    unit = matrix / (scale or 1.0)
    if not np.allclose(unit, unit.T, rtol=0, atol=1e-9):
        raise fault("must be a symmetric matrix", hint="make Ixy = Iyx and so on")
    smallest, middle, largest = np.linalg.eigvalsh(unit) * scale
    if smallest <= 0:
        what = f"must be positive definite; its smallest principal moment is {smallest:.4g}"
        raise fault(what, hint="check the signs of the products of inertia")
    if largest - middle > smallest + 1e-9 * scale:
        raise fault(
            f"is the inertia of no body: the principal moment {largest:.4g} exceeds the sum of "
            f"the other two, {smallest:.4g} and {middle:.4g}",
            hint="check the entries",
        )
    return given


BodyInertia = TypeAliasType("BodyInertia", Annotated[kind.Matrix3, AfterValidator(check_inertia)])
VectorQuantity = Known[kind.Vector, kind.Stds]
MassQuantity = Known[kind.PositiveAmount, kind.Std]
PlaceQuantity = Known[PlaceOnTerminal, kind.Stds]
InertiaQuantity = Known[BodyInertia, kind.Std]


class Terminal(Strict):
    """The terminal with all it carries: mass in kg, barycentre in m in the LCS, inertia."""

    mass: Annotated[MassQuantity, kind.WithStd] = key("kg: quantity")
    barycenter: Annotated[PlaceQuantity, kind.WithStd] = key("m: quantity, LCS")
    inertia: Annotated[InertiaQuantity, kind.WithStd] | None = key(
        "kg m²: quantity, 3 × 3 about the LCS origin; used in motion only", None
    )


class Campaign(Strict):
    """When, where, by whom and with what data were recorded; date: ISO 8601, a day or a time."""

    date: kind.Date | None = key("ISO 8601; where the log has no wall clock", None)
    operator: kind.Text | None = key("who ran the campaign", None)
    site: kind.Text | None = key("where it was run", None)
    tracker: kind.Label | None = key("serial and certificate of the laser tracker", None)
    scale: kind.Label | None = key("serial and certificate of what weighed the terminal", None)
    note: kind.Text | None = key("anything else to keep with it", None)


class Sensor(Strict):
    """A sensor's papers, carried to report and certificate; due: day of its next calibration."""

    serial: kind.Label | None = key("serial number of the sensor", None)
    certificate: kind.Label | None = key("number of its certificate", None)
    due: kind.Date | None = key("day of its next calibration, ISO 8601", None)


def _angles(given: Any) -> Any:
    if isinstance(given, (list, tuple)) and any(
        isinstance(angle, (int, float)) and 2 * math.pi < abs(angle) < math.inf for angle in given
    ):
        raise fault("an angle beyond 2π: roll, pitch and yaw are in rad", hint="convert degrees")
    return given


Angles = Annotated[kind.Vector, BeforeValidator(_angles)]


class Support(Strict):
    """One NCP with its TDFS: hinge in m in the LCS, zero and capacity in N, angles in rad."""

    name: kind.Name = key("letters, digits, _ and -")
    hinge: PlaceOnTerminal = key("m: SHC in the LCS")
    zero: Annotated[VectorQuantity, kind.WithStd] = block(
        "N: quantity, reading without load, sensor frame",
        VectorQuantity,
        value=(0.0, 0.0, 0.0),
        std=(math.inf,) * 3,
    )
    nominal_rpy: Angles = key("rad: nominal mounting", (0.0, 0.0, 0.0))
    rpy_std: kind.Stds = key(
        "rad: prior about the nominal mounting",
        (math.inf,) * 3,
        json_schema_extra={"default": kind.UNKNOWN},
    )
    capacity: kind.PositiveVector | None = key(
        "N: full scale; a reading beyond it is saturated", None
    )
    axes: tuple[Axis, ...] = key(
        "what the sensor measures; [z] is a load cell, [] no sensor", ("x", "y", "z")
    )
    sensor: Sensor | None = key("the sensor's papers, carried to report and certificate", None)

    @field_validator("axes")
    @classmethod
    def _each_once(cls, given: tuple[Axis, ...]) -> tuple[Axis, ...]:
        if len(set(given)) < len(given):
            raise fault("names an axis twice", hint="list each measured axis once, as in [x, z]")
        return given

    @field_validator("rpy_std")
    @classmethod
    def _open(cls, given: tuple[float, float, float]) -> tuple[float, float, float]:
        if min(given) <= 0:
            what = "must be above 0: an angle known exactly leaves nothing to calibrate"
            raise fault(what, hint="write how well the mounting is known, or leave it out")
        return given


class Compliance(Strict):
    """What gives between encoder and hinge, m/N, as a standard uncertainty about none."""

    lateral: kind.Amount = key("m/N: sideways", 0.0)
    vertical: kind.Amount = key("m/N: along Z of the BCS", 0.0)


class Uncertainty(Strict):
    """Standard uncertainties that the log's own scatter cannot show."""

    positioner: kind.Amount = key("m: repeatability of an NCP, per axis and posture", 0.0)
    hinge: kind.Amount = key("m: each coordinate of each hinge", 0.0)
    datum: kind.Amount = key("m: constant offset of an NCP's servo coordinates, per axis", 0.0)
    force_noise: kind.Amount = key(
        "N: per axis and posture, beyond the standard error of the mean", 0.0
    )
    force_sensitivity: kind.Amount = key("relative: gain and crosstalk of a sensor", 0.0)
    hinge_moment: kind.Amount = key("N·m: friction of the hinges, per axis and posture", 0.0)
    compliance: Compliance = block("what gives between encoder and hinge", Compliance)


class Drift(Strict):
    """Zeros that move within a campaign, per channel, and angles that do between campaigns."""

    time: kind.Std = key("N/h: standard uncertainty of a slope in time", 0.0)
    temperature: kind.Std = key("N/K: standard uncertainty of a slope against log.temperature", 0.0)
    walk: kind.Amount = key("N/√h: intensity of a random walk", 0.0)
    angle: kind.Amount = key("rad/√month: random walk of the angles between campaigns", 0.0)


class Contact(Strict):
    """Limit of the contact wrench's error at a posture of the terminal: N, N·m, rad."""

    force: kind.PositiveAmount | None = key("N: length of the force's error", None)
    torque: kind.PositiveAmount | None = key("N·m: length of the torque's error", None)
    rpy: Angles = key("rad: that posture of the terminal", (0.0, 0.0, 0.0))

    @model_validator(mode="after")
    def _limits_something(self) -> Self:
        if self.force is None and self.torque is None:
            raise fault("limits neither force nor torque", hint="add `force`, `torque` or both")
        return self


class AcceptanceBlock(Strict):
    """Limits of the quality gate; angles in rad."""

    angle_std: kind.PositiveAmount = key("rad: largest standard uncertainty of an angle", 5.0e-3)
    identifiable: kind.PositiveAmount = key(
        "rad: above it an angle counts as not determined (exit 4)", 0.05
    )
    birge_max: kind.PositiveAmount = key("largest Birge ratio", 2.0)
    contact: Contact | None = key(
        "limit of the contact wrench's error at a posture, guard-banded", None
    )


def check_hinges(names: Sequence[str], hinges: FloatArray) -> None:
    """Refuse hinges (n, 3) in m of which two coincide or which all lie on one line."""
    extent = np.linalg.svd(hinges - hinges.mean(axis=0), compute_uv=False)
    for i, j in combinations(range(len(names)), 2):
        if np.linalg.norm(hinges[i] - hinges[j]) <= _STRAIGHT * extent[0]:
            what = f"the hinges of `{names[i]}` and `{names[j]}` coincide"
            hint = "each NCP holds the terminal at a hinge of its own"
            raise fault(what, "supports", j, "hinge", hint=hint)
    if extent[1] <= _STRAIGHT * extent[0]:
        what = "the hinges lie on one line, which leaves the terminal free to turn about it"
        raise fault(what, "supports", hint="check the hinge coordinates")


def _each_its_own(what: str, values: Sequence[str | None], *place: str) -> None:
    """Refuse what two supports state alike."""
    for index, value in enumerate(values):
        if value is not None and (first := values.index(value)) < index:
            said = f"the {what} `{value}` is taken by supports[{first}]"
            raise fault(said, "supports", index, *place, hint="give it another")


class RigFile(Strict):
    """What is known of the rig (`rig.yaml`), SI units."""

    format: Literal["tdfscal-rig/1"] = key("tdfscal-rig/1")
    name: kind.Text = key("what the rig is called")
    serial: kind.Label | None = key("of the rig", None)
    campaign: Campaign | None = key("when, where and by whom the log was recorded", None)
    gravity: Gravity = block("m/s² along −Z of the BCS, and how level that is", Gravity)
    terminal: Terminal = key("the terminal with all it carries")
    supports: tuple[Support, ...] = key(
        "list of three or more, one NCP with its TDFS each", min_length=3
    )
    uncertainty: Uncertainty = block(
        "standard uncertainties that the log's own scatter cannot show", Uncertainty
    )
    drift: Drift = block("zeros that move within a campaign, per channel", Drift)
    log: LogBlocks | None = key(
        "how the recorder names things; a list of such blocks where there are several", None
    )
    tracker: TrackerBlock | None = key("a survey; paths relative to this file", None)
    acceptance: AcceptanceBlock = block("limits of the quality gate", AcceptanceBlock)
    sha256: kind.Sha256 | None = key("of the rig file, in a calibration", None)
    stated_limits: tuple[str, ...] | None = key(
        "keys of `acceptance` that the rig file stated, in a calibration", None
    )

    @model_validator(mode="after")
    def _fits_together(self) -> Self:
        names = [support.name for support in self.supports]
        _each_its_own("name", names, "name")
        if type(self) is RigFile:  # a calibration file that was written stays of use
            serials = [s.sensor.serial if s.sensor else None for s in self.supports]
            _each_its_own("serial number", serials, "sensor", "serial")
        check_hinges(names, np.array([support.hinge for support in self.supports]))
        check_recorders({s.name: s.axes for s in self.supports}, self.log or ())
        if self.drift.temperature > 0 and all(r.temperature is None for r in self.log or ()):
            what = "zeros that follow a temperature need one"
            hint = "name its field in the log block"
            raise fault(what, "drift", "temperature", hint=hint)
        return self
