"""Every fault a user may bring: one paragraph, the contract's exit status, no file."""

from __future__ import annotations

import re
import shutil
from collections.abc import Callable
from pathlib import Path
from typing import Any

import pyarrow as pa
import pyarrow.parquet as pq
import pytest
import yaml

from tests.cli.running import SAMPLES, run

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
        for i, name in enumerate(table.column_names):
            if re.fullmatch(rf"ncp\d\.{prefix}[{axes}]", name):
                values = pa.array(table[name].to_numpy() * factor)
                table = table.set_column(i, name, values)
        return table

    return change


def renamed(mapping: dict[str, str]) -> Callable[[pa.Table], pa.Table]:
    return lambda table: table.rename_columns([mapping.get(c, c) for c in table.column_names])


def swap(kind: str) -> dict[str, str]:
    """Exchange two sensors' (f) or NCPs' columns."""
    pairs: dict[str, str] = {}
    for axis in "xyz":
        a, b = f"ncp1.{kind}{axis}", f"ncp2.{kind}{axis}"
        pairs |= {a: b, b: a}
    return pairs


def with_nan(table: pa.Table) -> pa.Table:
    values = table["ncp2.fx"].to_numpy().copy()
    values[1234] = float("nan")
    return table.set_column(table.column_names.index("ncp2.fx"), "ncp2.fx", pa.array(values))


def only_first_seconds(table: pa.Table) -> pa.Table:
    return table.slice(0, 150)


def never_at_rest(table: pa.Table) -> pa.Table:
    time = table["time"].to_numpy()
    for name in ("ncp1.x", "ncp2.x", "ncp3.x"):
        values = table[name].to_numpy() + 1e-3 * time
        table = table.set_column(table.column_names.index(name), name, pa.array(values))
    return table


FAULTS: dict[str, tuple[Break, int, str]] = {
    "missing log": (lambda f: (f / "log.parquet").unlink(), 2, "log"),
    "missing rig": (lambda f: (f / "rig.yaml").unlink(), 2, "rig"),
    "empty log": (lambda f: (f / "log.parquet").write_bytes(b""), 3, "log.parquet"),
    "truncated log": (
        lambda f: (f / "log.parquet").write_bytes((f / "log.parquet").read_bytes()[:-100]),
        3,
        "log.parquet",
    ),
    "empty rig": (lambda f: (f / "rig.yaml").write_text(""), 2, "rig.yaml"),
    "unknown key": (edit_rig(lambda d: d.update(gravty={})), 2, "gravity"),
    "two supports": (edit_rig(lambda d: d["supports"].pop()), 2, "three"),
    "negative mass": (
        edit_rig(lambda d: d["terminal"]["mass"].update(value=-5)),
        2,
        "mass",
    ),
    "wrong column": (edit_log(renamed({"ncp2.fx": "ncp2.force_x"})), 3, "ncp2.fx"),
    "NaN": (edit_log(with_nan), 3, "ncp2.fx"),
    "mm read as m": (edit_log(scaled("", "xyz", 1e3)), 3, "in mm"),
    "kN read as N": (edit_log(scaled("f", "xyz", 1e-3)), 3, "force_unit"),
    "reaction read as force": (edit_log(scaled("f", "xyz", -1.0)), 3, "force_on"),
    "mirrored axis": (edit_log(scaled("", "x", -1.0)), 3, "-X"),
    "swapped sensors": (edit_log(renamed(swap("f"))), 3, "ncp1 taken from ncp2"),
    "swapped axes": (
        edit_log(renamed({"ncp2.fx": "ncp2.fy", "ncp2.fy": "ncp2.fx"})),
        3,
        "Fx and Fy of ncp2 exchanged",
    ),
    "an axis of opposite sign": (edit_log(scaled("f", "x", -1.0)), 3, "sign of Fx of every sensor"),
    "swapped positions": (edit_log(renamed(swap(""))), 3, "ncp1 taken from ncp2"),
    "one posture": (edit_log(only_first_seconds), 4, "do not determine"),
    "dead axis": (edit_log(scaled("f", "y", 0.0)), 3, "dead"),
    "another rig": (
        edit_rig(lambda d: d["supports"][0].update(hinge=[0.62, 0.05, 0.0])),
        3,
        "hinge pattern",
    ),
}


#: The search for another wiring takes a second; one of its cases is always tried.
LONG = ("swapped axes", "an axis of opposite sign", "swapped sensors")


@pytest.mark.parametrize(
    "name", [pytest.param(n, marks=pytest.mark.slow if n in LONG else ()) for n in FAULTS]
)
def test_refused_in_one_paragraph_without_a_file(
    name: str, campaign: Path, tmp_path: Path, capsys: pytest.CaptureFixture[str]
) -> None:
    fault, status, word = FAULTS[name]
    fault(campaign)
    target = tmp_path / "result.yaml"
    target.write_text("untouched")
    seen = run(capsys, "calibrate", campaign, "-o", target, "--trials", 0, "-q")
    assert seen.status == status, seen.err
    assert word in seen.err
    assert seen.err.startswith("tdfscal: ")
    assert seen.err.count("\n") == 1
    assert "Traceback" not in seen.err
    assert seen.out == ""
    assert target.read_text() == "untouched"
    assert [p.name for p in tmp_path.iterdir() if p.is_file()] == ["result.yaml"]


def test_the_untouched_campaign_is_accepted(
    campaign: Path, tmp_path: Path, capsys: pytest.CaptureFixture[str]
) -> None:
    """The faults above are faults: without one the same command succeeds."""
    target = tmp_path / "result.json"
    seen = run(capsys, "calibrate", campaign, "-o", target, "--trials", 0, "-q")
    assert (seen.status, seen.err) == (0, "")
    assert "ACCEPTED" in seen.out
    assert target.is_file()


@pytest.mark.parametrize(
    ("arguments", "word"),
    [
        (["calibrate"], "PATH"),
        (["calibrate", "no-such-folder"], "no-such-folder"),
        (["calibrate", SAMPLES / "csv", "-o", "result.txt"], ".json"),
        (["calibrate", SAMPLES / "csv", "-o", "no/such/folder/result.json"], "folder"),
        (["calibrate", SAMPLES / "csv", "--method", "guess"], "guess"),
        (["calibrate", SAMPLES / "csv", "--trials", "-1"], "trials"),
        (["report", "no-such-file.yaml"], "no-such-file.yaml"),
        (["unknown"], "unknown"),
    ],
)
def test_usage(
    arguments: list[str | Path],
    word: str,
    tmp_path: Path,
    monkeypatch: pytest.MonkeyPatch,
    capsys: pytest.CaptureFixture[str],
) -> None:
    monkeypatch.chdir(tmp_path)
    seen = run(capsys, *arguments)
    assert seen.status == 2
    assert word in seen.err
    assert seen.out == ""
    assert not list(tmp_path.iterdir())


def test_a_point_file_without_a_unit(tmp_path: Path, capsys: pytest.CaptureFixture[str]) -> None:
    folder = tmp_path / "campaign"
    shutil.copytree(SAMPLES / "parquet", folder)
    edit_rig(lambda d: d["tracker"].pop("length_unit", None))(folder)
    seen = run(capsys, "calibrate", folder, "--method", "tracker", "-o", tmp_path / "r.json", "-q")
    assert seen.status in (2, 3)
    assert "unit" in seen.err
    assert not (tmp_path / "r.json").exists()


def test_a_log_that_never_rests_has_no_dwells(
    campaign: Path, tmp_path: Path, capsys: pytest.CaptureFixture[str]
) -> None:
    edit_log(never_at_rest)(campaign)
    target = tmp_path / "result.yaml"
    seen = run(capsys, "calibrate", campaign, "--samples", "static", "-o", target, "-q")
    assert seen.status == 3
    assert "dwell" in seen.err
    assert not target.exists()
