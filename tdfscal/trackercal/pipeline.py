"""Installation rotations from a laser-tracker survey: X_i = (R_b^m)ᵀ R_{s,i}^m (Sect. 3.2).

One joint maximum-likelihood estimate of R_b^m (common to all NCPs), T̆_i of the point that NCP i
carries, and R_{s,i}^m, T_{s,i}^m of the sensors. The moves know nothing of the sensors' poses
and the targets nothing of R_b^m, so the joint normal equations are block diagonal: one block for
the moves of all NCPs, one per sensor. The X_i are correlated through R_b^m.
"""

from __future__ import annotations

from collections.abc import Iterator, Mapping, Sequence

import numpy as np

from tdfscal.errors import DataError
from tdfscal.findings import Finding, Value
from tdfscal.frozen import record, replace
from tdfscal.numerics import so3
from tdfscal.numerics.distributions import MonteCarlo, chi2_sf
from tdfscal.records import ExactMoves, FloatArray, Rig, Rotations, TrackerSession
from tdfscal.significance import FAR_FROM_NOMINAL, MISFIT, MOST_REJECTED
from tdfscal.trackercal.judged_registration import (
    RejectedPoint,
    SurveyFit,
    fit_survey,
)
from tdfscal.trackercal.noise import (
    MEASURED_FILE,
    REFERENCE_FILE,
    point_noise,
    simulate_inputs,
)
from tdfscal.trackercal.point_matching import (
    MatchedPoints,
    match_points,
    relabellings,
    unmatched,
)

#: Typical errors of what is taken as exact: a workshop's drawing, m, and a sensor's body against
#: its axes, rad.
_DRAWING, _MISALIGNMENT = 1e-4, 1e-3


@record
class TrackerCalibration:
    """A laser-tracker calibration of all n sensors.

    moves, targets : the registrations behind it; of the moves of all NCPs, whose rotation is
    R_b^m, BCS → tracker, and of each sensor's targets.
    rpy, rpy_std : (n, 3), rad, roll, pitch, yaw.
    chi2, dof, p_value : of all residuals together; birge = √(χ²/dof), with the noise as stated. The
    covariance is of the noise that the residuals of the moves, and of all targets, show.
    budget : source → (n, 3), rad², its share of the variance of each angle; they sum to rpy_std².
    exact : what has no uncertainty stated, and what an error of it would do.
    """

    rotations: Rotations
    moves: SurveyFit
    targets: tuple[SurveyFit, ...]
    rpy: FloatArray
    rpy_std: FloatArray
    chi2: float
    dof: int
    p_value: float
    birge: float
    budget: Mapping[str, FloatArray]
    monte_carlo: MonteCarlo | None
    findings: tuple[Finding, ...]
    exact: tuple[ExactMoves, ...]

    @property
    def surveys(self) -> tuple[SurveyFit, ...]:
        """All registrations, the moves' first."""
        return (self.moves, *self.targets)

    @property
    def rejected(self) -> tuple[RejectedPoint, ...]:
        """Points that are not used."""
        return tuple(point for survey in self.surveys for point in survey.rejected)

    @property
    def coplanar_targets(self) -> tuple[str, ...]:
        """Sensors whose targets lie in a plane, so that handedness is not checked."""
        named = zip(self.rotations.supports, self.targets, strict=True)
        return tuple(name for name, survey in named if not survey.fit.handed)


def calibrate_tracker(
    rig: Rig,
    session: TrackerSession,
    *,
    misalignment: float = 0.0,
    trials: int = 20_000,
    rng: np.random.Generator | None = None,
) -> TrackerCalibration:
    """Calibrate the installation rotations of all supports by laser tracker.

    misalignment : rad per axis, standard uncertainty of the sensor's body, which the tracker
    sees, against its sensing axes. trials : of the Monte Carlo; 0 leaves it out. rng : for it,
    by default seeded with 0.

    Raises
    ------
    DataError : points are missing, misnamed, mirrored, in a wrong unit, or too many outlie.
    NotIdentifiableError : targets or moves do not determine a rotation.
    """
    move_points, target_points, notes = _matched(rig, session)
    moves, targets = _fit(rig, session, move_points, target_points)
    _refuse_many_outliers(moves, targets, session.targets.source)
    chi2, dof = _misfit([moves, *targets])
    scales = [max(1.0, float(np.sqrt(np.divide(*_misfit(of))))) for of in ([moves], targets)]
    moves, targets = _fit(rig, session, move_points, target_points, *scales)
    X = so3.project(np.stack([moves.fit.rotation.T @ t.fit.rotation for t in targets]))
    shares = _shares(moves, targets, misalignment)
    covariance = np.sum(list(shares.values()), axis=0)
    rpy_std = np.sqrt(so3.rpy_variance(X, covariance))
    monte_carlo = None
    if trials > 0:
        monte_carlo = simulate_inputs(
            moves,
            targets,
            session.instrument,
            misalignment,
            rpy_std,
            trials=trials,
            rng=np.random.default_rng(0) if rng is None else rng,
        )
    result = TrackerCalibration(
        rotations=Rotations(rig.supports, X, (covariance + covariance.T) / 2),
        moves=moves,
        targets=targets,
        rpy=so3.to_rpy(X),
        rpy_std=rpy_std,
        chi2=chi2,
        dof=dof,
        p_value=float(chi2_sf(chi2, dof)),
        birge=float(np.sqrt(chi2 / dof)),
        budget={name: so3.rpy_variance(X, share) for name, share in shares.items()},
        monte_carlo=monte_carlo,
        findings=notes,
        exact=_exact_quantities(rig.supports, X, session, misalignment),
    )
    return replace(result, findings=(*notes, *_findings(rig, result)))


def _misfit(surveys: Sequence[SurveyFit]) -> tuple[float, int]:
    """χ² of the residuals of registrations, and its degrees of freedom."""
    return sum(s.fit.chi2 for s in surveys), sum(s.fit.dof for s in surveys)


def _matched(
    rig: Rig, session: TrackerSession
) -> tuple[MatchedPoints, MatchedPoints, tuple[Finding, ...]]:
    """Moves of the rig's supports, and targets; with what is to be said of them."""
    moves = match_points(session.moves, session.servo)
    targets = match_points(session.targets, session.nominal)
    for name in rig.supports:
        count = len(targets.indices(name))
        if count < 3:
            here = [m for m in (*targets.missing, *targets.extra) if m.startswith(f"{name}/")]
            few = Finding("targets-few", (name,), count, values={"alone": ", ".join(here)})
            raise DataError(few, where=targets.measured.source)
    source = moves.measured.source
    still = [name for name in rig.supports if len(moves.indices(name)) < 2]
    if len(still) == rig.n:
        raise DataError(Finding("moves-none", rig.supports), where=source)
    notes = [
        Finding("group-unknown", (name,), values={"file": source})
        for name in sorted(set(moves.groups) - set(rig.supports))
    ]
    notes += [Finding("moves-few", (name,), values={"file": source}) for name in still]
    usable = moves.take(
        np.flatnonzero([g in rig.supports and g not in still for g in moves.reference.group])
    )
    return usable, targets, (*unmatched(moves), *unmatched(targets), *notes)


def _fit(
    rig: Rig,
    session: TrackerSession,
    moves: MatchedPoints,
    targets: MatchedPoints,
    scale_moves: float = 1.0,
    scale_targets: float = 1.0,
) -> tuple[SurveyFit, tuple[SurveyFit, ...]]:
    """Register the moves of all NCPs, and the targets of each sensor.

    scale_moves, scale_targets : how many times larger than stated their noise is.
    """

    def fitted(
        points: MatchedPoints, reference: dict[str, float], scale: float, least: int, what: str
    ) -> SurveyFit:
        noise = point_noise(points, session.instrument, reference).scaled(scale)
        found = fit_survey(points, noise, common_shift=least == 3, least=least, what=what)
        return replace(found, scale=scale)

    own = {name: targets.take(targets.indices(name)) for name in rig.supports}
    servo, drawing = {"positioner": rig.declared.positioner}, {"drawing": session.drawing}
    return fitted(moves, servo, scale_moves, 2, "moved points"), tuple(
        fitted(points, drawing, scale_targets, 3, f"targets of {name}")
        for name, points in own.items()
    )


def _refuse_many_outliers(moves: SurveyFit, targets: Sequence[SurveyFit], source: str) -> None:
    surveys = [moves, *targets]
    rejected = [r.name for s in surveys for r in s.rejected]
    count = sum(len(s.points) for s in surveys) + len(rejected)
    if len(rejected) > MOST_REJECTED * count:
        many = Finding("points-off", tuple(rejected), len(rejected), values={"points": count})
        raise DataError(many, where=source)


def _shares(
    moves: SurveyFit, targets: Sequence[SurveyFit], misalignment: float
) -> dict[str, FloatArray]:
    """Share of each source in the covariance (3n, 3n) of the rotations.

    exp([d_i]×) X_i with d_i = (R_b^m)ᵀ (s_i − b), where s_i, b perturb R_{s,i}^m and R_b^m in the
    tracker's frame. Independent points add; the parts of one point's covariance add too.
    """
    n, back = len(targets), moves.fit.rotation.T
    shares: dict[str, FloatArray] = {}
    common = np.tile(np.eye(3), (n, 1))
    surveys = [(moves, -common)] + [
        (t, np.kron(np.eye(n)[:, [i]], np.eye(3))) for i, t in enumerate(targets)
    ]
    for survey, place in surveys:
        gain = np.einsum("pq,qnj->pnj", place @ back, survey.fit.gain[:3])
        turned = survey.fit.rotation
        parts = dict(survey.noise.measured)
        parts |= {name: turned @ cov @ turned.T for name, cov in survey.noise.reference.items()}
        for name, cov in parts.items():
            share = np.einsum("pnj,njk,qnk->pq", gain, cov, gain)
            shares[name] = shares.get(name, np.zeros((3 * n, 3 * n))) + share
    if misalignment > 0:
        shares["misalignment"] = misalignment**2 * np.eye(3 * n)
    return shares


def _exact_quantities(
    supports: tuple[str, ...], rotation: FloatArray, session: TrackerSession, misalignment: float
) -> tuple[ExactMoves, ...]:
    """Drawing and misalignment of body and axes, where nothing is stated of them.

    rotation : (n, 3, 3), of the sensors.
    """
    n = len(supports)
    found, none = [], np.zeros((3 * n, 0))
    if misalignment == 0:
        turns = _MISALIGNMENT * np.eye(3 * n)
        found.append(ExactMoves("body against axes", _MISALIGNMENT, "rad", turns, none))
    if session.drawing == 0 and session.nominal.std is None:
        moves = np.zeros((3 * n, 3 * n))
        for i, name in enumerate(supports):
            # Each coordinate is off by itself: a best fit's turn by that has the covariance
            # (Σ [r]×ᵀ [r]×)⁻¹ of the points about their middle.
            arm = session.nominal.xyz[[group == name for group in session.nominal.group]]
            lever = so3.hat(arm - arm.mean(axis=0))
            values, vectors = np.linalg.eigh(np.einsum("pca,pcb->ab", lever, lever))
            rows = slice(3 * i, 3 * i + 3)
            moves[rows, rows] = rotation[i] @ (_DRAWING * vectors / np.sqrt(values))
        found.append(ExactMoves("target drawing", _DRAWING, "m", moves, none))
    return tuple(found)


def _findings(rig: Rig, result: TrackerCalibration) -> Iterator[Finding]:
    """What the survey's numbers cannot vouch for."""
    for whose, surveys in (("moves", [result.moves]), ("targets", result.targets)):
        scale, dof = surveys[0].scale, _misfit(surveys)[1]
        if chi2_sf(scale**2 * dof, dof) < MISFIT:
            yield Finding("survey-scatters", (whose,), scale)
    yield from (point.finding for point in result.rejected)
    if result.coplanar_targets:
        yield Finding("targets-coplanar", result.coplanar_targets)
    symmetric = {}
    for name, t in zip(rig.supports, result.targets, strict=True):
        if others := relabellings(t.points, t.sigma):
            symmetric[name] = "-".join(t.points.reference.point[k] for k in others[0])
    if symmetric:
        values: dict[str, Value] = {"order": next(iter(symmetric.values()))}
        yield Finding("targets-symmetric", tuple(symmetric), values=values)
    back = np.swapaxes(so3.from_rpy(rig.nominal_rpy), 1, 2)
    turn = np.linalg.norm(so3.log(result.rotations.rotation @ back), axis=1)
    for i in np.flatnonzero(turn > FAR_FROM_NOMINAL * np.linalg.norm(rig.rpy_std, axis=1)):
        yield Finding("targets-misnamed", (rig.supports[i],), float(turn[i]), "rad")
    yield from _swapped_supports(rig, result.moves, result.targets)
    sources = {s for t in result.surveys for s in (*t.noise.measured, *t.noise.reference)}
    if sources & {MEASURED_FILE, REFERENCE_FILE}:
        yield Finding("uncertainty-from-files")


def _swapped_supports(rig: Rig, moves: SurveyFit, targets: Sequence[SurveyFit]) -> list[Finding]:
    """Targets sit beside the point that their NCP carries; swapped supports lie far from it."""
    if set(moves.points.groups) != set(rig.supports):
        return []
    driven = [moves.points.take(moves.points.indices(name)) for name in rig.supports]
    places = np.stack([points.measured.xyz.mean(axis=0) for points in driven])
    centres = np.stack([t.points.measured.xyz.mean(axis=0) for t in targets])
    gap = np.linalg.norm(centres[:, None] - places, axis=-1)
    nearest = gap.argmin(axis=1)
    return [
        Finding(
            "targets-swapped", (name,), float(gap[i, i]), "m", values={"other": rig.supports[k]}
        )
        for i, (name, k) in enumerate(zip(rig.supports, nearest, strict=True))
        if k != i and gap[i, i] > 2 * gap[i, k]
    ]
