"""Estimates of zeros that move and of supports that give, and what they cost the angles."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np

from tdfscal.estimation.uncertainty import Uncertainty
from tdfscal.model.parameters import layout, vector
from tdfscal.numerics import so3
from tdfscal.numerics.least_squares import Spectrum
from tdfscal.records import FloatArray
from tdfscal.selfcal.estimator import Fit


@dataclass(frozen=True, slots=True)
class Nuisance:
    """A group of parameters beside the angles.

    kind : time, temperature, parabola, walk; lateral, vertical. value, std : (m,), per channel in
    N/s, N/K, N/s², of a walk's modes in N; or (1,) in m/N. share : (n, 3), part of the variance of
    roll, pitch, yaw that would be gone if the group were known.
    """

    kind: str
    value: FloatArray
    std: FloatArray
    share: FloatArray


def nuisances(fit: Fit, parts: Spectrum, known: Uncertainty) -> tuple[Nuisance, ...]:
    """Estimate of each kind of drift, and of each compliance, that the rig file declares."""
    motion, n = fit.postures.motion, fit.rig.n
    kind, place = np.full(len(fit.active), "", dtype="U11"), layout(n, fit.state.motions)
    if motion is not None:
        kind[place["drift"]] = np.repeat(motion.kind, 3 * n)
    give = place["compliance"]
    kind[give] = np.where(fit.active[give], ["lateral", "vertical"], "")
    turns, columns = parts.root[: 3 * n], kind[fit.active]
    R = fit.state.rotation
    whole = np.maximum(so3.rpy_variance(R, turns @ turns.T), np.finfo(float).tiny)
    found = []
    for name in dict.fromkeys(kind[kind != ""].tolist()):
        # C_ad C_dd⁺ C_da over C_aa, a the angles, d the group.
        own = parts.root[columns == name]
        cross = turns @ own.T
        gone = cross @ np.linalg.pinv(own @ own.T, hermitian=True) @ cross.T
        share = so3.rpy_variance(R, gone) / whole
        which = kind == name
        found.append(Nuisance(name, vector(fit.state)[which], known.parameter_std[which], share))
    return tuple(found)
