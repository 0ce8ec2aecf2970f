"""Postures in contact that hide each other are found and named, and no channel in their place."""

from dataclasses import replace

import numpy as np
import pytest

from tdfscal import simulation
from tdfscal.selfcal.pipeline import SelfCalibration
from tdfscal.simulation import Contact, Faults, Options, Recorder
from tests.selfcal.campaigns import fitted

POSTURES, TOUCHED = 14, (1, 4, 8, 11, 12)


def campaign(sensors: int, seed: int, faults: Faults, noise: float = 0.0) -> SelfCalibration:
    """14 postures; noise : N, of one channel, beside 0.1 N of all."""
    rig = simulation.make_rig(sensors)
    options = Options(
        postures=POSTURES, squeeze=150.0, recorder=Recorder(mean_sd=0.1), faults=faults
    )
    dwells = simulation.simulate_dwells(rig, options, np.random.default_rng(seed), 1).dwells(0)
    force = dwells.force.copy()
    force[:, 1, 0] += noise * np.random.default_rng(seed).standard_normal(POSTURES)
    dwells = replace(dwells, force=force)
    return fitted(rig, dwells)


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
    result = campaign(sensors, seed, Faults(contacts=tuple(contacts)))
    assert sorted(result.rejected) == list(TOUCHED)
    assert [reason.code for reason in result.reasons if "uncertain" not in reason.code] == [
        "postures-rejected"
    ]
