"""The verdict on a calibration in use, whatever kind of log it was tested on."""

from __future__ import annotations

from dataclasses import dataclass

from tdfscal.records import FloatArray, Rig
from tdfscal.significance import VALIDATION_ALARM
from tdfscal.validation.causes import Cause, Causes


@dataclass(frozen=True, slots=True, kw_only=True)
class Verdict:
    """Verdict on a calibration.

    chi2, dof, p_value : of the residual wrench with its full covariance. search_p : the smallest
    probability that chance looks so much like one single cause, corrected for the number of causes
    tried. causes : held against each other. detectable : (n, 3), rad, smallest turn of one sensor
    about x, y, z of the BCS found with 95 % probability; ∞ where none is.
    """

    rig: Rig
    chi2: float
    dof: int
    p_value: float
    search_p: float
    causes: Causes
    detectable: FloatArray
    warnings: tuple[str, ...]

    @property
    def holds(self) -> bool:
        """Neither all residuals together nor the likeliest single cause are beyond chance."""
        return min(self.p_value, self.search_p) >= VALIDATION_ALARM / 2

    @property
    def suspected(self) -> tuple[Cause, ...]:
        """Where it does not hold: the causes that explain it and cannot be told apart."""
        return () if self.holds else self.causes.suspected
