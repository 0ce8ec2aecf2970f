"""`python -m studies`: files, JSON, refusals."""

import json
from pathlib import Path

import pytest

from studies.__main__ import main
from tests.cli.running import rows
from tests.reporting.samples import sketch

RIG = Path(__file__).parents[2] / "studies" / "rig.yaml"


def test_sensitivity(
    tmp_path: Path, capsys: pytest.CaptureFixture[str], monkeypatch: pytest.MonkeyPatch
) -> None:
    sketch(monkeypatch)
    out = tmp_path / "out"
    assert main(["sensitivity", str(RIG), "-o", str(out), "--json"]) == 0
    document = json.loads(capsys.readouterr().out, parse_constant=pytest.fail)
    assert document["format"] == "tdfscal-study/1"
    assert json.loads((out / "study.json").read_text(encoding="utf-8")) == document
    text = (out / "fig-4.csv").read_text(encoding="utf-8")
    assert text.startswith("# tdfscal study")
    (out / "plain.csv").write_text(text.partition("\n")[2], encoding="utf-8")
    assert max(float(row["force, N"]) for row in rows(out / "plain.csv")) > 80.0
    assert (out / "fig-4.svg").is_file()
    assert "<svg" in (out / "study.html").read_text(encoding="utf-8")


@pytest.mark.parametrize(
    ("words", "said"),
    [
        ("accuracy nowhere -o DIR", "nowhere"),
        ("accuracy RIG -o DIR --runs 2", "--runs"),
        ("table2 RIG -o DIR --runs 1", "--runs"),
        ("docking RIG -o DIR --runs -1", "--runs"),
        ("causes RIG -o DIR --seed -1", "seed"),
        ("sensitivity RIG -o DIR --calibration none.yaml", "none.yaml"),
        ("causes RIG -o DIR --calibration none.yaml", "--calibration"),
        ("sensitivity RIG -o FOLDER", "other files"),
        ("sensitivity RIG -o RIG", "is no folder"),
    ],
)
def test_refusals(
    words: str, said: str, tmp_path: Path, capsys: pytest.CaptureFixture[str]
) -> None:
    out = tmp_path / "out"
    line = (
        words.replace("DIR", str(out)).replace("RIG", str(RIG)).replace("FOLDER", str(RIG.parent))
    )
    before = RIG.read_bytes()
    assert main(line.split()) == 2
    seen = capsys.readouterr()
    assert seen.out == ""
    assert said in seen.err
    assert not out.exists()
    assert before == RIG.read_bytes()
