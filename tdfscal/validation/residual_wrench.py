"""Does a calibration still hold? Residual contact wrenches of static postures.

The residual wrenches of all postures are tested together: the error of the calibration is common
to them, only the dwells' own noise is not (theory, section 7).
"""

from __future__ import annotations

from dataclasses import dataclass, replace

import numpy as np

from tdfscal.checks import faulty_sensors, log_against_rig
from tdfscal.dwells.absence import no_dwell
from tdfscal.errors import DataError
from tdfscal.model.calibrated import Calibrated
from tdfscal.model.parameters import nominal, with_motions
from tdfscal.model.statics import Postures, balance, features_jacobian, postures
from tdfscal.model.zero_motion import ZeroAge
from tdfscal.records import Dwells, FloatArray, IntArray, Rig
from tdfscal.validation import causes
from tdfscal.validation.causes import NOISE, Causes
from tdfscal.validation.known_noise import AS_STATED, KnownNoise
from tdfscal.validation.verdict import Verdict
from tdfscal.validation.whitening import Whitened, calibration_error, whiten
from tdfscal.wrench.contact_wrench import contact_wrench, reached, to_lcs


@dataclass(frozen=True, slots=True, kw_only=True)
class Validation(Verdict):
    """Verdict on a calibration by K postures without contact.

    dwells : those found. used : (K,), indices of the dwells in the test. left_out : dwell index →
    reason. nominal, calibrated : (K, 6), residual contact wrench in the LCS about its origin, N
    and N·m, without and with the calibration; std : (K, 6), its predicted standard uncertainty.
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
    log_against_rig.check_geometry(rig, dwells.position, dwells.force)
    screened = faulty_sensors.screen(rig, dwells)
    used = np.flatnonzero(screened.keep)
    if not used.size:
        raise DataError(
            f"no dwell can be used: {next(iter(screened.reasons.values()))}", where="log forces"
        )
    observed, warnings = _with_noise(postures(rig, dwells, age).subset(used), noise)
    before, after, std, white = _residuals(given, known.scaled(observed))
    found = causes.causes(white)
    p_value, search_p = _chances(white, found, known)
    turned = log_against_rig.turned(rig, dwells.position)
    return Validation(
        rig=rig,
        dwells=dwells,
        used=used,
        left_out=screened.reasons,
        nominal=before,
        calibrated=after,
        std=std,
        white=white,
        p_value=p_value,
        search_p=search_p,
        causes=found,
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


def _residuals(
    given: Calibrated, observed: Postures
) -> tuple[FloatArray, FloatArray, FloatArray, Whitened]:
    """Wrenches without and with the calibration and the latter's std, (K, 6), and whitened."""
    rig, state = given.rig, with_motions(given.state, observed.motions)
    at = balance(observed, state, state.barycentre, rig.gravity)
    T = to_lcs(at)
    J = T @ (at.design @ features_jacobian(state, at, rig.gravity))
    before, after = (
        contact_wrench(s, rig.gravity, at.rotation, at.seen.force) for s in (nominal(rig), state)
    )
    root, unknown = calibration_error(given, observed.motion)
    half = J @ root
    total = T @ at.cov @ np.swapaxes(T, 1, 2) + half @ np.swapaxes(half, 1, 2)
    std = np.sqrt(np.diagonal(total, axis1=1, axis2=2))
    std = np.where(reached(T @ at.free), np.inf, std)
    own = at.whitener @ np.linalg.inv(T)
    white = whiten(
        (own @ after[..., None]).ravel(),
        (own @ J).reshape(-1, J.shape[2]),
        own,
        root,
        unknown,
        int(at.rows.sum()),
        rig.n,
    )
    return before, after, std, white
