"""What may have changed since a calibration, in words with its size, and what to do about it."""

from __future__ import annotations

import numpy as np

from tdfscal.files.calibration.log_time import clock_from
from tdfscal.records import FloatArray
from tdfscal.validation.causes import Cause, Kind
from tdfscal.validation.residual_wrench import Validation
from tdfscal.validation.verdict import Verdict

#: What to do first about the likeliest cause.
REMEDIES: dict[Kind, str] = {
    "sensor turned": "Look at the mounting of this sensor, then calibrate again.",
    "zero drifted": "Tare, and validate again; if it returns, calibrate again.",
    "gain changed": "Have this sensor, its amplifier and its cable checked; calibrate again with "
    "uncertainty.force_sensitivity declared until then.",
    "load changed": "Correct the load, or the rig file and calibrate again.",
    "base tilted": "Level the base, or calibrate again with gravity.tilt_std declared.",
    "contact": "Free these postures and record them again before anything else.",
    "hinges stick": "See whether the hinges move freely, or state uncertainty.hinge_moment.",
    "noise grown": "Look for what shakes or hums, at cables and amplifiers, or state "
    "uncertainty.force_noise, and validate again.",
    "zeros moved": "Tare, or state in zero.std by how much zeros move, and validate again.",
    "zeros wander": "Let sensors and amplifiers warm up, keep cables and temperature still, or "
    "state drift.walk, and validate again.",
}


#: Codes of the causes' findings.
CHANGES: dict[Kind, str] = {
    "sensor turned": "change-sensor-turned",
    "zero drifted": "change-zero-drifted",
    "gain changed": "change-gain",
    "load changed": "change-load",
    "base tilted": "change-base-tilted",
    "contact": "change-contact",
    "hinges stick": "change-hinges-stick",
    "noise grown": "change-noise-grown",
    "zeros moved": "change-zeros-moved",
    "zeros wander": "change-zeros-wander",
}


def describe(v: Verdict, cause: Cause) -> str:
    """One cause in words, with its size."""
    value, std = cause.value, cause.std
    whose = "all sensors" if cause.support is None else v.rig.supports[cause.support]
    match cause.kind:
        case "sensor turned":
            return (
                f"the sensor of {whose} has turned by {1e3 * np.linalg.norm(value):.2f} mrad: "
                f"{_pairs(1e3 * value, 1e3 * std)} mrad about x, y, z of the BCS"
            )
        case "zero drifted":
            moved = f"{_pairs(value, std)} N along x, y, z of the sensor"
            if v.zeros.moved:
                return f"the zero of {whose} is off what the rig file states by {moved}"
            return f"the zero of {whose} has drifted by {moved}"
        case "load changed":
            return (
                f"the terminal's mass has changed by {value[0]:+.3f} ± {std[0]:.3f} kg, and its "
                f"barycentre by {_pairs(1e3 * value[1:], 1e3 * std[1:])} mm"
            )
        case "gain changed":
            return f"the gain of {whose} has changed by {_gain(cause)}"
        case "base tilted":
            tilt = _pairs(1e3 * value, 1e3 * std)
            return f"the base is no longer level as it was: {tilt} mrad about x, y of the BCS"
        case "noise grown":
            return (
                f"the forces of {whose} scatter by {value[0]:.2g} N per axis and posture more than "
                "log and rig file state"
            )
        case "zeros wander":
            return (
                f"the zeros of all sensors wander by {value[0]:.2g} N per axis, from posture to "
                "posture and over the whole log, as 1/f noise does"
            )
        case "zeros moved":
            return (
                f"the zeros of all sensors have moved by about {value[0]:.2g} N per axis, farther "
                "than the rig file's zero.std has it"
            )
        case "hinges stick":
            return f"the moments scatter as friction of {value[0]:.2g} N·m in the hinges makes them"
    assert isinstance(v, Validation)  # in motion a contact is a stretch that is left out
    named = ", ".join(f"{v.used[k] + 1} ({start_of(v, int(v.used[k]))} s)" for k in cause.postures)
    force, moment = lengths(v.calibrated)[list(cause.postures)].max(axis=0)
    several = "s" if len(cause.postures) > 1 else ""
    return f"contact in posture{several} {named}: {force:.2g} N, {moment:.2g} N·m"


def _gain(cause: Cause) -> str:
    """Change of a gain, %, by the shape that was fitted."""
    value, std = 100 * cause.value, 100 * cause.std
    moved = np.flatnonzero(std > 0)
    if cause.unknowns == 1:
        where = "on all axes" if len(moved) == 3 else f"along {'xyz'[moved[0]]} of the sensor"
        return f"{value[moved[0]]:+.3f} ± {std[moved[0]]:.3f} % {where}"
    crosstalk = "" if cause.unknowns == 3 else ", with crosstalk yz, xz, xy"
    sizes = ", ".join(f"{value[k]:+.3f} ± {std[k]:.3f}" for k in moved)
    return f"{sizes} % along x, y, z of the sensor{crosstalk}"


def _pairs(value: FloatArray, std: FloatArray) -> str:
    return ", ".join(f"{a:+.2f} ± {s:.2f}" for a, s in zip(value, std, strict=True))


def start_of(v: Validation, k: int) -> str:
    """Seconds at which a dwell begins; those of a date count from the first dwell."""
    return f"{v.dwells.start[k] - clock_from(float(v.dwells.start[0])).origin:.1f}"


def lengths(wrench: FloatArray) -> FloatArray:
    """Lengths (K, 2) of force and moment of wrenches (K, 6)."""
    return np.asarray(np.linalg.norm(wrench.reshape(-1, 2, 3), axis=2))
