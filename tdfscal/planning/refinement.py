"""Chosen postures moved freely inside the limits: continuous exchange, one posture at a time.

A pool of candidates holds good postures, not the best: each chosen one is shifted, by turn, lean
and squeeze, as long as that lowers the objective, with steps that shrink (Meyer and Nachtsheim's
coordinate exchange, 1995, with random directions).
"""

from __future__ import annotations

import numpy as np

from tdfscal.numerics import so3
from tdfscal.planning.candidates import Candidates, realised
from tdfscal.planning.limits import Limits
from tdfscal.planning.predicted_information import Sight
from tdfscal.planning.selection import gains, information, inverse, updated
from tdfscal.records import FloatArray

#: Rounds, proposals per round, at most and at least per posture; sizes of the steps, as shares of
#: the limits.
_ROUNDS, _PROPOSALS, _MOST, _LEAST = 60, 600, 24, 6
_WIDEST, _FINEST = 1.2, 0.03
#: Share of the proposals that turn and lean as before and only squeeze otherwise, and of those
#: that first turn, lean or squeeze the other way: no small step gets there.
_SQUEEZE_ONLY, _MIRRORED = 0.4, 0.2


def refine(
    sight: Sight,
    limits: Limits,
    chosen: Candidates,
    base: FloatArray,
    objective: FloatArray,
    rng: np.random.Generator,
    *,
    rounds: int = _ROUNDS,
) -> Candidates:
    """Postures that make tr(L (base + Σ JᵀJ)⁻¹ Lᵀ) smaller than the chosen ones do.

    Parameters
    ----------
    chosen : (K postures), inside the limits.
    base : (p, p), information held without them. objective : (r, p), L.
    rounds : of proposals for every posture.

    Returns
    -------
    Candidates
        As many postures inside the limits, never worse.
    """
    rows = sight.rows(chosen)
    each = int(np.clip(_PROPOSALS // len(chosen), _LEAST, _MOST))
    for size in np.geomspace(_WIDEST, _FINEST, rounds):
        found = realised(sight.rig, limits, *_shifted(chosen, limits, size, each, rng))
        if found is None:
            break
        proposals, kept = found
        owner = np.repeat(np.arange(len(chosen)), each)[kept]
        offered = sight.rows(proposals)
        C = inverse(base + information(rows))
        picked = np.arange(len(chosen))
        for k in range(len(chosen)):
            mine = np.flatnonzero(owner == k)
            without = updated(C, rows[k], -1.0)
            gain = gains(np.concatenate([rows[k][None], offered[mine]]), without, objective)
            best = int(np.argmax(gain))
            if best == 0:
                continue
            rows[k] = offered[mine[best - 1]]
            picked[k] = len(chosen) + mine[best - 1]
            C = updated(without, rows[k])
        chosen = chosen.joined(proposals).take(picked)
    return chosen


def _shifted(
    chosen: Candidates, limits: Limits, size: float, each: int, rng: np.random.Generator
) -> tuple[FloatArray, FloatArray, FloatArray]:
    """Turn, lean and squeeze of proposals, `each` about every chosen posture; size : share of the
    limits.
    """
    count = len(chosen) * each
    still = rng.uniform(size=count) < _SQUEEZE_ONLY
    # A lean about an axis in the plane and a turn about the vertical: exp(turn z) exp(lean).
    turn, lean = turn_and_lean(chosen.rotation)
    step = size * limits.tilt * rng.standard_normal((count, 3)) * ~still[:, None]
    squeeze = np.repeat(chosen.squeeze, each, axis=0)
    push = size * limits.squeeze * rng.standard_normal(squeeze.shape)
    mirrored = rng.uniform(size=(count, 1)) < _MIRRORED
    sign = np.where(mirrored, rng.choice([-1.0, 1.0], size=(count, 3)), 1.0)
    return (
        sign[:, 0] * np.repeat(turn, each) + step[:, 0],
        sign[:, [1]] * np.repeat(lean, each, axis=0) + step[:, 1:],
        sign[:, 2, None, None] * squeeze + push,
    )


def turn_and_lean(rotation: FloatArray) -> tuple[FloatArray, FloatArray]:
    """Turn (K,) and lean (K, 2), rad, of rotations (K, 3, 3) = exp(turn z) exp((lean, 0))."""
    down = rotation[:, 2]  # zᵀ R = (exp(lean)ᵀ z)ᵀ, whatever the turn
    angle = np.arccos(np.clip(down[:, 2], -1.0, 1.0))
    across = np.stack([down[:, 1], -down[:, 0]], axis=1)
    length = np.linalg.norm(across, axis=1)
    lean = across * np.where(length > 0, angle / np.where(length > 0, length, 1.0), 1.0)[:, None]
    full = np.concatenate([lean, np.zeros((len(lean), 1))], axis=1)
    turn = so3.log(rotation @ np.swapaxes(so3.exp(full), 1, 2))[:, 2]
    return turn, lean
