"""Does a calibration still hold? Residual contact wrenches of static postures.

The residual wrenches of all postures are tested together: the error of the calibration is common
to them, only the dwells' own noise is not (theory, section 7).
"""

from __future__ import annotations

from dataclasses import dataclass, replace

import numpy as np
from scipy import special

from tdfscal.checks import faulty_sensors, log_against_rig
from tdfscal.dwells.absence import no_dwell
from tdfscal.errors import DataError
from tdfscal.model.calibrated import Calibrated
from tdfscal.model.parameters import nominal, prior_std, with_motions
from tdfscal.model.statics import Postures, balance, features_jacobian, postures
from tdfscal.model.zero_motion import ZeroAge
from tdfscal.records import BoolArray, Dwells, FloatArray, IntArray, Rig
from tdfscal.significance import DETECTION_POWER, VALIDATION_ALARM
from tdfscal.validation import causes
from tdfscal.validation.causes import NOISE, Causes
from tdfscal.validation.known_noise import AS_STATED, KnownNoise
from tdfscal.validation.verdict import Verdict
from tdfscal.validation.whitening import Whitened, whiten
from tdfscal.wrench.contact_wrench import contact_wrench, to_lcs

#: Share of an unmeasured force below which a component of the wrench does not depend on it.
_REACHED = 1e-6


@dataclass(frozen=True, slots=True, kw_only=True)
class Validation(Verdict):
    """Verdict on a calibration by K postures without contact.

    dwells : those found. used : (K,), indices of the dwells in the test. left_out : dwell index →
    reason. nominal, calibrated : (K, 6), residual contact wrench in the LCS about its origin, N
    and N·m, without and with the calibration; std : (K, 6), its predicted standard uncertainty.
    chi2 and dof are those of all calibrated wrenches together.
    """

    dwells: Dwells
    used: IntArray
    left_out: dict[int, str]
    nominal: FloatArray
    calibrated: FloatArray
    std: FloatArray


def validate(
    given: Calibrated,
    dwells: Dwells,
    *,
    rig: Rig | None = None,
    noise: float | None = None,
    known: KnownNoise = AS_STATED,
    age: ZeroAge | None = None,
) -> Validation:
    """Test a calibration on static dwells without contact.

    rig : the rig of this log, for what it declares; default the calibration's.
    noise : N, standard uncertainty of a reading per axis where neither log nor rig state one.
    known : what the calibration found of the noise. A single posture, and how far any of them
    scatters, is judged by its tails.
    age : of the calibration's zeros at the first dwell, from which on they move as is declared.

    Raises
    ------
    DataError
        There is no dwell, the positions do not fit the hinges, a sensor is dead or saturated, or no
        noise is stated anywhere.
    """
    rig = rig or given.rig
    if len(dwells) == 0:
        raise no_dwell(dwells)
    log_against_rig.check_geometry(rig, dwells.position)
    screened = faulty_sensors.screen(rig, dwells)
    used = np.flatnonzero(screened.keep)
    if not used.size:
        raise DataError(
            f"no dwell can be used: {next(iter(screened.reasons.values()))}", where="log forces"
        )
    observed, warnings = _with_noise(postures(rig, dwells, age).subset(used), noise)
    seen = _see(given, known.scaled(observed))
    white = seen.white
    found = causes.causes(white)
    p_value, search_p = _chances(white, found, known)
    turned = log_against_rig.turned(rig, dwells.position)
    return Validation(
        rig=rig,
        dwells=dwells,
        used=used,
        left_out=screened.reasons,
        nominal=seen.nominal,
        calibrated=seen.calibrated,
        std=seen.std,
        chi2=white.chi2,
        dof=white.dof,
        p_value=p_value,
        search_p=search_p,
        causes=found,
        detectable=detectable_turns(causes.turn_information(white), found.tried),
        warnings=(*dwells.warnings, *warnings, *known.words, *([turned] if turned else [])),
    )


def _chances(white: Whitened, found: Causes, known: KnownNoise) -> tuple[float, float]:
    """Probability of all residuals together, and of what looks most like one single cause.

    A posture counts as far off as it would have to be with normal noise to be as improbable.
    """
    spared = known.as_normal(white)
    if spared is not white:
        found = causes.causes(spared)
    overall = known.chi2_sf(spared.chi2, spared.dof) if white.dof > 0 else 1.0
    single = [c for c in found.best if len(c.postures) < 2 and c.kind not in NOISE]
    least = min(known.chi2_sf(c.gain, c.unknowns) if c.unknowns else 1.0 for c in single)
    return overall, min(1.0, found.tried * least)


def _with_noise(observed: Postures, noise: float | None) -> tuple[Postures, tuple[str, ...]]:
    """Postures with a noise level: their own, or the one that the calibration met."""
    if np.diagonal(observed.force_cov, axis1=2, axis2=3)[:, observed.measured].min() > 0:
        return observed, ()
    if not noise:
        raise DataError(
            "neither the log nor the rig file states a force noise",
            where="log forces",
            hint="set uncertainty.force_noise in rig.yaml",
        )
    text = (
        f"neither the log nor the rig file states a force noise; {noise:.2g} N per axis and "
        "posture was taken from the residuals of the calibration"
    )
    cov = np.broadcast_to(noise**2 * np.eye(3), observed.force_cov.shape)
    return replace(observed, force_cov=cov), (text,)


@dataclass(frozen=True, slots=True)
class _Seen:
    """Wrenches without and with the calibration and the latter's std, (K, 6), and whitened."""

    nominal: FloatArray
    calibrated: FloatArray
    std: FloatArray
    white: Whitened


def _see(given: Calibrated, observed: Postures) -> _Seen:
    rig, state = given.rig, with_motions(given.state, observed.motions)
    at = balance(observed, state, state.barycentre, rig.gravity)
    T = to_lcs(at)
    J = T @ (at.design @ features_jacobian(state, at, rig.gravity))
    plain, calibrated = (
        contact_wrench(s, rig.gravity, at.rotation, at.seen.force) for s in (nominal(rig), state)
    )
    root, unknown = _with_motion(given, observed)
    half = J @ root
    total = T @ at.cov @ np.swapaxes(T, 1, 2) + half @ np.swapaxes(half, 1, 2)
    std = np.sqrt(np.diagonal(total, axis1=1, axis2=2))
    if not observed.measured.all():
        reach = np.linalg.norm(T @ at.free, axis=2)
        std = np.where(reach > _REACHED * reach.max(axis=1, keepdims=True), np.inf, std)
    own = at.whitener @ np.linalg.inv(T)
    return _Seen(
        nominal=plain,
        calibrated=calibrated,
        std=std,
        white=whiten(
            (own @ calibrated[..., None]).ravel(),
            (own @ J).reshape(-1, J.shape[2]),
            own,
            root,
            unknown,
            int(at.rows.sum()),
            rig.n,
        ),
    )


def _with_motion(given: Calibrated, observed: Postures) -> tuple[FloatArray, BoolArray]:
    """Root (P + 3nG, r) of all parameters' covariance, and which of them are unknown.

    How zeros move belongs to each log alone, so its amplitudes come with their prior.
    """
    if observed.motion is None:
        return given.root, given.open
    std = prior_std(given.rig, observed.motion)[len(given.open) :]
    finite = np.diag(np.where(np.isfinite(std), std, 0.0))
    root = np.zeros((len(given.open) + len(std), given.root.shape[1] + len(std)))
    root[: len(given.open), : given.root.shape[1]] = given.root
    root[len(given.open) :, given.root.shape[1] :] = finite
    return root, np.concatenate([given.open, np.isinf(std)])


def detectable_turns(information: FloatArray, tried: int) -> FloatArray:
    """Smallest turns (n, 3), rad, that the search finds with probability DETECTION_POWER."""
    threshold = special.chdtri(3, VALIDATION_ALARM / 2 / tried)
    offset = float(special.chndtrinc(threshold, 3, 1 - DETECTION_POWER))
    seen = np.diagonal(information, axis1=1, axis2=2)
    with np.errstate(divide="ignore"):
        return np.asarray(np.sqrt(offset / seen))
