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
    support, axis = np.nonzero(rig.axes)
    for item in fit.designs:
        some = slice(item.block.index.start, item.block.index.stop, _EVERY)
        weight = item.block.taper[0, ::_EVERY] ** 2
        place = shifted(fit.slow, item.block.index, fit.delay)[::_EVERY]
        seen = instants(rig, fit.slow, place, some)
        # The instants as they are, and again for every reading, that one moved by a newton.
        K, reading = len(seen), np.arange(len(support))
        seen = seen.subset(np.tile(np.arange(K), 1 + len(support)))
        force = seen.force.reshape(1 + len(support), K, rig.n, 3).copy()
        force[1 + reading, :, support, axis] += 1.0
        seen = replace(seen, force=force.reshape(-1, rig.n, 3))
        at = balance(seen, state, fit.origin.centre, rig.gravity)
        design = at.design.reshape(1 + len(support), K, 6, -1)
        # Σ_a over readings of (∂design/∂f_a)ᵀ W B M e_a.
        felt = reading_gain(item, fit.noise) @ at.noise_force[:K] * weight[:, None, None, None]
        along = np.tensordot(felt[:, support, :, axis], design[1:] - design[0], axes=3)
        total += along @ slope[: len(along), :P] / weight.sum()
    return total
