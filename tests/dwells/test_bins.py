"""Bins against numpy on the samples themselves; pieces, widths, gaps and bad input."""

from collections.abc import Iterable
from dataclasses import replace
from itertools import pairwise

import numpy as np
import pytest

from tdfscal.dwells import reduce_to_bins
from tdfscal.errors import DataError
from tdfscal.records import Log, Series

from .rig_log import Recipe, record


def cut(log: Log, edges: Iterable[float], late: float = 0.5) -> list[Log]:
    """Pieces between edges; the positions run `late` seconds behind the forces."""

    def part(series: Series, low: float, high: float) -> Series:
        rows = (series.time >= low) & (series.time < high)
        return Series(series.time[rows], series.value[rows])

    return [
        replace(
            log,
            position=tuple(part(s, low - late, high - late) for s in log.position),
            force=tuple(part(s, low, high) for s in log.force),
        )
        for low, high in pairwise([-np.inf, *edges, np.inf])
    ]


@pytest.fixture(scope="module")
def log() -> Log:
    recipe = Recipe(rate=250, position_rate=50, stops=(2.0, 3.0, 2.0), jitter=0.5, seed=5)
    return record(recipe, origin=1.7e9).log


def test_each_bin_holds_the_moments_of_its_samples(log: Log) -> None:
    bins = reduce_to_bins([log])
    for stream, series in enumerate((*log.position, *log.force)):
        inside = np.searchsorted(series.time, np.append(bins.start, bins.start[-1] + bins.width))
        np.testing.assert_array_equal(np.diff(inside), bins.count[:, stream])
        for b in range(0, len(bins), 17):
            x = series.value[inside[b] : inside[b + 1]]
            if not len(x):
                continue
            np.testing.assert_allclose(bins.mean[b, stream], x.mean(axis=0), rtol=1e-14)
            scatter = ((x - x.mean(axis=0)) ** 2).sum(axis=0)
            np.testing.assert_allclose(bins.scatter[b, stream], scatter, rtol=1e-5, atol=1e-16)
            if stream >= 3:
                extremes = bins.mean[b, stream] + bins.low[b, stream - 3]
                np.testing.assert_allclose(extremes, x.min(axis=0), rtol=1e-6, atol=1e-6)


def test_too_many_bins_are_halved_and_keep_every_sample() -> None:
    log = record(Recipe(rate=100, stops=(60.0, 60.0))).log
    fine = reduce_to_bins([log], width=0.02)
    coarse = reduce_to_bins([log], width=0.02, most=2048)
    assert coarse.width == 4 * fine.width
    assert len(coarse) <= 2048 < len(fine)
    np.testing.assert_array_equal(coarse.count.sum(axis=0), fine.count.sum(axis=0))
    total = (fine.count[..., None] * fine.mean).sum(axis=0)
    np.testing.assert_allclose((coarse.count[..., None] * coarse.mean).sum(axis=0), total)


@pytest.mark.parametrize("fault", ["back", "nan", "empty", "stuck", "supports"])
def test_what_cannot_be_used_is_refused_with_its_place(fault: str, log: Log) -> None:
    pieces = cut(log, [log.force[0].time[0] + 3.0])
    force = pieces[1].force[1]
    time, value = force.time.copy(), force.value.copy()
    if fault == "back":
        time[40] = time[30]
    elif fault == "nan":
        value[12, 2] = np.nan
    elif fault == "stuck":
        time[:] = time[0]
    changed = replace(
        pieces[1], force=(pieces[1].force[0], Series(time, value), pieces[1].force[2])
    )
    if fault == "supports":
        changed = replace(changed, supports=("x", "y", "z"))
    given = {"empty": [], "stuck": [changed]}.get(fault, [pieces[0], changed])
    with pytest.raises(DataError) as raised:
        reduce_to_bins(given)
    if fault in ("back", "nan"):
        assert raised.value.where is not None
        assert "ncp2, force" in raised.value.where
    if fault == "nan":
        assert f"{force.time[12]:.6f}" in str(raised.value)


@pytest.mark.parametrize(("scale", "code"), [(1e-3, "dense"), (1e-6, "dense"), (1e3, "sparse")])
def test_times_in_another_unit_are_no_recorder_s(scale: float, code: str, log: Log) -> None:
    scaled = [Series((s.time - 1.7e9) * scale, s.value) for s in (*log.position, *log.force)]
    n = len(log.supports)
    with pytest.raises(DataError) as raised:
        reduce_to_bins([replace(log, position=tuple(scaled[:n]), force=tuple(scaled[n:]))])
    assert raised.value.finding.code == f"samples-{code}"
