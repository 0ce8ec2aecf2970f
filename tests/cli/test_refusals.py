"""Faults of a log's numbers: the contract's exit status, what is named, no file."""

import re
from collections.abc import Callable
from pathlib import Path

import pyarrow as pa
import pyarrow.parquet as pq
import pytest

from tests.cli.running import Cli, recorded

Break = Callable[[Path], object]


def edit_log(change: Callable[[pa.Table], pa.Table]) -> Break:
    """A fault in the log."""

    def apply(folder: Path) -> None:
        pq.write_table(change(pq.read_table(folder / "log.parquet")), folder / "log.parquet")

    return apply


def scaled(prefix: str, axes: str, factor: float) -> Callable[[pa.Table], pa.Table]:
    def change(table: pa.Table) -> pa.Table:
        names = [n for n in table.column_names if re.fullmatch(rf"ncp\d\.{prefix}[{axes}]", n)]
        return recorded(table, {name: table[name].to_numpy() * factor for name in names})

    return change


def with_nan(table: pa.Table) -> pa.Table:
    values = table["ncp2.fx"].to_numpy().copy()
    values[1234] = float("nan")
    return recorded(table, {"ncp2.fx": values})


FAULTS: dict[str, tuple[Break, str]] = {
    "NaN": (edit_log(with_nan), "ncp2.fx"),
    "kN read as N": (edit_log(scaled("f", "xyz", 1e-3)), "force_unit"),
}


@pytest.mark.parametrize("name", FAULTS)
def test_refused_without_a_file(name: str, campaign: Path, tmp_path: Path, cli: Cli) -> None:
    fault, word = FAULTS[name]
    fault(campaign)
    target = tmp_path / "result.yaml"
    target.write_text("untouched")
    seen = cli("calibrate", campaign, "-o", target, "--trials", 0, "-q", ends=3)
    assert word in seen.err
    assert target.read_text() == "untouched"
    assert [p.name for p in tmp_path.iterdir() if p.is_file()] == ["result.yaml"]
