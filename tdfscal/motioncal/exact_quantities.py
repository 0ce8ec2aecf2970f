"""What is taken as exact in motion; see `selfcal.exact_quantities`."""

from __future__ import annotations

import numpy as np

from tdfscal.model import dynamics
from tdfscal.model.parameters import parameter_count
from tdfscal.motioncal.estimator import MovingFit
from tdfscal.numerics.least_squares import spectrum
from tdfscal.selfcal.exact_quantities import ExactQuantity, of_columns

#: Typical error of a delay of the force stamps, s: a sample or two of a fieldbus.
_DELAY = 1e-3


def exact_quantities(fit: MovingFit) -> tuple[ExactQuantity, ...]:
    """Each quantity of a calibration in motion that has no uncertainty of its own."""
    still, variance = fit.state.still, fit.noise.variance(fit.rows.bins)
    slope = fit.slope_at(fit.state)
    columns = fit.rows.weighted(fit.rows.design @ slope, variance)
    parts = spectrum(fit.whitened()[1])
    P = parameter_count(still.n, still.motions)
    found = of_columns(columns[:, :P], parts, fit.active[:P], still)
    if not fit.active[P + dynamics.DELAY]:
        column = _DELAY * columns[:, P + dynamics.DELAY]
        moved = parts.root @ (parts.left[: len(columns)].T @ column)
        angles = np.flatnonzero(np.flatnonzero(fit.active) < 3 * still.n)
        found += (ExactQuantity("delay", _DELAY, "s", moved[angles, None]),)
    return found
