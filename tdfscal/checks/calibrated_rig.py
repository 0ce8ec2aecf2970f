"""Is it the rig that was calibrated: by what two rig files state, and by a log that passes?

In use there may be contact, so that no wrench is wrong by itself. What no contact explains is
refused; what might be contact or a fault of the wiring is said.
"""

from __future__ import annotations

from collections.abc import Iterable, Iterator
from dataclasses import replace
from itertools import combinations

import numpy as np
import numpy.typing as npt

from tdfscal.checks import log_against_rig
from tdfscal.checks.wiring import REACTION, rewired_sensors
from tdfscal.findings import Finding, Value
from tdfscal.model.calibrated import Calibrated
from tdfscal.model.parameters import layout
from tdfscal.model.samples_in_motion import Samples, rotations
from tdfscal.records import FloatArray, Rig
from tdfscal.significance import CONTRADICTION, WRENCH_PRESENT
from tdfscal.wrench.contact_wrench import contact_wrench, wrenches

#: Two numbers that were typed the same agree to this share.
_ROUNDING = 1.0e-9
#: Gravity is one where it agrees to this share.
_GRAVITY = 1.0e-4
#: What two rig files of one rig may not state differently beyond their uncertainties, and what two
#: campaigns of it have to state alike: zeros and load are each campaign's own.
_FIXED = ("gravity", "hinge", "nominal mounting", "stated zero", "mass", "barycentre")
_CONSTANT = ("hinge", "nominal mounting", "rpy_std", "gravity", "gravity.tilt_std")
_CONSTANT_UNCERTAINTIES = {
    "uncertainty.hinge": ("hinge", "m"),
    "uncertainty.datum": ("datum", "m"),
    "uncertainty.force_sensitivity": ("force_sensitivity", "(relative)"),
    "uncertainty.compliance.lateral": ("compliance_lateral", "m/N"),
    "uncertainty.compliance.vertical": ("compliance_vertical", "m/N"),
}
#: Samples kept of a whole log at most, and the fewest that judge a piece of it.
_KEPT = 1024
_FEW = 16
#: Forces this many times the weight, or this share of it, are no contact.
_HUGE, _TINY = 100.0, 0.01
#: Forces of the wrong sign: the share of samples that show the right one by chance at most, and
#: what the opposite sign leaves of the wrench at most, by the weight and its lever.
_CHANCE, _BALANCED = 0.01, 0.1
#: Another wiring that makes the wrench this many times smaller is named.
_BETTER = 5.0


def _stated(rig: Rig) -> dict[tuple[str, str], tuple[str, FloatArray, npt.ArrayLike]]:
    """What a rig file states, by what and of which support: unit, value, standard uncertainty."""
    own, near = rig.declared, _GRAVITY * rig.gravity / CONTRADICTION / np.sqrt(2.0)
    found: dict[tuple[str, str], tuple[str, npt.ArrayLike, npt.ArrayLike]] = {
        ("gravity", ""): ("m/s²", rig.gravity, near),
        ("gravity.tilt_std", ""): ("rad", rig.gravity_tilt_std, 0.0),
        ("mass", ""): ("kg", rig.mass.value, rig.mass.std),
        ("barycentre", ""): ("m", rig.barycentre.value, rig.barycentre.std),
    }
    for key, (field, unit) in _CONSTANT_UNCERTAINTIES.items():
        found[key, ""] = (unit, getattr(own, field), 0.0)
    for i, name in enumerate(rig.supports):
        found["hinge", name] = ("m", rig.hinge[i], own.hinge)
        found["nominal mounting", name] = ("rad", rig.nominal_rpy[i], 0.0)
        found["rpy_std", name] = ("rad", rig.rpy_std[i], 0.0)
        found["stated zero", name] = ("N", rig.zero.value[i], rig.zero.std[i])
    return {key: (unit, np.asarray(value), std) for key, (unit, value, std) in found.items()}


def _differing(
    first: Rig, other: Rig, which: Iterable[str], *, exact: bool = False
) -> tuple[Finding, ...]:
    """Names, serials, and what is stated differently: beyond the uncertainties of both, or at all.

    which : what is compared of what both state, where they state the same supports.
    """
    found = _named(first, other)
    if first.supports != other.supports:
        return found
    theirs = _stated(other)
    for (what, of), (unit, value, std) in _stated(first).items():
        _, than, own = theirs[what, of]
        bound = 0.0 if exact else np.hypot(std, own)
        if what in which and not _agree(value, than, bound):
            differs = _differs(what, of, unit, value, than)
            framed = what == "hinge" and not _distances(first, other)
            found += (replace(differs, values={**differs.values, "framed": framed}),)
    return found


def other_rig(first: Rig, other: Rig) -> tuple[Finding, ...]:
    """What shows that two rig files are of two rigs; nothing: of one, for all they say.

    Compared are the supports, the serials of rig and sensors where both state one, gravity, and the
    distances between hinges within the uncertainties that both state: the angles are those of
    sensors in the BCS, whichever LCS a rig file has.
    """
    found = _differing(first, other, ("gravity",))
    return (*found, *_distances(first, other)) if first.supports == other.supports else found


def _distances(first: Rig, other: Rig) -> list[Finding]:
    """Distances between hinges that two rig files with the same supports state differently."""
    # Of the difference of two places, along the line that joins them.
    std, found = np.sqrt(2.0) * np.hypot(first.declared.hinge, other.declared.hinge), []
    for i, j in combinations(range(first.n), 2):
        own, given = (np.linalg.norm(rig.hinge[i] - rig.hinge[j]) for rig in (first, other))
        if not _agree(own, given, std):
            names = f"{first.supports[i]} to {first.supports[j]}"
            found.append(_differs("distance of the hinges", names, "m", own, given))
    return found


def contradictions(calibrated: Rig, given: Rig) -> tuple[Finding, ...]:
    """What of `given` contradicts the calibrated rig; nothing: they agree.

    Compared are names, serials and gravity, hinges in the LCS, nominal mounting, stated zeros, mass
    and barycentre, each within the uncertainties that both state.
    """
    return _differing(calibrated, given, _FIXED)


def different_constants(first: Rig, other: Rig) -> tuple[Finding, ...]:
    """What two rig files state differently of the rig's constants; nothing: one rig.

    Zeros and load may differ from campaign to campaign; supports, hinges, nominal mounting and the
    uncertainties of what stays the same may not.
    """
    return _differing(first, other, (*_CONSTANT, *_CONSTANT_UNCERTAINTIES), exact=True)


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
    """Within the std of their difference, 0: typed the same, to rounding; ∞ is ∞."""
    near = np.isclose(a, b, rtol=_ROUNDING, atol=1e-3 * _ROUNDING)
    with np.errstate(invalid="ignore"):
        return bool(np.all(near | (np.abs(np.subtract(a, b)) <= CONTRADICTION * np.asarray(std))))


def _shown(values: npt.ArrayLike) -> str:
    numbers = ", ".join(f"{v:g}" for v in np.ravel(values))
    return f"({numbers})" if np.ndim(values) else numbers


class Inspection:
    """Keeps evenly spaced samples of a log that passes, `kept`, and judges them at its end."""

    def __init__(self, given: Calibrated) -> None:
        self._given = given
        self._stride = 1
        self._passed = 0
        self._largest, self._when = np.zeros((2, given.rig.n, 3))
        self.kept: Samples | None = None

    def watch(self, pieces: Iterable[Samples]) -> Iterator[Samples]:
        """Pass the pieces on.

        Raises
        ------
        DataError
            The positions of a piece cannot be in the unit that is declared.
        """
        for piece in pieces:
            self._keep(piece)
            self._measure(piece)
            if piece.time.size >= _FEW:
                some = piece.position[:: max(1, piece.time.size // _KEPT)]
                log_against_rig.check_size(self._given.rig, some)
            yield piece

    def _measure(self, piece: Samples) -> None:
        """Keep the largest reading of every channel, N, and its time, s."""
        if piece.time.size:
            size = np.nan_to_num(np.abs(piece.force))
            place = size.argmax(axis=0)
            found = np.take_along_axis(size, place[None], axis=0)[0]
            self._when = np.where(found > self._largest, piece.time[place], self._when)
            self._largest = np.maximum(self._largest, found)

    def _absurd(self) -> tuple[Finding, ...]:
        """Name the reading that is farthest beyond what its sensor or the machine can show."""
        rig, state = self._given.rig, self._given.state
        capacity = np.where(rig.axes, rig.capacity, np.inf)
        known = np.isfinite(_mass_std(self._given))
        limit = np.minimum(capacity, _HUGE * state.mass * rig.gravity if known else np.inf)
        i, j = np.unravel_index(int(np.argmax(self._largest / limit)), limit.shape)
        size = float(self._largest[i, j])
        if size <= limit[i, j]:
            return ()
        values: dict[str, Value] = {"axis": "xyz"[j], "time": float(self._when[i, j])}
        if size > capacity[i, j]:
            values["capacity"] = float(capacity[i, j])
        return (Finding("reading-absurd", (rig.supports[i],), size, "N", values=values),)

    def _keep(self, piece: Samples) -> None:
        part = piece.rows(slice(-self._passed % self._stride, None, self._stride))
        self._passed += piece.time.size
        # Joined is copied: a view would hold the whole piece in memory.
        kept = Samples.joined([part] if self.kept is None else [self.kept, part])
        while kept.time.size > _KEPT:
            # All that is kept lies on multiples of the stride: every second one stays.
            kept = kept.rows(slice(None, None, 2))
            self._stride *= 2
        self.kept = kept

    def finish(self) -> list[Finding]:
        """Judge what has passed, and return what was found.

        Raises
        ------
        DataError
            The positions do not fit the hinges, or the forces have another unit or sign.
        """
        if self.kept is None:
            return []
        given, seen = self._given, self.kept
        log_against_rig.check_geometry(given.rig, seen.position, seen.force)
        _check_forces(given, seen)
        turned = log_against_rig.turned(given.rig, seen.position)
        return [*turned, *_doubt(given, seen), *self._absurd()]


def _mass_std(given: Calibrated) -> float:
    """Relative standard uncertainty of the mass, ∞ where it is open."""
    place = layout(given.rig.n)["mass"].start
    if given.open[place]:
        return np.inf
    return float(np.sqrt(given.covariance[place, place]) / given.state.mass)


def _check_forces(given: Calibrated, seen: Samples) -> None:
    """Raise DataError where unit or sign contradict the weight, whatever is touched."""
    state, g = given.state, given.rig.gravity
    allowed, mass = log_against_rig.weight_tolerance(_mass_std(given)), float(state.mass)
    if not np.isfinite(allowed):
        return
    load = float(np.median(np.linalg.norm(seen.force, axis=2).sum(axis=1))) / (mass * g)
    if load < _TINY:  # the zeros would hide what little there is
        bare = replace(state, zero=np.zeros_like(state.zero))
        rest = float(np.median(log_against_rig.weight_share(bare, g, seen.force)))
        raise log_against_rig.weight_error(rest, allowed, mass)
    share = log_against_rig.weight_share(state, g, seen.force)
    ratio = float(np.median(share))
    # Who presses with twice the weight turns the sign too, but hardly all the time, nor in balance.
    reaction = (
        abs(ratio + 1) <= allowed
        and np.mean(np.abs(share - 1) <= allowed) < _CHANCE
        and _sizes(given, seen, [-seen.force])[0] < _BALANCED
    )
    if abs(ratio) > _HUGE or reaction:
        raise log_against_rig.weight_error(ratio, allowed, mass)


def _doubt(given: Calibrated, seen: Samples) -> tuple[Finding, ...]:
    """Name a wrench that another wiring explains, or that is of the weight's order."""
    found = wrenches(given, seen.time, seen.position, seen.force)
    others = list(rewired_sensors(given.rig.supports))
    readings = [seen.force, *(other.signals(seen.force) for other in others)]
    here, *left = _sizes(given, seen, readings)
    best = int(np.argmin(left))
    force = float(np.median(np.linalg.norm(found.value[:, :3], axis=1)))
    torque = float(np.median(np.linalg.norm(found.value[:, 3:], axis=1)))
    values: dict[str, Value] = {"torque": torque}
    if left[best] * _BETTER < here:
        words = others[best].words
        values |= {"ratio": here / left[best], "other": "" if words == REACTION else words}
        return (Finding("wrench-rewired", size=force, unit="N", values=values),)
    weight = float(given.state.mass) * given.rig.gravity
    std = float(np.median(np.linalg.norm(found.calibration_std[:, :3], axis=1)))
    if force > max(
        weight * log_against_rig.weight_tolerance(_mass_std(given)), WRENCH_PRESENT * std
    ):
        values["ratio"] = force / weight
        return (Finding("wrench-large", size=force, unit="N", values=values),)
    return ()


def _sizes(given: Calibrated, seen: Samples, readings: list[FloatArray]) -> list[float]:
    """Median size of the wrench of each of several readings (N, n, 3), N, at rest.

    Forces by the weight, moments by the weight at the hinges' mean distance from their middle.
    """
    state, g = given.state, given.rig.gravity
    arm = np.linalg.norm(state.hinge - state.hinge.mean(axis=0), axis=1).mean()
    scale = float(state.mass) * g * np.repeat([1.0, arm], 3)
    turn = rotations(state.hinge, seen.position - state.datum)
    found = (contact_wrench(state, g, turn, reading) / scale for reading in readings)
    return [float(np.median(np.linalg.norm(wrench, axis=1))) for wrench in found]
