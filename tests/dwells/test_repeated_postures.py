"""Averaged postures that are there twice are one recording."""

import numpy as np
import pytest

from tdfscal.dwells import find_dwells
from tdfscal.records import IntArray, Log, Series
from tdfscal.simulation import Options, reference_rig, simulate_dwells
from tests.words import in_words


def postures(count: int = 12, seed: int = 0) -> Log:
    return simulate_dwells(
        reference_rig(), Options(postures=count), np.random.default_rng(seed), 1
    ).log(0)


def changed(log: Log, position: int | None, force: int | None, rows: IntArray) -> Log:
    """The rows of a log, rounded to so many digits, as another file would hold them."""

    def series(old: Series, digits: int | None) -> Series:
        value = old.value[rows]
        return Series(
            np.arange(len(rows), dtype=np.float64),
            value if digits is None else np.round(value, digits),
        )

    return Log(
        log.supports,
        tuple(series(s, position) for s in log.position),
        tuple(series(s, force) for s in log.force),
        rows="postures",
    )


@pytest.mark.parametrize("digits", [(None, None), (6, 3), (7, 2)])
@pytest.mark.parametrize("order", [np.arange(12), np.arange(12)[::-1], np.array([3, 7])])
def test_second_exports_count_once(digits: tuple[int | None, int | None], order: IntArray) -> None:
    log = postures()
    dwells = find_dwells([log, changed(log, *digits, order)])
    once = find_dwells(log)
    assert np.array_equal(dwells.force, once.force)
    assert np.array_equal(dwells.start, once.start)
    assert len(in_words(dwells.findings)) == 1
    assert f"{len(order)} of {12 + len(order)}" in in_words(dwells.findings)[0]


def test_postures_visited_again_are_no_copies() -> None:
    """The same places with new noise, in readings of three digits."""
    log = postures()
    rng = np.random.default_rng(1)
    again = Log(
        log.supports,
        log.position,
        tuple(Series(s.time, s.value + 0.05 * rng.normal(size=s.value.shape)) for s in log.force),
        rows="postures",
    )
    rows = np.arange(12)
    dwells = find_dwells([changed(log, 6, 3, rows), changed(again, 6, 3, rows)])
    assert len(dwells) == 24
    assert not in_words(dwells.findings)
