"""What may have changed since a calibration, as findings with their sizes."""

from __future__ import annotations

import numpy as np

from tdfscal.files.calibration.log_time import clock_from
from tdfscal.findings import Finding, Value
from tdfscal.records import FloatArray
from tdfscal.validation.causes import NOISE, Cause, Kind
from tdfscal.validation.residual_wrench import Validation
from tdfscal.validation.verdict import Verdict

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


def change(v: Verdict, cause: Cause, *, tied: bool = False) -> Finding:
    """Return one cause with its size; tied : it is not told apart from a likelier one."""
    value, std = cause.value.tolist(), cause.std.tolist()
    support = None if cause.support is None else v.rig.supports[cause.support]
    values: dict[str, Value] = {
        "tied": tied, "whose": support or "all sensors", "change": value, "change_std": std
    }  # fmt: skip
    size, unit = None, ""
    match cause.kind:
        case "sensor turned":
            size, unit = float(np.linalg.norm(cause.value)), "rad"
        case "zero drifted":
            values["stated"] = v.zeros.moved
        case "load changed":
            values |= {"mass": value[0], "mass_std": std[0]}
            values |= {"barycentre": value[1:], "barycentre_std": std[1:]}
        case "gain changed":
            values |= _gain(cause)
        case "contact":
            assert isinstance(v, Validation)  # in motion a contact is a stretch that is left out
            which = [int(v.used[k]) for k in cause.postures]
            force, moment = lengths(v.calibrated)[list(cause.postures)].max(axis=0)
            size, unit = float(force), "N"
            values["postures"] = [f"{k + 1} ({start_of(v, k)} s)" for k in which]
            values |= {"more": len(which) > 1, "torque": float(moment)}
    if cause.kind in NOISE:
        size, unit = value[0], "N·m" if cause.kind == "hinges stick" else "N"
    subject = () if support is None else (support,)
    code = CHANGES[cause.kind]
    return Finding(code, subject, size, unit, cause.p_value, values=values, rejects=True)


def _gain(cause: Cause) -> dict[str, Value]:
    """Change of a gain, %, by the shape that was fitted."""
    moved = np.flatnonzero(cause.std > 0)
    axes = ["xyz"[k] for k in moved if k < 3]
    if cause.unknowns == 1:
        moved = moved[:1]
    return {
        "change": (100 * cause.value[moved]).tolist(),
        "change_std": (100 * cause.std[moved]).tolist(),
        "axes": axes,
        "alike": cause.unknowns == 1 and len(axes) > 1,
        "crosstalk": cause.unknowns > 3,
    }


def start_of(v: Validation, k: int) -> str:
    """Seconds at which a dwell begins; those of a date count from the first dwell."""
    return f"{v.dwells.start[k] - clock_from(float(v.dwells.start[0])).origin:.1f}"


def lengths(wrench: FloatArray) -> FloatArray:
    """Lengths (K, 2) of force and moment of wrenches (K, 6)."""
    return np.asarray(np.linalg.norm(wrench.reshape(-1, 2, 3), axis=2))
