"""What has changed since a calibration, as a validation finds it: findings with their sizes."""

from __future__ import annotations

from collections.abc import Iterator

import numpy as np

from tdfscal.catalogue.numbers import measured
from tdfscal.findings import Finding, Value
from tdfscal.numerics.distributions import INTERVAL_FACTOR, normal_quantile
from tdfscal.records import FloatArray
from tdfscal.reporting.figures import origin
from tdfscal.significance import INTERVAL_COVERAGE
from tdfscal.validation.causes import Cause
from tdfscal.validation.in_motion import MovingValidation
from tdfscal.validation.residual_wrench import Validation

Tested = Validation | MovingValidation


def changes(v: Tested) -> list[Finding]:
    """Return what has changed since the calibration, the likeliest first."""
    if v.holds:
        return _zeros(v, "zeros-moved")
    if not v.suspected:
        p = v.judged.search_p if v.decided_by_search else v.judged.p_value
        return [Finding("change-unexplained", p_value=p, rejects=True)]
    found = [change(v, cause, tied=k > 0) for k, cause in enumerate(v.suspected)]
    # A zero that drifted says so itself.
    drifted = v.suspected[0].kind == "zero drifted"
    return found if drifted else found + _zeros(v, "zeros-beside-change")


def _zeros(v: Tested, code: str) -> list[Finding]:
    """The change of a zero that stands out most, where they moved and the log tells by how much.

    It does not where the noise is not known, or what explains the rest; it names none where the
    largest of so many may be chance.
    """
    std = v.zeros.change_std
    known = v.zeros.moved and (v.holds or any(not c.scatters for c in v.suspected[:1]))
    if not known or not np.isfinite(std).any():
        return []
    told = np.divide(np.abs(v.zeros.change), std, out=np.zeros_like(std), where=std > 0)
    i, j = np.unravel_index(np.where(np.isfinite(std), told, -1.0).argmax(), std.shape)
    if told[i, j] < normal_quantile(1.0 - (1.0 - INTERVAL_COVERAGE) / (2 * np.isfinite(std).sum())):
        unclear = INTERVAL_FACTOR * float(std[np.isfinite(std)].max())
        return [Finding(code, values={"unclear": unclear})] if v.holds else []
    values: dict[str, Value] = {"std": float(std[i, j]), "axis": "xyz"[j]}
    size = float(v.zeros.change[i, j])
    return [Finding(code, (v.rig.supports[i],), size, "N", values=values)]


def change(v: Tested, cause: Cause, *, tied: bool = False) -> Finding:
    """Return one cause with its size; tied : it is not told apart from a likelier one."""
    value, half = cause.value.tolist(), (INTERVAL_FACTOR * cause.std).tolist()
    support = None if cause.support is None else v.rig.supports[cause.support]
    values: dict[str, Value] = {
        "tied": tied, "rivals": len(v.suspected) > 1, "whose": support or "all sensors",
        "change": value, "change_95": half,
    }  # fmt: skip
    size, unit = None, ""
    match cause.kind:
        case "sensor turned":
            size, unit = float(np.linalg.norm(cause.value)), "rad"
            values["std"] = cause.size_std
        case "sensors turned":
            turns = np.linalg.norm(cause.value.reshape(-1, 3), axis=1)
            widest = cause.std.reshape(-1, 3).max(axis=1)
            size, unit, values["whose"] = float(turns.max()), "rad", list(v.rig.supports)
            values |= {"change": turns.tolist(), "change_95": (INTERVAL_FACTOR * widest).tolist()}
        case "zero drifted":
            moved = np.flatnonzero(cause.std > 0)
            values |= {"stated": v.zeros.moved, "axes": ["xyz"[k] for k in moved]}
            values |= {"change": cause.value[moved].tolist()}
            values |= {"change_95": (INTERVAL_FACTOR * cause.std[moved]).tolist()}
        case "sensor slipped" | "zero jumped":
            size = float(np.linalg.norm(cause.value))
            unit = "rad" if cause.kind == "sensor slipped" else "N"
            if cause.between is not None:
                values["between"] = list(cause.between)
            else:
                assert isinstance(v, Validation)
                for key, k in zip(("posture", "last"), v.used[list(cause.postures)], strict=False):
                    values[key] = f"{k + 1} ({start(v, int(k))} s)"
        case "zeros drift" | "zeros follow temperature":
            size, unit = float(np.abs(cause.value).max()), "N"
        case "load changed":
            values |= {"mass": value[0], "mass_95": half[0], "shifted": bool(half[1] > 0)}
            values |= {"barycentre": value[1:], "barycentre_95": half[1:]}
        case "gain changed" | "gains changed":
            values |= _gain(cause)
        case "contact":
            assert isinstance(v, Validation)  # in motion a contact is a stretch that is left out
            force, moment = lengths(v.calibrated)[list(cause.postures)].max(axis=0)
            size, unit = float(force), "N"
            which = [int(v.used[k]) for k in cause.postures]
            values["postures"] = [f"{k + 1} ({start(v, k)} s)" for k in which]
            values |= {"more": len(which) > 1, "torque": float(moment)}
    if cause.scatters:
        size, unit = value[0], "N·m" if cause.kind == "hinges stick" else "N"
    subject = () if support is None else (support,)
    code = f"change-{cause.kind.removesuffix(' changed').replace(' ', '-')}"
    return Finding(code, subject, size, unit, cause.p_value, values=values, rejects=True)


def _gain(cause: Cause) -> dict[str, Value]:
    """Change of a gain, %, by the shape that was fitted."""
    moved = np.flatnonzero(cause.std > 0)
    axes = ["xyz"[k] for k in moved if k < 3]
    if cause.unknowns == 1:
        moved = moved[:1]
    return {
        "change": (100 * cause.value[moved]).tolist(),
        "change_95": (100 * INTERVAL_FACTOR * cause.std[moved]).tolist(),
        "axes": axes,
        "alike": cause.unknowns == 1 and len(axes) > 1,
        "crosstalk": cause.unknowns > 3,
    }


def start(v: Validation, k: int) -> str:
    """Seconds at which a dwell begins; those of a date count from the first dwell."""
    return f"{v.dwells.start[k] - origin(float(v.dwells.start[0])):.1f}"


def lengths(wrench: FloatArray) -> FloatArray:
    """Lengths (K, 2) of force and moment of wrenches (K, 6)."""
    return np.asarray(np.linalg.norm(wrench.reshape(-1, 2, 3), axis=2))


def allowed(v: Tested) -> Iterator[str]:
    """What the rig file allows of the contact wrench's error, beside the largest residual."""
    after = v.residual.after if isinstance(v, MovingValidation) else lengths(v.calibrated)
    sizes = after.max(axis=0).tolist()
    for (quantity, unit, _, limit), size in zip(
        v.rig.acceptance.contact_limits, sizes, strict=True
    ):
        if limit is not None:
            told = f"The largest residual {quantity}, {measured(size, 3)} {unit},"
            side = "within" if size <= limit else "beyond"
            yield f"{told} is {side} the {limit:g} {unit} that the rig file allows."
