"""Distributions: tails and quantiles from scipy.special (scipy.stats costs a second to import), and
their propagation with the adaptive procedure of JCGM 101:2008, 7.9, and clause 8.
"""

from __future__ import annotations

from collections.abc import Callable

import numpy as np
import numpy.typing as npt
from scipy import special

from tdfscal.frozen import record, replace
from tdfscal.records import FloatArray
from tdfscal.significance import FEWEST_TRIALS, INTERVAL_COVERAGE

_THREE = 0.9973  # coverage of three standard deviations


def chi2_sf(x: npt.ArrayLike, dof: npt.ArrayLike) -> FloatArray:
    """Probability that χ² with dof degrees of freedom exceeds x; 1 where there is none."""
    none = np.asarray(dof) <= 0
    return np.where(none, 1.0, special.chdtrc(np.where(none, 1.0, dof), x))


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


def trials_decide(trials: int, *, validated: bool) -> bool:
    """Whether an interval is that of its trials: they are many, and do not confirm the linear."""
    return not validated and trials >= FEWEST_TRIALS


#: Trials per block: 7.9.4 b) asks for at least 10⁴.
BLOCK = 10_000


@record
class MonteCarlo:
    """What trials show of a quantity; mean to tolerance have its own shape.

    low, high : probabilistically symmetric coverage interval. tolerance : δ of 7.9.2.
    stable : twice the standard deviations of all averages fell below δ/5 before the trials ran
    out; a fifth of δ is what clause 8 asks of a validation. sample : (≤ BLOCK, …), first block, as
    deviations from the estimate. validated : the linear interval agrees with that of the trials.
    unsettled : trials whose iteration did not settle; they count where they ended.
    """

    trials: int
    mean: FloatArray
    std: FloatArray
    low: FloatArray
    high: FloatArray
    tolerance: FloatArray
    stable: bool
    sample: FloatArray
    validated: bool = False
    unsettled: int = 0

    @property
    def decides(self) -> bool:
        """Whether the trials' own interval is to be stated."""
        return trials_decide(self.trials, validated=self.validated)

    def validates(self, low: FloatArray, high: FloatArray) -> bool:
        """Both ends of another interval agree with this one within δ (clause 8)."""
        off = np.maximum(np.abs(self.low - low), np.abs(self.high - high))
        return bool((off <= self.tolerance).all())

    def about(self, estimate: FloatArray, half: FloatArray) -> MonteCarlo:
        """The trials of deviations from an estimate, whose linear interval has this half width."""
        return replace(
            self,
            mean=estimate + self.mean,
            low=estimate + self.low,
            high=estimate + self.high,
            validated=self.validates(-half, half),
        )


def numerical_tolerance(std: FloatArray, digits: int = 1) -> FloatArray:
    """Return δ = ½ 10ˡ with std = c 10ˡ and c an integer of that many digits (7.9.2)."""
    exponent = np.floor(np.log10(std)) - (digits - 1)
    # A mantissa that rounds up to the next power of ten has moved to the next l.
    rounds_up = np.round(std / 10.0**exponent) >= 10.0**digits
    return np.asarray(0.5 * 10.0 ** (exponent + rounds_up))


def propagate(
    draw: Callable[[int], FloatArray],
    std: FloatArray,
    coverage: float,
    max_trials: int,
    digits: int = 1,
) -> MonteCarlo:
    """Draw blocks of outputs until their averages are stable or the trials run out (7.9.4).

    Blocks are alike in size, so that their averages count alike.

    draw : returns (size, …) independent values of the output. std : (…), its standard
    uncertainty, for the tolerance. max_trials : two or more, as one has no spread.
    """
    tolerance = numerical_tolerance(std, digits)
    tail = 100 * (1 - coverage) / 2
    summaries: list[FloatArray] = []
    sample = np.empty(0)
    trials, stable, blocks = 0, False, -(-max_trials // BLOCK)
    while trials < max_trials and not stable:
        block = draw(max_trials * (len(summaries) + 1) // blocks - trials)
        sample = block if trials == 0 else sample
        trials += len(block)
        low, high = np.percentile(block, [tail, 100 - tail], axis=0)
        summaries.append(np.stack([block.mean(axis=0), block.std(axis=0, ddof=1), low, high]))
        if len(summaries) > 1:
            spread = np.std(summaries, axis=0, ddof=1) / np.sqrt(len(summaries))
            stable = bool((2 * spread < tolerance / 5).all())
    mean, found, low, high = np.mean(summaries, axis=0)
    return MonteCarlo(trials, mean, found, low, high, tolerance, stable, sample)
