"""The verdict on a calibration in use, whatever kind of log it was tested on."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np
from scipy import special

from tdfscal.model.parameters import layout
from tdfscal.records import FloatArray, Rig
from tdfscal.significance import DETECTION_POWER, VALIDATION_ALARM
from tdfscal.validation.causes import Cause, Causes
from tdfscal.validation.whitening import Whitened


@dataclass(frozen=True, slots=True, kw_only=True)
class Verdict:
    """Verdict on a calibration.

    white : the residual wrench, all that correlates it taken away. p_value : of its χ².
    search_p : the smallest probability that chance looks so much like one single cause, corrected
    for the number of causes tried. causes : held against each other.
    """

    rig: Rig
    white: Whitened
    p_value: float
    search_p: float
    causes: Causes
    warnings: tuple[str, ...]

    @property
    def chi2(self) -> float:
        """χ² of the residual wrench with its full covariance."""
        return self.white.chi2

    @property
    def dof(self) -> int:
        """Its degrees of freedom."""
        return self.white.dof

    @property
    def detectable(self) -> FloatArray:
        """Smallest turns (n, 3), rad, of one sensor about x, y, z of the BCS that are found.

        With probability DETECTION_POWER; ∞ where none is.
        """
        threshold = special.chdtri(3, VALIDATION_ALARM / 2 / self.causes.tried)
        offset = float(special.chndtrinc(threshold, 3, 1 - DETECTION_POWER))
        turns = self.white.columns[:, layout(self.rig.n)["rotation"]]
        with np.errstate(divide="ignore"):
            return np.asarray(np.sqrt(offset / np.sum(turns**2, axis=0))).reshape(-1, 3)

    @property
    def holds(self) -> bool:
        """Neither all residuals together nor the likeliest single cause are beyond chance."""
        return min(self.p_value, self.search_p) >= VALIDATION_ALARM / 2

    @property
    def suspected(self) -> tuple[Cause, ...]:
        """Where it does not hold: the causes that explain it and cannot be told apart."""
        return () if self.holds else self.causes.suspected
