"""Is the rig of a log the one that was calibrated?"""

from __future__ import annotations

import numpy as np
import numpy.typing as npt

from tdfscal.errors import UsageError
from tdfscal.records import FloatArray, Rig
from tdfscal.significance import CONTRADICTION

#: Two numbers that were typed the same agree to this share.
_ROUNDING = 1.0e-9
_GRAVITY = 1.0e-4

#: Standard uncertainties of constants, as the rig file names them: field and unit.
_CONSTANT_UNCERTAINTIES = {
    "hinge": ("hinge", "m"),
    "datum": ("datum", "m"),
    "force_sensitivity": ("force_sensitivity", "(relative)"),
    "compliance.lateral": ("compliance_lateral", "m/N"),
    "compliance.vertical": ("compliance_vertical", "m/N"),
}


def other_rig(first: Rig, other: Rig) -> tuple[str, ...]:
    """What shows that two rig files are of two rigs, in words; nothing: of one, for all they say.

    Compared are the supports, the serial where both state one, gravity, and the hinges within the
    uncertainties that both state.
    """
    if first.supports != other.supports:
        return (_other_supports(first, other),)
    found = _other_serial(first, other)
    g, own = first.gravity, other.gravity
    if abs(own - g) > _GRAVITY * g:
        found += (_differs("gravity", "m/s²", g, own),)
    std = np.hypot(first.declared.hinge, other.declared.hinge)
    return found + tuple(
        _differs(f"the hinge of {name}", "m", a, b)
        for name, a, b in zip(first.supports, first.hinge, other.hinge, strict=True)
        if not _agree(a, b, std)
    )


def contradictions(calibrated: Rig, given: Rig) -> tuple[str, ...]:
    """What of `given` contradicts the calibrated rig, in words; nothing: they agree.

    Compared are, besides what tells one rig from another, nominal mounting, stated zeros, mass and
    barycentre, each within the uncertainties that both state.
    """
    found = other_rig(calibrated, given)
    if calibrated.supports != given.supports:
        return found
    zeros = np.hypot(calibrated.zero.std, given.zero.std)
    pairs: list[tuple[str, str, FloatArray, FloatArray, npt.ArrayLike]] = []
    for i, name in enumerate(given.supports):
        nominal, zero = (calibrated.nominal_rpy[i], given.nominal_rpy[i]), calibrated.zero.value[i]
        pairs += [
            (f"the nominal mounting of {name}", "rad", *nominal, 0.0),
            (f"the stated zero of {name}", "N", zero, given.zero.value[i], zeros[i]),
        ]
    for what, unit, a, b in (
        ("the mass", "kg", calibrated.mass, given.mass),
        ("the barycentre", "m", calibrated.barycentre, given.barycentre),
    ):
        pairs.append((what, unit, a.value, b.value, np.hypot(a.std, b.std)))
    return found + tuple(
        _differs(what, unit, a, b) for what, unit, a, b, std in pairs if not _agree(a, b, std)
    )


def different_constants(first: Rig, other: Rig) -> tuple[str, ...]:
    """What two rig files state differently of the rig's constants, in words; nothing: one rig.

    Zeros and load may differ from campaign to campaign; supports, hinges, nominal mounting and the
    uncertainties of what stays the same may not.
    """
    if first.supports != other.supports:
        return (_other_supports(first, other),)
    pairs: list[tuple[str, str, npt.ArrayLike, npt.ArrayLike]] = []
    for i, name in enumerate(other.supports):
        pairs += [
            (f"the hinge of {name}", "m", first.hinge[i], other.hinge[i]),
            (f"the nominal mounting of {name}", "rad", first.nominal_rpy[i], other.nominal_rpy[i]),
            (f"the rpy_std of {name}", "rad", first.rpy_std[i], other.rpy_std[i]),
        ]
    pairs += [
        ("gravity", "m/s²", first.gravity, other.gravity),
        ("gravity.tilt_std", "rad", first.gravity_tilt_std, other.gravity_tilt_std),
    ]
    for key, (field, unit) in _CONSTANT_UNCERTAINTIES.items():
        a, b = getattr(first.declared, field), getattr(other.declared, field)
        pairs.append((f"uncertainty.{key}", unit, a, b))
    return _other_serial(first, other) + tuple(
        _differs(*pair) for pair in pairs if not _same(*pair[2:])
    )


def require_agreement(calibrated: Rig, given: Rig, where: str) -> None:
    """Raise UsageError where a calibration, known as `where`, is of another rig than the given."""
    found = contradictions(calibrated, given)
    if found:
        raise UsageError(
            f"this calibration is of another rig: {'; '.join(found)}",
            where=where,
            hint="name the rig file that was calibrated",
        )


def _other_supports(first: Rig, other: Rig) -> str:
    return f"its supports are {', '.join(other.supports)} instead of {', '.join(first.supports)}"


def _other_serial(first: Rig, other: Rig) -> tuple[str, ...]:
    if None in (first.serial, other.serial) or first.serial == other.serial:
        return ()
    return (f"its serial is {other.serial} instead of {first.serial}",)


def _differs(what: str, unit: str, a: npt.ArrayLike, b: npt.ArrayLike) -> str:
    return f"{what} is {_shown(b)} {unit} instead of {_shown(a)}"


def _agree(a: FloatArray, b: FloatArray, std: npt.ArrayLike) -> bool:
    size = np.maximum(np.abs(a), np.abs(b))
    return bool(
        np.all(np.abs(a - b) <= CONTRADICTION * np.asarray(std) + _ROUNDING * np.maximum(size, 1.0))
    )


def _same(a: npt.ArrayLike, b: npt.ArrayLike) -> bool:
    """Typed the same, to rounding; ∞ is ∞."""
    return bool(np.allclose(a, b, rtol=_ROUNDING, atol=1e-3 * _ROUNDING))


def _shown(values: npt.ArrayLike) -> str:
    numbers = ", ".join(f"{v:g}" for v in np.ravel(values))
    return f"({numbers})" if np.ndim(values) else numbers
