"""`python -m studies`: files, JSON, refusals."""

from __future__ import annotations

import json
from pathlib import Path

import pytest

from studies.__main__ import run
from tests.cli.running import SAMPLES, rows

RIG = SAMPLES / "csv"


def test_sensitivity(tmp_path: Path, capsys: pytest.CaptureFixture[str]) -> None:
    out = tmp_path / "out"
    assert run(["sensitivity", str(RIG), "-o", str(out), "--json"]) == 0
    assert json.loads(capsys.readouterr().out)["format"] == "tdfscal-study-sensitivity/1"
    worst = max(float(row["force_error_N"]) for row in rows(out / "sensitivity.csv"))
    assert worst > 80.0
    assert (out / "sensitivity-aligned.png").read_bytes().startswith(b"\x89PNG")


@pytest.mark.parametrize(
    ("words", "status", "said"),
    [
        (["accuracy", "nowhere", "-o", "DIR"], 2, "nowhere"),
        (["accuracy", str(RIG), "-o", "DIR", "--runs", "1"], 2, "--runs"),
        (["sensitivity", str(RIG), "-o", "DIR", "--calibration", "none.yaml"], 2, "none.yaml"),
    ],
)
def test_refusals(
    words: list[str],
    status: int,
    said: str,
    tmp_path: Path,
    capsys: pytest.CaptureFixture[str],
) -> None:
    out = tmp_path / "out"
    assert run([word.replace("DIR", str(out)) for word in words]) == status
    seen = capsys.readouterr()
    assert seen.out == ""
    assert said in seen.err
    assert not out.exists()
