"""What is taken as exact: predicted effects against simulated campaigns with that very error."""

from dataclasses import replace
from typing import Any

import numpy as np
import pytest

from tdfscal.estimation.exact_quantities import exact_quantities
from tdfscal.model.parameters import layout
from tdfscal.numerics import so3
from tdfscal.records import DeclaredUncertainty, FloatArray, Rig, UncertainValue
from tdfscal.selfcal.pipeline import SelfCalibration
from tdfscal.simulation import Faults, Gain, Options, make_rig, simulate_dwells
from tests.selfcal.campaigns import fitted
from tests.words import in_words

#: Nothing but the error in question is uncertain, and nothing else scatters but a little.
QUIET = DeclaredUncertainty(positioner=1e-5, force_noise=0.05)
RIG = make_rig(zero_std=np.inf, declared=QUIET)
KNOWN = make_rig(zero_std=1e-4, mass_std=0.0, barycentre_std=0.0, declared=QUIET)


def calibrated(stated: Rig, real: Rig, faults: Faults | None = None, squeeze: float = 0.0):  # type: ignore[no-untyped-def]
    """Calibration of one campaign, and the truth; alike to the last draw but for the error."""
    options = Options(postures=24, squeeze=squeeze, faults=faults or Faults())
    batch = simulate_dwells(real, options, np.random.default_rng(3), 1)
    result = fitted(stated, batch.dwells(0))
    return result, batch.truth


def moved(wrong: SelfCalibration, right: SelfCalibration) -> FloatArray:
    """Turns (3n,), rad, BCS, from one estimate to the other."""
    back = np.swapaxes(right.fit.state.rotation, 1, 2)
    return np.asarray(so3.log(wrong.fit.state.rotation @ back).ravel())


def quantity(result: SelfCalibration, name: str) -> FloatArray:
    every = exact_quantities(result.fit, result.estimate.parts)
    (found,) = (q for q in every if q.name.startswith(name))
    return found.turns(3) / found.error


@pytest.mark.parametrize("stated", [RIG, KNOWN])
@pytest.mark.parametrize("tilt_std", [1e-5, 1e-3])
def test_a_base_off_level_moves_the_angles_as_predicted(stated: Rig, tilt_std: float) -> None:
    right, _ = calibrated(stated, stated)
    wrong, truth = calibrated(stated, replace(stated, gravity_tilt_std=tilt_std))
    gx, gy, _ = truth.gravity[0] / RIG.gravity
    tilt = np.array([gy, -gx])  # gravity is −Z turned by the tilt
    size = float(np.linalg.norm(tilt))
    assert size > 0.3 * tilt_std
    # What is wrong is in the truth; the estimate takes it for turns of the sensors.
    predicted = quantity(right, "base level") @ tilt
    np.testing.assert_allclose(moved(wrong, right), predicted, atol=0.1 * size)
    largest = np.abs(predicted).max()
    assert largest > 0.2 * size
    if stated is RIG:
        np.testing.assert_allclose(moved(wrong, right), predicted, atol=0.02 * largest)


def shifted(rig: Rig, name: str, by: FloatArray) -> Rig:
    """A rig that is off by this where its file says otherwise."""
    stated: UncertainValue = getattr(rig, name)
    change: dict[str, Any] = {name: UncertainValue(stated.value + by, stated.std)}
    return replace(rig, **change)


OFF, TARE = np.array([1e-5, -2e-5, 1e-5]), np.zeros((3, 3))
TARE[1] = [1.0, -0.5, 0.0]
GAIN = np.zeros((3, 6))  # xx, yy, zz and three of cross talk
GAIN[1, :3] = [1e-3, -1e-3, 2e-3]
TARED, ZEROED = (make_rig(zero_std=std, declared=QUIET) for std in (0.1, 0.0))
WRONG: list[tuple[str, Rig, Rig, Faults, FloatArray]] = [
    # what is taken as exact, the rig as stated and as it is, by how much it is off
    ("gain", RIG, RIG, Faults(gains=(Gain(1, (1e-3, -1e-3, 2e-3)),)), GAIN),
    ("barycentre", KNOWN, shifted(KNOWN, "barycentre", OFF), Faults(), OFF),
    ("zeros", TARED, shifted(TARED, "zero", TARE), Faults(), TARE),
    ("zeros", ZEROED, shifted(ZEROED, "zero", TARE), Faults(), TARE),
]


@pytest.mark.parametrize(("name", "stated", "real", "faults", "off"), WRONG)
def test_a_wrong_value_moves_the_angles_as_predicted(
    name: str, stated: Rig, real: Rig, faults: Faults, off: FloatArray
) -> None:
    squeeze = 100.0 if name == "gain" else 0.0
    right, _ = calibrated(stated, stated, squeeze=squeeze)
    wrong, _ = calibrated(stated, real, faults, squeeze=squeeze)
    predicted = quantity(right, name) @ off.ravel()
    assert np.abs(predicted).max() > (1e-5 if name == "barycentre" else 1e-4)
    np.testing.assert_allclose(moved(wrong, right), predicted, atol=0.05 * np.abs(predicted).max())


def test_a_barycentre_taken_as_exact_moves_the_zeros_as_predicted_and_unseen() -> None:
    """Sideways it goes into the zeros whole: no test shows it, so that a warning must."""
    stated = make_rig(zero_std=np.inf, mass_std=0.0, barycentre_std=0.0, declared=QUIET)
    real = make_rig(zero_std=20.0, mass_std=0.0, barycentre_std=0.0, declared=QUIET)
    off = np.array([2e-4, 0.0, 0.0])
    moved_real = replace(real, barycentre=UncertainValue.exact(real.barycentre.value + off))
    right, _ = calibrated(stated, real, squeeze=100.0)
    wrong, truth = calibrated(stated, moved_real, squeeze=100.0)
    every = exact_quantities(right.fit, right.estimate.parts)
    (found,) = (q for q in every if q.name == "barycentre")
    predicted = (found.columns[layout(3)["zero"]] @ off / found.error).reshape(3, 3)
    assert np.abs(predicted).max() > 1.0
    seen = wrong.fit.state.zero - right.fit.state.zero
    np.testing.assert_allclose(seen, predicted, atol=0.02 * np.abs(predicted).max())
    std = wrong.uncertainty.parameter_std[layout(3)["zero"]].reshape(3, 3)
    assert np.abs((wrong.fit.state.zero - truth.zero[0]) / std).max() > 6
    assert not wrong.suspicions
    for result in (right, wrong):
        (said,) = (
            text
            for text in in_words(result.findings)
            if "hardly show in a residual" in text and "bary" in text
        )
        assert "terminal.barycenter.std" in said
    declared, _ = calibrated(RIG, real)
    assert not [text for text in in_words(declared.findings) if "hardly show in a residual" in text]
