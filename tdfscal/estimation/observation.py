"""What one campaign, or a survey, says of the rig's constants: observations add.

A campaign is a quadratic form: its own quantities (zeros) are eliminated by a Schur complement;
what is left is the information on the rig's constants, counted from a common reference. Rotations,
hinges, datums, sensitivities, the direction of gravity and a load stated alike have one realisation
in all campaigns: they are pooled together, since pooled on the rotations alone a hinge's error
would seem to average out. Information adds; a campaign that determines nothing by itself adds what
it has.

C active constants in the order of `model.parameters.layout`; the 3n rotations come first, rad.
"""

from __future__ import annotations

import numpy as np

from tdfscal.estimation.fit import Fitted, Priors
from tdfscal.frozen import record
from tdfscal.model.calibrated import Calibrated, constants_known, free_constants
from tdfscal.model.parameters import (
    LOAD,
    State,
    constants,
    deviation,
    furthest,
    layout,
    parameter_count,
    prior_std,
    with_motions,
)
from tdfscal.numerics.information import Contrast, Information, without
from tdfscal.records import BoolArray, FloatArray

#: A share of a direction that no row sees below this is rounding.
_OPEN = 1e-6


@record
class Observation:
    """What was observed of the rig's constants; observations add.

    A campaign at rest or in motion, or a survey, its own parameters eliminated at a state.

    chi2 : with the constants at the reference and the own parameters at their best. rows : number
    of residuals, own priors included, less the own parameters that they determine.
    places : (P,), which parameters are the campaign's own. own : (o,), their step at the reference;
    give : (o, C), their change per change of the constants. spread : (o, o), their covariance where
    the constants are known. open : (o,), of which the campaign says nothing.
    """

    information: Information
    chi2: float
    rows: int
    places: BoolArray
    own: FloatArray
    give: FloatArray
    spread: FloatArray
    open: BoolArray


def eliminate(of: Fitted, reference: State) -> Observation:
    """Reduce a campaign to its constants (C,), counted from the reference's; priors of the
    constants are left out, those of its own parameters are kept.

    of : a fit whose parameters are those of statics.
    """
    shared = np.pad(free_constants(of.rig), (0, len(of.active) - parameter_count(of.rig.n)))
    common = shared[of.active]
    own_rows = np.asarray(np.abs(of.prior_jacobian[:, ~common]).any(axis=1))
    r, J = of.whitened()
    kept = np.concatenate([np.ones(len(r) - len(own_rows), dtype=np.bool_), own_rows])
    r, J = r[kept], J[kept]
    # Residual at the reference's constants, to the first order.
    away = deviation(of.still, with_motions(reference, of.still.motions))[of.active][common]
    A, B = J[:, common], J[:, ~common]
    r = r - A @ away
    scale = np.linalg.norm(B, axis=0)
    scale = np.where(scale > 0, scale, 1.0)
    U, s, Vt = np.linalg.svd(B / scale, full_matrices=True)
    rank = int(np.sum(s > s[0] * max(B.shape) * np.finfo(float).eps * 8)) if len(s) else 0
    U = U[:, :rank]
    back = -(Vt[:rank].T / s[:rank]) @ U.T / scale[:, None]
    free_A, free_r = A - U @ (U.T @ A), r - U @ (U.T @ r)
    give, spread = back @ A, back @ back.T
    pull = of.noise_pull[of.active]
    by_noise, by_own = pull[common], pull[~common]
    return Observation(
        information=Information(free_A.T @ free_A, by_noise + give.T @ by_own - free_A.T @ free_r),
        chi2=float(free_r @ free_r),
        rows=of.rows + int(own_rows.sum()) - rank,
        places=of.active & ~shared,
        own=back @ r + spread @ by_own,
        give=give,
        spread=spread,
        open=np.abs(Vt[rank:]).max(axis=0, initial=0.0) > _OPEN,
    )


def of_estimate(known: Calibrated, prior: Information, reference: State) -> Observation:
    """What a campaign says that was calibrated by itself, as one in motion and a survey are.

    Its posterior less its prior (C, C) of the constants, both counted from the reference: the noise
    of its rows was estimated with them, so that no χ² of its own remains.
    """
    free = free_constants(known.rig)
    places = ~free & (prior_std(known.rig) > 0)
    C = known.covariance
    posterior = constants_known(known.rig, C).matrix
    away = deviation(known.state, reference)[free]
    found = without(Information(posterior, posterior @ away), prior)
    give = C[np.ix_(places, free)] @ posterior
    spread = C[np.ix_(places, places)] - give @ C[np.ix_(free, places)]
    # An estimate without residuals: χ² is its distance from the reference.
    chi2, rank = Contrast(found.matrix, found.score).chi2()
    own, none_open = -give @ away, np.zeros(len(give), dtype=np.bool_)
    return Observation(found, chi2, rank, places, own, give, spread, none_open)


def stated(priors: Priors, reference: State) -> Information:
    """What the rig file, or an earlier calibration, says of the constants, counted once."""
    free = free_constants(priors.rig)
    common = free[priors.active]
    residual, rows = priors(reference)
    rows = rows[:, common]
    here = np.abs(rows).any(axis=1)
    matrix = rows[here].T @ rows[here]
    matrix += np.diag(furthest(reference.n)[free] ** -2.0)
    return Information(matrix, -(rows[here].T @ residual[here]))


def unstated(priors: Priors, *, load_alone: bool = False) -> int:
    """Count the free constants that have no prior of their own; of the terminal alone, if asked."""
    std, n = priors.full_std, len(priors.nominal)
    if load_alone:
        return sum(int(np.isinf(std[layout(n)[group]]).sum()) for group in LOAD)
    open_std = np.isinf(std) & constants(n)
    return int(open_std.sum()) - len(priors.angled)
