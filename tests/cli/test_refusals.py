"""Every fault a user may bring: one paragraph, the contract's exit status, no file."""

import re
from collections.abc import Callable
from pathlib import Path
from typing import Any

import pyarrow as pa
import pyarrow.parquet as pq
import pytest
import yaml

from tests.cli.running import Cli, recorded

Break = Callable[[Path], object]


def edit_rig(change: Callable[[dict[str, Any]], object]) -> Break:
    """A fault in rig.yaml."""

    def apply(folder: Path) -> None:
        document = yaml.safe_load((folder / "rig.yaml").read_text())
        change(document)
        (folder / "rig.yaml").write_text(yaml.safe_dump(document, sort_keys=False))

    return apply


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


FAULTS: dict[str, tuple[Break, int, str]] = {
    "missing log": (lambda f: (f / "log.parquet").unlink(), 2, "log"),
    "missing rig": (lambda f: (f / "rig.yaml").unlink(), 2, "rig"),
    "empty rig": (lambda f: (f / "rig.yaml").write_text(""), 2, "rig.yaml"),
    "NaN": (edit_log(with_nan), 3, "ncp2.fx"),
    "kN read as N": (edit_log(scaled("f", "xyz", 1e-3)), 3, "force_unit"),
    "dead axis": (edit_log(scaled("f", "y", 0.0)), 3, "dead"),
    "another rig": (
        edit_rig(lambda d: d["supports"][0].update(hinge=[0.62, 0.05, 0.0])),
        3,
        "hinge pattern",
    ),
}


@pytest.mark.parametrize("name", FAULTS)
def test_refused_without_a_file(name: str, campaign: Path, tmp_path: Path, cli: Cli) -> None:
    fault, status, word = FAULTS[name]
    fault(campaign)
    target = tmp_path / "result.yaml"
    target.write_text("untouched")
    seen = cli("calibrate", campaign, "-o", target, "--trials", 0, "-q", ends=status)
    assert word in seen.err
    assert seen.err.startswith("tdfscal: ")
    assert seen.err.count("\n") == 1
    assert "Traceback" not in seen.err
    assert seen.out == ""
    assert target.read_text() == "untouched"
    assert [p.name for p in tmp_path.iterdir() if p.is_file()] == ["result.yaml"]
