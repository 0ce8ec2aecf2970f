"""A log without a dwell: the cause is named, and what is advised brings dwells."""

from collections.abc import Callable
from dataclasses import replace

import numpy as np
import pytest
from scipy.signal import lfilter

from tdfscal.dwells import find_dwells
from tdfscal.dwells.find import no_dwell
from tdfscal.records import Absence, FloatArray, Log, Series
from tests.words import in_words

from .rig_log import Recipe, record

STOPS = 10


def of(log: Log) -> Absence:
    dwells = find_dwells(log)
    assert len(dwells) == 0
    assert dwells.absence is not None
    error = no_dwell(dwells)
    assert (dwells.absence.seen in error.what, error.hint) == (True, dwells.absence.advice)
    return dwells.absence


def changed(log: Log, quantity: str, change: Callable[[Series], FloatArray]) -> Log:
    series = tuple(Series(s.time, change(s)) for s in getattr(log, quantity))
    return replace(log, position=series) if quantity == "position" else replace(log, force=series)


def filtered(stop: float, tau: float, quantity: str) -> Log:
    """A first-order low pass of a time constant, s."""

    def low_pass(series: Series) -> FloatArray:
        a = np.exp(-np.diff(series.time).mean() / tau)
        first = series.value[0]
        return np.asarray(lfilter([1 - a], [1, -a], series.value - first, axis=0) + first)

    return changed(record(Recipe(stops=(stop,) * STOPS)).log, quantity, low_pass)


def stopping(stop: float, rate: float) -> Log:
    return record(Recipe(rate=rate, stops=(stop,) * STOPS)).log


CAUSES: dict[str, tuple[Callable[[float], Log], float, str]] = {
    "1 Hz": (lambda stop: stopping(stop, 1.0), 4.0, "sampled too slowly"),
    "stops of 0.1 s": (lambda stop: stopping(stop, 1000.0), 0.1, "stops are too short"),
    "forces filtered, 0.5 s": (lambda stop: filtered(stop, 0.5, "force"), 4.0, "filter"),
}


@pytest.mark.parametrize("name", CAUSES)
def test_the_cause_is_named_and_the_advice_helps(name: str) -> None:
    make, stop, words = CAUSES[name]
    absence = of(make(stop))
    assert words in absence.seen
    assert absence.stop is not None
    assert absence.stop > stop
    better = find_dwells(make(absence.stop))
    assert len(better) >= 0.7 * STOPS


@pytest.mark.parametrize("quantity", ["position", "force"])
@pytest.mark.parametrize("share", [0.01, 0.3])
def test_zeros_in_place_of_readings_are_always_named(quantity: str, share: float) -> None:
    rng = np.random.default_rng(0)

    def dropped(series: Series) -> FloatArray:
        return np.where(rng.random(len(series.time))[:, None] < share, 0.0, series.value)

    dwells = find_dwells(changed(record(Recipe()).log, quantity, dropped))
    said = " ".join(in_words(dwells.findings)) + (dwells.absence.seen if dwells.absence else "")
    assert f"the {quantity} of ncp" in said
    assert "0, 0, 0" in said


def test_a_log_in_motion_is_called_so() -> None:
    t = np.arange(0.0, 60.0, 0.01)
    rng = np.random.default_rng(2)

    def wave(size: float, noise: float) -> tuple[Series, ...]:
        made = []
        for _ in range(3):
            hertz, phase = rng.uniform(0.03, 0.2, (2, 3)), rng.uniform(0.0, 6.0, (2, 3))
            turn = 2 * np.pi * hertz * t[:, None, None] + phase
            value = size * np.sin(turn).sum(axis=1) + noise * rng.normal(size=(len(t), 3))
            made.append(Series(t, value))
        return tuple(made)

    log = Log(("a", "b", "c"), wave(0.02, 3e-7), wave(200.0, 1.0))
    assert "never rest" in of(log).seen
