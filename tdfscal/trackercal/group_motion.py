"""Do the groups of two point files move as one body, or each by itself?"""

from __future__ import annotations

from collections.abc import Iterable

import numpy as np

from tdfscal.errors import TdfscalError
from tdfscal.trackercal.judged_registration import Noise, SurveyFit, fit_survey
from tdfscal.trackercal.point_matching import MatchedPoints

#: By so much the residuals must shrink before another model is worth a word. Three further
#: unknowns do so by chance in about one case of a thousand at six degrees of freedom.
_BETTER = 3.0
_LEAST_DOF = 6


def moved_apart(points: MatchedPoints, noise: Noise, together: SurveyFit) -> str | None:
    """Say that a translation, or a transform, per group fits much better; None where it does not.

    together : the fit of one transform for all.
    """
    if (sigma := together.fit.sigma) is not None:  # none was stated: that of the residuals
        noise = Noise({}, {"residuals": np.tile(sigma**2 * np.eye(3), (len(points), 1, 1))})
    shifted = _attempt(points, noise, common_shift=False)
    best, model = [together], ""
    for fits, name in (
        ([shifted] if shifted else [], "a translation"),
        (_one_by_one(points, noise), "a transform"),
    ):
        enough = sum(fit.fit.dof for fit in fits) >= _LEAST_DOF
        if enough and _spread(best) > _BETTER * _spread(fits):
            best, model = fits, name
    if not model:
        return None
    groups, after = ", ".join(dict.fromkeys(points.group)), _spread(best)
    return (
        f"{model} of its own for each group ({groups}) fits {_spread([together]) / after:.3g} "
        f"times better, within {1e3 * after:.2g} mm per coordinate: the groups have moved against "
        "each other, or are given in frames of their own; register each by itself"
    )


def fit_one_by_one(points: MatchedPoints, noise: Noise) -> bool:
    """Tell whether there are several groups, each of which registers alone."""
    return bool(_one_by_one(points, noise))


def _one_by_one(points: MatchedPoints, noise: Noise) -> list[SurveyFit]:
    """Fits of the single groups; none where there is one group, or one that fails."""
    groups = dict.fromkeys(points.group)
    if len(groups) < 2:
        return []
    fits = []
    for group in groups:
        which = points.indices(group)
        fit = _attempt(points.take(which), noise.take(which), common_shift=True)
        if fit is None:
            return []
        fits.append(fit)
    return fits


def _attempt(points: MatchedPoints, noise: Noise, *, common_shift: bool) -> SurveyFit | None:
    if len(set(points.group)) < 2 and not common_shift:
        return None
    try:
        return fit_survey(points, noise, common_shift=common_shift, least=3, what="points")
    except TdfscalError:
        return None


def _spread(fits: Iterable[SurveyFit]) -> float:
    """Noise per coordinate that the residuals show, m."""
    squares = sum(float(np.sum(fit.fit.residual**2)) for fit in fits)
    return float(np.sqrt(squares / max(sum(fit.fit.dof for fit in fits), 1)))
