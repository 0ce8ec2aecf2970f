"""What of a log serves in motion: frozen, clipped and touched stretches are left out.

A log that cannot serve at all is refused with its reason. What touches the terminal while it moves
is found by a score test of a free wrench in sliding windows: a window's shape times each of the six
components of a wrench is a column that the model does not have. Its score in the weighted
residuals, less what the fit would take up of it, is χ² of as many unknowns as are seen where
nothing touches (Rao, Proc. Camb. Phil. Soc. 44, 1948).
"""

from __future__ import annotations

from collections.abc import Callable, Sequence

import numpy as np

from tdfscal.checks.faulty_sensors import check_directions, check_unmeasured, stuck_axes
from tdfscal.checks.log_against_rig import check_unit
from tdfscal.errors import DataError
from tdfscal.estimation.fit import factored_information
from tdfscal.findings import Finding, Value
from tdfscal.frozen import record
from tdfscal.motioncal.blocks import BAND, SHORTEST, Block, ComplexArray, Stretch, blocks, runs
from tdfscal.motioncal.design import BlockDesign
from tdfscal.motioncal.estimator import MovingFit
from tdfscal.motioncal.streams import Slow
from tdfscal.numerics.distributions import chi2_quantile
from tdfscal.records import BoolArray, FloatArray, Rig
from tdfscal.significance import CONTACT_IN_MOTION

#: Share of the speed's power above the band at which a recording is too slow for the motion.
_FAST = 0.05
#: Rounding of the recorded positions, over the positioners' own error, that is too coarse, and
#: the error of positioners of which nothing is stated, m.
_COARSE, _UNSTATED = 2.0, 1.0e-5
#: Time of one and the same reading after which a channel is frozen, s, what counts as the same,
#: and the way of another NCP, m, meanwhile that shows that the terminal moves.
_FROZEN, _SAME, _MOVES = 1.0, 1e-12, 1e-4
#: Longest step of time, in steps of the time base, that is no hole; share of the way that the NCPs
#: would have gone in a hole below which they did not move in it.
_HOLE, _JUMPED = 1.5, 0.2
#: Holes that are named one by one.
_NAMED = 3
#: Length of a window and the way from one to the next, s.
WINDOW, _STRIDE = 2.0, 0.5
#: A window under the taper's ramp shows nothing: least share of its weight.
_LEAST = 0.2
#: Blocks above which no fit takes up half of what a window shows.
_MANY, _HALF = 4, 0.5
#: Rounds in which contacts come to light.
_ROUNDS = 6
#: Left-out stretches closer than this are one, s.
_TOGETHER = 4.0


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

    Unfit: a component is dead, or one that is not measured follows the load, or positions are too
    coarse.
    """
    if rig.drift.temperature > 0 and slow.temperature is None:
        raise DataError(Finding("temperature-missing"))
    check_directions(rig)
    check_unmeasured(
        rig.supports,
        rig.axes,
        scatter=slow.force.std(axis=0),
        noise=np.diff(slow.force, 2, axis=0).std(axis=0) / np.sqrt(6.0),
    )
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

    A force that stays the same to the last digit is frozen; an NCP's place is while others move.
    """
    found: list[tuple[slice, Finding]] = []
    frozen = np.zeros(slow.force.shape, dtype=np.bool_)
    for i, j in np.argwhere(rig.axes):
        for run in _same(slow.force[:, i, j, None], slow.step):
            frozen[run, i, j] = True
    for i in range(rig.n):
        for run in runs(np.asarray(frozen[:, i].any(axis=1))):
            stuck = np.asarray(frozen[run, i].any(axis=0))
            values = stuck_axes(rig.axes[i], stuck, slow.force[run.start, i])
            if run.stop == len(frozen) and run.start:
                values["before"] = round(float(slow.time[run.start]), 2)
            found.append((run, Finding("stretch-frozen", (rig.supports[i],), values=values)))
        reason = Finding("stretch-standing", (rig.supports[i],))
        still = _same(slow.position[:, i], slow.step)
        moved = (np.ptp(slow.position[run], axis=0).max() > _MOVES for run in still)
        found += [(run, reason) for run, other in zip(still, moved, strict=True) if other]
    return found + [(run, Finding("stretch-over-capacity")) for run in runs(slow.clipped)]


def _same(value: FloatArray, step: float) -> list[slice]:
    """Runs of instants at which values (N, c) stay the same for _FROZEN seconds or more."""
    change = np.abs(np.diff(value, axis=0)) <= _SAME * np.abs(value[1:])
    least = max(3, int(np.ceil(_FROZEN / step)))
    return [
        slice(run.start, run.stop + 1)
        for run in runs(np.asarray(change.all(axis=1)))
        if run.stop - run.start >= least
    ]


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


def without_contacts(
    fit: MovingFit, usable: Usable, again: Callable[[tuple[Block, ...], MovingFit], MovingFit]
) -> tuple[MovingFit, Usable]:
    """Leave out what touches the terminal, and fit anew, until nothing does.

    again : the fit of what is left, from the last one.
    """
    slow, keep = fit.slow, usable.keep
    for _ in range(_ROUNDS):
        found = touched(fit)
        if not found:
            break
        rejected = _merged([*usable.rejected, *found])
        for s in rejected:
            keep = keep & ((slow.time < s.begin) | (slow.time > s.end))
        usable = Usable(keep, blocks(slow, keep), rejected)
        check_blocks(slow, usable.blocks)
        fit = again(usable.blocks, fit)
    return fit, usable


def _merged(left_out: Sequence[Stretch]) -> tuple[Stretch, ...]:
    """Join stretches close to each other: what lies between is no log to calibrate from."""
    out: list[Stretch] = []
    for stretch in sorted(left_out, key=lambda s: s.begin):
        if out and stretch.begin - out[-1].end < _TOGETHER:
            last = out.pop()
            stretch = Stretch(last.begin, max(last.end, stretch.end), last.reason)
        out.append(stretch)
    return tuple(out)


def touched(fit: MovingFit) -> tuple[Stretch, ...]:
    """Name the stretches in which a wrench acts that the model does not know."""
    alike = {len(block): block for block in fit.blocks}
    shapes = {size: _windows(block) for size, block in alike.items()}
    tests = max(1, sum(len(shapes[len(block)][1]) for block in fit.blocks))
    limit = float(chi2_quantile(1 - CONTACT_IN_MOTION / tests, len(fit.designs[0].mix)))
    root = factored_information(fit).root
    floor = _HALF * limit if len(fit.designs) > _MANY else 0.0
    out: list[Stretch] = []
    for item, e in zip(fit.designs, fit.wrenches(), strict=True):
        d, middle = shapes[len(item.block)]
        statistic, wrench = _scores(fit, item, e, d, root, floor)
        time = item.block.begin + middle
        out += [_stretch(time[run], wrench[run]) for run in runs(statistic > limit)]
    return tuple(out)


def _stretch(middle: FloatArray, wrench: FloatArray) -> Stretch:
    """Join neighbouring windows (W,): a window tells of what lies in its middle half."""
    force, moment = np.linalg.norm(wrench.reshape(-1, 2, 3), axis=2).max(axis=0)
    return Stretch(
        begin=float(middle[0] - WINDOW / 4),
        end=float(middle[-1] + WINDOW / 4),
        reason=Finding(
            "stretch-touched", size=float(force), unit="N", values={"moment": float(moment)}
        ),
    )


def _scores(
    fit: MovingFit,
    item: BlockDesign,
    e: ComplexArray,
    d: ComplexArray,
    root: FloatArray,
    floor: float,
) -> tuple[FloatArray, FloatArray]:
    """Score statistics (W,) of all windows of one block, and their wrenches (W, 6).

    e : (F, 6), residual. d : (W, F), shapes. root : (p, r), of the parameters' covariance. Where
    the fit can take up half of a statistic at most, one below the floor is not worked out.
    """
    mixing, weight = item.mix, item.weight(fit.noise)
    # In the components that are independent: u = Σ d* r / s, G = Σ |d|² / s, L = Σ d* J / s.
    u = (d.conj() @ (e @ mixing.T * weight)).real
    G = np.abs(d) ** 2 @ weight
    statistic = np.asarray(np.sum(u**2 / G, axis=1))
    amplitude = -u / G
    some = statistic >= floor
    if some.any():
        J = (mixing @ item.wrench(fit.slope)) * weight[..., None]
        L = d[some].conj() @ J.reshape(len(weight), -1)
        each = np.arange(len(mixing))
        taken = L.real.reshape(len(L), len(each), -1) @ root
        info = -(taken @ np.swapaxes(taken, 1, 2))
        info[:, each, each] += G[some]
        # What the fit takes up whole leaves no information; a trace of it keeps the matrix regular.
        info[:, each, each] += 1e-6 * G[some]
        amplitude[some] = -np.linalg.solve(info, u[some, :, None])[..., 0]
        statistic[some] = -np.sum(u[some] * amplitude[some], axis=1)
    # e = … + wrench of the contact: what acts is minus what the balance lacks.
    return statistic, np.asarray(-amplitude @ np.linalg.pinv(mixing).T)


def _windows(block: Block) -> tuple[ComplexArray, FloatArray]:
    """Coefficients (W, F) of shapes, smooth and of height 1, and their middles (W,).

    Middles are in s from the block's begin.
    """
    time = block.step * np.arange(len(block))
    middle = np.arange(WINDOW / 2, time[-1] - WINDOW / 2 + 1e-9, _STRIDE)
    near = np.ceil((middle - WINDOW / 2) / block.step).astype(int)[:, None]
    near = near + np.arange(int(WINDOW / block.step) + 1)
    u = (block.step * near - middle[:, None]) / (WINDOW / 2)
    shape = np.zeros((len(middle), len(block) + 1))  # one more instant, at which a window may end
    np.put_along_axis(shape, near, np.where(np.abs(u) < 1, np.cos(np.pi * u / 2) ** 2, 0.0), 1)
    shape = shape[:, :-1]
    seen = shape @ block.taper[0] >= _LEAST * shape.sum(axis=1)
    return block.transform(shape[seen].T).T, middle[seen]
