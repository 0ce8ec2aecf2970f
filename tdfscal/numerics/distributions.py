"""Tail probabilities and quantiles from scipy.special; scipy.stats costs a second to import."""

from __future__ import annotations

import numpy as np
import numpy.typing as npt
from scipy import special

from tdfscal.records import FloatArray
from tdfscal.significance import INTERVAL_COVERAGE

_THREE = 0.9973  # coverage of three standard deviations


def chi2_sf(x: npt.ArrayLike, dof: npt.ArrayLike) -> FloatArray:
    """Probability that χ² with dof degrees of freedom exceeds x; 1 where there is none."""
    none = np.asarray(dof) <= 0
    return np.where(none, 1.0, special.chdtrc(np.where(none, 1.0, dof), x))


def p_text(p: float) -> str:
    """Write a p-value: below 1e-6 its size says nothing any more."""
    return f"p = {p:.1g}" if p >= 1e-6 else "p < 1e-6"


def chi2_quantile(p: npt.ArrayLike, dof: npt.ArrayLike) -> FloatArray:
    """Value that χ² with dof degrees of freedom stays below with probability p."""
    return np.asarray(special.chdtri(dof, 1.0 - np.asarray(p)), dtype=np.float64)


def normal_quantile(p: npt.ArrayLike) -> FloatArray:
    """Quantile of the standard normal distribution."""
    return np.asarray(special.ndtri(p), dtype=np.float64)


def coverage_factor(coverage: float, dof: npt.ArrayLike = np.inf) -> FloatArray:
    """Two-sided coverage factor k from Student's t with dof degrees of freedom (GUM, G.3.4).

    dof may be ∞ (the normal distribution) and broadcasts.
    """
    p, dof = 0.5 + coverage / 2, np.asarray(dof, dtype=np.float64)
    finite = np.isfinite(dof)
    t = special.stdtrit(np.where(finite, dof, 1.0), p)
    return np.asarray(np.where(finite, t, special.ndtri(p)), dtype=np.float64)


def coverage(k: float, dof: float = np.inf) -> float:
    """Probability within ±k standard uncertainties, of Student's t with dof degrees of freedom."""
    return float(1.0 - 2.0 * (special.stdtr(dof, -k) if np.isfinite(dof) else special.ndtr(-k)))


#: Half an interval over a normal standard uncertainty.
INTERVAL_FACTOR = float(coverage_factor(INTERVAL_COVERAGE))


def widening(dof: float) -> float:
    """Factor on a standard error of so many degrees of freedom: three of them cover 99.73 %."""
    return float(coverage_factor(_THREE, dof)) / 3.0


def student_dof(coverage: float, k: npt.ArrayLike) -> FloatArray:
    """Degrees of freedom whose two-sided coverage factor is k; ∞ where k is the normal one's."""
    k = np.asarray(k, dtype=np.float64)
    p = 0.5 + coverage / 2
    normal = k <= special.stdtrit(1e4, p)
    dof = special.stdtridf(p, np.where(normal, 2 * k, k))
    return np.asarray(np.where(normal, np.inf, dof), dtype=np.float64)
