"""What a self-calibration has seen when the data do not give the angles."""

from __future__ import annotations

from dataclasses import dataclass

from tdfscal.errors import NotConvergedError, NotIdentifiableError
from tdfscal.records import Dwells, Rig
from tdfscal.selfcal.covariance import Quality, information_root
from tdfscal.selfcal.cross_validation import CrossValidation, cross_validate
from tdfscal.selfcal.estimator import Fit
from tdfscal.selfcal.mounting_search import Rival, describe
from tdfscal.selfcal.observability import Observability


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
    rig, result, verdict = seen.rig, seen.fit, seen.observability
    if not verdict.determined.any() or not verdict.identified:
        weakness = (*verdict.weak, *verdict.lacking)[0]
        raise NotIdentifiableError(
            f"the data do not determine {verdict.unseen}", hint=weakness.advice, evidence=seen
        )
    if not result.converged:
        raise NotConvergedError(
            f"the estimate did not settle in {result.iterations} iterations",
            hint="check mass, hinges and nominal mounting in rig.yaml, and record more postures",
            evidence=seen,
        )
    if near and near[0].as_likely:
        rival = near[0]
        raise NotIdentifiableError(
            "two mountings explain the log about equally well (χ² apart by "
            f"{abs(rival.gap):.2g}): {describe(rig, result.state, rival.state)}",
            hint="state which it is by nominal_rpy and rpy_std in rig.yaml (0.2 rad will do), or "
            "squeeze harder, tilt more and record more postures",
            evidence=seen,
        )
