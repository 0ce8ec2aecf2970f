"""Is the rig of a log the one that was calibrated? What two rig files state differently."""

from __future__ import annotations

from itertools import combinations

import numpy as np
import numpy.typing as npt

from tdfscal.findings import Finding, Value
from tdfscal.records import FloatArray, Rig
from tdfscal.significance import CONTRADICTION

#: Two numbers that were typed the same agree to this share.
_ROUNDING = 1.0e-9
_GRAVITY = 1.0e-4
#: Standard uncertainties of constants, as users know them: field and unit.
_CONSTANT_UNCERTAINTIES = {
    "hinge": ("hinge", "m"),
    "datum": ("datum", "m"),
    "force_sensitivity": ("force_sensitivity", "(relative)"),
    "compliance.lateral": ("compliance_lateral", "m/N"),
    "compliance.vertical": ("compliance_vertical", "m/N"),
}


def other_rig(first: Rig, other: Rig) -> tuple[Finding, ...]:
    """What shows that two rig files are of two rigs; nothing: of one, for all they say.

    Compared are the supports, the serials of rig and sensors where both state one, gravity, and the
    distances between hinges within the uncertainties that both state: the angles are those of
    sensors in the BCS, whichever LCS a rig file has.
    """
    found = _named(first, other)
    if first.supports != other.supports:
        return found
    found += _gravities(first, other)
    # Of the difference of two places, along the line that joins them.
    std = np.sqrt(2.0) * _hinge_std(first, other)
    for i, j in combinations(range(first.n), 2):
        own, given = (np.linalg.norm(rig.hinge[i] - rig.hinge[j]) for rig in (first, other))
        if not _agree(own, given, std):
            names = f"{first.supports[i]} to {first.supports[j]}"
            found += (_differs("distance of the hinges", names, "m", own, given),)
    return found


def _gravities(first: Rig, other: Rig) -> tuple[Finding, ...]:
    g, own = first.gravity, other.gravity
    return () if abs(own - g) <= _GRAVITY * g else (_differs("gravity", "", "m/s²", g, own),)


def _hinge_std(first: Rig, other: Rig) -> float:
    """Standard uncertainty of a hinge's coordinate between two rig files, m."""
    return float(np.hypot(first.declared.hinge, other.declared.hinge))


def other_papers(first: tuple[str, Rig], other: tuple[str, Rig]) -> tuple[Finding, ...]:
    """What leaves open whether two rigs are one, each with what it goes by: names, serials."""
    (a, A), (b, B) = first, other
    values: dict[str, Value] = {"own": A.name, "than": b, "other": B.name}
    found = [Finding("rig-renamed", (a,), values=values)] if A.name != B.name else []
    for (name, rig), (than, lacking) in ((first, other), (other, first)):
        if whose := [what for what in _serials(rig) if what not in _serials(lacking)]:
            found.append(Finding("serials-untold", (name,), values={"whose": whose, "than": than}))
    return tuple(found)


def _serials(rig: Rig) -> dict[str, str]:
    """Serial numbers that are stated, by what they are of."""
    sensors = zip(rig.supports, rig.sensors, strict=False)  # none: no papers
    all_of = {"the rig": rig.serial} | {f"the sensor of {name}": s.serial for name, s in sensors}
    return {what: serial for what, serial in all_of.items() if serial is not None}


def contradictions(calibrated: Rig, given: Rig) -> tuple[Finding, ...]:
    """What of `given` contradicts the calibrated rig; nothing: they agree.

    Compared are names, serials and gravity, hinges in the LCS, nominal mounting, stated zeros, mass
    and barycentre, each within the uncertainties that both state.
    """
    found = _named(calibrated, given)
    if calibrated.supports != given.supports:
        return found
    found += _gravities(calibrated, given)
    hinges = _hinge_std(calibrated, given)
    zeros = np.hypot(calibrated.zero.std, given.zero.std)
    pairs: list[tuple[str, str, str, FloatArray, FloatArray, npt.ArrayLike]] = []
    for i, name in enumerate(given.supports):
        nominal, zero = (calibrated.nominal_rpy[i], given.nominal_rpy[i]), calibrated.zero.value[i]
        pairs += [
            ("hinge", name, "m", calibrated.hinge[i], given.hinge[i], hinges),
            ("nominal mounting", name, "rad", *nominal, 0.0),
            ("stated zero", name, "N", zero, given.zero.value[i], zeros[i]),
        ]
    for what, unit, a, b in (
        ("mass", "kg", calibrated.mass, given.mass),
        ("barycentre", "m", calibrated.barycentre, given.barycentre),
    ):
        pairs.append((what, "", unit, a.value, b.value, np.hypot(a.std, b.std)))
    return found + tuple(_differs(*pair[:5]) for pair in pairs if not _agree(*pair[3:]))


def different_constants(first: Rig, other: Rig) -> tuple[Finding, ...]:
    """What two rig files state differently of the rig's constants; nothing: one rig.

    Zeros and load may differ from campaign to campaign; supports, hinges, nominal mounting and the
    uncertainties of what stays the same may not.
    """
    found = _named(first, other)
    if first.supports != other.supports:
        return found
    pairs: list[tuple[str, str, str, npt.ArrayLike, npt.ArrayLike]] = []
    for i, name in enumerate(other.supports):
        pairs += [
            ("hinge", name, "m", first.hinge[i], other.hinge[i]),
            ("nominal mounting", name, "rad", first.nominal_rpy[i], other.nominal_rpy[i]),
            ("rpy_std", name, "rad", first.rpy_std[i], other.rpy_std[i]),
        ]
    pairs += [
        ("gravity", "", "m/s²", first.gravity, other.gravity),
        ("gravity.tilt_std", "", "rad", first.gravity_tilt_std, other.gravity_tilt_std),
    ]
    for key, (field, unit) in _CONSTANT_UNCERTAINTIES.items():
        a, b = getattr(first.declared, field), getattr(other.declared, field)
        pairs.append((f"uncertainty.{key}", "", unit, a, b))
    return found + tuple(_differs(*pair) for pair in pairs if not _same(*pair[3:]))


def _named(first: Rig, other: Rig) -> tuple[Finding, ...]:
    """Supports of other names, or another serial of the rig or of a sensor."""
    if first.supports != other.supports:
        return (Finding("rig-supports", other.supports, values={"others": first.supports}),)
    pairs: list[tuple[str, tuple[str, ...], str | None, str | None]]
    pairs = [("rig-serial", (), first.serial, other.serial)]
    sensors = zip(first.supports, first.sensors, other.sensors, strict=False)  # none: no papers
    pairs += [("sensor-exchanged", (name,), a.serial, b.serial) for name, a, b in sensors]
    return tuple(
        Finding(code, of, values={"own": own, "other": given})
        for code, of, own, given in pairs
        if None not in (own, given) and own != given
    )


def _differs(what: str, of: str, unit: str, a: npt.ArrayLike, b: npt.ArrayLike) -> Finding:
    values: dict[str, Value] = {"what": what, "of": of, "unit": unit}
    return Finding("rig-constant", values=values | {"own": _shown(a), "other": _shown(b)})


def _agree(a: npt.ArrayLike, b: npt.ArrayLike, std: npt.ArrayLike) -> bool:
    size, off = np.maximum(np.abs(a), np.abs(b)), np.abs(np.subtract(a, b))
    return bool(np.all(off <= CONTRADICTION * np.asarray(std) + _ROUNDING * np.maximum(size, 1.0)))


def _same(a: npt.ArrayLike, b: npt.ArrayLike) -> bool:
    """Typed the same, to rounding; ∞ is ∞."""
    return bool(np.allclose(a, b, rtol=_ROUNDING, atol=1e-3 * _ROUNDING))


def _shown(values: npt.ArrayLike) -> str:
    numbers = ", ".join(f"{v:g}" for v in np.ravel(values))
    return f"({numbers})" if np.ndim(values) else numbers
