"""Score tests on the residual of a motion: what the rig file lacks, and what touches the terminal.

As for postures: each suspect is a set of columns that the model does not have, in the Fourier
coefficients whitened by the noise's own spectrum.

A contact is a free wrench in a sliding window: the window's shape times each of six components. Its
score in the weighted residuals, less what the fit would take up of it, is χ² of as many unknowns as
are seen where nothing touches (Rao, Proc. Camb. Phil. Soc. 44, 1948).
"""

from __future__ import annotations

from collections.abc import Callable, Iterator, Sequence

import numpy as np

from tdfscal.estimation.fit import factored_information
from tdfscal.estimation.score_tests import (
    Suspect,
    Suspicion,
    likeliest,
    moving_zeros,
    speaking,
    stated_suspects,
)
from tdfscal.estimation.uncertainty import Estimate
from tdfscal.findings import Finding
from tdfscal.motioncal.blocks import Block, ComplexArray, Stretch, blocks, runs
from tdfscal.motioncal.design import BlockDesign, suspected
from tdfscal.motioncal.fit import MovingFit
from tdfscal.motioncal.preparation import Usable, check_blocks
from tdfscal.motioncal.slip import likeliest_steps
from tdfscal.numerics.distributions import chi2_quantile
from tdfscal.numerics.streams import covered
from tdfscal.records import FloatArray
from tdfscal.significance import CONTACT_IN_MOTION


def suspicions(of: Estimate[MovingFit]) -> tuple[Suspicion, ...]:
    """Ask for every suspect, and return the likeliest with those that are about as likely."""
    return likeliest(speaking(of, [*stated_suspects(of.fit), *_drifts(of.fit)]))


def _drifts(fit: MovingFit) -> Iterator[Suspect]:
    """Zeros that move as nobody declared."""
    n, last = fit.rig.n, len(fit.psi) - fit.rests
    shapes = suspected(fit.rig, fit.slow)
    columns = fit.whiten(fit.data.design[:, last - 3 * n * len(shapes) : last])
    columns = np.pad(columns, ((0, len(fit.prior_residual)), (0, 0))).reshape(
        len(fit.white), -1, n, 3
    )
    for k, (name, _, unit) in enumerate(shapes):
        yield from moving_zeros(name, columns[:, k], unit)


#: Length of a window and the way from one to the next, s.
WINDOW, _STRIDE = 2.0, 0.5
#: A window under the taper's ramp shows nothing: least share of its weight.
_LEAST = 0.2
#: Blocks above which no fit takes up half of what a window shows.
_MANY, _HALF = 4, 0.5
#: Rounds in which contacts come to light.
_ROUNDS = 8
#: Share of the largest statistic below which a contact is asked again without the larger ones:
#: these bend the fit and the spectrum by which it is judged.
_SHARE = 0.3
#: Left-out stretches closer than this are one, s.
_TOGETHER = 4.0


def without_contacts(
    fit: MovingFit, usable: Usable, again: Callable[[tuple[Block, ...], MovingFit], MovingFit]
) -> tuple[MovingFit, Usable]:
    """Leave out what touches the terminal, and fit anew, until nothing does.

    What a sensor that turned on the way leaves looks like contact all over the log: where a step
    leaves less of it, only what is left beside the step is contact.

    again : the fit of what is left, from the last one.
    """
    slow, keep = fit.slow, usable.keep
    for _ in range(_ROUNDS):
        found = touched(fit)
        if found and (steps := likeliest_steps(fit)):
            found = min(found, touched(fit, steps[0].wrench), key=covered)
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


def touched(fit: MovingFit, known: Sequence[ComplexArray] = ()) -> tuple[Stretch, ...]:
    """Name the stretches in which a wrench acts that the model does not know, the strongest ones.

    known : wrench (F, 6) of every block that is explained already.
    """
    wrenches = fit.wrenches()
    if known:
        wrenches = [e + own for e, own in zip(wrenches, known, strict=True)]
    alike = {len(block): block for block in fit.blocks}
    shapes = {size: _windows(block) for size, block in alike.items()}
    tests = max(1, sum(len(shapes[len(block)][1]) for block in fit.blocks))
    limit = float(chi2_quantile(1 - CONTACT_IN_MOTION / tests, len(fit.designs[0].mix)))
    root = factored_information(fit).root
    floor = _HALF * limit if len(fit.designs) > _MANY else 0.0
    out: list[tuple[float, Stretch]] = []
    for item, e in zip(fit.designs, wrenches, strict=True):
        d, middle = shapes[len(item.block)]
        statistic, wrench = _scores(fit, item, e, d, root, floor)
        time = item.block.begin + middle
        found = runs(statistic > limit)
        out += [(statistic[run].max(), _stretch(time[run], wrench[run])) for run in found]
    most = max((float(size) for size, _ in out), default=0.0)
    return tuple(stretch for size, stretch in out if size > _SHARE * most)


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
    N, step = len(block), block.step
    middle = np.arange(WINDOW / 2, (N - 1) * step - WINDOW / 2 + 1e-9, _STRIDE)
    first = np.ceil((middle - WINDOW / 2) / step - 1e-9).astype(int)
    inside = np.arange(int(WINDOW / step) + 1)
    near = np.minimum(first[:, None] + inside, N - 1)
    u = (step * (first[:, None] + inside) - middle[:, None]) / (WINDOW / 2)
    shape = np.where(np.abs(u) < 1, np.cos(np.pi * u / 2) ** 2, 0.0)
    weighted = shape * block.taper[0, near]
    seen = weighted.sum(axis=1) >= _LEAST * shape.sum(axis=1)
    # A window is short: its own Fourier sum, turned to where it begins.
    turn = -2j * np.pi * step * block.frequency
    own = block.scale * weighted[seen] @ np.exp(inside[:, None] * turn)
    return own * np.exp(first[seen, None] * turn), middle[seen]
