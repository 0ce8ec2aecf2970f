"""Does a calibration still hold? The residual wrench of a terminal that never stops.

The noise's spectrum comes from the same log, with all that may have changed left free: a change
of the rig must not pass for noise. So χ² over all frequencies says nothing; what is tested is the
part of the residual along what the model knows to change, rotations, zeros and load first, with
the calibration's covariance and the spectrum's own uncertainty (theory, section 8).
"""

from __future__ import annotations

from collections.abc import Sequence

import numpy as np

from tdfscal.checks import log_against_rig
from tdfscal.errors import NotConvergedError
from tdfscal.estimation.fit import factored_information
from tdfscal.findings import Finding, Value
from tdfscal.frozen import record, replace
from tdfscal.model import dynamics
from tdfscal.model.calibrated import Calibrated, with_own_load
from tdfscal.model.parameters import layout, nominal, with_motions
from tdfscal.motioncal.blocks import Block, Stretch
from tdfscal.motioncal.design import drifting
from tdfscal.motioncal.estimator import (
    ResidualWrench,
    at_state,
    estimate_noise,
    fit_moving,
    residual_wrench,
)
from tdfscal.motioncal.fit import MovingFit, MovingPriors, MovingState, spectrum_share
from tdfscal.motioncal.preparation import gaps, moments, usable_samples
from tdfscal.motioncal.score_tests import without_contacts
from tdfscal.motioncal.slip import CONTACT, Step, likeliest_steps, refuse_changed_delay
from tdfscal.motioncal.streams import Slow
from tdfscal.numerics import so3
from tdfscal.numerics.least_squares import block_diagonal, spectrum
from tdfscal.records import Rig, UncertainValue
from tdfscal.selfcal.preparation import check_positions
from tdfscal.validation.causes import Cause
from tdfscal.validation.residual_wrench import judged_by, refuse_misread
from tdfscal.validation.residuals import Course, Linearised, moving_zeros
from tdfscal.validation.verdict import Judged, Verdict, judged_with_zeros


@record(kw_only=True)
class MovingValidation(Verdict):
    """Verdict on a calibration by a log in motion.

    begin : s, in the log's time; seconds : length of what was tested. rejected : stretches left
    out, contacts among them. residual : lengths of the residual wrench over time, without and
    with the calibration. chi2 and dof are those of the residual along all that may change.
    """

    begin: float
    seconds: float
    rejected: tuple[Stretch, ...]
    residual: ResidualWrench


def validate_moving(
    given: Calibrated, slow: Slow, delay: UncertainValue, *, rig: Rig | None = None
) -> MovingValidation:
    """Test a calibration on a log in motion; contacts in it are found and left out.

    rig : the rig of this log, for what it declares, its zeros and its load; default the
    calibration's.

    Raises
    ------
    DataError
        The log cannot serve, its positions do not fit the hinges, or its forces are not what their
        fields are called, or in another unit.
    NotConvergedError
        Something changed on the way, and the fit by which it is told does not settle.
    """
    rig = rig or given.rig
    log_against_rig.check_unit(rig, slow.force)
    usable = usable_samples(rig, slow)
    seen = moments(rig, slow, usable.keep)
    check_positions(rig, seen)
    given = with_own_load(given, rig)
    # Before the noise is sought in the residuals, for which it would pass.
    refuse_misread(given, rig, seen)
    priors = MovingPriors(_loosened(rig, given), slow, delay)
    start = priors.start(given.state)

    def noise_of(cut: tuple[Block, ...]) -> MovingFit:
        return _best(estimate_noise(at_state(priors, cut, start, None)))

    fit, usable = without_contacts(noise_of(usable.blocks), usable, lambda cut, last: noise_of(cut))
    at = _linearised(given, fit, MovingPriors(rig, slow, delay))
    judged, zeros = judged_with_zeros(at, given, rig, judged_by)
    if steps := _changed_on_the_way(fit, given):
        judged = _with_steps(judged, steps)
        # Before it and behind it they are others.
        zeros = replace(zeros, moved=False, change_std=np.full_like(zeros.change_std, np.inf))
    return MovingValidation(
        rig=rig,
        begin=float(slow.time[0]),
        seconds=sum(block.seconds for block in fit.blocks),
        rejected=usable.rejected,
        residual=residual_wrench(fit, nominal(rig), start.still),
        judged=judged,
        zeros=zeros,
        findings=(
            *gaps(slow),
            *(stretch.finding for stretch in usable.rejected),
            *log_against_rig.turned(rig, seen.position),
        ),
    )


def _changed_on_the_way(fit: MovingFit, given: Calibrated) -> tuple[Step, ...]:
    """The likeliest steps; of a fit that has settled, since a large turn of the whole log bends it.

    Raises DataError where the delay changed, NotConvergedError where that fit does not settle.
    """
    turns = layout(given.rig.n)["rotation"]
    determined = np.all(~given.open[turns].reshape(-1, 3), axis=1)
    steps = likeliest_steps(fit, determined)
    if steps:
        settled = fit_moving(fit.priors, fit.blocks, fit.state, fit.noise)
        if not settled.converged:
            facts: dict[str, Value] = {"moving": True}
            found = Finding("estimate-unsettled", size=settled.iterations, values=facts)
            raise NotConvergedError(found)
        steps = likeliest_steps(settled, determined)
    refuse_changed_delay(steps)
    return steps


def _with_steps(judged: Judged, steps: Sequence[Step]) -> Judged:
    """The same, with steps as the causes: beside them nothing else of the log can be told."""
    found = tuple(
        Cause(
            kind="sensor slipped" if step.what == "rotation" else "zero jumped",
            support=step.support,
            postures=(),
            value=step.amount,
            std=step.std,
            gain=step.statistic,
            weight=step.worth,
            unknowns=len(step.amount),
            p_value=step.p_value,
            remaining_p=1.0,  # the spectrum takes all else
            between=step.between,
        )
        for step in steps
        if steps[0].what != CONTACT  # no sensor is to blame
    )
    search_p = min(judged.search_p, steps[0].p_value)
    return replace(judged, causes=replace(judged.causes, best=found), search_p=search_p)


#: How far mounting (rad), zeros, mass and barycentre (of the load) may have changed in the log.
_OPEN = 0.1
#: A direction in which a change as wide as its prior shows by less than this, in standard
#: deviations, is no test: its column is noise, and may be the very noise of the residual.
_SEEN = 0.1


def _loosened(rig: Rig, given: Calibrated) -> Rig:
    """The rig with mounting, zeros and load open about the calibration: no change is noise."""
    state = given.state
    mass, size = float(state.mass), float(np.linalg.norm(rig.hinge, axis=1).mean())
    return replace(
        rig,
        nominal_rpy=so3.to_rpy(state.rotation),
        rpy_std=np.full((rig.n, 3), _OPEN),
        zero=UncertainValue(state.zero, np.full((rig.n, 3), _OPEN * mass * rig.gravity / rig.n)),
        mass=UncertainValue(state.mass, np.array(_OPEN * mass)),
        barycentre=UncertainValue(state.barycentre, np.full(3, _OPEN * size)),
        earlier=None,
    )


def _best(fit: MovingFit) -> MovingFit:
    """The fit with the residuals of its own linear minimum, which is where noise is seen."""
    r, j = fit.whitened()
    step = spectrum(j).solve(r)
    moved = np.zeros(len(fit.active))
    moved[fit.active] = step[: int(fit.active.sum())]
    return replace(
        fit,
        state=fit.state.moved(moved),
        psi=fit.psi + fit.slope @ step,
        residual=fit.residual + fit.jacobian @ step,
        prior_residual=fit.prior_residual + fit.prior_jacobian @ step,
    )


def _linearised(given: Calibrated, fit: MovingFit, priors: MovingPriors) -> Linearised:
    """The residual at the calibration along all that the model knows."""
    state = MovingState(with_motions(given.state, priors.motions), fit.state.moving)
    at = at_state(priors, fit.blocks, state, fit.noise)
    slope = at.data.design @ at.slope_at(state)
    turns = at.data.design[:, len(at.psi) - at.rests :]
    columns = np.concatenate([at.residual[:, None], slope, turns], axis=1)
    real = at.data.weighted(columns, fit.noise.variance(at.data.bins))
    r, J = real[:, 0], real[:, 1:]
    width = np.concatenate([priors.still.full_std, priors.std, np.ones(at.rests)])
    U, seen, _ = np.linalg.svd(J * np.where(np.isfinite(width), width, 1.0), full_matrices=False)
    U = U[:, seen > _SEEN]
    r, J = U.T @ r, U.T @ J
    # What the spectrum's own uncertainty adds to the covariance of the rows.
    root = factored_information(fit).root
    added = spectrum_share(fit, root @ root.T)
    columns = J[:, np.concatenate([fit.active, np.ones(fit.rests, dtype=np.bool_)])]
    own = np.linalg.cholesky(np.eye(len(r)) + columns @ added @ columns.T)
    r, J = np.linalg.solve(own, r), np.linalg.solve(own, J)
    root, unknown = moving_zeros(priors.rig, drifting(priors.rig, priors.slow))
    # Inertia, friction and delay are no part of what is tested.
    moving = np.arange(dynamics.PARAMETERS + at.rests) < dynamics.PARAMETERS
    return Linearised(
        residual=r,
        columns=J,
        own=np.zeros((0, 6, 6)),
        own_root=block_diagonal(root, np.diag(np.where(moving, 0.0, 1.0))),
        own_unknown=np.append(unknown, moving),
        rows=len(r),
        sensors=priors.rig.n,
        course=Course(np.zeros(0)),
    )
