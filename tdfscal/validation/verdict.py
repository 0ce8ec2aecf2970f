"""The verdict on a calibration in use, whatever kind of log it was tested on.

What looks like a changed rig may be none. A tare draws all zeros from what the rig file states,
whatever they were; it is told from a rig that changed by what it does: all sensors move, and stay
where they are over the log. What explains forces that fit nowhere is searched as a calibration does
it (`selfcal.misreadings`), and held against what may have changed by likelihood.
"""

from __future__ import annotations

from collections.abc import Callable
from typing import Literal

import numpy as np
from scipy import special

from tdfscal.findings import Finding
from tdfscal.frozen import record, replace
from tdfscal.model.calibrated import Calibrated, redrawn
from tdfscal.model.parameters import layout, prior_std
from tdfscal.numerics.distributions import INTERVAL_FACTOR, chi2_sf
from tdfscal.numerics.least_squares import block_diagonal
from tdfscal.records import FloatArray, Rig
from tdfscal.significance import (
    CAUSES_APART,
    DETECTION_POWER,
    VALIDATION_ALARM,
    VALIDATION_CHI2,
    VALIDATION_SEARCH,
)
from tdfscal.validation.causes import COURSES, NOISE, Cause, Causes, unknown_columns
from tdfscal.validation.residuals import Linearised, Whitened, basis, whiten

#: Does it hold; unproven: nothing speaks against it, but the log cannot show that it holds;
#: touched: the check is what is wrong, not the calibration.
Outcome = Literal["holds", "unproven", "touched", "changed"]

#: Of the search for one cause, the part of turned sensors.
_TURNED = 2.0 / 3.0


@record
class Judged:
    """Residual wrenches held against what the stated uncertainties explain.

    white : the residual wrench, all that correlates it taken away. causes : held against each
    other. p_value : of its χ². search_p : as `searched` has it. tared : as white, by zeros drawn
    anew; what stands out of it passes for no tare. noise_dof : degrees of freedom with which the
    noise behind p_value is known, ∞ as stated.
    """

    white: Whitened
    causes: Causes
    p_value: float
    search_p: float
    tared: Whitened | None = None
    noise_dof: float = np.inf

    @property
    def holds(self) -> bool:
        """Neither all residuals together nor the likeliest single cause are beyond chance."""
        return self.search_p >= VALIDATION_SEARCH and self.p_value >= VALIDATION_CHI2

    @property
    def merit(self) -> tuple[bool, float]:
        """Whether anything explains the residuals, and the likelihood of what does, −deviance."""
        explaining = [cause for cause in self.causes.best if cause.explains]
        weights = [cause.weight for cause in explaining or self.causes.best]
        best = max(*weights, 0.0) if self.holds else max(weights)
        return self.holds or bool(explaining), best - self.white.deviance


def searched(found: Causes, chance: Callable[[Cause], float]) -> float:
    """Smallest probability that chance looks so much like one cause, for as many as were tried.

    That a sensor turned is what is asked; it has two thirds of the search, the others one.
    """
    single = [c for c in found.best if len(c.postures) < 2 and c.kind not in (*NOISE, *COURSES)]
    turns = [c for c in single if c.kind == "sensor turned"]
    others = [c for c in single if c.kind != "sensor turned"]
    return min(
        1.0,
        len(turns) / _TURNED * min(map(chance, turns)),
        (found.tried - len(turns)) / (1 - _TURNED) * min(map(chance, others)),
    )


@record
class Zeros:
    """Zeros at the time of a log, n sensors, N, sensor frames.

    moved : they are not those of the calibration, as after a tare; the verdict takes them as drawn
    anew from what the rig file states. Where a change of the rig is suspected, the zeros are
    estimated together with the likeliest. change : (n, 3), from the calibration's zeros to these,
    its std beside it; ∞ where the log does not tell. detectable : (n, 3), the smallest change of
    one alone that is found with probability DETECTION_POWER. value : (n, 3), the zeros now, and
    covariance (3n, 3n).
    """

    moved: bool
    change: FloatArray
    change_std: FloatArray
    detectable: FloatArray
    value: FloatArray
    covariance: FloatArray


@record(kw_only=True)
class Verdict:
    """Verdict on a calibration: on angles, load and gain, by zeros that may have been tared anew.

    rig : of the log. judged : the test. zeros : whether they moved. findings : what is to be said
    of log and noise. own : logs that went into the calibration itself, where what was tested is
    theirs. earlier : the log is older than the calibration's data. gate_rejected : the calibration
    never was fit for use.
    """

    rig: Rig
    judged: Judged
    zeros: Zeros
    findings: tuple[Finding, ...]
    own: tuple[str, ...] = ()
    earlier: bool = False
    gate_rejected: bool = False

    @property
    def few(self) -> bool:
        """Too little was tested to show more than a gross change."""
        return False

    @property
    def limit(self) -> float:
        """Half width, rad, of the widest interval that the quality gate lets an angle have."""
        return INTERVAL_FACTOR * self.rig.acceptance.angle_std

    @property
    def blind(self) -> bool:
        """It would have missed a turn that the quality gate takes for too much."""
        return bool(self.detectable.max() > self.limit)

    @property
    def outcome(self) -> Outcome:
        """What the test says of the calibration; touched where nothing else explains the log."""
        if not self.holds:
            return "touched" if {c.kind for c in self.suspected} == {"contact"} else "changed"
        unproven = self.gate_rejected or self.own or self.earlier or self.few or self.blind
        return "unproven" if unproven else "holds"

    @property
    def decided_by_search(self) -> bool:
        """The search for one cause is farther below its limit than χ², or nearer above it."""
        return self.judged.search_p / VALIDATION_SEARCH < self.judged.p_value / VALIDATION_CHI2

    @property
    def chi2(self) -> float:
        """χ² of the residual wrench with its full covariance."""
        return self.judged.white.chi2

    @property
    def dof(self) -> int:
        """Its degrees of freedom."""
        return self.judged.white.dof

    @property
    def detectable(self) -> FloatArray:
        """Smallest turns (n, 3), rad, of one sensor about x, y, z of the BCS that are found.

        With probability DETECTION_POWER, though the zeros may have been tared; ∞ where none is.
        """
        white = self.judged.tared or self.judged.white
        turns = white.at.columns[:, layout(self.rig.n)["rotation"]]
        return _smallest(white, turns, 3, VALIDATION_SEARCH * _TURNED / self.rig.n)

    @property
    def holds(self) -> bool:
        """The test is within chance."""
        return self.judged.holds

    @property
    def suspected(self) -> tuple[Cause, ...]:
        """Where it does not hold: the causes that explain it and cannot be told apart."""
        return () if self.holds else self.judged.causes.suspected


def _smallest(white: Whitened, columns: FloatArray, unknowns: int, level: float) -> FloatArray:
    """Sizes (n, 3) along columns (m, 3n) that a test of so many unknowns finds at its level."""
    threshold = special.chdtri(unknowns, level)
    offset = float(special.chndtrinc(threshold, unknowns, 1 - DETECTION_POWER))
    seen = np.maximum(np.diagonal(white.information(columns)), 0.0)
    with np.errstate(divide="ignore"):
        return np.asarray(np.sqrt(offset / seen)).reshape(-1, 3)


def judged_with_zeros(
    at: Linearised, given: Calibrated, rig: Rig, judge: Callable[[Whitened], Judged]
) -> tuple[Judged, Zeros]:
    """Judge residuals with the calibration's zeros and with zeros tared anew, and choose.

    rig : of the log, for what it states of its zeros.
    """
    zero = layout(rig.n)["zero"]
    std = prior_std(rig)[zero]
    stated = np.where(np.isinf(std), given.state.zero.ravel(), rig.zero.value.ravel())
    step = stated - given.state.zero.ravel()
    tared = redrawn(given, zero=(stated.reshape(rig.n, 3), np.diag(std**2)))

    def beside(by: Calibrated, residual: FloatArray) -> Judged:
        root = block_diagonal(by.root, at.own_root)
        unknown = np.concatenate([by.open, at.own_unknown])
        return judge(whiten(replace(at, residual=residual), root, unknown))

    same = beside(given, at.residual)
    fresh = beside(tared, at.residual + at.zero_columns @ step)

    def no_tare(cause: Cause) -> bool:
        if cause.kind == "zeros moved":
            return False
        if cause.kind != "zero drifted" or cause.support is None:
            return True
        own = slice(3 * cause.support, 3 * cause.support + 3)
        variance = std[own] ** 2 + np.diagonal(given.covariance)[zero][own] + cause.std**2
        off = np.sum((cause.value - step[own]) ** 2 / variance)
        return bool(chi2_sf(off, 3) < VALIDATION_ALARM / rig.n)

    rivals = tuple(cause for cause in same.causes.best if no_tare(cause))
    moved = _moved(same, fresh, rivals)
    chosen = replace(fresh if moved else same, tared=fresh.white)
    changed = next(iter(() if chosen.holds else chosen.causes.suspected), None)
    found = _zeros(at, given, step, std, moved=moved, changed=changed)
    level = VALIDATION_SEARCH * (1 - _TURNED) / (same.causes.tried - rig.n)
    seen = _smallest(same.white, at.zero_columns, 1, level)
    return chosen, replace(found, detectable=seen)


def _moved(same: Judged, fresh: Judged, rivals: tuple[Cause, ...]) -> bool:
    """Whether zeros drawn anew explain the residuals, rather than the calibration's.

    rivals : changes of the rig with the calibration's zeros, one zero among them where it moved
    farther than a tare would move it. The benefit of the doubt is the calibration's: what a tare
    explains is no change of the rig, unless that is likelier by odds which a tare gives it as
    seldom as there may be false alarms (Markov's inequality).
    """
    moving = next((c.weight for c in same.causes.best if c.kind == "zeros moved"), 0.0)
    if same.holds:
        return fresh.holds and moving >= CAUSES_APART
    odds = -2.0 * np.log(VALIDATION_ALARM)
    if fresh.holds:
        worth = same.white.worth
        likeliest = max((_evidence(c) - worth for c in rivals if c.explains), default=-np.inf)
        return bool(likeliest < moving + odds)
    # Under one load turns of all sensors look like a tare, too.
    doubt = odds * (same.causes.best[0].kind == "sensors turned")
    return fresh.merit[0] and fresh.merit > (same.merit[0], same.merit[1] - doubt)


def _evidence(cause: Cause) -> float:
    """By how much −2 ln L falls where a change has a variance, as the zeros' move has, not a size.

    At its best, of a change whose q unknowns take a gain of χ²: gain − q (1 + ln (gain / q)).
    """
    if cause.scatters:
        return cause.gain
    ratio = max(cause.gain / max(cause.unknowns, 1), 1.0)
    return float(cause.gain - cause.unknowns * (1.0 + np.log(ratio)))


def _zeros(
    at: Linearised,
    given: Calibrated,
    step: FloatArray,
    std: FloatArray,
    *,
    moved: bool,
    changed: Cause | None,
) -> Zeros:
    """Zeros of a log: now, by what is stated too; how far they moved, by the log alone.

    What is stated would draw a move towards none. changed : what the rig changed by.
    """
    n = at.sensors
    if changed is not None and changed.kind == "zero drifted" and changed.support is not None:
        std = np.where(np.arange(3 * n) // 3 == changed.support, np.inf, std)
    widest = float(given.state.mass) * given.rig.gravity
    value, root, *_ = _solved(at, given, step, np.minimum(std, widest), changed)
    _, _, change, change_std = _solved(at, given, step, np.full(3 * n, widest), changed)
    told = ~given.open[layout(n)["zero"]] & (change_std < widest / 2)
    return Zeros(
        moved=moved,
        change=change.reshape(n, 3),
        change_std=np.where(told, change_std, np.inf).reshape(n, 3),
        detectable=np.full((n, 3), np.inf),
        value=given.state.zero + value.reshape(n, 3),
        covariance=root @ root.T,
    )


def _solved(
    at: Linearised, given: Calibrated, step: FloatArray, std: FloatArray, changed: Cause | None
) -> tuple[FloatArray, FloatArray, FloatArray, FloatArray]:
    """New zeros (3n,) less the calibration's, N, a root of their covariance; moves, their std.

    With x = (calibrated parameters d, own ones, new zeros less the calibration's m), m ~ N(step,
    std²), the residuals are −J x with the zeros' columns at m; m − d_zero is by how much they
    moved. changed : of what the rig changed by nothing is known; zeros would take the part of it
    that looks alike.
    """
    old, n = layout(at.sensors)["zero"], at.sensors
    J = np.concatenate([at.columns, at.zero_columns], axis=1)
    J[:, old] = 0.0
    root = block_diagonal(given.root, at.own_root, np.diag(std))
    unknown = np.concatenate([given.open, at.own_unknown, np.zeros(3 * n, dtype=np.bool_)])
    unknown[old] = False
    aside = [] if changed is None else [unknown_columns(changed, at)]
    free = basis(np.concatenate([J[:, unknown], *aside], axis=1))
    B, r = J @ root, at.residual + at.zero_columns @ step
    B, r = B - free @ (free.T @ B), r - free @ (free.T @ r)
    half = np.linalg.inv(np.linalg.cholesky(np.eye(B.shape[1]) + B.T @ B)).T
    spread = root @ half
    found = -spread @ (half.T @ (B.T @ r))
    new = slice(len(root) - 3 * n, None)
    value, moves = step + found[new], spread[new] - spread[old]
    return value, spread[new], value - found[old], np.linalg.norm(moves, axis=1)
