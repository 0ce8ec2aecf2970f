"""A log that is read wrongly since the calibration: the mistake is named, and no change."""

from collections.abc import Callable
from dataclasses import replace

import numpy as np
import pytest

from tdfscal.errors import DataError
from tdfscal.records import Dwells, FloatArray
from tdfscal.validation.residual_wrench import validate
from tests.words import refusal

from .held_out import RIG, world

TRIALS = 100


def changed(trial: int, change: Callable[[FloatArray], None], *, tared: bool = False) -> Dwells:
    """Held-out dwells whose forces (K, n, 3) are changed, tared anew before where that is asked."""
    held = world(TRIALS).held(trial)
    force = held.force.copy()
    if tared:
        new = np.random.default_rng(trial).normal(RIG.zero.value, RIG.zero.std)
        force += new - world(TRIALS).batch.truth.zero[trial]
    change(force)
    return replace(held, force=force)


def exchanged(*pairs: tuple[tuple[int, int], tuple[int, int]]) -> Callable[[FloatArray], None]:
    """Channels (sensor, axis) that change places."""

    def change(force: FloatArray) -> None:
        for (i, a), (j, b) in pairs:
            force[:, [i, j], [a, b]] = force[:, [j, i], [b, a]]

    return change


def scaled(
    factor: float | FloatArray, sensor: int, axis: int | slice = slice(None)
) -> Callable[[FloatArray], None]:
    def change(force: FloatArray) -> None:
        force[:, sensor, axis] *= factor

    return change


MISTAKES = {
    "channels": (exchanged(((0, 0), (1, 0))), "Fx of ncp1 and Fx of ncp2 exchanged"),
    "axes": (exchanged(((1, 0), (1, 1))), "Fx and Fy of ncp2 exchanged"),
    "sign": (scaled(-1.0, 2, 1), "the opposite sign of Fy of ncp3"),
    "half a turn": (
        scaled(np.array([-1.0, 1.0, -1.0]), 0),
        "the opposite sign of Fx and Fz of ncp1",
    ),
    "unit": (scaled(1 / 9.80665, 0), "kgf"),
}


@pytest.mark.parametrize(("name", "tared"), [*((name, False) for name in MISTAKES), ("axes", True)])
def test_a_mistake_in_the_log_is_named_before_a_tare_or_a_change(name: str, *, tared: bool) -> None:
    change, mistake = MISTAKES[name]
    found = refusal(validate, world(TRIALS).given[0], changed(0, change, tared=tared))
    assert mistake in (found.values.get("exchange"), found.values.get("unit"))
    assert name != "unit" or found.subject == ("ncp1",)


@pytest.mark.parametrize("whole", [True, False])
def test_both_ends_of_exchanged_supports_are_named_at_once(*, whole: bool) -> None:
    held, order = world(TRIALS).held(0), [1, 0, 2]
    force = held.force[:, order] if whole else held.force
    with pytest.raises(DataError, match="ncp1 taken from ncp2") as caught:
        validate(
            world(TRIALS).given[0], replace(held, position=held.position[:, order], force=force)
        )
    assert caught.value.finding.values.get("whole", False) is whole


@pytest.mark.parametrize(("factor", "unit"), [(1e-3, "kN"), (1e3, "N")])
@pytest.mark.parametrize("zero", [0.0, 40.0])
def test_forces_in_another_unit_are_no_load(factor: float, unit: str, zero: float) -> None:
    """Also where zeros are stated that outweigh the whole terminal in kN."""
    rig = replace(RIG, zero=replace(RIG.zero, value=RIG.zero.value + zero))

    def read(force: FloatArray) -> None:
        force[:] = factor * (force + zero)

    held = changed(0, read)
    assert refusal(validate, world(TRIALS).given[0], held, rig=rig).values["unit"] == unit
