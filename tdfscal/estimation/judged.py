"""The judged result of a calibration, from postures or from a motion; what changed on the way.

From an instant on a sensor may have another rotation or zero, while all else stays common. Nothing
is fitted anew. With the whitened Jacobian J of the fit, its residual r and the columns c of the
suspect, score u = cᵀ(r − J A⁺ Jᵀr) and information I = cᵀc − cᵀJ A⁺ Jᵀc, A = JᵀJ, the statistic
uᵀ I⁺ u is χ² of the rank of I (Rao, Math. Proc. Camb. Phil. Soc. 44, 1948). Of all suspects the
likeliest is named, by the fall of −2 ln L less q ln N for q unknowns (Schwarz).
"""

from __future__ import annotations

from collections.abc import Sequence
from functools import cached_property
from typing import Any, Generic

import numpy as np

from tdfscal.acceptance import Conformity, assess_stated, judge
from tdfscal.estimation.observability import Observability
from tdfscal.estimation.score_tests import Suspicion, worst_angle
from tdfscal.estimation.uncertainty import UNDECLARED, Estimate, F, Quality, Uncertainty, beside
from tdfscal.findings import Finding, Value, rejecting
from tdfscal.frozen import record
from tdfscal.model.calibrated import Calibrated
from tdfscal.model.parameters import nominal
from tdfscal.numerics import so3
from tdfscal.numerics.distributions import INTERVAL_FACTOR, MonteCarlo
from tdfscal.numerics.least_squares import ask_beside
from tdfscal.records import Dwells, FloatArray, Rig, Rotations

#: A sensor turned from its nominal mounting by more than this is not where it is said to be, rad.
_FAR_TURNED = np.pi / 8


@record
class HeldOut:
    """Residual of K postures, or stretches of a motion, each held against all the others.

    before, after : (K, 2), lengths of force, N, and moment, N·m, with the nominal mounting and
    stated values, and with the calibration from the others. Of a posture about the LCS origin, of a
    stretch about the barycentre, in the band, quadratic means over its time.
    """

    before: FloatArray
    after: FloatArray


@record(kw_only=True)
class Judged(Generic[F]):
    """An estimate, and what was found when it was doubted.

    suspicions : what residuals and distances say was not declared. validation : None where nothing
    can be left out. findings : all that was found.
    """

    rig: Rig
    estimate: Estimate[F]
    observability: Observability
    suspicions: tuple[Suspicion, ...]
    validation: HeldOut | None
    monte_carlo: MonteCarlo | None = None
    findings: tuple[Finding, ...] = ()

    @property
    def fit(self) -> F:
        """The fit."""
        return self.estimate.fit

    @property
    def quality(self) -> Quality:
        """How well residuals and what is stated of them agree."""
        return self.estimate.quality

    @property
    def uncertainty(self) -> Uncertainty:
        """Uncertainty of the rotations."""
        return self.estimate.uncertainty

    @property
    def rotations(self) -> Rotations:
        """The rotations with their covariance."""
        R = self.fit.still.rotation
        return Rotations(self.rig.supports, R, self.uncertainty.covariance)

    @property
    def calibrated(self) -> Calibrated:
        """All parameters of the rig with their joint covariance, for those who use them."""
        return self.estimate.calibrated

    @cached_property
    def conformity(self) -> Conformity | None:
        """Of the contact wrench, where the rig file limits it."""
        return assess_stated(self.calibrated)

    @property
    def reasons(self) -> tuple[Finding, ...]:
        """Why the gate rejects; empty where it accepts."""
        return rejecting(self.findings)

    def gate(self, used: int = 0, rejected: int = 0) -> tuple[Finding, ...]:
        """Reasons to reject; used, rejected : numbers of postures."""
        spoilt = (doubt for doubt in self.suspicions if doubt.spoils(self.fit.moving))
        return judge(
            self.rig,
            self.rotations,
            self.quality.birge,
            determined=self.observability.determined,
            used=used,
            rejected=rejected,
            suspicions=[finding for doubt in spoilt for finding in doubt.findings(rejects=True)],
            conformity=self.conformity,
        )

    def harmless(self) -> list[Finding]:
        """What is suspected and does not reject; held : the covariance holds it."""
        held = UNDECLARED in self.estimate.shares
        return [
            finding
            for doubt in self.suspicions
            if not doubt.spoils(self.fit.moving)
            for finding in doubt.findings(rejects=False, held=held and doubt.move is not None)
        ]

    def turned_sensors(self) -> list[Finding]:
        """Sensors far from their nominal mounting, with the signs that would turn them back."""
        rotation, mounted = self.fit.still.rotation, nominal(self.rig).rotation
        back = np.swapaxes(mounted, 1, 2) @ rotation
        along = np.diagonal(back, axis1=1, axis2=2)
        found = list[Finding]()
        # Heights of opposite sign turn all about the vertical, the barycentre's unknown.
        upended = np.all(np.abs(along) > np.cos(_FAR_TURNED)) and np.all(along * [-1, -1, 1] > 0)
        mirrored = bool(upended and not np.isfinite(self.rig.barycentre.std[2]))
        for i, turn in enumerate(np.linalg.norm(so3.log(back), axis=1).tolist()):
            half: dict[str, Value] = {}
            if np.all(np.abs(along[i]) > np.cos(_FAR_TURNED)) and np.any(along[i] < 0):
                half = {"turned": [self.rig.supports[i]], "signs": np.sign(along[i]).tolist()}
                half["mirrored"] = mirrored
            if turn > _FAR_TURNED and self.observability.determined[i]:
                name = self.rig.supports[i]
                found.append(Finding("sensor-turned", (name,), turn, "rad", values=half))
        return found


@record
class Undetermined:
    """An estimate whose angles do not stand, and what can be looked at beside them.

    of : all dwells that were found, or s of a motion that were used. rejected : dwell index →
    reason, or stretches of the motion that were left out.
    """

    rig: Rig
    quality: Quality
    observability: Observability
    of: Dwells | float
    rejected: Any


def holding(known: Estimate[F], *groups: tuple[Suspicion, ...]) -> Estimate[F]:
    """The estimate with what is suspected in its covariance, as if declared with its size here.

    Of the suspects of a group only one is true: their moves count by their likelihood. A group that
    rejects the result is left out.
    """
    covariance: list[FloatArray] = []
    for doubts in groups:
        if doubts and not any(doubt.spoils(known.fit.moving) for doubt in doubts):
            moves = np.array([doubt.move for doubt in doubts])
            weight = np.array([doubt.weight for doubt in doubts])
            share = np.exp((weight - weight.max()) / 2)
            covariance.append((moves.T * (share / share.sum())) @ moves)
    return beside(known, np.sum(covariance, axis=0)) if covariance else known


#: Kind of a suspicion by what changed, code of its finding, and the unit of its size.
_CHANGED = {
    "rotation": ("slip", "sensor-slipped", "rad"),
    "zero": ("jump", "zero-jumped", "N"),
    "LCS": ("contact", "contact-stays", "N"),
    "BCS": ("contact", "contact-stays", "N"),
}


@record(kw_only=True)
class Change:
    """What became another on the way, as far as the residuals ask for it.

    what : rotation or zero of a sensor, delay, or LCS or BCS, the frame of a wrench that stayed.
    which : of the candidates that were asked for. amount, std : rad in the BCS, N in the sensor's
    frame, s; of a wrench the force first. move : (p + …,), of the other unknowns with it.
    statistic : fall of χ², by so many unknowns. worth : less what these are worth.
    """

    what: str
    support: int
    which: int
    amount: FloatArray
    std: FloatArray
    move: FloatArray
    statistic: float
    unknowns: int
    worth: float

    @property
    def kind(self) -> str:
        """Of a suspicion."""
        return _CHANGED[self.what][0]

    def cause(self, rig: Rig, **when: Value) -> Finding:
        """The change as a finding; when : and at which instant."""
        kind, code, unit = _CHANGED[self.what]
        values: dict[str, Value] = {
            "change": self.amount[:3].tolist(),
            "change_95": (INTERVAL_FACTOR * self.std[:3]).tolist(),
            **when,
        }
        subject: tuple[str, ...] = (rig.supports[self.support],)
        if kind == "contact":
            subject, values["frame"] = (), self.what
        return Finding(code, subject, float(np.linalg.norm(self.amount[:3])), unit, values=values)


class ChangeSearch:
    """What further columns explain of the residual of a fit, all of its parameters giving way.

    root : (p, r), of their covariance. rows : N. pull : (r,), score along it, 0 at an estimate.
    chi2, dof : of the residual, where its scatter may be more than is stated.
    """

    def __init__(
        self,
        root: FloatArray,
        rows: int,
        pull: FloatArray | None = None,
        chi2: float = 0.0,
        dof: int = 1,
    ) -> None:
        self.root, self.unknown = root, float(np.log(max(rows, 2)))
        self.pull = np.zeros(root.shape[1]) if pull is None else pull
        self.chi2, self.dof = chi2, dof

    def likeliest(
        self, what: str, support: int, cross: FloatArray, own: FloatArray, score: FloatArray
    ) -> Change:
        """The best of S candidates with columns c: cᵀJ (S, g, p), cᵀc (S, g, g) and cᵀr (S, g)."""
        known = cross @ self.root
        asked = ask_beside(own, score - known @ self.pull, known)
        best = int(np.argmax(asked.statistic))
        fall, unknowns = float(asked.statistic[best]), int(asked.unknowns[best])
        amount = -asked.amount[best]
        return Change(
            what=what,
            support=support,
            which=best,
            amount=amount,
            # Held against the scatter that remains without it, or it would excuse itself.
            std=asked.std[best] * np.sqrt(max(1.0, self.scatter(fall, unknowns))),
            move=-self.root @ (self.pull + known[best].T @ amount),
            statistic=fall,
            unknowns=unknowns,
            worth=fall - unknowns * self.unknown,
        )

    def scatter(self, fall: float, unknowns: int) -> float:
        """χ² per degree of freedom without what makes it fall by so much."""
        return float(max(self.chi2 - fall, np.finfo(float).tiny) / max(self.dof - unknowns, 1))


def change_suspicion(
    of: Estimate[F], changes: Sequence[Change], causes: Sequence[Finding], **facts: Any
) -> Suspicion:
    """The likeliest change and those about as likely as one suspicion.

    It has the angle that they spoil most, before or after them. facts : its other fields.
    """
    moves, turns = list[FloatArray](), 3 * of.fit.rig.n
    for change in changes:
        after = (before := change.move[:turns]).copy()
        if change.what == "rotation":
            after[3 * change.support : 3 * change.support + 3] += change.amount
        moves += [np.abs(before), np.abs(after)]
    shift, harm, angle = worst_angle(of.fit.rig, of.uncertainty, np.max(moves, axis=0))
    own = {"kind": changes[0].kind, "support": changes[0].support, "weight": changes[0].worth}
    return Suspicion(tuple(causes), shift=shift, harm=harm, angle=angle, **{**own, **facts})
