"""Propagation of distributions with the adaptive procedure of JCGM 101:2008, 7.9, and clause 8."""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import dataclass, replace

import numpy as np

from tdfscal.records import FloatArray

#: Trials per block: 7.9.4 b) asks for at least 10⁴.
BLOCK = 10_000


@dataclass(frozen=True, slots=True)
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
