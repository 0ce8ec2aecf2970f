"""Sensors that lie before any model is asked: saturated, frozen, dead."""

from __future__ import annotations

import numpy as np

from tdfscal.checks.log_against_rig import check_unit
from tdfscal.errors import DataError, NotIdentifiableError
from tdfscal.findings import Finding, Value
from tdfscal.frozen import record, replace
from tdfscal.model.parameters import State, nominal, sensing, with_motions
from tdfscal.model.statics import balance, forces, internal_part, postures
from tdfscal.records import BoolArray, Dwells, FloatArray, Rig
from tdfscal.significance import OF_CAPACITY

AXES = ("x", "y", "z")
#: A reading this close to a limit, relative, stands at it.
_AT = 1e-6
#: Share of a direction that the axes of all sensors measure, below which they miss it.
_ALONG = 1e-3
#: Relative; what rounding makes of one reading.
_ROUNDED = 1e-9
#: A reading so many times as large as any other of its axis is no end of a range.
_LOST = 3.0
#: Dwells with one reading, of the last, that freeze an axis: no noise repeats itself so often.
_FROZEN = 3


@record
class Screened:
    """Which dwells may be used (K,), and the reason for each that may not."""

    keep: BoolArray
    reasons: dict[int, Finding]


def screen(rig: Rig, dwells: Dwells) -> Screened:
    """Leave out dwells with a saturated or frozen axis.

    The range of the whole log tells an axis that is saturated in every dwell from a dead one.

    Raises
    ------
    DataError
        An axis gives one and the same reading in every posture.
    """
    low, high = dwells.force_min, dwells.force_max
    if len(dwells) > 1:
        stuck = _same(low.min(axis=0), high.max(axis=0)) & (dwells.count.max(axis=0) > 0)[:, None]
        stuck &= rig.axes
        for i, j in np.argwhere(stuck):
            check_unit(rig, dwells.force)
            raise _stuck(rig, dwells, int(i), int(j), stuck[i])
    reasons: dict[int, Finding] = {}
    capacity, over = _over(rig, dwells)
    for k, i, j in np.argwhere(over):
        code = "posture-over-capacity" if np.isfinite(rig.capacity[i, j]) else "posture-saturated"
        reasons.setdefault(int(k), _spoilt(code, rig, dwells, (k, i, j), float(capacity[i, j])))
    # One axis without any scatter, where it and the others have some elsewhere, is frozen.
    still = _same(low, high) & (dwells.count >= 8)[..., None]
    lively = rig.axes & (np.mean(~still, axis=0) > 0.5)
    for k, i, j in np.argwhere(still & (lively | _froze(still, low) & rig.axes)):
        value, others = float(low[k, i, j]), np.abs(high[~_same(high, low[k])[:, i, j], i, j])
        # A code for a reading that was lost stands far from all that is read.
        code = "posture-frozen"
        if _at_limit(dwells, value, i, j) and abs(value) < _LOST * others.max(initial=0.0):
            code = "posture-saturated"
        since = float(_since(dwells)[i, j])
        reasons.setdefault(int(k), _spoilt(code, rig, dwells, (k, i, j), value, since))
    keep = np.ones(len(dwells), dtype=bool)
    keep[list(reasons)] = False
    if not keep.any():
        check_unit(rig, dwells.force)
    return Screened(keep, reasons)


def _over(rig: Rig, dwells: Dwells) -> tuple[FloatArray, BoolArray]:
    """Capacities (n, 3), stated or shown, and the readings (K, n, 3) that reach them.

    A range that nobody states shows where several dwells stand without any scatter at one end of
    the log's readings, and none elsewhere: a coarse resolution has such dwells anywhere. Where all
    stand so, both ends have to be there, and alike.
    """
    low, high, capacity = dwells.force_min, dwells.force_max, rig.capacity.copy()
    peak = np.maximum(np.abs(low), np.abs(high))
    over = (peak >= capacity) & np.isfinite(capacity)
    if not len(dwells):
        return capacity, over
    still = _same(low, high) & (dwells.count >= 8)[..., None]
    reached = [_same(low, low.min(axis=0)), _same(high, high.max(axis=0))]
    clipped = np.isinf(capacity) & np.isnan(_since(dwells))  # or else it is frozen there
    alike = _same(low.min(axis=0), -high.max(axis=0))
    clipped &= np.any(~still, axis=0) | alike
    clipped &= np.all(~still | reached[0] | reached[1], axis=0)
    for end, there in zip((low.min(axis=0), high.max(axis=0)), reached, strict=True):
        shown = clipped & (np.sum(still & there, axis=0) >= _FROZEN) & (end != 0)
        capacity = np.where(shown, np.minimum(capacity, np.abs(end)), capacity)
        over |= shown & (there | _same(peak, np.abs(end)))
    return capacity, np.asarray(over & rig.axes)


def exceeded_ranges(rig: Rig, dwells: Dwells, state: State) -> tuple[Finding, ...]:
    """By how much forces exceed the capacity of a sensor, and what keeps them within.

    A reading that is cut off hides how much. The balance of all others has it: as of an axis that
    nobody measures, at what is calibrated. It consists of what carries the terminal and of what the
    NCPs squeeze, which less squeeze lowers; both with the noise of the samples.

    state : calibrated. Returned with the one that exceeds most first.
    """
    (capacity, over), every = _over(rig, dwells), postures(rig, dwells)
    rows = np.flatnonzero(over.any(axis=(1, 2)))
    needed, squeezed = np.full((2, *over.shape), np.nan)
    for axes in np.unique(over[rows], axis=0):
        own = rows[np.all(over[rows] == axes, axis=(1, 2))]
        seen = replace(every.subset(own), measured=every.measured & ~axes)
        at = balance(seen, with_motions(state, seen.motions), state.barycentre, rig.gravity)
        inside = internal_part(at.arm, forces(state, at.seen.force))
        known = np.isfinite(np.diagonal(at.seen.force_cov, axis1=2, axis2=3))
        needed[own] = np.where(known, at.seen.force, np.nan)
        squeezed[own] = np.einsum("nab,knb->kna", np.linalg.inv(sensing(state)), inside)
    noise = np.maximum(dwells.force_max - dwells.force, dwells.force - dwells.force_min)
    found = []
    for i, j in np.argwhere(over.any(axis=0)):
        own = over[:, i, j] & np.isfinite(needed[:, i, j])
        if not own.any() or over[:, i, j].all():
            continue
        peak = float(np.median(noise[~over[:, i, j], i, j]))
        size, inner = np.abs(needed[own, i, j]), np.sign(needed[own, i, j]) * squeezed[own, i, j]
        left = capacity[i, j] - peak - (size - inner)
        share = np.where(left > 0, left / np.maximum(inner, left), 0.0).min()
        most = float(size.max() + peak)
        facts: dict[str, Value] = {
            "axis": AXES[j],
            "excess": most - float(capacity[i, j]),
            "range": most / OF_CAPACITY,
            "share": f"{share:.0%}" if share > 0 else "",
        }
        found.append(Finding("range-exceeded", (rig.supports[i],), most, "N", values=facts))
    return tuple(sorted(found, key=lambda one: -float(str(one.values["excess"]))))


def _same(a: FloatArray, b: FloatArray) -> BoolArray:
    """Readings that are one and the same; sums over a dwell may round their ends apart."""
    return np.asarray(np.isclose(a, b, rtol=_ROUNDED, atol=0.0))


def _froze(still: BoolArray, value: FloatArray) -> BoolArray:
    """Axes (n, 3) with scatter up to a dwell, and one and the same reading in all from there on.

    A coarse resolution has its dwells without scatter here and there. still, value : (K, n, 3).
    """
    count = still.sum(axis=0)
    late = np.arange(len(still))[:, None, None] >= len(still) - count
    same = np.all(~still | _same(value, value[-1]), axis=0)
    return np.asarray((count >= _FROZEN) & (count < len(still)) & same & np.all(still == late, 0))


def check_directions(rig: Rig) -> None:
    """Raise NotIdentifiableError where the sensors together miss a direction of forces.

    Of load cells that all stand alike no balance holds that has not a free force in it.
    """
    sensor, axis = np.nonzero(rig.axes)
    measured = nominal(rig).rotation[sensor, :, axis]
    if np.linalg.matrix_rank(measured, _ALONG) < 3:
        raise NotIdentifiableError(Finding("axes-blind"))


def _spoilt(
    code: str,
    rig: Rig,
    dwells: Dwells,
    place: tuple[int, int, int],
    force: float,
    since: float = np.nan,
) -> Finding:
    """Why a dwell cannot be used; place : dwell, sensor and axis."""
    k, i, j = place
    facts: dict[str, Value] = {"axis": AXES[j], **({"since": since} if since == since else {})}
    low, high = float(dwells.force_min[place]), float(dwells.force_max[place])
    facts |= {"reading": high if high > -low else low}
    facts |= {"time": [float(dwells.start[k]), float(dwells.end[k])]} if since != since else {}
    return Finding(code, (rig.supports[i],), force, "N", values=facts)


def _at_limit(dwells: Dwells, value: float, i: int, j: int) -> bool:
    """Whether an axis that varies over the log stands at the end of what it reads there.

    At zero it does not: that is what an axis reads which is not connected.
    """
    if dwells.force_range is None or value == 0 or np.isfinite(_since(dwells)[i, j]):
        return False
    low, high = dwells.force_range[:, i, j]
    return bool(low < high and min(abs(value - low), abs(value - high)) <= _AT * abs(value))


def _since(dwells: Dwells) -> FloatArray:
    """Since when an axis is frozen for all dwells to come, (n, 3), s; NaN where it is not."""
    if dwells.force_still is None:
        return np.full(dwells.force.shape[1:], np.nan)
    later = np.sum(dwells.start[:, None, None] >= dwells.force_still, axis=0)
    return np.where(later >= _FROZEN, dwells.force_still, np.nan)


def stuck_axes(measured: BoolArray, stuck: BoolArray, force: FloatArray) -> dict[str, Value]:
    """What is said of a sensor's axes (3,) that stand at one reading, N, and of those that live."""
    stuck = stuck & measured
    return {
        "axis": [name for name, own in zip(AXES, stuck, strict=True) if own],
        "axes": bool(stuck.sum() > 1),
        "stuck": force[stuck].tolist(),
        "others": [name for name, own in zip(AXES, measured & ~stuck, strict=True) if own],
    }


def _stuck(rig: Rig, dwells: Dwells, i: int, j: int, stuck: BoolArray) -> DataError:
    """The error for an axis with one reading in every posture: saturated, frozen or dead.

    stuck : (3,), which axes of its sensor have.
    """
    value = float(dwells.force_max[0, i, j])
    low, high = (value, value) if dwells.force_range is None else dwells.force_range[:, i, j]
    facts: dict[str, Value] = {
        **stuck_axes(rig.axes[i], stuck, dwells.force_max[0, i]),
        "postures": len(dwells),
        "left_out": len(dwells.left_out),
        "low": float(low),
        "high": float(high),
        "moves": bool(low < high),
    }
    if np.isfinite(since := float(_since(dwells)[i, j])):
        facts |= {"since": since, "before": sum(out.end <= since for out in dwells.left_out)}
    code = "axis-frozen" if low < high else "channel-dead"
    if abs(value) >= rig.capacity[i, j] * (1 - _AT) or _at_limit(dwells, value, i, j):
        code = "axis-saturated"
    return DataError(Finding(code, (rig.supports[i],), value, "N", values=facts))
