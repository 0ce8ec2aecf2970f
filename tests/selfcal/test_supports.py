"""Sensors that lack axes, zeros that move, frames that are turned: truth from the simulator."""

from dataclasses import replace
from itertools import product

import numpy as np
import pytest

from tdfscal import simulation
from tdfscal.errors import NotIdentifiableError, RigError
from tdfscal.estimation.observability import verdict
from tdfscal.estimation.uncertainty import estimate
from tdfscal.model.parameters import layout, nominal
from tdfscal.model.statics import postures
from tdfscal.numerics import so3
from tdfscal.numerics.distributions import chi2_quantile
from tdfscal.records import Drift, Rig
from tdfscal.selfcal.estimator import fit
from tdfscal.selfcal.mounting_search import best_start
from tdfscal.selfcal.pipeline import self_calibrate
from tdfscal.selfcal.preparation import misplaced_hinges
from tdfscal.selfcal.score_tests import suspicions
from tdfscal.simulation import Options, Recorder
from tdfscal.simulation.faults import Faults, Frame, Warming
from tests.selfcal.campaigns import fitted
from tests.words import in_words

OPTIONS = Options(internal=200.0, recorder=Recorder(mean_sd=0.1))


def lacking(*dead: tuple[int, int], n: int = 3) -> Rig:
    """A rig whose sensors do not measure these (sensor, axis)."""
    axes = np.ones((n, 3), dtype=np.bool_)
    for sensor, axis in dead:
        axes[sensor, axis] = False
    return replace(simulation.make_rig(n), axes=axes)


@pytest.mark.parametrize(
    ("dead", "n", "undetermined"),
    [
        (((2, 1),), 3, ()),
        (((2, 2),), 3, ()),
        (((2, 0), (2, 1)), 3, ("ncp3",)),
        (((3, 0), (3, 1), (3, 2)), 4, ("ncp4",)),
    ],
)
def test_the_rest_of_the_sensors_stand(
    dead: tuple[tuple[int, int], ...], n: int, undetermined: tuple[str, ...]
) -> None:
    """Errors within χ² at a millionth; what lacks too much is named and nothing else."""
    rig = lacking(*dead, n=n)
    batch = simulation.simulate_dwells(rig, OPTIONS, np.random.default_rng(3), 1)
    result = fit(rig, postures(rig, batch.dwells(0)), nominal(rig))
    judged = estimate(result)
    found, stats = judged.uncertainty, judged.quality
    seen = verdict(rig, result.state, result.postures, found.covariance)
    assert result.converged
    assert seen.undetermined == undetermined
    assert seen.identified
    d = so3.log(batch.truth.rotation[0] @ np.swapaxes(result.state.rotation, 1, 2)).ravel()
    known = np.repeat(seen.determined, 3)
    d2 = d[known] @ np.linalg.solve(found.covariance[np.ix_(known, known)], d[known])
    assert d2 < chi2_quantile(1 - 1e-6, int(known.sum()))
    assert chi2_quantile(1e-6, stats.dof) < stats.chi2 < chi2_quantile(1 - 1e-6, stats.dof)
    assert not suspicions(judged, np.arange(len(result.weight), dtype=np.float64))


def test_two_load_cells_are_started_in_the_lowest_minimum() -> None:
    """Campaign 50 has a minimum of 5000 about upright load cells."""
    rig = lacking((2, 0), (2, 1), (3, 0), (3, 1), n=4)
    batch = simulation.simulate_dwells(rig, OPTIONS, np.random.default_rng(1), 60)
    for trial in (0, 50):
        seen = postures(rig, batch.dwells(trial))
        result = fit(rig, seen, best_start(rig, seen).state)
        assert result.converged
        assert result.cost < chi2_quantile(1 - 1e-6, result.dof)


def test_a_turn_that_the_data_do_not_determine_is_not_told() -> None:
    rig = lacking((2, 0), (2, 1))
    dwells = simulation.simulate_dwells(rig, OPTIONS, np.random.default_rng(1), 40).dwells(12)
    result = fitted(rig, dwells)
    assert np.linalg.norm(so3.log(result.fit.state.rotation[2])) > np.pi / 8
    assert "sensor-turned" not in [found.code for found in result.findings]


def test_load_cells_alone_determine_nothing() -> None:
    """Every balance of theirs has a free force in it: there is no row left to fit."""
    rig = lacking(*product(range(4), (0, 1)), n=4)
    dwells = simulation.simulate_dwells(rig, OPTIONS, np.random.default_rng(1), 1).dwells(0)
    with pytest.raises(NotIdentifiableError, match="all directions"):
        fitted(rig, dwells)


def test_zeros_follow_the_temperature_where_declared() -> None:
    slopes = ((0.4, -0.3, 0.2), (-0.2, 0.3, 0.1), (0.1, -0.1, -0.3))
    warming = replace(OPTIONS, faults=Faults(warming=Warming(10.0, slopes)))
    rig = simulation.make_rig(3)
    dwells = simulation.simulate_dwells(rig, warming, np.random.default_rng(4), 1).dwells(0)
    declared = replace(rig, drift=Drift(temperature=np.inf))
    result = fit(declared, postures(declared, dwells), nominal(declared))
    place = layout(3, 1)["drift"]
    std = estimate(result).uncertainty.parameter_std[place].reshape(3, 3)
    off = (result.state.drift[0] - np.array(slopes)) / std
    assert np.abs(off).max() < 4.5
    assert std[:, 2].max() < 0.02  # N/K: plain against slopes of 0.1 to 0.3
    ignored = fit(rig, postures(rig, dwells), nominal(rig))
    assert ignored.cost > 2 * result.cost  # the check can fail


def test_a_turned_frame_is_named() -> None:
    rig = simulation.make_rig(3)
    for faults, named in ((Faults(), False), (Faults(frames=(Frame(1, (0.0, 6e-4, 8e-4)),)), True)):
        options = replace(OPTIONS, faults=faults)
        dwells = simulation.simulate_dwells(rig, options, np.random.default_rng(5), 1).dwells(0)
        result = fit(rig, postures(rig, dwells), nominal(rig))
        doubts = misplaced_hinges(estimate(result))
        assert bool(doubts) is named
        if named:
            assert "ncp2 is turned" in " ".join(in_words(doubts[0].findings(rejects=False)))


def test_a_parabola_is_estimated_where_the_residuals_ask_for_it() -> None:
    """Zeros that bend by a newton, of which a slope in time is declared; and zeros that stay."""
    rig = replace(simulation.make_rig(3), drift=Drift(time=np.inf))
    slope = ((0.3, -0.3, 0.3), (-0.3, 0.3, 0.3), (0.3, 0.3, -0.3))
    for faults, bent in ((Faults(), False), (Faults(warming=Warming(10.0, slope)), True)):
        options = replace(OPTIONS, faults=faults)
        dwells = simulation.simulate_dwells(rig, options, np.random.default_rng(10), 1).dwells(0)
        found = fitted(rig, replace(dwells, temperature=None))
        motion = found.fit.postures.motion
        assert motion is not None
        assert ("parabola" in motion.kind) is bent
        assert any("parabola" in warning for warning in in_words(found.findings)) is bent


def test_the_linear_method_needs_every_component() -> None:
    rig = lacking((1, 0))
    dwells = simulation.simulate_dwells(rig, OPTIONS, np.random.default_rng(9), 1).dwells(0)
    with pytest.raises(RigError, match="does not measure x, and the linear method needs"):
        self_calibrate(rig, dwells, rng=np.random.default_rng(0), estimator="linear")
