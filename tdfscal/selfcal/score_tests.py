"""Score tests of static postures: their suspects, and noise held against them.

Friction of the hinges is no shift but a scatter, of the moments alone; it is asked for by the
variance of the residuals along them. What the tests speak for is held against all kinds of noise
and zeros that wander (`scatter`).
"""

from __future__ import annotations

from collections.abc import Iterator
from dataclasses import replace

import numpy as np

from tdfscal.estimation.score_tests import (
    Suspect,
    misstated_mountings,
    moving_zeros,
    speaking,
    stated_suspects,
)
from tdfscal.estimation.suspicion import Suspicion, likeliest
from tdfscal.estimation.uncertainty import Estimate
from tdfscal.model.parameters import layout, prior_std
from tdfscal.model.statics import balance, features_jacobian
from tdfscal.records import FloatArray
from tdfscal.selfcal.estimator import ROWS, Fit
from tdfscal.selfcal.scatter import chance, scatters, wandering
from tdfscal.significance import MISFIT, UNDECLARED_ERROR, UNDECLARED_FRICTION_SHARE

_HOUR = 3600.0


def suspicions(
    of: Estimate[Fit], time: FloatArray, temperature: FloatArray | None = None
) -> tuple[Suspicion, ...]:
    """Ask for every suspect, and return the likeliest with those that are about as likely.

    time : (K,), s, when each posture was held. temperature : (K, n), °C, where it is known.
    """
    fit, parts = of.fit, of.parts
    suspects = list(_suspects(fit, time, temperature))
    found = speaking(of, suspects, lambda: noise_scores(fit), other=UNDECLARED_FRICTION_SHARE)
    if (
        chance(fit.root[:, :, 3:], parts, fit.white) <= UNDECLARED_ERROR * UNDECLARED_FRICTION_SHARE
        or of.quality.p_value < MISFIT
    ):
        found += scatters(of)
    if found:
        found += wandering(of, time)
    # At rest no covariance holds their moves.
    return likeliest([replace(doubt, move=None) for doubt in found])


def noise_scores(fit: Fit) -> FloatArray:
    """Expected scores (P,) of all parameters by the noise of the readings alone.

    A column c(f) of the model, made of readings f with noise ν, has the expected score
    E[cᵀ W e] = Σ_a σ_a² (∂c/∂f_a)ᵀ W (∂e/∂f_a) although its parameter is 0. The turns of the
    sensors are free of it where the noise is isotropic (theory, section 3); gains and the
    compliance are not, and with many noisy postures it passes for one.
    """
    state, g, root, seen = fit.state, fit.rig.gravity, fit.root, fit.at.seen
    by_state = features_jacobian(state, fit.at, g)
    std = np.sqrt(np.diagonal(seen.force_cov, axis1=2, axis2=3))  # (K, n, 3)
    total = np.zeros(by_state.shape[1])
    for i, a in np.argwhere(seen.measured):
        force = seen.force.copy()
        force[:, i, a] += std[:, i, a]
        moved = balance(replace(seen, force=force), state, fit.at.centre, g)
        change = root @ ((moved.design - fit.at.design) @ by_state)
        shift = root @ (fit.at.noise_force[:, i, :, a] * std[:, i, a, None])[..., None]
        total += np.einsum("kap,ka->p", change, shift[..., 0])
    return np.asarray(total * fit.dof / max(fit.rows, 1))


def _suspects(fit: Fit, time: FloatArray, temperature: FloatArray | None) -> Iterator[Suspect]:
    """What the rig file states, and zeros that move."""
    rig, K, priors = fit.rig, len(fit.weight), len(fit.prior_residual)
    columns = np.pad(fit.slopes.reshape(ROWS * K, -1), ((0, priors), (0, 0)))
    std = prior_std(rig, fit.postures.motion)
    yield from stated_suspects(rig, columns, std, fit.state.motions, priors)
    yield from misstated_mountings(rig, len(columns))
    zeros = columns[:, layout(rig.n)["zero"]].reshape(-1, rig.n, 3)
    for group, shape in _shapes(fit, time, temperature):
        size = 1.0 if group != "parabola" else float(np.sqrt(_HOUR / np.ptp(time)))
        each = np.pad(np.repeat(shape, ROWS, axis=0), ((0, priors), (0, 0)))
        yield from moving_zeros(group, zeros * each[..., None], size)


def _shapes(
    fit: Fit, time: FloatArray, temperature: FloatArray | None
) -> Iterator[tuple[str, FloatArray]]:
    """How zeros may move that nobody declared, (K, n) at most 1: by what moves them."""
    declared = () if fit.postures.motion is None else fit.postures.motion.kind
    if "walk" in declared:
        return
    n = fit.rig.n
    line = np.repeat(time[:, None], n, axis=1)
    if "time" not in declared:
        yield "drift", _away_from(line[0], line)
    elif "parabola" not in declared:
        centred = _away_from(line.mean(axis=0), line) ** 2
        yield "parabola", _away_from(centred.mean(axis=0), centred)
    if temperature is not None and "temperature" not in declared:
        warm = _away_from(temperature[0], temperature)
        if np.any(warm):
            yield "temperature", warm


def _away_from(start: FloatArray, values: FloatArray) -> FloatArray:
    """Values (K, n) from a start (n,), the largest of a column at 1.

    A zero is stated where it was tared, so that it moves from the first posture on.
    """
    away = values - start
    return np.asarray(away / np.maximum(np.abs(away).max(axis=0), np.finfo(float).tiny))
