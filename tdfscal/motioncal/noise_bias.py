"""What noise in the readings adds to a score in motion; see `selfcal.noise_bias`."""

from __future__ import annotations

from dataclasses import replace

import numpy as np

from tdfscal.model.parameters import parameter_count
from tdfscal.model.statics import balance
from tdfscal.motioncal.design import instants, shifted
from tdfscal.motioncal.estimator import MovingFit
from tdfscal.motioncal.rows import reading_gain
from tdfscal.records import FloatArray

#: One of so many instants of a block shows how its columns are made of readings.
_EVERY = 20


def noise_scores(fit: MovingFit, slope: FloatArray) -> FloatArray:
    """Expected scores (P,) of the static parameters by the noise of the readings alone.

    slope : (q + …, P + 8), of the features. Noise of density S_F in reading a at one instant moves
    a column by ∂c/∂f_a and the balance by B M e_a: Σ S_F (∂c/∂f_a)ᵀ S⁻¹ (B M e_a), over all
    frequencies, and instants by the taper's weight.
    """
    rig, state = fit.rig, fit.state.still
    P = parameter_count(rig.n, state.motions)
    total = np.zeros(P)
    for item in fit.designs:
        some = slice(item.block.index.start, item.block.index.stop, _EVERY)
        weight = item.block.taper[0, ::_EVERY] ** 2
        place = shifted(fit.slow, item.block.index, fit.delay)[::_EVERY]
        seen = instants(rig, fit.slow, place, some)
        at = balance(seen, state, fit.origin.centre, rig.gravity)
        W = reading_gain(item, fit.noise)
        static = at.design.shape[2]
        # Σ_a over readings of (∂design/∂f_a)ᵀ W B M e_a, the readings moved by one newton each.
        felt = W @ at.noise_force * weight[:, None, None, None]
        along = np.zeros(static)
        for i, a in np.argwhere(rig.axes):
            force = seen.force.copy()
            force[:, i, a] += 1.0
            moved = replace(seen, force=force)
            change = balance(moved, state, fit.origin.centre, rig.gravity).design - at.design
            along += np.tensordot(felt[:, i, :, a], change, axes=2)
        total += along @ slope[:static, :P] / weight.sum()
    return total
