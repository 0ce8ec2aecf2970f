"""Residual wrenches at a calibration, all that correlates them taken away, and their noise."""

from __future__ import annotations

from collections.abc import Iterator

import numpy as np
from scipy import special

from tdfscal.findings import Finding
from tdfscal.frozen import record, replace
from tdfscal.model.calibrated import Calibrated
from tdfscal.model.parameters import layout, parameter_count, prior_std
from tdfscal.model.postures import ZeroMotion
from tdfscal.model.statics import Postures
from tdfscal.numerics.distributions import chi2_sf
from tdfscal.numerics.least_squares import block_diagonal
from tdfscal.records import BoolArray, FloatArray, IntArray, Rig
from tdfscal.significance import MISFIT


@record
class Course:
    """When K postures were held, s; and the temperature (K, n), °C, at each sensor, if logged."""

    time: FloatArray
    temperature: FloatArray | None = None

    def subset(self, keep: IntArray) -> Course:
        """Return that of the postures that keep selects."""
        warm = None if self.temperature is None else self.temperature[keep]
        return Course(self.time[keep], warm)

    def step(self, first: int) -> FloatArray:
        """1 at postures (K, 1) that were held with one of them or after it, else 0."""
        return np.asarray(self.time >= self.time[first], dtype=np.float64)[:, None]

    def drifts(self, sensors: int) -> Iterator[tuple[bool, FloatArray]]:
        """Shapes (K, n, g) of drifts, and whether they are of temperature.

        They begin with the log, or began before it.
        """
        everyone = (len(self.time), sensors, 1)
        before = np.ones(everyone)
        elapsed = self.time - self.time.min(initial=np.inf)
        if not elapsed.any():
            return
        line = np.broadcast_to((elapsed / elapsed.max())[:, None, None], everyone)
        for shapes in ([line], [line, line**2], [line, line**2, before]):
            yield False, np.concatenate(shapes, axis=2)
        if self.temperature is not None:
            warming = (self.temperature - self.temperature[np.argmin(self.time)])[:, :, None]
            if warming.any():
                warming = warming / np.abs(warming).max()
                yield True, warming
                yield True, np.concatenate([warming, before], axis=2)


@record
class Linearised:
    """Residual wrenches at a calibration to the first order, white in each posture's own noise.

    residual : (m,); m is 6K, or as many as a motion determines. columns : (m, P + E), derivative
    by the calibrated parameters and by E of this log alone: zeros that move, a motion's own.
    own : (K, 6, 6), whitens each posture's own noise, with 0 along forces that nobody measures;
    K = 0 in motion, where a contact is found otherwise. own_root : (E, r), of the covariance of
    this log's parameters. own_unknown : (E,), those of which nothing is known. rows : directions of
    all residuals that no unmeasured force reaches. sensors : n. course : of the K postures.
    """

    residual: FloatArray
    columns: FloatArray
    own: FloatArray
    own_root: FloatArray
    own_unknown: BoolArray
    rows: int
    sensors: int
    course: Course

    @property
    def zero_columns(self) -> FloatArray:
        """Derivative (m, 3n) by the zeros."""
        return self.columns[:, layout(self.sensors)["zero"]]


@record
class Whitened:
    """Residual wrenches of K postures with all that correlates them taken away.

    at : the same, white in each posture's own noise only. residual : (m,), white altogether; m is
    6K, or as many as a motion determines. columns : (m, P), its derivative by the calibrated
    parameters. common : (m, r), H of the inverse root I − H Hᵀ for the calibration's error, which
    is common to all postures. free : (m, f), orthonormal, directions of parameters that nobody
    knows; the residual has no part in them. spread : ln det of the residuals' covariance, by what
    it is without the calibration's error.
    """

    at: Linearised
    residual: FloatArray
    columns: FloatArray
    common: FloatArray
    free: FloatArray
    spread: float

    @property
    def chi2(self) -> float:
        """χ² of all residual wrenches together."""
        return float(self.residual @ self.residual)

    @property
    def dof(self) -> int:
        """Its degrees of freedom."""
        return int(self.at.rows - self.free.shape[1])

    @property
    def worth(self) -> float:
        """What one unknown has to lower χ² by (Schwarz)."""
        return float(np.log(max(self.at.rows, 2)))

    @property
    def deviance(self) -> float:
        """−2 ln of the residuals' likelihood, but for a constant of the log."""
        return float(self.chi2 + self.spread + self.worth * self.free.shape[1])

    @property
    def unfolded(self) -> tuple[FloatArray, FloatArray]:
        """Return y (m,) and M (m, r + f): y = Aᵀ residual, AᵀA = I − M Mᵀ, A the whitening.

        By them score and information of columns come from the rows where these are not 0.
        """
        H, F = self.common, self.free
        M = np.hstack([H * np.sqrt(2.0 - np.sum(H**2, axis=0)), F - H @ (H.T @ F)])
        return self.residual - H @ (H.T @ self.residual), M

    def white(self, columns: FloatArray) -> FloatArray:
        """Columns (6K, c), whitened posture by posture already, made white altogether."""
        white = columns - self.common @ (self.common.T @ columns)
        return np.asarray(white - self.free @ (self.free.T @ white))


def whiten(at: Linearised, given: Calibrated) -> Whitened:
    """Take away the error of a calibration, which is common to all postures, from residuals.

    given : P parameters with their covariance U Uᵀ; of those that are open nothing is known. The
    residuals are at its state.

    With B the columns times U the covariance is I + B Bᵀ; by the singular values s of B its
    inverse root is I − V (1 − 1/√(1 + s²)) Vᵀ.
    """
    root = block_diagonal(given.root, at.own_root)
    unknown = np.concatenate([given.open, at.own_unknown])
    V, s, _ = np.linalg.svd(at.columns @ root, full_matrices=False)
    common, spread = V * np.sqrt(1 - 1 / np.sqrt(1 + s**2)), float(np.sum(np.log1p(s**2)))
    none = np.zeros((len(at.columns), 0))
    start = Whitened(at, at.residual, at.columns, common, none, spread)
    known = replace(start, free=basis(start.white(at.columns[:, unknown])))
    white = known.white(at.residual[:, None])[:, 0]
    return replace(known, residual=white, columns=known.white(at.columns))


def moving_zeros(rig: Rig, motion: ZeroMotion | None) -> tuple[FloatArray, BoolArray]:
    """Root (3nG, 3nG) of the amplitudes' covariance by which zeros move in this log; the unknown.

    A log's amplitudes are its own: they have their prior.
    """
    std = prior_std(rig, motion)[parameter_count(rig.n) :]
    return np.diag(np.where(np.isfinite(std), std, 0.0)), np.isinf(std)


def basis(columns: FloatArray) -> FloatArray:
    """Orthonormal basis of what columns (m, c) span."""
    size = np.linalg.norm(columns, axis=0)
    U, s, _ = np.linalg.svd(columns[:, size > 0] / size[size > 0], full_matrices=False)
    return np.asarray(U[:, s > 1e-9 * s.max(initial=0.0)])


@record
class KnownNoise:
    """What a calibration's own postures say of the noise.

    birge : √(χ²/dof) of its fit, where above 1, by which its own noise was scaled too. dof : behind
    that.
    """

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
        return observed

    @property
    def findings(self) -> tuple[Finding, ...]:
        """What was taken from the calibration, where the noise was not as stated."""
        found = []
        if self.birge > 1.0 and chi2_sf(self.birge**2 * self.dof, self.dof) < MISFIT:
            found.append(Finding("noise-as-calibrated", size=self.birge))
        return tuple(found)

    @property
    def freedom(self) -> float:
        """Degrees of freedom with which the noise is known: ∞ as stated, or those that told it."""
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


#: A calibration that says nothing of the noise.
AS_STATED = KnownNoise()
