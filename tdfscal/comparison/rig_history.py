"""What is known of a rig when a campaign begins, and its history from calibrations and campaigns.

A calibration that stands on an earlier one counts only with what its own data added.
"""

from __future__ import annotations

from collections.abc import Mapping, Sequence

import numpy as np

from tdfscal.comparison.common import common, with_load
from tdfscal.comparison.control_chart import Check
from tdfscal.comparison.history import Life, live
from tdfscal.comparison.misfit import scatter_of, within
from tdfscal.comparison.pooling import Pool
from tdfscal.errors import UsageError
from tdfscal.estimation.exact_quantities import OF_THE_TERMINAL
from tdfscal.estimation.fit import Priors, stated
from tdfscal.findings import Finding
from tdfscal.frozen import field, record, replace
from tdfscal.model.calibrated import free_constants, joint_prior, of_load, same_load, turned
from tdfscal.model.parameters import State, deviation, nominal
from tdfscal.numerics import so3
from tdfscal.numerics.information import Information, without
from tdfscal.records import BoolArray, ExactMoves, FloatArray, JointPrior, Measured, Rig
from tdfscal.significance import ALARMS_PER_YEAR


@record(kw_only=True)
class EarlierCalibration:
    """A calibration with its full covariance, before any scaling by a Birge ratio.

    information : on the free constants (C,) of its rig, counted from `state`. determined : (n,),
    sensors whose turns it gives. chi2, dof : of all the fits behind it. sha256 : of its file.
    base : digest and date of the calibration that it stands on. pooled : of several campaigns.
    exact : how its constants (C,) move with errors of what it took as exact. sources : (n, 3),
    share of each source in the variance of its roll, pitch, yaw; none where that is not told.
    """

    name: str
    rig: Rig
    state: State
    information: Information
    determined: BoolArray
    measured: Measured
    sha256: str
    chi2: float
    dof: int
    base: tuple[str, str] | None = None
    pooled: bool = False
    exact: tuple[ExactMoves, ...] = ()
    sources: Mapping[str, FloatArray] = field(default_factory=dict)

    def prior(self, rig: Rig, month: float) -> JointPrior:
        """What it says of a rig's constants at a time in months, its walk since included.

        Of the terminal only where the rig file states it alike.
        """
        known = self.information.walked(self.walk(rig, month))
        alike = same_load(self.rig, rig)
        other, free = of_load(self.rig) & (not alike), free_constants(self.rig)
        exact = [
            one if alike or one.name not in OF_THE_TERMINAL else one.all_apart()
            for one in self.exact
        ]
        prior = joint_prior(
            rig, self.state, known, self.chi2, self.dof, free=free, but=other, exact=exact
        )
        return replace(prior, sources=self._with_walk(self.walk(rig, month)))

    def _with_walk(self, walk: FloatArray) -> dict[str, FloatArray]:
        """Shares of the sources after the angles walked with variance (C,)."""
        if not self.sources:
            return {}
        size = 3 * self.rig.n
        R, own = self.state.rotation, self.information.covariance[:size, :size]
        before, walked = so3.rpy_variance(R, own), so3.rpy_variance(R, np.diag(walk[:size]))
        left = before / (before + walked)
        return {name: left * share for name, share in self.sources.items()} | {"walk": 1.0 - left}

    def walk(self, rig: Rig, month: float) -> FloatArray:
        """Variance by which a rig's angles may have walked since, at a time in months."""
        gap = max(month - self.measured.month, 0.0)
        return turned(rig, rig.drift.angle * float(np.sqrt(gap)), len(self.information.score))

    def about(self, reference: State) -> Information:
        """Information (c,) on its own constants, counted from a reference."""
        free = free_constants(self.rig)
        away = deviation(self.state, reference)[: len(free)][free]
        return Information(self.information.matrix, self.information.matrix @ away)


def life_of(
    rig: Rig, known: Sequence[EarlierCalibration], pooled: Pool | None
) -> tuple[Life, list[Finding]]:
    """Go through calibrations and a pool's campaigns; and say which count with their own scatter.

    Raises UsageError where a calibration stands on another that is not among them.
    """
    rigs = pooled.common.rigs if pooled else ()
    shared = common([*rigs, *(e.rig for e in known)])
    first, told = known[0].state if known else nominal(rig), np.zeros(rig.n, dtype=np.bool_)
    if pooled:
        first, told = pooled.reference, _determined(rig, pooled)
    first = _with_turns(first, told, known)
    loads = [*(pooled.references if pooled else ()), *(e.state for e in known)]
    references = [with_load(first, loads[k]) for k in shared.terminal]
    prior, checks, fits = shared.stated(references), list[Check](), list[tuple[float, int]]()
    for k, m in enumerate(pooled.members if pooled else ()):
        own = m.own.padded(shared.size)
        if not told.all():
            own = _added(rig, own + prior, prior, told)
        checks.append(Check(m.name, m.month, own, shared.load(k)))
        fits.append(within(replace(m.reduced, information=own), prior))
    for k, e in enumerate(known, len(rigs)):
        own = _own(rig, e, known, references[k])
        checks.append(Check(e.name, e.measured.month, shared.embedded(k, own), shared.load(k)))
        fits.append((0.0, 0) if e.pooled else (e.chi2, e.dof))
    birge = scatter_of(fits)
    least = float(birge.min())
    noisy = [
        Finding("campaign-noisy", (check.name,), float(ratio))
        for check, ratio in zip(checks, birge, strict=True)
        if ratio > least
    ]
    scaled = (replace(c, own=c.own.scaled(b / least)) for c, b in zip(checks, birge, strict=True))
    ordered = sorted(scaled, key=lambda check: check.month)
    return live(rig, references[-1], prior, ordered, rate=ALARMS_PER_YEAR, birge=least), noisy


def _determined(rig: Rig, pooled: Pool) -> BoolArray:
    """Sensors (n,) that campaigns together determine, or that lack no axis in any of them."""
    whole = np.all([one.axes.all(axis=1) for one in pooled.common.rigs], axis=0)
    last = pooled.posterior(len(pooled.members) - 1)
    std = np.sqrt(np.diagonal(last.covariance)[: 3 * rig.n]).reshape(-1, 3)
    return np.asarray(whole | (std.max(axis=1) < rig.acceptance.identifiable))


def _with_turns(first: State, told: BoolArray, known: Sequence[EarlierCalibration]) -> State:
    """Constants from which all checks count: each sensor's turns where something determines it.

    told : (n,), those that the first state has from something.
    """
    rotation = first.rotation.copy()
    for e in known:
        new = e.determined & ~told
        rotation[new], told = e.state.rotation[new], told | new
    return replace(first, rotation=rotation)


def _own(
    rig: Rig, e: EarlierCalibration, known: Sequence[EarlierCalibration], reference: State
) -> Information:
    """What a calibration's own data say (c,), without what was known before them."""
    told, before = e.determined, stated(Priors(e.rig), reference)
    if e.base is not None:
        digest, created = e.base
        base = next((other for other in known if other.sha256 == digest), None)
        if base is not None:
            stood = base.about(reference).walked(base.walk(rig, e.measured.month))
            told = told & base.determined
            if same_load(base.rig, e.rig):
                before = stood
            else:  # of the terminal its own rig file spoke
                spoken, kept = ~of_load(e.rig), ~of_load(base.rig)
                rest = stood.without(~kept)
                before.matrix[np.ix_(spoken, spoken)] = rest.matrix[np.ix_(kept, kept)]
                before.score[spoken] = rest.score[kept]
        elif min(other.measured.month for other in known) < e.measured.month:
            unnamed = Finding("calibration-unnamed", values={"date": created[:10]})
            raise UsageError(unnamed, where=e.name)
    return _added(e.rig, e.about(reference), before, told)


def _added(rig: Rig, now: Information, before: Information, told: BoolArray) -> Information:
    """What was added to what was known before, but for turns of sensors (n,) that are not told."""
    lost = np.zeros(len(now.score), dtype=np.bool_)
    lost[: 3 * rig.n] = np.repeat(~told, 3)
    return without(now.without(lost), before.without(lost))
