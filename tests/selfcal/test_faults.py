"""Inject one fault, and exactly that is named."""

import re
from dataclasses import replace

import numpy as np
import pytest

from tdfscal import simulation
from tdfscal.records import Rig, UncertainValue
from tdfscal.selfcal.pipeline import self_calibrate
from tdfscal.simulation import Contact, Drift, Faults, Gain, Jolt, Options, Recorder
from tdfscal.simulation.faults import Frame, Walk
from tests.selfcal.campaigns import SQUEEZED, calibrated, distance, fitted, study
from tests.words import in_words

RIG = simulation.reference_rig()
#: Wrench on the terminal alike in all postures.
PUSHED = tuple(Contact(k, (6.0, -6.0, 6.0)) for k in range(SQUEEZED.postures))


def with_faults(faults: Faults, options: Options = SQUEEZED) -> Options:
    return replace(options, faults=faults)


@pytest.mark.parametrize("touched", [(7,), (2, 19)])
def test_touched_postures_are_rejected_by_name_and_no_other(touched: tuple[int, ...]) -> None:
    contacts = tuple(Contact(k, (3.0, -4.0, 6.0), (1.0, 0.5, -0.5)) for k in touched)
    for result in study(RIG, with_faults(Faults(contacts=contacts)), seed=2, trials=1).results:
        assert tuple(sorted(result.rejected)) == touched
        assert all("contact" in reason for reason in in_words(result.rejected.values()))
        assert not result.reasons


def test_a_contact_is_told_with_its_moment_about_the_lcs_origin() -> None:
    """As `validate` tells it; about the barycentre it would be 5.6 N·m."""
    touching = Contact(7, (30.0, -40.0, 60.0), (10.0, 5.0, -5.0))
    (result,) = study(RIG, with_faults(Faults(contacts=(touching,))), seed=2, trials=1).results
    moment = result.rejected[7].values["moment"]
    assert moment == pytest.approx(np.linalg.norm(touching.moment), abs=1.0)


def declared(**really: float) -> Rig:
    """The rig as it is where its file understates a scatter."""
    return replace(RIG, declared=replace(RIG.declared, **really))


def suspects(real: Rig, stated: Rig, options: Options, seed: int) -> list[str]:
    """What a campaign suspects, the surest first."""
    batch = simulation.simulate_dwells(real, options, np.random.default_rng(seed), 1)
    found = calibrated(batch, stated, 0).suspicions
    return [" ".join(in_words(doubt.findings(rejects=False))) for doubt in found]


@pytest.mark.parametrize(
    ("real", "faults", "words"),
    [
        (RIG, Faults(gains=(Gain(1, (0.004, 0.004, 0.004)),)), "gain of ncp2"),
        (
            RIG,
            Faults(gains=(Gain(2, crosstalk=(0.004, 0.004, 0.004)),)),
            "gain or crosstalk of ncp3",
        ),
        (RIG, Faults(drifts=(Drift(0, (4.0, -4.0, 4.0)),)), "the zero of ncp1 drifts"),
        (RIG, Faults(walks=tuple(Walk(i, 1.0) for i in range(3))), "of all sensors wander"),
        (replace(RIG, mass=UncertainValue(np.asarray(503.0), RIG.mass.std)), Faults(), "the mass"),
        (
            replace(
                RIG, barycentre=UncertainValue(np.array([0.006, -0.006, 0.25]), RIG.barycentre.std)
            ),
            Faults(),
            "the barycentre",
        ),
        (replace(RIG, gravity_tilt_std=4e-3), Faults(), "gravity"),
        (RIG, Faults(contacts=PUSHED), "pushes or turns the terminal"),
        (declared(force_noise=0.8), Faults(), "the forces scatter"),
        # 60 degrees of freedom know it to a tenth.
        (declared(hinge_moment=0.4), Faults(), r"friction of 0\.[345] N·m"),
    ],
    ids=["gain", "crosstalk", "drift", "walk", "mass", "centre", "tilt", "push", "noise", "stick"],
)
def test_what_was_not_declared_is_named_alone(real: Rig, faults: Faults, words: str) -> None:
    (found,) = suspects(real, RIG, with_faults(faults), seed=4)
    assert re.search(words, found)


@pytest.mark.parametrize(("sensor", "scale"), [(0, -5e-3), (2, 8e-3)])
def test_a_vertical_axis_off_in_scale_is_named_with_its_size(sensor: int, scale: float) -> None:
    """Heights change no distance to first order: forces alone tell."""
    frame = Frame(sensor, scale=(0.0, 0.0, scale))
    options = with_faults(Faults(frames=(frame,)), replace(SQUEEZED, squeeze=200.0))
    (result,) = study(RIG, options, seed=3, trials=1).results
    cause = result.suspicions[0].causes[0]
    assert (cause.code, cause.subject) == ("axis-scale-suspected", (RIG.supports[sensor],))
    assert cause.size == pytest.approx(abs(scale), rel=0.1)
    assert "axis-scale-suspected" in [reason.code for reason in result.reasons]
    assert "frame-scaled" not in [found.code for found in result.findings]  # told once


@pytest.mark.parametrize("axes", [(0,), (1,), (0, 1)])
def test_a_stale_tare_is_named_with_its_axis_where_it_is_of_one(axes: tuple[int, ...]) -> None:
    dwells = simulation.simulate_dwells(RIG, SQUEEZED, np.random.default_rng(5), 1).dwells(0)
    force = dwells.force.copy()
    force[:, 1, axes] += 8.0
    causes = [
        c for doubt in fitted(RIG, replace(dwells, force=force)).suspicions for c in doubt.causes
    ]
    assert [(c.code, c.subject) for c in causes] == [("zero-suspected", (RIG.supports[1],))]
    assert causes[0].values.get("axis") == ("xy"[axes[0]] if len(axes) == 1 else None)
    assert causes[0].size == pytest.approx(8.0, abs=2.5)  # the stated 0.5 N, and what is mass


def test_friction_of_postures_that_only_tilt_is_named_with_what_looks_alike() -> None:
    """Moments of 0.8 N·m about X and Y, none about Z: NCPs under a weight make such ones too."""
    batch = simulation.simulate_dwells(RIG, SQUEEZED, np.random.default_rng(7), 4)
    lever = np.column_stack([RIG.hinge[:, 1], -RIG.hinge[:, 0]])
    rng, sizes = np.random.default_rng(3), []
    for trial in range(4):
        dwells = batch.dwells(trial)
        force = dwells.force.copy()
        moment = 0.8 * rng.standard_normal((len(force), 2))
        force[:, :, 2] += moment @ np.linalg.pinv(lever - lever.mean(axis=0))
        found = fitted(RIG, replace(dwells, force=force)).suspicions
        assert {doubt.kind for doubt in found} <= {"hinge friction", "position noise"}
        sizes += [doubt.causes[0].size or 0.0 for doubt in found if doubt.kind == "hinge friction"]
    # The rms of 2 moments in so many postures, all campaigns together, within 3 of its own scatter.
    freedom = 2 * 4 * len(force)
    assert len(sizes) == 4
    assert abs(np.sqrt(np.mean(np.square(sizes))) / 0.8 - 1) < 3 / np.sqrt(2 * freedom)


def test_a_mounting_that_contradicts_its_prior_is_named() -> None:
    nominal = np.array([[0.0], [0.02], [0.0]]) * [1, -1, 1]
    stated = replace(RIG, rpy_std=np.full((3, 3), 2e-3), nominal_rpy=nominal)
    true = replace(stated, nominal_rpy=np.zeros((3, 3)))
    assert "ncp2 is not mounted as stated" in suspects(true, stated, SQUEEZED, seed=6)[0]
    assert not suspects(true, true, SQUEEZED, seed=6)


def test_a_walks_likelihood_is_the_restricted_one_of_its_covariance() -> None:
    """Against the dense covariance on the complement of what the parameters follow."""
    from tdfscal.estimation.uncertainty import estimate
    from tdfscal.model.parameters import layout
    from tdfscal.selfcal.score_tests import wandering

    walks = with_faults(Faults(walks=(Walk(0, 2.0),)), replace(SQUEEZED, postures=10))
    batch = simulation.simulate_dwells(RIG, walks, np.random.default_rng(13), 1)
    fit = calibrated(batch, RIG, 0).fit
    time = np.arange(10.0) ** 1.2
    known = estimate(fit)
    parts, residual, H = known.parts, fit.white, fit.slopes[:, :, layout(3)["zero"]]
    first = next(walk for walk in wandering(known, time) if walk.support is None)
    gain = first.weight + np.log(fit.rows)
    walk = np.minimum.outer(time, time)
    C = np.zeros((len(residual), len(residual)))
    C[:60, :60] = np.einsum("kaj,kl,lbj->kalb", H, walk, H).reshape(60, 60)
    apart = np.linalg.svd(parts.left)[0][:, parts.left.shape[1] :]
    own, seen = apart.T @ C @ apart, apart.T @ residual

    def cost(variance: float) -> float:
        whole = np.eye(len(own)) + variance * own
        return float(np.linalg.slogdet(whole)[1] + seen @ np.linalg.solve(whole, seen))

    assert gain > 1.0
    tried = [cost(0.0) - cost(intensity**2) for intensity in np.geomspace(1e-3, 10.0, 400)]
    assert gain == pytest.approx(max(tried), abs=0.02)
    said = re.search(r"`drift.walk: ([0-9.]+)`", " ".join(in_words(first.findings(rejects=False))))
    assert said is not None
    hours = float(said[1])
    best = 60 * np.geomspace(1e-3, 10.0, 400)[np.argmax(tried)]
    assert best <= hours * 1.02
    assert hours < 2.1 * best


def test_a_jolt_does_not_reach_the_angles() -> None:
    """A blow during a dwell, in the time series: cut out, or the posture rejected."""
    from scipy import stats

    from tdfscal.dwells import find_dwells

    options = with_faults(Faults(jolts=(Jolt(6, (200.0, -100.0, 300.0)),)))
    campaign = simulation.simulate_campaign(RIG, options, np.random.default_rng(8))
    result = fitted(RIG, find_dwells(campaign.log))
    assert distance(campaign.truth.rotation, result) < stats.chi2.ppf(1 - 1e-4, 9)
    assert not result.reasons


@pytest.mark.parametrize("seed", [11, 12, 13])
def test_a_stale_tare_is_that_of_all_sensors(seed: int) -> None:
    """And not one sensor's a round, nor a positioner's offset."""
    rig = simulation.make_rig()
    options = simulation.Options(postures=24, squeeze=200.0)
    dwells = simulation.simulate_dwells(rig, options, np.random.default_rng(seed), 1).dwells(0)
    off = 10.0 * np.random.default_rng(seed).choice([-1.0, 1.0], (3, 3))
    moved = {name: getattr(dwells, name) + off for name in ("force", "force_min", "force_max")}
    rng = np.random.default_rng(0)
    found = self_calibrate(rig, replace(dwells, **moved), rng=rng, max_trials=0).reasons
    assert [(one.code, one.subject) for one in found[:1]] == [("zero-suspected", ())]


TOUCHED = (1, 4, 8, 11, 12)


@pytest.mark.parametrize(("sensors", "seed", "alike"), [(3, 1, True), (4, 2, False)])
def test_sideways_contact_at_a_third_is_found(sensors: int, seed: int, alike: bool) -> None:
    """60 N; those that push the same way pull the fit to themselves."""
    rng = np.random.default_rng(seed)
    contacts = []
    for k in TOUCHED:
        angle, place = 0.7 if alike else rng.uniform(0, 2 * np.pi), rng.uniform(-0.4, 0.4, 3)
        force = 60.0 * np.array([np.cos(angle), np.sin(angle), 0.0])
        x, y, z = np.cross(place, force)
        contacts.append(Contact(k, (force[0], force[1], 0.0), (x, y, z)))
    options = Options(postures=14, squeeze=150.0, recorder=Recorder(mean_sd=0.1))
    played = with_faults(Faults(contacts=tuple(contacts)), options)
    (result,) = study(simulation.make_rig(sensors), played, seed, trials=1).results
    assert sorted(result.rejected) == list(TOUCHED)
    assert [reason.code for reason in result.reasons if "uncertain" not in reason.code] == [
        "postures-rejected"
    ]
