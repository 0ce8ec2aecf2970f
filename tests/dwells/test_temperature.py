"""The temperature of each dwell, where a log carries it."""

from dataclasses import replace

import numpy as np
import pytest

from tdfscal.dwells import find_dwells
from tdfscal.errors import DataError
from tdfscal.records import FloatArray, Log, Series

from .rig_log import Recipe, record


def warming(time: FloatArray, sensor: int) -> FloatArray:
    """A hall that warms up by 3 K in an hour, each sensor elsewhere."""
    return 20.0 + sensor + 3.0 / 3600.0 * time


def with_fields(fields: int, rate: float = 10.0, noise: float = 0.02) -> Log:
    log = record(Recipe()).log
    time = np.arange(0.0, log.force[0].time[-1], 1.0 / rate)
    rng = np.random.default_rng(0)
    return replace(
        log,
        temperature=tuple(
            Series(time, (warming(time, i) + noise * rng.normal(size=len(time)))[:, None])
            for i in range(fields)
        ),
    )


@pytest.mark.parametrize(("fields", "rate"), [(1, 1.0), (3, 100.0)])
def test_each_dwell_has_the_temperature_of_its_time(fields: int, rate: float) -> None:
    dwells = find_dwells(with_fields(fields, rate))
    assert dwells.temperature is not None
    middle = 0.5 * (dwells.start + dwells.end)
    sensors = range(3) if fields == 3 else [0, 0, 0]
    truth = np.stack([warming(middle, i) for i in sensors], axis=1)
    # A mean over a second: half a second of warming, and the noise of at least one sample.
    assert np.abs(dwells.temperature - truth).max() < 0.5 * 3.0 / 3600.0 + 5 * 0.02


def test_a_field_without_numbers_is_refused() -> None:
    log = with_fields(1)
    empty = Series(log.temperature[0].time, np.full_like(log.temperature[0].value, np.nan))
    with pytest.raises(DataError, match="temperature"):
        find_dwells(replace(log, temperature=(empty,)))
