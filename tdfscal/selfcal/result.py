"""What a self-calibration is: its record, what its user must know; what is seen without angles."""

from __future__ import annotations

from dataclasses import dataclass
from typing import Literal

import numpy as np

from tdfscal.acceptance.conformity import Conformity
from tdfscal.checks import log_against_rig
from tdfscal.errors import NotIdentifiableError
from tdfscal.model.parameters import State, nominal
from tdfscal.numerics import so3
from tdfscal.numerics.distributions import p_text
from tdfscal.numerics.propagation import MonteCarlo
from tdfscal.records import Dwells, FloatArray, Rig
from tdfscal.selfcal.covariance import Quality, Uncertainty, information_root
from tdfscal.selfcal.cross_validation import CrossValidation, cross_validate
from tdfscal.selfcal.estimator import Fit
from tdfscal.selfcal.exact_quantities import exact_caveats
from tdfscal.selfcal.mounting_search import Rival, describe
from tdfscal.selfcal.noise_components import GrossNoise, noisier
from tdfscal.selfcal.observability import Observability, require_angles
from tdfscal.selfcal.repeatability import Stability
from tdfscal.selfcal.suspicion import Suspicion
from tdfscal.significance import MISFIT, OVERSTATED_NOISE

Estimator = Literal["ml", "linear"]

_NO_TRIALS = (
    "the linear intervals of {} sensors stand without a Monte Carlo, which takes minutes: ask for "
    "it by --trials"
)
#: A sensor turned from its nominal mounting by more than this is not where it is said to be, rad.
_FAR_TURNED = np.pi / 8


@dataclass(frozen=True, slots=True)
class SelfCalibration:
    """The judged result of a self-calibration.

    dwells : all that were found; the fit's postures are those not screened out. rejected : dwell
    index → reason. suspicions : what the residuals say was not declared. conformity : of the
    contact wrench, where the rig file limits it. channels : (n, 3), noise over the stated one.
    gross : of a channel that is touched or broken.
    reasons : why the gate rejects; empty where it accepts. set_aside : suspicions that a slip
    explains as well. with_moves : (n, 3), rad, standard uncertainties of roll, pitch, yaw to
    expect from dwells and moves together, where the log holds moves.
    """

    rig: Rig
    estimator: Estimator
    dwells: Dwells
    fit: Fit
    quality: Quality
    uncertainty: Uncertainty
    observability: Observability
    suspicions: tuple[Suspicion, ...]
    channels: FloatArray | None
    gross: GrossNoise | None
    stability: Stability
    conformity: Conformity | None
    validation: CrossValidation
    monte_carlo: MonteCarlo | None
    rejected: dict[int, str]
    set_aside: tuple[Suspicion, ...]
    reasons: tuple[str, ...] = ()
    warnings: tuple[str, ...] = ()
    with_moves: FloatArray | None = None


@dataclass(frozen=True, slots=True)
class Undetermined:
    """A fit whose angles do not stand, and all that can be looked at beside them.

    dwells : all that were found. rejected : dwell index → reason.
    """

    rig: Rig
    dwells: Dwells
    fit: Fit
    quality: Quality
    observability: Observability
    rejected: dict[int, str]

    @property
    def validation(self) -> CrossValidation:
        """Residual wrench of each posture; directions that it alone carries say nothing."""
        return cross_validate(self.fit, information_root(self.fit))


def check_determined(seen: Undetermined, near: tuple[Rival, ...]) -> None:
    """Raise NotIdentifiableError or NotConvergedError where no angles can be given.

    near : other mountings that may explain the postures as well.
    """
    rig, fit, verdict = seen.rig, seen.fit, seen.observability
    require_angles(verdict, fit.converged, fit.iterations, seen, "the data do", "more postures")
    if near and near[0].as_likely:
        rival = near[0]
        raise NotIdentifiableError(
            "two mountings explain the log about equally well (χ² apart by "
            f"{abs(rival.gap):.2g}): {describe(rig, fit.state, rival.state)}",
            hint="state which it is by nominal_rpy and rpy_std in rig.yaml (0.2 rad will do), or "
            "squeeze harder, tilt more and record more postures",
            evidence=seen,
        )


def caveats(of: SelfCalibration, measured_noise: bool, unasked: bool) -> tuple[str, ...]:
    """Collect what the user must know although the result may be good."""
    rig, stats, trials, seen = of.rig, of.quality, of.monte_carlo, of.observability
    found = list(of.dwells.warnings)
    if turned := log_against_rig.turned(rig, of.dwells.position):
        found.append(turned)
    found += _turned_sensors(rig, of.fit.state)
    if of.channels is not None and of.gross is None:
        found.append(noisier(of.channels, rig.supports))
    found += seen.caveats
    if rig.declared.force_sensitivity > 0:
        found.append(
            "gain and crosstalk of the sensors were decoupled in situ, from a prior of "
            f"{rig.declared.force_sensitivity:.2%}: a reading needs rotation · sensitivity⁻¹"
        )
    if measured_noise:
        found.append(
            "neither the log nor rig.yaml states a force noise; it was taken from the residuals, "
            "so χ² cannot warn of contact or a wrong rig file (set uncertainty.force_noise)"
        )
    elif stats.p_value < MISFIT:
        found.append(
            f"the residuals are {stats.birge:.2g} times what the stated uncertainties explain "
            f"({p_text(stats.p_value)}); all noise was scaled up by that factor"
        )
    elif stats.p_value > 1 - OVERSTATED_NOISE:
        found.append(
            f"the residuals are only {stats.birge:.2g} times what the stated uncertainties "
            "explain: those may be overstated (uncertainty.force_noise, positioner), and so the "
            "angles' own"
        )
    found += [doubt.text for doubt in of.suspicions if not doubt.harmful]
    if not measured_noise and not of.suspicions:  # a named cause says more than the trend it makes
        found += of.stability.warnings
    if trials is not None and trials.unsettled:
        found.append(
            f"{trials.unsettled} of {trials.trials} Monte Carlo trials did not settle; they count "
            "where they ended: the angles are known so poorly that noise can turn a sensor away"
        )
    if trials is not None and not trials.validated:
        found.append(
            "Monte Carlo does not confirm the linear 95 % intervals; the intervals given are those "
            "of the trials"
        )
    if of.estimator == "ml":
        found += exact_caveats(of.fit, of.uncertainty)
        if unasked:
            found.append(_NO_TRIALS.format(rig.n))
    return tuple(found)


def _turned_sensors(rig: Rig, state: State) -> list[str]:
    """Warnings for sensors that stand far from their nominal mounting."""
    back = np.swapaxes(nominal(rig).rotation, 1, 2)
    turn = np.linalg.norm(so3.log(state.rotation @ back), axis=1)
    return [
        f"the sensor of {rig.supports[i]} is turned by {np.degrees(turn[i]):.0f}° from its "
        "nominal mounting: look whether it is, and state nominal_rpy in rig.yaml"
        for i in np.flatnonzero(turn > _FAR_TURNED)
    ]
