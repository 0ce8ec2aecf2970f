"""What noise in the readings adds to a score: regressors made of noisy forces correlate with them.

A column c(f) of the model, made of readings f with noise ν, has the expected score
E[cᵀ W e] = Σ_a σ_a² (∂c/∂f_a)ᵀ W (∂e/∂f_a) although its parameter is 0. The turns of the sensors
are free of it where the noise is isotropic (theory, section 3); gains and the compliance are not,
and with many noisy postures it passes for one.
"""

from __future__ import annotations

from dataclasses import replace

import numpy as np

from tdfscal.model.statics import balance, features_jacobian
from tdfscal.records import FloatArray
from tdfscal.selfcal.estimator import Fit


def noise_scores(fit: Fit, root: FloatArray) -> FloatArray:
    """Expected scores (P,) of all parameters by the noise of the readings alone.

    root : (K, 6, 6), whitens the postures; 0 where one is left out.
    """
    state, g = fit.state, fit.rig.gravity
    by_state = features_jacobian(state, fit.at, g)
    seen = fit.at.seen
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
