"""Logs with one gross mistake are refused by its name; poor postures are not blamed on any."""

from collections.abc import Callable
from dataclasses import replace

import numpy as np
import pytest

from tdfscal import simulation
from tdfscal.errors import DataError
from tdfscal.records import Dwells, FloatArray, UncertainValue
from tdfscal.simulation import Faults, Gain, Options, Recorder
from tests.selfcal.campaigns import fitted

RIGS = {n: simulation.make_rig(n) for n in (3, 4, 6)}


def recorded(n: int, squeeze: float, change: Callable[[FloatArray], None]) -> Dwells:
    """14 postures whose forces (K, n, 3) are changed."""
    options = Options(postures=14, squeeze=squeeze)
    dwells = simulation.simulate_dwells(RIGS[n], options, np.random.default_rng(n), 1).dwells(0)
    force = dwells.force.copy()
    change(force)
    off = force - dwells.force
    return replace(
        dwells, force=force, force_min=dwells.force_min + off, force_max=dwells.force_max + off
    )


def scaled(factor: float, sensor: int | slice, axis: int | slice) -> Callable[[FloatArray], None]:
    def change(force: FloatArray) -> None:
        force[:, sensor, axis] *= factor

    return change


def both(
    one: Callable[[FloatArray], None], other: Callable[[FloatArray], None]
) -> Callable[[FloatArray], None]:
    def change(force: FloatArray) -> None:
        one(force)
        other(force)

    return change


def exchanged(a: tuple[int, int], b: tuple[int, int]) -> Callable[[FloatArray], None]:
    def change(force: FloatArray) -> None:
        force[:, [a[0], b[0]], [a[1], b[1]]] = force[:, [b[0], a[0]], [b[1], a[1]]]

    return change


def tared(force: FloatArray) -> None:
    force[6:, 1] -= force[5, 1]


MISTAKES = {
    "a channel in kgf": (scaled(1 / 9.80665, 1, 0), r"Fx of ncp2 reads 0\.102 times .* in kgf"),
    "a channel in kN": (scaled(1e-3, 2, 1), r"Fy of ncp3 reads .* in kN where N is declared"),
    "a channel of another gain": (scaled(0.6, 0, 0), r"Fx of ncp1 reads 0\.(6|60|59)\d? times"),
    "a sensor in kgf": (scaled(1 / 9.80665, 1, slice(None)), r"every axis of ncp2 reads .* in kgf"),
    "two channels": (exchanged((0, 0), (2, 0)), "Fx of ncp1 and Fx of ncp3 exchanged"),
    "unlike channels": (exchanged((0, 0), (1, 1)), "Fx of ncp1 and Fy of ncp2 exchanged"),
    "a sign": (scaled(-1.0, 0, 1), "the opposite sign of Fy of ncp1"),
    "two signs": (
        both(scaled(-1.0, 0, 0), scaled(-1.0, 1, 2)),
        "opposite sign of Fx of ncp1, and the opposite sign of Fz of ncp2",
    ),
    "an exchange and a sign": (
        both(exchanged((0, 0), (2, 0)), scaled(-1.0, 2, 0)),
        "Fx of ncp1 and Fx of ncp3 exchanged, and the opposite sign of Fx of ncp1",
    ),
    "a tare": (tared, r"the zero of ncp2 jumped by .* before posture 7, .* as a tare"),
}


#: One of each kind; the others are of these kinds too.
_QUICK = ("a channel in kgf", "two channels", "a sign", "two signs")


@pytest.mark.parametrize(
    ("name", "n", "squeeze"),
    [
        *((name, 3, 150.0 if k % 2 else 0.0) for k, name in enumerate(_QUICK)),
        ("a tare", 6, 300.0),
        *(
            pytest.param(name, n, squeeze, marks=pytest.mark.slow)
            for name in MISTAKES
            for n, squeeze in ((3, 150.0), (4, 0.0))
        ),
    ],
)
def test_one_mistake_is_named_in_place_of_advice(name: str, n: int, squeeze: float) -> None:
    change, words = MISTAKES[name]
    with pytest.raises(DataError, match=words):
        fitted(RIGS[n], recorded(n, squeeze, change))


@pytest.mark.parametrize("axis", [0, 2])
def test_a_mirrored_axis_of_every_sensor_is_no_negative_mass(axis: int) -> None:
    """Where the mass is unknown the forces would hold up -500 kg as well."""
    rig = replace(RIGS[3], mass=UncertainValue(np.asarray(500.0), np.asarray(np.inf)))
    dwells = recorded(3, 150.0, scaled(-1.0, slice(None), axis))
    with pytest.raises(DataError, match=f"F{'xyz'[axis]} of every sensor has the opposite sign"):
        fitted(rig, dwells)


@pytest.mark.parametrize("n", RIGS)
def test_whole_supports_exchanged_are_named_at_once(n: int) -> None:
    """Positions and forces; where positions alone are exchanged, forces are left as they are."""
    options = Options(postures=14, squeeze=200.0)
    dwells = simulation.simulate_dwells(RIGS[n], options, np.random.default_rng(n), 1).dwells(0)
    order = [1, 0, *range(2, n)]
    for whole in (True, False):
        force = dwells.force[:, order] if whole else dwells.force
        with pytest.raises(DataError, match=r"ncp1 taken from ncp2 and ncp2 taken") as error:
            fitted(RIGS[n], replace(dwells, position=dwells.position[:, order], force=force))
        assert ("position and force fields" in str(error.value)) == whole


@pytest.mark.parametrize("axis", range(3))
@pytest.mark.parametrize("measured", [False, True])
def test_a_left_handed_log_is_named_though_supports_exchanged_fit_its_distances(
    axis: int, *, measured: bool
) -> None:
    """Forces tell; with hinges as the log has them, by the zeros, or of heights not at all."""
    options, sign, rig = Options(postures=14, squeeze=200.0), np.ones(3), RIGS[3]
    dwells = simulation.simulate_dwells(rig, options, np.random.default_rng(3), 1).dwells(0)
    sign[axis] = -1
    mirrored = replace(dwells, position=dwells.position * sign)
    if measured:
        unknown = UncertainValue(np.zeros((3, 3)), np.full((3, 3), np.inf))
        centre = UncertainValue(np.zeros(3), np.array([0.02, 0.02, np.inf]))
        rig = replace(rig, hinge=rig.hinge * sign, barycentre=centre, zero=unknown)
        if axis == 2:
            found = fitted(rig, mirrored).turned_sensors()
            assert [each.values["mirrored"] for each in found] == [True] * 3
            return
    with pytest.raises(DataError) as error:
        fitted(rig, mirrored)
    assert f"fit with the opposite sign of {'XYZ'[axis]} of every positioner" in str(error.value)
    assert ("only with zeros" in str(error.value)) == measured
    assert error.value.finding.values["signs"] == sign.tolist()


@pytest.mark.parametrize("axes", [False, True])
@pytest.mark.parametrize("step", [1, 2])
def test_positions_renamed_in_a_circle_are_named(step: int, *, axes: bool) -> None:
    """Supports, or the axes of all: distances between hinges stay as they are, forces tell."""
    options = Options(postures=14, squeeze=200.0)
    dwells = simulation.simulate_dwells(RIGS[3], options, np.random.default_rng(3), 1).dwells(0)
    order = np.roll(np.arange(3), step)
    circled = dwells.position[..., order] if axes else dwells.position[:, order]
    back = np.argsort(order)
    words = f"ncp1 taken from ncp{back[0] + 1} and ncp2"
    if axes:
        words = "the axes read as " + ", ".join("XYZ"[a] for a in back)
    with pytest.raises(DataError, match=words):
        fitted(RIGS[3], replace(dwells, position=circled))


RIG = simulation.reference_rig()


@pytest.mark.parametrize(("seed", "support", "axis", "size"), [(5, 0, 1, 1.2), (8, 1, 0, 5.0)])
def test_a_noisy_channel_is_named(seed: int, support: int, axis: int, size: float) -> None:
    """1.2 N, nine times the stated 0.14 N, is a thousandth of the load at most."""
    options = Options(postures=16, squeeze=150.0, recorder=Recorder(mean_sd=0.1))
    dwells = simulation.simulate_dwells(RIG, options, np.random.default_rng(seed), 1).dwells(0)
    force = dwells.force.copy()
    force[:, support, axis] += size * np.random.default_rng(seed).standard_normal(16)
    result = fitted(RIG, replace(dwells, force=force))
    assert result.reasons
    assert ("sensor noise", support) in [(s.kind, s.support) for s in result.suspicions]


@pytest.mark.parametrize("size", [0.01, pytest.param(0.05, marks=pytest.mark.slow)])
def test_a_wrong_gain_is_named_before_the_noise_that_it_looks_like(size: float) -> None:
    """Its misfit varies from posture to posture and is 14 to 500 times the noise of a channel."""
    options = Options(
        postures=27,
        squeeze=400.0,
        recorder=Recorder(mean_sd=0.05),
        faults=Faults(gains=(Gain(3, (size,) * 3),)),
    )
    rig = simulation.make_rig(4, mass=1500.0, radius=0.4)
    dwells = simulation.simulate_dwells(rig, options, np.random.default_rng(1), 1).dwells(0)
    result = fitted(rig, dwells)
    causes = [f for f in result.reasons if f.code not in ("residuals-large", "angle-uncertain")]
    assert [(cause.code, cause.subject) for cause in causes] == [("gain-suspected", ("ncp4",))]


def test_noise_that_is_overstated_is_said() -> None:
    dwells = simulation.simulate_dwells(
        RIG, Options(squeeze=100.0), np.random.default_rng(3), 1
    ).dwells(0)
    for stated in ({"force_noise": 0.3}, {"positioner": 3e-4}):
        rig = replace(RIG, declared=replace(RIG.declared, **stated))
        result = fitted(rig, dwells)
        assert "noise-overstated" in [each.code for each in result.findings]
