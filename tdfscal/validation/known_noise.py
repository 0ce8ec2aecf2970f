"""Noise as the calibration found it: its level, noisier channels, and heavy tails."""

from __future__ import annotations

from dataclasses import dataclass, replace

import numpy as np
from scipy import special

from tdfscal.findings import Finding
from tdfscal.model.statics import Postures
from tdfscal.numerics.distributions import chi2_sf
from tdfscal.records import FloatArray
from tdfscal.selfcal.noise_components import scaled
from tdfscal.significance import MISFIT
from tdfscal.validation.residuals import Whitened

#: Components of a posture's wrench.
_ROWS = 6
#: Standard errors by which the noise's kurtosis may exceed what the calibration's postures show.
_ALLOWED = 2.0
#: Variance of Mardia's kurtosis over that of normal residuals of six components, per posture.
_KURTOSIS_VARIANCE = 1.0 / 6.0
#: Residuals that would shrink by less stay as they are.
_UNTOUCHED = 0.98
#: Points of the integral over one reading's noise.
_POINTS = 400


@dataclass(frozen=True, slots=True)
class KnownNoise:
    """What a calibration's own postures say of the noise.

    channels : (n, 3), standard deviation over the stated one; None where it is as stated.
    kurtosis : of its residual wrenches over that of normal ones; None unknown. postures : K, behind
    both. birge : √(χ²/dof) of its fit, where above 1, by which its own noise was scaled too.
    dof : behind that.
    """

    channels: FloatArray | None = None
    kurtosis: float | None = None
    postures: int = 0
    birge: float = 1.0
    dof: int = 0

    def scaled(self, observed: Postures) -> Postures:
        """Postures whose noise is what the calibration's own postures showed it to be."""
        if self.birge > 1.0:
            variance = self.birge**2
            observed = replace(
                observed,
                force_cov=variance * observed.force_cov,
                position_cov=variance * observed.position_cov,
                moment_var=variance * observed.moment_var,
            )
        if self.channels is not None:
            observed = scaled(observed, self.channels)
        return observed

    @property
    def findings(self) -> tuple[Finding, ...]:
        """What was taken from the calibration, where the noise was not as stated."""
        found = []
        if self.birge > 1.0 and chi2_sf(self.birge**2 * self.dof, self.dof) < MISFIT:
            found.append(Finding("noise-as-calibrated", size=self.birge))
        if self.channels is not None:
            found.append(Finding("channels-as-calibrated"))
        return tuple(found)

    @property
    def freedom(self) -> float:
        """Degrees of freedom with which the noise is known: ∞ as stated, or those that told it."""
        if self.channels is not None:
            return self.postures
        return self.dof if self.birge > 1.0 else np.inf

    def chi2_sf(self, square: float, freedom: int) -> float:
        """Probability of a larger sum of squares of so many white residuals, by Fisher's F."""
        if np.isinf(self.freedom):
            return float(special.chdtrc(freedom, square))
        return float(special.fdtrc(freedom, self.freedom, square / freedom))

    def gain_sf(self, gain: float, unknowns: int, rest: float, rest_freedom: int) -> float:
        """Probability that chance alone lets so many unknowns take more of a sum of squares.

        rest : what they leave, which tells of the noise too where it is not known as stated; it
        never makes that smaller than stated.
        """
        if unknowns == 0:
            return 1.0
        if np.isinf(self.freedom) or rest_freedom <= 0:
            return self.chi2_sf(gain, unknowns)
        freedom = self.freedom + rest_freedom
        variance = max((self.freedom + rest) / freedom, self.birge**-2)
        return float(special.fdtrc(unknowns, freedom, gain / unknowns / variance))

    def reading_tail(self, sensors: int) -> float:
        """Degrees of freedom ν of the t by which one reading scatters, as heavy as may be; or ∞.

        3n readings of excess kurtosis 6 / (ν − 4) make the six components of a wrench, each with a
        weight h = 2 / n: E q² of its squared length is 48 + Σ h² · 6 / (ν − 4), normally 48.
        """
        if self.kurtosis is None or self.postures == 0:
            return np.inf
        error = np.sqrt(_KURTOSIS_VARIANCE / self.postures)
        excess = max(self.kurtosis - 1.0, 0.0) + _ALLOWED * error
        weight = 3 * sensors * (2.0 / sensors) ** 2 / (_ROWS * (_ROWS + 2))
        return float(4.0 + 6.0 * weight / excess)

    def posture_sf(self, square: FloatArray, sensors: int) -> FloatArray:
        """Probability that one posture's white wrench has a larger squared length; square (K,).

        It is large where the noise is, or where one of the 3n readings, of weight h = 2 / n, is in
        its tail: h x² + χ² of the five other components.
        """
        square = np.asarray(square, dtype=np.float64)
        normal = np.asarray(special.chdtrc(_ROWS, square))
        tail = self.reading_tail(sensors)
        if np.isinf(tail):
            return normal
        h = min(2.0 / sensors, 1.0)
        unit = np.sqrt(tail / (tail - 2.0))
        edge = np.sqrt(square / h)[:, None] * np.linspace(0.0, 1.0, _POINTS)
        beyond = 2.0 * special.stdtr(tail, -unit * edge)
        usual = 2.0 * special.ndtr(-edge)
        rest = special.chdtrc(_ROWS - 1, np.maximum(square[:, None] - h * edge**2, 0.0))
        # ∫ P(χ²₅ > s − h x²) dP(x), by parts: the tail beyond x against how the rest grows.
        extra = np.sum((beyond - usual)[:, 1:] * np.diff(rest, axis=1), axis=1)
        return np.asarray(np.minimum(normal + 3 * sensors * np.maximum(extra, 0.0), 1.0))

    def as_normal(self, white: Whitened) -> Whitened:
        """Residuals whose postures are as far off as they would have to be with normal noise.

        To be as improbable as they are; none is made larger. What noise with tails does once in a
        while no longer looks like a contact, or like anything else that one posture can pretend.
        """
        if np.isinf(self.reading_tail(white.sensors)):
            return white
        each = white.residual.reshape(-1, _ROWS)
        square = np.sum(each**2, axis=1)
        p = np.maximum(self.posture_sf(square, white.sensors), np.finfo(np.float64).tiny)
        usual = np.minimum(special.chdtri(_ROWS, p), square)
        factor = np.sqrt(np.divide(usual, square, out=np.ones_like(square), where=square > 0))
        if factor.min() > _UNTOUCHED:
            return white
        return replace(white, residual=(each * factor[:, None]).ravel())


#: A calibration that says nothing of the noise.
AS_STATED = KnownNoise()
