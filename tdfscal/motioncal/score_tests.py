"""Score tests on the residual of a motion: what the rig file lacks, and what touches the terminal.

As for postures: each suspect is a set of columns that the model does not have, in the Fourier
coefficients whitened by the noise's own spectrum.

A contact is a free wrench in a sliding window: the window's shape times each of six components. Its
score in the weighted residuals, less what the fit would take up of it, is χ² of as many unknowns as
are seen where nothing touches (Rao, Proc. Camb. Phil. Soc. 44, 1948).
"""

from __future__ import annotations

from collections.abc import Callable, Iterator, Sequence
from operator import itemgetter

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
from tdfscal.frozen import replace
from tdfscal.motioncal.blocks import SHORTEST, Block, ComplexArray, Stretch, blocks, runs
from tdfscal.motioncal.design import BlockDesign, suspected
from tdfscal.motioncal.estimator import at_state, residual_wrench
from tdfscal.motioncal.fit import MovingFit
from tdfscal.motioncal.preparation import Usable, check_blocks
from tdfscal.motioncal.slip import CONTACT, likeliest_steps
from tdfscal.numerics.distributions import chi2_quantile
from tdfscal.numerics.streams import covered
from tdfscal.records import BoolArray, FloatArray, IntArray
from tdfscal.significance import CONTACT_IN_MOTION


def suspicions(of: Estimate[MovingFit], left_out: Sequence[Stretch] = ()) -> tuple[Suspicion, ...]:
    """Ask for every suspect, and return the likeliest with those that are about as likely.

    left_out : what was. Where that is an end of the log that was touched, it may be the rest that
    was, by as much: then the model lacks that wrench.
    """
    found = likeliest(speaking(of, [*stated_suspects(of.fit), *_drifts(of.fit)]))
    time = of.fit.slow.time
    for stretch in left_out:
        gap = min(stretch.begin - time[0], time[-1] - stretch.end)
        if found and stretch.reason.code == _TOUCHED.code and gap < SHORTEST:
            rest = replace(stretch.reason, code="rest-touched")
            return (replace(found[0], causes=(*found[0].causes, rest)), *found[1:])
    return found


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


#: Way from one edge of a window to the next, s; a short window's edges are two of these apart.
_STRIDE = 0.5
#: Blocks above which no fit takes up half of what a window shows.
_MANY, _HALF = 4, 0.5
#: Edges at most, of the short windows that show most, between which a contact lasts in a block; the
#: longest one as a share of the log, with one edge less: the rest in contact would look alike.
_EDGES, _LONGEST, _LONGEST_AT_END = 40, 0.7, 0.5
#: Why a stretch is left out for it.
_TOUCHED = Finding("stretch-touched", unit="N")
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
        found, worth = touched(fit)
        best = next(iter(likeliest_steps(fit)), None) if found else None
        if best and best.what != CONTACT and best.worth > worth:
            found = min(found, touched(fit, best.wrench)[0], key=covered)
        if not found:
            break
        rejected = _merged([*usable.rejected, *found])
        for s in rejected:
            keep = keep & ((slow.time < s.begin) | (slow.time > s.end))
        usable = Usable(keep, blocks(slow, keep), rejected)
        check_blocks(slow, usable.blocks)
        fit = again(usable.blocks, fit)
    return fit, replace(usable, rejected=tuple(_sized(fit, keep, s) for s in usable.rejected))


def _sized(fit: MovingFit, keep: BoolArray, stretch: Stretch) -> Stretch:
    """One that was touched with its wrench, the largest mean over a second at the fit."""
    if stretch.reason.code != _TOUCHED.code:
        return stretch
    after = fit.slow.time - stretch.begin
    inside = (after >= 0) & (fit.slow.time <= stretch.end)
    near = (after > -SHORTEST) & (fit.slow.time < stretch.end + SHORTEST)
    cut = blocks(fit.slow, near & (keep | inside))
    there = at_state(fit.priors, cut, fit.state, fit.noise)
    force, moment = residual_wrench(there, fit.still, fit.still).after.max(axis=0).tolist()
    reason = replace(stretch.reason, size=force, values={"moment": moment})
    return replace(stretch, reason=reason)


def _merged(left_out: Sequence[Stretch]) -> tuple[Stretch, ...]:
    """Join stretches close to each other: what lies between is no log to calibrate from."""
    out: list[Stretch] = []
    for stretch in sorted(left_out, key=lambda s: s.begin):
        if out and stretch.begin - out[-1].end < _TOGETHER:
            last = out.pop()
            stretch = Stretch(last.begin, max(last.end, stretch.end), last.reason)
        out.append(stretch)
    return tuple(out)


def touched(
    fit: MovingFit, known: Sequence[ComplexArray] = ()
) -> tuple[tuple[Stretch, ...], float]:
    """Name the stretches in which a wrench acts that the model does not know, the strongest ones.

    The spectrum takes a wrench that lasts for slow noise, and only its edges show. So a window from
    edge to edge stands for the strongest of them where it explains a share of what that does.

    known : wrench (F, 6) of every block that a step explains, beside which none lasts. Returns what
    the largest one is worth too, less its unknowns.
    """
    wrenches = fit.wrenches()
    if known:
        wrenches = [e + own for e, own in zip(wrenches, known, strict=True)]
    alike = {len(block): block for block in fit.blocks}
    shapes = {size: _rises(block) for size, block in alike.items()}
    tests = sum(len(shapes[len(block)][1]) + _EDGES**2 // 2 for block in fit.blocks)
    unknowns = len(fit.designs[0].mix)
    limit = float(chi2_quantile(1 - CONTACT_IN_MOTION / tests, unknowns))
    root = factored_information(fit).root
    floor = _HALF * limit if len(fit.designs) > _MANY else 0.0
    seconds = sum(block.seconds for block in fit.blocks)
    short, lasting = [(0.0, Stretch(0.0, 0.0, _TOUCHED))], [(0.0, Stretch(0.0, 0.0, _TOUCHED))]
    for item, e in zip(fit.designs, wrenches, strict=True):
        rise, edges = shapes[len(item.block)]
        edges = item.block.begin + edges
        a = np.arange(1, len(edges) - 3)
        statistic = _scores(fit, item, e, rise[a] - rise[a + 2], root, floor)
        for run in runs(statistic > limit):
            begin, end = edges[[a[run.start], a[run.stop - 1] + 2]].tolist()
            short.append((float(statistic[run].max()), Stretch(begin, end, _TOUCHED)))
        a, b = _lasting(edges, a, statistic, seconds)
        if len(a) and not known:
            statistic = _scores(fit, item, e, rise[a] - rise[b], root, floor)
            k = int(np.argmax(statistic))
            begin, end = edges[[a[k], b[k]]].tolist()
            lasting.append((float(statistic[k]), Stretch(begin, end, _TOUCHED)))
    most, edge = max(short, key=itemgetter(0))
    size, longer = max(lasting, key=itemgetter(0))
    worth = max(most, size) - unknowns * float(np.log(fit.rows))
    # Where there is an edge, it is one of its own.
    own = edge.begin <= longer.end and longer.begin <= edge.end and size > _SHARE * most
    if own if most > limit else size > limit:
        return (longer,), worth
    return tuple(stretch for size, stretch in short if size > max(limit, _SHARE * most)), worth


def _lasting(
    edges: FloatArray, short: IntArray, statistic: FloatArray, seconds: float
) -> tuple[IntArray, IntArray]:
    """Beginnings and ends of windows that last, among edges (K,), s, of a block.

    short : (W,), beginnings of the short ones, and their statistic. seconds : of all blocks.
    """
    last = len(edges) - 1
    # Under the taper's ramps an edge is no other than the block's own.
    shown = short[3:-3][np.argsort(statistic[3:-3])[-_EDGES // 2 :]]
    some = np.unique(np.concatenate([shown, shown + 2, [0, last]]))
    a, b = some[np.array(np.triu_indices(len(some), 1))]
    most = np.where((a > 0) & (b < last), _LONGEST, _LONGEST_AT_END) * seconds
    lasts = (b - a > 2) & (edges[b] - edges[a] <= most)
    return a[lasts], b[lasts]


def _scores(
    fit: MovingFit,
    item: BlockDesign,
    e: ComplexArray,
    d: ComplexArray,
    root: FloatArray,
    floor: float,
) -> FloatArray:
    """Score statistics (W,) of all windows of one block.

    e : (F, 6), residual. d : (W, F), shapes. root : (p, r), of the parameters' covariance. Where
    the fit can take up half of a statistic at most, one below the floor is not worked out.
    """
    mixing, weight = item.mix, item.weight(fit.noise)
    # In the components that are independent: u = Σ d* r / s, G = Σ |d|² / s, L = Σ d* J / s.
    u = (d.conj() @ (e @ mixing.T * weight)).real
    G = np.abs(d) ** 2 @ weight
    statistic = np.asarray(np.sum(u**2 / G, axis=1))
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
        own = u[some]
        statistic[some] = np.sum(own * np.linalg.solve(info, own[..., None])[..., 0], axis=1)
    return statistic


def _rises(block: Block) -> tuple[ComplexArray, FloatArray]:
    """Coefficients (K, F) of smooth rises from 0 to 1 at edges (K,), s from the block's begin.

    A wrench may act already at its begin, where all of it has risen, and still at its end.
    """
    edges = np.linspace(0, block.seconds, int(block.seconds / _STRIDE) + 1)
    since = (np.arange(len(block)) * block.step)[:, None] - edges
    rise = np.sin(np.pi / 4 * np.clip(since / _STRIDE + 1, 0, 2)) ** 2
    rise[:, 0], rise[:, -1] = 1, 0
    return block.transform(rise).T, edges
