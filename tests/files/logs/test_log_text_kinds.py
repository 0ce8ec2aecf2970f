"""Text logs by writers other than ours: spaces, no header, remarks, dates with times as clocks."""

from collections.abc import Callable
from datetime import UTC, datetime, timedelta, timezone
from pathlib import Path

import numpy as np
import pandas as pd
import pytest

from tdfscal.errors import DataError
from tdfscal.files.rig.recorders import LogBlock
from tdfscal.logs import read_log
from tdfscal.logs.describe import describe_logs
from tests.files.logs.log_making import SUPPORTS, make_truth, table

FRAME = table(make_truth(50)).assign(time=np.arange(50) * 0.02)
NAMES = list(FRAME.columns)


def columns(time: int) -> LogBlock:
    each = zip(SUPPORTS, (2, 8, 14), strict=True)
    fields = {s: {"position": [k, k + 1, k + 2], "force": [k + 3, k + 4, k + 5]} for s, k in each}
    return LogBlock.model_validate({"time": {"field": time}, "supports": fields})


def assert_same(path: Path, mapping: LogBlock | None, start: float = 0.0) -> None:
    log = read_log([path], mapping, SUPPORTS)
    for i, name in enumerate(SUPPORTS):
        expected = FRAME[[f"{name}.{axis}" for axis in "xyz"]].to_numpy()
        np.testing.assert_array_equal(log.position[i].value, expected)
        expected = FRAME[[f"{name}.f{axis}" for axis in "xyz"]].to_numpy()
        np.testing.assert_array_equal(log.force[i].value, expected)
    np.testing.assert_allclose(log.force[0].time - start, FRAME["time"], rtol=0, atol=5e-7)


@pytest.mark.parametrize("delimiter", [" ", ",", ";", "\t", "|"])
@pytest.mark.parametrize("preamble", ["", "# no names here\n"])
def test_columns_without_a_header(tmp_path: Path, delimiter: str, preamble: str) -> None:
    path = tmp_path / "log.dat"
    np.savetxt(path, FRAME.to_numpy(), delimiter=delimiter)
    path.write_text(preamble + path.read_text())
    assert_same(path, columns(time=1))
    fields = describe_logs([path]).contents[0].streams[0].fields
    assert [f.name for f in fields] == [str(k + 1) for k in range(19)]
    with pytest.raises(DataError, match=r"no column 20"):
        read_log([path], columns(time=20), SUPPORTS)


def stamps(write: Callable[[datetime], str]) -> list[str]:
    begin = datetime(2026, 11, 21, 23, 59, 59, 500_000, UTC)
    return [write(begin + timedelta(seconds=float(s))) for s in FRAME["time"]]


BEGIN = datetime(2026, 11, 21, 23, 59, 59, 500_000, UTC).timestamp()
CET = timezone(timedelta(hours=1))
CLOCKS: list[tuple[Callable[[datetime], str], float]] = [
    (lambda t: t.isoformat(), 0.0),
    (lambda t: t.astimezone(CET).isoformat(), 0.0),
    (lambda t: t.astimezone(timezone(-timedelta(hours=4, minutes=30))).isoformat(), 0.0),
    (lambda t: t.strftime("%Y-%m-%dT%H:%M:%S.%fZ"), 0.0),
    (lambda t: t.strftime("%Y-%m-%d %H:%M:%S.%f"), 0.0),
    (lambda t: t.strftime("%Y/%m/%d %H:%M:%S.%f"), 0.0),
    (lambda t: t.strftime("%Y%m%dT%H%M%S.%f"), 0.0),
    (lambda t: t.strftime("%d.%m.%Y %H:%M:%S.%f"), 0.0),
    (lambda t: t.astimezone(CET).strftime("%d.%m.%Y %H:%M:%S.%f"), 3600.0),
]


@pytest.mark.parametrize(("write", "ahead"), CLOCKS)
def test_dates_are_clocks(tmp_path: Path, write: Callable[[datetime], str], ahead: float) -> None:
    path = tmp_path / "log.csv"
    FRAME.assign(time=stamps(write)).to_csv(path, index=False)
    assert_same(path, None, BEGIN + ahead)
    FRAME.assign(time=stamps(write)).to_parquet(tmp_path / "log.parquet")
    assert_same(tmp_path / "log.parquet", None, BEGIN + ahead)
    info = describe_logs([path])
    assert info.recorders[0].time.field == "time"
    assert not info.problems


@pytest.mark.parametrize(
    ("cell", "match"),
    [
        ("11/12/2026 10:00:00", r"line 3, column time: '11/12/2026 10:00:00' is no date"),
        ("2026-02-30 10:00:00", r"line 3, column time: '2026-02-30 10:00:00' is no date"),
        ("soon", r"line 3, column time: 'soon' is no date"),
        ("2026-11-21 09:00:00", r"the time of column time goes from"),
        ("2026-11-21 10:00:01Z", r"line 3, column time: .* is no date"),
        ("0000-11-21 10:00:01", r"line 3, column time: .* is no date"),
    ],
)
def test_dates_that_are_none(tmp_path: Path, cell: str, match: str) -> None:
    path = tmp_path / "log.csv"
    time = ["2026-11-21 10:00:00", cell, *["2026-11-21 10:00:02"] * 48]
    FRAME.assign(time=time).to_csv(path, index=False)
    with pytest.raises(DataError, match=match):
        read_log([path], None, SUPPORTS)


@pytest.mark.parametrize("second", ["+99:99", ""])
@pytest.mark.parametrize("suffix", ["csv", "parquet"])
def test_zones_are_in_all_rows_or_none(tmp_path: Path, second: str, suffix: str) -> None:
    path = tmp_path / f"log.{suffix}"
    time = [f"2026-11-21T10:00:{k:02}+01:00" for k in range(50)]
    time[40] = time[40].replace("+01:00", second)
    frame = FRAME.assign(time=time)
    frame.to_csv(path, index=False) if suffix == "csv" else frame.to_parquet(path)
    with pytest.raises(DataError, match=r"column time.*is no date and time as the first row"):
        read_log([path], None, SUPPORTS)


def turns(path: Path, change: Callable[[pd.DataFrame], pd.DataFrame] = lambda f: f) -> None:
    """Rows of one vector each, at times of its own; the cells of the others are empty."""
    vectors = [
        [f"{name}.{kind}{axis}" for axis in "xyz"] for name in SUPPORTS for kind in ("", "f")
    ]
    parts = [
        FRAME[["time", *names]].assign(time=FRAME["time"] + 1e-3 * k)
        for k, names in enumerate(vectors)
    ]
    table = pd.concat(parts).sort_values("time", kind="stable")[NAMES].reset_index(drop=True)
    change(table).to_csv(path, index=False)


@pytest.mark.parametrize("block", [1 << 10, 8 << 20])
def test_streams_take_turns(tmp_path: Path, block: int, monkeypatch: pytest.MonkeyPatch) -> None:
    """Each signal has the samples of its own rows, at their times, over blocks of any size."""
    monkeypatch.setattr("tdfscal.logs.text_file._BLOCK", block)
    turns(tmp_path / "log.csv")
    log = read_log([tmp_path / "log.csv"], None, SUPPORTS)
    for i, name in enumerate(SUPPORTS):
        for k, (kind, series) in enumerate((("", log.position[i]), ("f", log.force[i]))):
            expected = FRAME[[f"{name}.{kind}{axis}" for axis in "xyz"]].to_numpy()
            np.testing.assert_array_equal(series.value, expected)
            late = 1e-3 * (2 * i + k)
            np.testing.assert_allclose(series.time, FRAME["time"] + late, rtol=0, atol=1e-12)
    guess = describe_logs([tmp_path / "log.csv"]).guess
    assert guess.supports == SUPPORTS
