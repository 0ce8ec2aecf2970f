"""`--from` and `--to`: a part of a log is what a log cut by hand would be."""

import shutil
from datetime import UTC, datetime
from pathlib import Path

import numpy as np
import pyarrow.compute as pc
import pyarrow.parquet as pq
import pytest

import tdfscal
from tests.cli.running import Cli, recorded

EPOCH = datetime(2026, 11, 21, 9, 30, tzinfo=UTC).timestamp()


def cut(folder: Path, low: float, high: float) -> Path:
    """The same campaign with a log that holds these times only."""
    other = Path(shutil.copytree(folder, folder.with_name("cut")))
    table = pq.read_table(other / "log.parquet")
    time = table["time"]
    part = table.filter(pc.and_(pc.greater_equal(time, low), pc.less_equal(time, high)))
    pq.write_table(part, other / "log.parquet")
    return other


def forces(folder: Path, **options: object) -> list[list[list[float]]]:
    """Mean forces of the dwells, which the calibration is of."""
    dwells = tdfscal.info(folder, **options).description.dwells  # type: ignore[arg-type]
    assert dwells is not None
    return np.asarray(dwells.force).tolist()  # type: ignore[no-any-return]


def span(folder: Path) -> tuple[float, float]:
    time = pq.read_table(folder / "log.parquet")["time"].to_numpy()
    return float(time[0]), float(time[-1])


def shifted(folder: Path, by: float) -> None:
    table = pq.read_table(folder / "log.parquet")
    moved = recorded(table, {"time": table["time"].to_numpy() + by})
    pq.write_table(moved, folder / "log.parquet")


def test_a_part_is_what_a_log_cut_by_hand_is(campaign: Path) -> None:
    begin, end = span(campaign)
    low, high = begin + 0.1 * (end - begin), begin + 0.8 * (end - begin)
    by_hand = forces(cut(campaign, low, high))
    assert by_hand != forces(campaign)
    assert forces(campaign, from_=low, to=high) == by_hand
    assert forces(campaign, from_=f"{1e3 * low!r}ms", to=f"{high / 60!r} min") == by_hand
    shifted(campaign, EPOCH)
    relative = forces(campaign, from_=f"+{low - begin!r}", to=f"+{high - begin!r}s")
    dates = [datetime.fromtimestamp(EPOCH + t, UTC) for t in (low, high)]
    assert relative == forces(campaign, from_=dates[0].isoformat(), to=dates[1].isoformat())
    assert relative == forces(campaign, from_=dates[0], to=dates[1].replace(tzinfo=None))
    np.testing.assert_allclose(relative, by_hand, rtol=0, atol=1e-3)  # N; of a coarser clock


@pytest.mark.parametrize(
    ("options", "said"),
    [
        (["--from", "soon"], "is no time"),
        (["--from", "5d"], "is no time"),
        (["--to", "nan"], "is no time"),
        (["--from", "20", "--to", "10"], "not before"),
        (["--from", "+1e9"], "no sample lies"),
        (["--to", "-5"], "no sample lies"),
        (["--from", "2026-11-21 09:30"], "clock has no dates"),
        (["--to", "2026-11-21 09:30"], "clock has no dates"),
    ],
)
def test_no_part_of_the_log(options: list[str], said: str, campaign: Path, cli: Cli) -> None:
    done = cli("calibrate", campaign, *options, "-o", campaign / "out.yaml", "-q")
    assert done.status == (3 if "sample" in said else 2)
    assert said in done.err
    assert len(done.err.splitlines()) == 1
    assert not (campaign / "out.yaml").exists()
