"""What of a log serves in motion, and where the estimate starts.

Frozen and clipped stretches are left out; a log that cannot serve at all is refused with its
reason. The mounting to start from comes from instants taken as if at rest.
"""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import replace

import numpy as np

from tdfscal.checks.faulty_sensors import check_directions, stuck_axes
from tdfscal.checks.log_against_rig import check_unit
from tdfscal.errors import DataError, TdfscalError
from tdfscal.estimation.fit import factored_information
from tdfscal.findings import Finding, Value
from tdfscal.frozen import record
from tdfscal.model.parameters import State, starting_state
from tdfscal.model.postures import Postures, alike
from tdfscal.motioncal.blocks import BAND, SHORTEST, Block, Stretch, blocks, runs
from tdfscal.motioncal.estimator import at_state, estimate_noise
from tdfscal.motioncal.fit import MovingFit, MovingPriors
from tdfscal.motioncal.streams import REACH, Slow
from tdfscal.numerics import so3
from tdfscal.numerics.distributions import normal_quantile
from tdfscal.records import BoolArray, FloatArray, Rig, UncertainValue
from tdfscal.selfcal.estimator import fit as quasi_static
from tdfscal.selfcal.mounting_search import APART, apart, best_start, describe
from tdfscal.selfcal.preparation import check_forces
from tdfscal.significance import AMBIGUOUS_MOUNTING

#: Share of the speed's power above the band at which a recording is too slow for the motion.
_FAST = 0.05
#: Rounding of the recorded positions, over the positioners' own error, that is too coarse, and
#: the error of positioners of which nothing is stated, m.
_COARSE, _UNSTATED = 2.0, 1.0e-5
#: Time of one and the same reading after which a channel is frozen, s, what counts as the same,
#: and the way of another NCP, m, meanwhile that shows that the terminal moves.
_FROZEN, _SAME, _MOVES = 1.0, 1e-12, 1e-4
#: Instants that the kernel mixes with a frozen one, and how far a force jumps, in usual ways.
_MIXED, _JUMP = round(2 * REACH), 2.0
#: Longest step of time, in steps of the time base, that is no hole; share of the way that the NCPs
#: would have gone in a hole below which they did not move in it.
_HOLE, _JUMPED = 1.5, 0.2
#: Holes that are named one by one.
_NAMED = 3


@record
class Usable:
    """What of a log serves: its instants (a mask (N,)), their blocks, and what was left out."""

    keep: BoolArray
    blocks: tuple[Block, ...]
    rejected: tuple[Stretch, ...]


def usable_samples(rig: Rig, slow: Slow) -> Usable:
    """Leave out what is frozen or clipped. Raises DataError where nothing serves."""
    check_stream(rig, slow)
    keep, rejected = np.ones(len(slow.time), dtype=np.bool_), []
    for run, reason in _unfit(rig, slow):
        keep[run] = False
        rejected.append(Stretch(float(slow.time[run][0]), float(slow.time[run][-1]), reason))
    cut = blocks(slow, keep)
    if not cut:
        check_unit(rig, slow.force)
    check_blocks(slow, cut)
    return Usable(keep, cut, tuple(rejected))


def check_stream(rig: Rig, slow: Slow) -> None:
    """Raise DataError where a declaration has no place in motion, or the streams are unfit.

    NotIdentifiableError where the sensors together miss a direction of forces.

    Unfit: a component is dead, or positions are too coarse.
    """
    if rig.drift.temperature > 0 and slow.temperature is None:
        raise DataError(Finding("temperature-missing"))
    check_directions(rig)
    still = np.ptp(slow.force, axis=0) <= _SAME * np.abs(slow.force).max(axis=0)
    for i in np.flatnonzero((still & rig.axes).any(axis=1)):
        check_unit(rig, slow.force)
        values = stuck_axes(rig.axes[i], still[i], slow.force[0, i])
        raise DataError(Finding("channel-dead", (rig.supports[i],), values=values))
    rounding, own = slow.quantum / np.sqrt(12.0), rig.declared.positioner or _UNSTATED
    if rounding > _COARSE * own:
        each = {"step": slow.quantum, "error": rounding, "own": own}
        values = {name: 1e6 * float(size) for name, size in each.items()}
        raise DataError(Finding("positions-coarse", size=slow.quantum, unit="m", values=values))


def check_blocks(slow: Slow, cut: tuple[Block, ...]) -> None:
    """Raise DataError where nothing is left, or the motion is faster than the recording."""
    if not cut:
        raise DataError(Finding("motion-short", size=SHORTEST, unit="s"))
    fast = total = 0.0
    for block in cut:
        place = slow.position[block.index].reshape(len(block), -1)
        spectrum = np.fft.rfft(block.taper[0][:, None] * (place - place.mean(axis=0)), axis=0)
        f = np.fft.rfftfreq(len(place), slow.step)
        power = np.sum(np.abs(spectrum) ** 2, axis=1) * f**2
        fast += float(power[f > BAND / slow.step].sum())
        total += float(power.sum())
    moved = max(np.ptp(slow.position[block.index], axis=0).max() for block in cut)
    noise = 10 * max(slow.quantum, 1e-6)
    if fast > _FAST * total and moved > noise:
        edge, values = BAND / slow.step, {"rate": float(slow.rate)}
        raise DataError(Finding("motion-fast", size=edge, unit="Hz", values=values))


def _unfit(rig: Rig, slow: Slow) -> list[tuple[slice, Finding]]:
    """Runs of instants at which a channel is frozen or clipped, and what is wrong there.

    A force that stays the same to the last digit for long, or at a level it jumped to, is frozen,
    with what the kernel mixes with it; an NCP's place is while others move, or where it jumps.
    """
    found: list[tuple[slice, Finding]] = []
    frozen = np.zeros(slow.force.shape, dtype=np.bool_)
    places = slow.position.reshape(len(slow.time), -1)
    leapt = [run for run, jumped in _standing(places) if jumped]
    for i, j in np.argwhere(rig.axes):
        for run, jumped in _standing(slow.force[:, [i], j]):
            frozen[run, i, j] = jumped or run.stop - run.start > _FROZEN / slow.step
    for i in range(rig.n):
        for run in runs(np.asarray(frozen[:, i].any(axis=1))):
            stands = np.ptp(slow.force[run, i], axis=0) <= _SAME * np.abs(slow.force[run.start, i])
            stuck = np.asarray(frozen[run, i].any(axis=0) | stands)
            values = stuck_axes(rig.axes[i], stuck, slow.force[run.start, i])
            if run.stop == len(frozen) and run.start:
                values["before"] = round(float(slow.time[run.start]), 2)
            run = slice(max(run.start - _MIXED, 0), run.stop + _MIXED)
            found.append((run, Finding("stretch-frozen", (rig.supports[i],), values=values)))
        reason = Finding("stretch-standing", (rig.supports[i],))
        for run in _same(slow.position[:, i]):
            others = np.ptp(slow.position[run], axis=0).max() > _MOVES
            jumped = any(run.start < one.stop and one.start < run.stop for one in leapt)
            if run.stop - run.start >= _FROZEN / slow.step and (others or jumped):
                found.append((slice(max(run.start - _MIXED, 0), run.stop + _MIXED), reason))
    return found + [(run, Finding("stretch-over-capacity")) for run in runs(slow.clipped)]


def _standing(value: FloatArray) -> list[tuple[slice, bool]]:
    """Runs of instants at which values (N, c) stay the same, and whether they jumped there.

    They jumped where they went farther than twice what they ever go in as much time elsewhere.
    """
    stands = _same(value)
    near = np.zeros(len(value), dtype=np.bool_)
    for run in stands:
        near[max(run.start - _MIXED, 0) : run.stop + _MIXED] = True
    way = np.abs(value[_MIXED:] - value[:-_MIXED]).max(axis=1)
    apart = ~(near[_MIXED:] | near[:-_MIXED])
    usual = way.max(initial=0.0, where=apart) if apart.any() else np.inf

    def jumped(run: slice) -> bool:
        ends = value[[max(run.start - _MIXED, 0), min(run.stop - 1 + _MIXED, len(value) - 1)]]
        return bool(np.abs(ends - value[run.start]).max() > _JUMP * usual)

    return [(run, jumped(run)) for run in stands]


def _same(value: FloatArray) -> list[slice]:
    """Runs of two instants and more at which values (N, c) stay the same."""
    change = np.abs(np.diff(value, axis=0)) <= _SAME * np.abs(value[1:])
    return [slice(run.start, run.stop + 1) for run in runs(np.asarray(change.all(axis=1)))]


def gaps(slow: Slow) -> list[Finding]:
    """Name the holes at which the motion is cut: pauses, and clocks that jumped ahead.

    Where the NCPs go on after a hole from where they stood before it, while they moved all along,
    no time has passed: the clock of all streams jumped. What follows is as good as what was before.
    """
    out = []
    # Of the NCP that goes farthest, from each instant to the next; 0 before the first.
    way = np.pad(np.linalg.norm(np.diff(slow.position, axis=0), axis=2).max(axis=1), 1)
    for k in np.flatnonzero(np.diff(slow.time) > _HOLE * slow.step):
        begin, end = slow.time[k : k + 2]
        expected = (way[k] + way[k + 2]) / 2 * (end - begin) / slow.step
        jumped = expected > _MOVES and way[k + 1] < _JUMPED * expected
        values: dict[str, Value] = {"begin": float(begin), "end": float(end)}
        code = "clock-jumped" if jumped else "recording-paused"
        out.append(Finding(code, size=float(end - begin), unit="s", values=values))
    if len(out) > _NAMED:
        out = [*out[:_NAMED], Finding("holes-more", size=len(out) - _NAMED)]
    return out


#: Blocks of a long log from which it is told what its moves would add.
_FEW = 4
#: Instants at most that the quasi-static start is estimated from, and their noise, N and m.
_START_ROWS, _START_FORCE, _START_PLACE = 400, 1.0, 1.0e-5
#: A mounting farther than this from the nominal one was not meant by it, rad.
_MOUNTED_WITHIN = 0.3


def first_fit(
    rig: Rig, seen: Postures, fitted: Callable[[State], MovingFit]
) -> tuple[MovingFit, tuple[Finding, ...]]:
    """Fit from the nominal mounting, and from the one that explains the forces best.

    Where the two are mountings apart the likelier one stands. A motion that hardly tilts shows
    forces and their reverse alike (half a turn of every sensor): then the nominal mounting
    decides, and it is said.

    Raises DataError where units, signs or names of the forces cannot be right.
    """
    begin = starting_state(rig)
    near, best = quasi_static(rig, seen, begin), best_start(rig, seen)
    check_forces(rig, best.postures, best)
    if apart(near.state.rotation, best.state.rotation) <= APART:
        # Without some axes a turn may hardly show at rest, and where that start leads is far off.
        first = fitted(best.state if rig.axes.all() else begin)
        return first if first.converged or rig.axes.all() else fitted(best.state), ()
    far = fitted(best.state)
    if apart(near.state.rotation, begin.rotation) > APART + _MOUNTED_WITHIN:
        return far, ()
    close = fitted(near.state)
    if apart(close.state.still.rotation, far.state.still.rotation) <= APART:
        return close, ()
    # Both by the spectrum of the better one, which the other can only have raised.
    scale = min(close, far, key=lambda f: float(f.noise.variance(f.data.bins).sum())).noise
    gap = replace(close, noise=scale).cost - replace(far, noise=scale).cost
    if gap > float(normal_quantile(1 - AMBIGUOUS_MOUNTING)) ** 2:
        return far, ()
    other, _ = describe(rig, close.state.still, far.state.still)
    return close, (Finding("mounting-ambiguous", values={"other": other}),)


def moments(rig: Rig, slow: Slow, keep: BoolArray) -> Postures:
    """Instants of the motion as if they were postures: for a start, and for the loads' course."""
    rows = np.flatnonzero(keep)
    rows = rows[:: max(1, int(np.ceil(len(rows) / _START_ROWS)))]
    force = np.where(rig.axes, slow.force[rows], 0.0)
    return alike(slow.position[rows], force, rig.axes, place=_START_PLACE, noise=_START_FORCE)


def with_moves(rig: Rig, slow: Slow, delay: UncertainValue, still: State) -> FloatArray | None:
    """Standard uncertainties (n, 3) of roll, pitch, yaw to expect from the whole log, rad.

    One linearisation at the estimate from the dwells, and the spectrum of what it leaves: no
    iteration, and nothing for what that spectrum leaves open, which is little wherever the moves
    tell much. Of a long log some blocks are looked at, and the rest taken to tell as much.

    still : the estimate from the dwells. Returns None where the log does not serve in motion.
    """
    try:
        whole = usable_samples(rig, slow).blocks
        few = whole[:: -(-len(whole) // _FEW)]
        priors = MovingPriors(rig, slow, delay)
        fit = estimate_noise(at_state(priors, few, priors.start(still), None))
        turns = factored_information(fit).root[: 3 * rig.n]
        std = np.sqrt(so3.rpy_variance(still.rotation, turns @ turns.T))
    except (TdfscalError, np.linalg.LinAlgError):
        return None
    seen, all_seconds = (sum(block.seconds for block in part) for part in (few, whole))
    return std * float(np.sqrt(seen / all_seconds))
