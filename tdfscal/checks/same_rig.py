"""Is the rig of a log the one that was calibrated?"""

from __future__ import annotations

import numpy as np

from tdfscal.errors import UsageError
from tdfscal.records import FloatArray, Rig, UncertainValue
from tdfscal.significance import CONTRADICTION

#: Two numbers that were typed the same agree to this share.
_ROUNDING = 1.0e-9
_GRAVITY = 1.0e-4

#: Standard uncertainties of constants, as the rig file names them.
_CONSTANT_UNCERTAINTIES = {
    "hinge": "hinge",
    "datum": "datum",
    "force_sensitivity": "force_sensitivity",
    "compliance.lateral": "compliance_lateral",
    "compliance.vertical": "compliance_vertical",
}


def contradictions(calibrated: Rig, given: Rig) -> tuple[str, ...]:
    """What of `given` contradicts the calibrated rig, in words; nothing: they agree.

    Compared are the supports, gravity, hinges, nominal mounting, stated zeros, mass and
    barycentre, each within the uncertainties that both state.
    """
    if calibrated.supports != given.supports:
        return (
            f"its supports are {', '.join(given.supports)}, calibrated were "
            f"{', '.join(calibrated.supports)}",
        )
    found = []
    if abs(given.gravity - calibrated.gravity) > _GRAVITY * calibrated.gravity:
        found.append(f"gravity is {given.gravity:g} m/s² instead of {calibrated.gravity:g}")
    hinge_std = np.hypot(calibrated.declared.hinge, given.declared.hinge)
    for i, name in enumerate(given.supports):
        if not _agree(calibrated.hinge[i], given.hinge[i], np.full(3, hinge_std)):
            found.append(
                f"the hinge of {name} is at {_m(given.hinge[i])} m instead of "
                f"{_m(calibrated.hinge[i])}"
            )
        if not _agree(calibrated.nominal_rpy[i], given.nominal_rpy[i], np.zeros(3)):
            found.append(
                f"the nominal mounting of {name} is {_m(given.nominal_rpy[i])} rad instead of "
                f"{_m(calibrated.nominal_rpy[i])}"
            )
        here, there = (UncertainValue(z.value[i], z.std[i]) for z in (calibrated.zero, given.zero))
        if not _known_agree(here, there):
            found.append(
                f"the stated zero of {name} is {_m(there.value)} N instead of {_m(here.value)}"
            )
    if not _known_agree(calibrated.mass, given.mass):
        found.append(f"the mass is {given.mass.value:g} kg instead of {calibrated.mass.value:g}")
    if not _known_agree(calibrated.barycentre, given.barycentre):
        found.append(
            f"the barycentre is at {_m(given.barycentre.value)} m instead of "
            f"{_m(calibrated.barycentre.value)}"
        )
    return tuple(found)


def different_constants(first: Rig, other: Rig) -> tuple[str, ...]:
    """What two rig files state differently of the rig's constants, in words; nothing: one rig.

    Zeros and load may differ from campaign to campaign; supports, hinges, nominal mounting and the
    uncertainties of what stays the same may not.
    """
    if first.supports != other.supports:
        return (
            f"its supports are {', '.join(other.supports)} instead of {', '.join(first.supports)}",
        )
    found = []
    if None not in (first.serial, other.serial) and first.serial != other.serial:
        found.append(f"its serial is {other.serial} instead of {first.serial}")
    for i, name in enumerate(other.supports):
        for what, a, b, unit in (
            ("hinge", first.hinge[i], other.hinge[i], "m"),
            ("nominal mounting", first.nominal_rpy[i], other.nominal_rpy[i], "rad"),
            ("rpy_std", first.rpy_std[i], other.rpy_std[i], "rad"),
        ):
            if not _same(a, b):
                found.append(f"the {what} of {name} is {_m(b)} {unit} instead of {_m(a)}")
    if not _same(np.array(first.gravity), np.array(other.gravity)):
        found.append(f"gravity is {other.gravity:g} m/s² instead of {first.gravity:g}")
    pairs = [
        ("gravity.tilt_std", first.gravity_tilt_std, other.gravity_tilt_std),
        *(
            (f"uncertainty.{key}", getattr(first.declared, field), getattr(other.declared, field))
            for key, field in _CONSTANT_UNCERTAINTIES.items()
        ),
    ]
    found += [
        f"{key} is {b:g} instead of {a:g}"
        for key, a, b in pairs
        if not _same(np.array(a), np.array(b))
    ]
    return tuple(found)


def require_agreement(calibrated: Rig, given: Rig, where: str) -> None:
    """Raise UsageError where a calibration, known as `where`, is of another rig than the given."""
    found = contradictions(calibrated, given)
    if found:
        raise UsageError(
            f"this calibration is of another rig: {'; '.join(found)}",
            where=where,
            hint="name the rig file that was calibrated",
        )


def _known_agree(a: UncertainValue, b: UncertainValue) -> bool:
    return _agree(a.value, b.value, np.hypot(a.std, b.std))


def _agree(a: FloatArray, b: FloatArray, std: FloatArray) -> bool:
    size = np.maximum(np.abs(a), np.abs(b))
    return bool(np.all(np.abs(a - b) <= CONTRADICTION * std + _ROUNDING * np.maximum(size, 1.0)))


def _same(a: FloatArray, b: FloatArray) -> bool:
    """Typed the same, to rounding; ∞ is ∞."""
    return bool(np.allclose(a, b, rtol=_ROUNDING, atol=1e-3 * _ROUNDING))


def _m(values: FloatArray) -> str:
    return "(" + ", ".join(f"{v:g}" for v in values) + ")"
