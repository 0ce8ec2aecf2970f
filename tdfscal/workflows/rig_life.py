"""Calibrations and campaigns of one rig as checks from one common reference."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import replace

import numpy as np

from tdfscal.comparison.control_chart import Check
from tdfscal.comparison.eliminated import stated
from tdfscal.comparison.history import Life, live
from tdfscal.comparison.pooling import Pool, pool
from tdfscal.errors import UsageError
from tdfscal.model.earlier import free_constants, turned
from tdfscal.model.parameters import State, deviation
from tdfscal.numerics.information import Information, without
from tdfscal.records import BoolArray, Rig
from tdfscal.selfcal.estimator import Priors
from tdfscal.workflows.earlier import Earlier
from tdfscal.workflows.several_campaigns import Read, recorded


def life_of(rig: Rig, known: Sequence[Earlier], reads: Sequence[Read], rate: float) -> Life:
    """Go through calibrations and campaigns of a rig, at a rate of false alarms per year.

    Raises UsageError where a calibration stands on another that is not among them.
    """
    checks: list[Check] = []
    fits = [(e.chi2, e.dof) for e in known if not e.file.campaigns]
    if reads:
        pooled = pool([recorded(read) for read in reads])
        reference, told = pooled.reference, _determined(rig, pooled, reads)
        for m in pooled.members:
            own = m.own if told.all() else _said(rig, m.own + pooled.prior, pooled.prior, told)
            checks.append(Check(m.name, m.month, own))
            fits.append(m.within)
    else:
        reference, told = known[0].state, np.zeros(rig.n, dtype=np.bool_)
    reference = _common(reference, told, known)
    prior = stated(Priors(rig), reference)
    checks += [
        Check(e.name, e.measured.month, _own(rig, e, known, reference, prior)) for e in known
    ]
    checks.sort(key=lambda check: check.month)
    fit = (sum(chi2 for chi2, _ in fits), sum(dof for _, dof in fits))
    return live(rig, reference, prior, checks, rate=rate, fit=fit)


def _determined(rig: Rig, pooled: Pool, reads: Sequence[Read]) -> BoolArray:
    """Sensors (n,) that campaigns together determine, or that lack no axis in any of them."""
    whole = np.all([read.rig.axes.all(axis=1) for read in reads], axis=0)
    last = pooled.posterior(rig, len(pooled.members) - 1)
    std = np.sqrt(np.diagonal(last.covariance)[: 3 * rig.n]).reshape(-1, 3)
    return np.asarray(whole | (std.max(axis=1) < rig.acceptance.identifiable))


def _common(first: State, told: BoolArray, known: Sequence[Earlier]) -> State:
    """Constants from which all checks count: each sensor's turns where something determines it.

    told : (n,), those that the first state has from something.
    """
    rotation = first.rotation.copy()
    for e in known:
        new = e.file.determined & ~told
        rotation[new], told = e.state.rotation[new], told | new
    return replace(first, rotation=rotation)


def _own(
    rig: Rig, e: Earlier, known: Sequence[Earlier], reference: State, prior: Information
) -> Information:
    """What a calibration's own data say, without what was known before them."""
    told, before = e.file.determined, prior
    if e.file.history:
        last = e.file.history[-1]
        base = next((o for o in known if o.sha256 == last.sha256), None)
        if base is not None:
            gap = max(e.measured.month - base.measured.month, 0.0)
            step = turned(rig, rig.drift.angle * float(np.sqrt(gap)))
            told, before = told & base.file.determined, _about(rig, base, reference).walked(step)
        elif min(o.measured.month for o in known) < e.measured.month:
            raise UsageError(
                f"stands on a calibration of {last.created[:10]} that is not named",
                where=e.name,
                hint="name every calibration since the first, or campaigns instead",
            )
    return _said(rig, _about(rig, e, reference), before, told)


def _said(rig: Rig, now: Information, before: Information, told: BoolArray) -> Information:
    """What was added to what was known before, but for turns of sensors (n,) that are not told."""
    lost = np.zeros(int(free_constants(rig).sum()), dtype=np.bool_)
    lost[: 3 * rig.n] = np.repeat(~told, 3)
    return without(now.without(lost), before.without(lost))


def _about(rig: Rig, e: Earlier, reference: State) -> Information:
    """Information of a calibration, counted from a common reference."""
    free = free_constants(rig)
    away = deviation(e.state, reference)[: len(free)][free]
    return Information(e.information.matrix, e.information.matrix @ away)
