"""Does a log fit the calibration that it is used with? Looked at while it streams.

In use there may be contact, so that no wrench is wrong by itself. What no contact explains is
refused; what might be contact or a fault of the wiring is said.
"""

from __future__ import annotations

from collections.abc import Iterable, Iterator
from dataclasses import replace

import numpy as np

from tdfscal.checks import log_against_rig
from tdfscal.checks.log_against_rig import REACTION, rewired_sensors
from tdfscal.findings import Finding, Value
from tdfscal.model.calibrated import Calibrated
from tdfscal.model.parameters import layout
from tdfscal.records import FloatArray
from tdfscal.significance import WRENCH_PRESENT
from tdfscal.wrench.contact_wrench import contact_wrench, wrenches
from tdfscal.wrench.samples_in_motion import Samples, rotations

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
