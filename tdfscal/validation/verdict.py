"""The verdict on a calibration in use, whatever kind of log it was tested on, and causes for it.

A cause is a linear model e = H a + noise of the whitened residual wrenches of all postures; it is
judged by how far χ² falls when its q unknowns a are fitted (generalised least squares), less q ln N
for N residuals (Schwarz, Ann. Stat. 6, 1978); the posture from which a step holds is an unknown
too. Causes of few and many unknowns are so held against each other on one scale, twice the
logarithm of their odds.
"""

from __future__ import annotations

from collections.abc import Callable
from operator import attrgetter
from typing import Literal

import numpy as np
from scipy import special

from tdfscal.findings import Finding
from tdfscal.frozen import record, replace
from tdfscal.model.calibrated import Calibrated, redrawn
from tdfscal.model.parameters import layout
from tdfscal.numerics.distributions import INTERVAL_FACTOR, chi2_sf
from tdfscal.records import FloatArray, Rig
from tdfscal.significance import (
    CAUSE_EXPLAINS,
    CAUSES_APART,
    DETECTION_POWER,
    VALIDATION_CHI2,
    VALIDATION_SEARCH,
)
from tdfscal.validation.residuals import Whitened

#: Does it hold; unproven: nothing speaks against it, but the log cannot show that it holds;
#: touched: the check is what is wrong, not the calibration.
Outcome = Literal["holds", "unproven", "touched", "changed"]
Kind = Literal[
    "sensor turned",
    "sensors turned",
    "load changed",
    "zero drifted",
    "gain changed",
    "gains changed",
    "base tilted",
    "contact",
    "noise grown",
    "zeros wander",
    "zeros moved",
    "hinges stick",
    "sensor slipped",
    "zero jumped",
    "zeros drift",
    "zeros follow temperature",
]

#: Causes that are a scatter, not a change: the test of all residuals together sees them.
NOISE: tuple[Kind, ...] = ("noise grown", "zeros wander", "zeros moved", "hinges stick")
#: Changes in the course of a log; the test of all residuals together sees them too.
STEPS: tuple[Kind, ...] = ("sensor slipped", "zero jumped")
COURSES: tuple[Kind, ...] = (*STEPS, "zeros drift", "zeros follow temperature")

#: Of a contact, which is told by the residual wrench.
NO_SIZE = np.zeros(0)

#: Order of causes, by the odds for them.
WEIGHT = attrgetter("weight")


@record
class Cause:
    """A possible cause, fitted by generalised least squares.

    support : index, for a sensor's cause. postures : indices, for a contact; for a step the first
    one from which on it holds, at rest. between : s, of a step in motion, times between which it
    lies with 95 %.
    value, std : (q,), its unknowns: a turn in rad (rx, ry, rz, BCS: R_now = exp([a]×) R),
    of all sensors in turn where several did; a load's
    mass in kg and barycentre in m, as changes; a zero's change in N,
    where it drifts the largest of each; a gain's change as S (6,): xx,
    yy, zz, yz, xz, xy; the base's tilt in rad about x and y of the BCS; the standard deviation of
    more noise, of the zeros' wander or of a move of all zeros, N, or of the hinges' friction, N·m,
    per axis and posture. A contact has none here.
    gain : by how much χ² falls, with q unknowns. weight : the same less what as many unknowns are
    worth (Schwarz). p_value : that chance alone lets it fall so far.
    remaining_p : probability of the χ² that is left. size_std : of the length of value, along
    itself, to first order; noise across it makes a length near none too large.
    """

    kind: Kind
    support: int | None
    postures: tuple[int, ...]
    value: FloatArray
    std: FloatArray
    gain: float
    weight: float
    unknowns: int
    p_value: float
    remaining_p: float
    size_std: float = np.nan
    between: tuple[float, float] | None = None

    @property
    def explains(self) -> bool:
        """Nothing remarkable is left."""
        return self.remaining_p >= CAUSE_EXPLAINS

    @property
    def scatters(self) -> bool:
        """It is a scatter, not a change."""
        return self.kind in NOISE

    @property
    def told(self) -> bool:
        """Its size is told from none."""
        return self.p_value < CAUSE_EXPLAINS


@record
class Causes:
    """Single causes, the most likely first.

    best : one per kind and support or posture, the likeliest of its shapes. tried : how many could
    have looked like the likeliest by chance.
    """

    best: tuple[Cause, ...]
    tried: int

    @property
    def suspected(self) -> tuple[Cause, ...]:
        """The causes that explain the residuals and cannot be told apart, the likeliest first.

        One whose size may as well be none is not among them: near the limit it explains the
        residuals as nothing would.
        """
        explaining = [cause for cause in self.best if cause.explains and cause.told]
        if not explaining:
            return ()
        most = explaining[0].weight
        # What explains less well than another that leaves too much is not the cause.
        if self.best[0].weight - most >= CAUSES_APART:
            return ()
        return tuple(c for c in explaining if most - c.weight < CAUSES_APART)


@record
class Model:
    """Columns (6K, q) of the unknowns, of parameters by `shape` (p, q), which gives them back."""

    kind: Kind
    support: int | None
    postures: tuple[int, ...]
    columns: FloatArray
    shape: FloatArray | None = None


def fitted(model: Model, given: Whitened) -> Cause:
    """Fit a cause to the residuals.

    What changed is minus what would cancel it: e is linear about the estimate.
    """
    size = np.linalg.norm(model.columns, axis=0)
    size = np.where(size > 0, size, 1.0)
    U, s, Vt = np.linalg.svd(model.columns / size, full_matrices=False)
    seen = s > 1e-9 * s.max(initial=0.0)
    along = U[:, seen].T @ given.residual
    gain, q = float(along @ along), int(seen.sum())
    root = (Vt[seen].T / s[seen]) / size[:, None]
    if model.shape is not None:
        root = model.shape @ root
    sizes = -(root @ along), np.linalg.norm(root, axis=1)
    found = explained(given, model.kind, gain, q, model.support, model.postures, *sizes)
    along = found.value / (np.linalg.norm(found.value) or 1.0)
    return replace(found, size_std=float(np.linalg.norm(along @ root)))


def explained(
    given: Whitened,
    kind: Kind,
    gain: float,
    unknowns: int,
    support: int | None = None,
    postures: tuple[int, ...] = (),
    value: FloatArray = NO_SIZE,
    std: FloatArray = NO_SIZE,
) -> Cause:
    """A cause of so many unknowns that lowers χ² of the residuals by `gain`; the rest as there."""
    return Cause(
        kind=kind,
        support=support,
        postures=postures,
        value=value,
        std=std,
        gain=gain,
        weight=gain - (unknowns + (kind in STEPS)) * given.worth,
        unknowns=unknowns,
        p_value=float(chi2_sf(gain, unknowns)),
        remaining_p=float(chi2_sf(max(given.chi2 - gain, 0.0), given.dof - unknowns)),
    )


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
    its std beside it; ∞ where the log does not tell. value : (n, 3), the zeros now, and covariance
    (3n, 3n).
    """

    moved: bool
    change: FloatArray
    change_std: FloatArray
    value: FloatArray
    covariance: FloatArray

    def brought_into(self, given: Calibrated) -> Calibrated:
        """Return the calibration with these zeros, where they moved."""
        if not self.moved:
            return given
        return redrawn(given, zero=(self.value, self.covariance))


@record(kw_only=True)
class Verdict:
    """Verdict on a calibration: on angles, load and gain, by zeros that may have been tared anew.

    rig : of the log. judged : the test. zeros : whether they moved.
    findings : what is to be said of log and noise. own : logs that went into the
    calibration itself, where what was tested is theirs. earlier : the log is older than the
    calibration's data. gate_rejected : the calibration never was fit for
    use.
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
        threshold = special.chdtri(3, VALIDATION_SEARCH * _TURNED / self.rig.n)
        offset = float(special.chndtrinc(threshold, 3, 1 - DETECTION_POWER))
        white = self.judged.tared or self.judged.white
        turns = white.columns[:, layout(self.rig.n)["rotation"]]
        with np.errstate(divide="ignore"):
            return np.asarray(np.sqrt(offset / np.sum(turns**2, axis=0))).reshape(-1, 3)

    @property
    def holds(self) -> bool:
        """The test is within chance."""
        return self.judged.holds

    @property
    def suspected(self) -> tuple[Cause, ...]:
        """Where it does not hold: the causes that explain it and cannot be told apart."""
        return () if self.holds else self.judged.causes.suspected
