"""The tracker session: geometry without noise, and the noise of a spherical instrument."""

import numpy as np
from scipy.spatial.transform import Rotation

from tdfscal.records import FloatArray, Instrument
from tdfscal.simulation import (
    Options,
    Survey,
    SurveyOptions,
    Truth,
    draw_truths,
    measure,
    reference_rig,
    simulate_survey,
)

from .rigs import chi2_p, exact_rig, plausible

PERFECT = Instrument(range=0.0, range_ppm=0.0, angle_arcsec=0.0)


def survey(options: SurveyOptions, seed: int = 0, exact: bool = True) -> tuple[Truth, Survey]:
    rig = exact_rig() if exact else reference_rig()
    rpy = np.random.default_rng(seed).normal(scale=0.1, size=(3, 3))
    truth = draw_truths(rig, Options(rpy=rpy), np.random.default_rng(seed), 1).trial(0)
    return truth, simulate_survey(rig, truth, options, np.random.default_rng(seed))


def align(a: FloatArray, b: FloatArray) -> FloatArray:
    """Rotation that takes a to b, by scipy's solution of Wahba's problem."""
    turn, _ = Rotation.align_vectors(b - b.mean(axis=0), a - a.mean(axis=0))
    return np.asarray(turn.as_matrix())


def test_perfect_instrument_gives_the_installation_back() -> None:
    truth, played = survey(SurveyOptions(instrument=PERFECT))
    session = played.session
    for i in range(3):
        part = slice(4 * i, 4 * i + 4)
        body = align(session.nominal.xyz[part], session.targets.xyz[part])
        moves = slice(12 * i, 12 * i + 12)
        base = align(session.servo.xyz[moves], session.moves.xyz[moves])
        np.testing.assert_allclose(base, played.rotation, atol=1e-12)
        np.testing.assert_allclose(base.T @ body, truth.rotation[i], atol=1e-12)
        point = session.servo.xyz[moves] + played.offset[i]
        np.testing.assert_allclose(
            session.moves.xyz[moves], point @ played.rotation.T + played.translation, atol=1e-13
        )


def test_instrument_noise_is_spherical() -> None:
    instrument = Instrument(range=1.0e-5, range_ppm=5.0, angle_arcsec=2.0)
    rng = np.random.default_rng(1)
    point = rng.normal(size=(3000, 3)) * [4.0, 4.0, 1.0]
    seen = measure(point, instrument, rng)
    away = np.linalg.norm(point, axis=1)
    radial = np.linalg.norm(seen, axis=1) - away
    assert plausible(chi2_p(radial / (1e-5 + 5e-6 * away)))
    second = np.pi / 180.0 / 3600.0
    turn = np.arctan2(seen[:, 1], seen[:, 0]) - np.arctan2(point[:, 1], point[:, 0])
    turn = (turn + np.pi) % (2 * np.pi) - np.pi
    assert plausible(chi2_p(turn / (2.0 * second)))
    rise = np.arcsin(seen[:, 2] / np.linalg.norm(seen, axis=1)) - np.arcsin(point[:, 2] / away)
    assert plausible(chi2_p(rise / (2.0 * second)))


def test_repeatability_and_drawing_enter() -> None:
    unit = []
    for seed in range(20):
        _, played = survey(SurveyOptions(instrument=PERFECT), seed, exact=False)
        session = played.session
        expected = session.servo.xyz + np.repeat(played.offset, 12, axis=0)
        unit.append((session.moves.xyz - played.translation) @ played.rotation - expected)
    assert plausible(chi2_p(np.array(unit) / 1e-5))
    truth, played = survey(SurveyOptions(instrument=PERFECT, drawing=5e-5))
    found = played.session.targets.xyz[:4] - played.session.targets.xyz[:4].mean(axis=0)
    drawn = played.session.nominal.xyz[:4] - played.session.nominal.xyz[:4].mean(axis=0)
    off = found @ played.rotation @ truth.rotation[0] - drawn
    assert 1e-5 < np.std(off) < 1.5e-4
