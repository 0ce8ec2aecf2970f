"""The judged result of a calibration, from postures or from a motion."""

from __future__ import annotations

from functools import cached_property
from typing import Generic

import numpy as np

from tdfscal.acceptance import Conformity, assess_stated, judge
from tdfscal.estimation.observability import Observability
from tdfscal.estimation.score_tests import Suspicion
from tdfscal.estimation.uncertainty import UNDECLARED, Estimate, F, Quality, Uncertainty, beside
from tdfscal.findings import Finding, Value, rejecting
from tdfscal.frozen import record
from tdfscal.model.calibrated import Calibrated
from tdfscal.model.parameters import nominal
from tdfscal.numerics import so3
from tdfscal.numerics.distributions import MonteCarlo
from tdfscal.records import FloatArray, Rig, Rotations

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
        for i, turn in enumerate(np.linalg.norm(so3.log(back), axis=1).tolist()):
            half: dict[str, Value] = {}
            if np.all(np.abs(along[i]) > np.cos(_FAR_TURNED)) and np.any(along[i] < 0):
                half = {"turned": [self.rig.supports[i]], "signs": np.sign(along[i]).tolist()}
            if turn > _FAR_TURNED:
                name = self.rig.supports[i]
                found.append(Finding("sensor-turned", (name,), turn, "rad", values=half))
        return found


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
