"""What is recorded: sensors, servos, noise, rest and motion; determinism."""

from dataclasses import replace

import numpy as np

from tdfscal.records import DeclaredUncertainty, FloatArray, Log
from tdfscal.simulation import Campaign, Options, reference_rig, simulate_campaign

from .rigs import SILENT, chi2_p, exact_rig, plausible, still


def forces(log: Log) -> FloatArray:
    return np.stack([s.value for s in log.force], axis=1)


def positions(log: Log) -> FloatArray:
    return np.stack([s.value for s in log.position], axis=1)


def at_rest(campaign: Campaign, k: int, settled: float = 0.0) -> FloatArray:
    time = campaign.log.force[0].time
    return np.asarray((time >= campaign.start[k] + settled) & (time <= campaign.end[k]))


def test_reading_is_the_force_in_the_sensors_axes() -> None:
    rpy = np.zeros((3, 3))
    rpy[0] = [0.0, 0.0, np.pi / 2]  # the sensor's x axis along the BCS' y
    rpy[1] = [np.pi / 2, 0.0, 0.0]  # its y axis along the BCS' z
    campaign = simulate_campaign(
        exact_rig(), still(postures=3, squeeze=200.0, rpy=rpy), np.random.default_rng(0)
    )
    x, y, z = np.moveaxis(campaign.force, -1, 0)
    for k in range(3):
        reading = forces(campaign.log)[at_rest(campaign, k)]
        for i, expected in enumerate(
            [
                np.stack([y[k, 0], -x[k, 0], z[k, 0]]),
                np.stack([x[k, 1], z[k, 1], -y[k, 1]]),
                campaign.force[k, 2],
            ]
        ):
            np.testing.assert_allclose(
                reading[:, i], np.broadcast_to(expected, reading[:, i].shape), atol=1e-12 * 3e3
            )


def test_rest_and_motion() -> None:
    campaign = simulate_campaign(reference_rig(), Options(), np.random.default_rng(3))
    time, p = campaign.log.position[0].time, positions(campaign.log)
    assert len(campaign.start) == 24
    assert time[0] == 0.0
    assert campaign.end[-1] - 0.01 < time[-1] <= campaign.end[-1]
    dwell, move = campaign.end - campaign.start, campaign.start[1:] - campaign.end[:-1]
    assert dwell.min() >= 3.2
    assert dwell.max() <= 4.8
    assert move.min() >= 2.0
    assert move.max() <= 4.0
    for k in range(24):
        rest = p[at_rest(campaign, k)] - campaign.servo[k]
        assert plausible(chi2_p(rest / 0.3e-6))
    for k in range(23):
        middle = 0.5 * (campaign.end[k] + campaign.start[k + 1])
        half_way = p[np.searchsorted(time, middle)]
        way = campaign.servo[k + 1] - campaign.servo[k]
        travelled = np.sum((half_way - campaign.servo[k]) * way) / np.sum(way**2)
        assert 0.4 < travelled < 0.6


def test_what_will_relax_at_a_stop_builds_up_in_balance() -> None:
    """Of internal forces all the way: no net force and no net moment at any place of a move."""
    calm = replace(SILENT, dwell=(1.0, 1.0), move=(2.0, 2.0), settling=0.1)
    logs = [
        simulate_campaign(
            exact_rig(),
            still(postures=3, rpy=np.zeros((3, 3)), recorder=replace(calm, settling_force=size)),
            np.random.default_rng(4),
        ).log
        for size in (0.0, 50.0)
    ]
    rows = np.arange(105, 300)  # the first move, long after the first stop's oscillation
    grown = (forces(logs[1]) - forces(logs[0]))[rows]
    assert np.abs(grown[-1]).max() > 5.0
    np.testing.assert_allclose(grown.sum(axis=1), 0.0, atol=1e-9)
    moment = np.cross(positions(logs[0])[rows], grown).sum(axis=1)
    np.testing.assert_allclose(moment, 0.0, atol=1e-9)


def test_a_move_takes_the_force_that_its_mass_needs() -> None:
    """Newton's m a of the same move, whose terminal does not turn."""
    recorder = replace(SILENT, dwell=(1.0, 1.0), move=(2.0, 2.0))
    options = still(postures=2, tilt=0.0, rpy=np.zeros((3, 3)), recorder=recorder)
    campaign = simulate_campaign(exact_rig(), options, np.random.default_rng(4))
    u = np.linspace(0.0, 1.0, 201)[1:-1]
    way = (campaign.servo[1] - campaign.servo[0]).mean(axis=0)
    expected = 500.0 * (60 * u - 180 * u**2 + 120 * u**3)[:, None] * way / 2.0**2
    expected += [0.0, 0.0, 500.0 * 9.80665]
    net = forces(campaign.log)[101:300].sum(axis=1)
    # Differences over 5 ms: a twelfth of the step squared times the fourth derivative of the way.
    atol = 500.0 * 5e-3**2 / 12 * 360 / 2.0**4 * np.abs(way).max()
    np.testing.assert_allclose(net, expected, atol=1.01 * atol)


def test_datum_errors_shift_what_is_logged_and_strain_nothing() -> None:
    rig = replace(exact_rig(), declared=DeclaredUncertainty(datum=1e-4))
    clean = simulate_campaign(exact_rig(), still(postures=3), np.random.default_rng(15))
    taught = simulate_campaign(rig, still(postures=3), np.random.default_rng(15))
    np.testing.assert_allclose(taught.force, clean.force, atol=1e-6)
    np.testing.assert_allclose(taught.servo + taught.truth.datum, clean.servo, atol=1e-15)
