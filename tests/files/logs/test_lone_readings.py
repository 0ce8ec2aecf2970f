"""One spoilt cell of a log: left out by name, so that no dwell and no mean is touched."""

from pathlib import Path

import numpy as np
import pytest

import tdfscal
from tdfscal.dwells import find_dwells
from tdfscal.errors import DataError
from tdfscal.logs import read_log
from tdfscal.records import Dwells, Log
from tests.files.logs.log_making import SUPPORTS, make_truth, table
from tests.words import in_words


@pytest.fixture(scope="module", params=[50.0, pytest.param(1000.0, marks=pytest.mark.slow)])
def campaign(tmp_path_factory: pytest.TempPathFactory, request: pytest.FixtureRequest) -> Path:
    folder = tmp_path_factory.mktemp("campaign") / "c"
    tdfscal.simulate(folder, postures=4, seed=2, rate=request.param)
    return folder


def read(folder: Path, lines: list[str], name: str) -> tuple[Log, Dwells]:
    path = folder.parent / name
    path.write_text("\n".join(lines) + "\n")
    log = tdfscal.read_log(path, folder / "rig.yaml")
    return log, find_dwells(log)


@pytest.mark.parametrize(
    ("column", "cell", "part"),
    [(1, "1.33", 0.02), (8, "1e5", 0.4), (6, "0", 0.95), (12, "-9e4", 0.4)],
)
def test_a_spoilt_cell_moves_nothing(campaign: Path, column: int, cell: str, part: float) -> None:
    lines = (campaign / "log.csv").read_text().splitlines()
    log, whole = read(campaign, lines, "whole.csv")
    assert not in_words(log.findings)
    time = log.force[0].time
    row = int(np.searchsorted(time, whole.start[2] + part * (whole.end[2] - whole.start[2])))
    cells = lines[row + 1].split(",")
    cells[column] = cell
    spoilt, found = read(campaign, [*lines[: row + 1], ",".join(cells), *lines[row + 2 :]], "1.csv")
    what = "force" if column % 6 in (0, 4, 5) else "position"
    assert f"1 reading stands alone in the {what} of" in in_words(spoilt.findings)[0]
    assert f"at {time[row]:.9g} s" in in_words(spoilt.findings)[0]
    assert len(in_words(spoilt.findings)) == 1
    assert len(found) == len(whole)
    # One sample less of some hundred: a tenth of a standard error where it was the worst.
    std = np.sqrt(np.diagonal(whole.force_cov, axis1=2, axis2=3))
    assert np.abs((found.force - whole.force) / std).max() < 0.35
    np.testing.assert_allclose(found.position, whole.position, rtol=0, atol=1e-7)


@pytest.mark.parametrize("size", [300.0, 9999.0])
@pytest.mark.parametrize("count", [2, 5, 10])
def test_a_few_wild_readings_together_are_left_out(campaign: Path, size: float, count: int) -> None:
    """In three stops; of what lasts longer than 0.1 s the dwell search says that it returns."""
    lines = (campaign / "log.csv").read_text().splitlines()
    _, whole = read(campaign, lines, "whole.csv")
    times = np.array([float(line.split(",")[0]) for line in lines[1:]])
    for k in (0, 1, 2):
        for row in np.searchsorted(times, (whole.start[k] + whole.end[k]) / 2) + np.arange(count):
            cells = lines[row + 1].split(",")
            cells[6] = str(size if size > 1e3 else float(cells[6]) + size)
            lines[row + 1] = ",".join(cells)
    spoilt, found = read(campaign, lines, "wild.csv")
    told = spoilt.findings or found.findings
    assert [one.size for one in told] == [3 if count > 0.1 / np.diff(times).mean() else 3 * count]
    assert len(found) == len(whole)
    assert np.abs(found.force - whole.force).max() < 0.5


@pytest.mark.parametrize(
    ("row", "jump"), [(0, 1.8e9), (1000, -1.8e9), (1000, 1e300), (1999, 1.8e9)]
)
def test_a_stamp_years_away_is_named(tmp_path: Path, row: int, jump: float) -> None:
    path = tmp_path / "log.csv"
    frame = table(make_truth(2000))
    frame["time"] = np.arange(2000) * 0.01
    frame["time"] += jump * (np.arange(2000) == row)
    frame.to_csv(path, index=False)
    with pytest.raises(DataError, match="the time of column time goes from"):
        read_log([path], None, SUPPORTS)
