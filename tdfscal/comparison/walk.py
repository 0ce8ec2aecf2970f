"""Angles that creep: a random walk between campaigns, filtered forwards and smoothed backwards.

State: the free constants of the rig (C,), of which the 3n rotations walk with intensity q per axis
(rad/√month) and the others stay. In information form a campaign that determines only a part of
them needs no special case. Filtered forwards and backwards, the smoothed state is the sum of both
and of the campaign's own (two-filter form of Rauch, Tung and Striebel's smoother; Fraser and
Potter, IEEE Trans. Autom. Control 14, 1969).
"""

from __future__ import annotations

from collections.abc import Callable, Sequence

import numpy as np

from tdfscal.frozen import record
from tdfscal.numerics.distributions import chi2_quantile
from tdfscal.numerics.information import Information, contrast
from tdfscal.records import FloatArray
from tdfscal.significance import INTERVAL_COVERAGE

#: Random-walk intensities that are tried, rad/√month, beside none at all.
_TRIED = np.geomspace(1e-6, 2e-2, 60)


@record
class Walk:
    """Checks in the order of time: what each says by itself, and the walk between them.

    own : per check. prior : before the first. steps : variance (C,) of the walk before each check;
    the first is not used.
    """

    own: Sequence[Information]
    prior: Information
    steps: Sequence[FloatArray]

    def before(self) -> list[Information]:
        """What is known before each check speaks, from those before it."""
        found, now = [], self.prior
        for k, item in enumerate(self.own):
            now = now.walked(self.steps[k]) if k else now
            found.append(now)
            now = now + item
        return found

    def others(self) -> list[Information]:
        """What all other checks say of the constants at the time of each."""
        found, later = self.before(), self.prior - self.prior
        for k in range(len(self.own) - 1, -1, -1):
            found[k] = found[k] + later
            later = (later + self.own[k]).walked(self.steps[k])
        return found

    def log_likelihood(self) -> float:
        """Logarithm of the likelihood of all checks but the first, up to a constant."""
        total = 0.0
        for known, item in zip(self.before()[1:], self.own[1:], strict=True):
            gain = _log_det(known.matrix + item.matrix) - _log_det(known.matrix)
            total -= 0.5 * (gain + contrast(known, item).chi2()[0])
        return total


def _log_det(matrix: FloatArray) -> float:
    scale = np.sqrt(np.diagonal(matrix))
    return float(np.linalg.slogdet(matrix / scale[:, None] / scale)[1] + 2 * np.log(scale).sum())


@record
class Intensity:
    """Random-walk intensity by the history, rad/√month: most likely value, 95 % interval."""

    value: float
    low: float
    high: float


def intensity(likelihood: Callable[[float], float]) -> Intensity:
    """Estimate q from its log-likelihood; the interval by the likelihood ratio (χ² of one).

    Its ends lie outwards, at the first values tried that are not within it: with many checks it is
    narrower than the steps between them. low is 0 where no walk at all is within it.
    """
    tried = np.concatenate([[0.0], _TRIED])
    level = np.array([likelihood(float(q)) for q in tried])
    best = int(np.argmax(level))
    inside = np.flatnonzero(level >= level[best] - chi2_quantile(INTERVAL_COVERAGE, 1) / 2)
    low, high = max(inside[0] - 1, 0), min(inside[-1] + 1, len(tried) - 1)
    return Intensity(float(tried[best]), float(tried[low]), float(tried[high]))
