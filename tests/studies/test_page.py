"""The paper's page quotes records of the studies, and the records can be made again.

`benchmarks/paper/NAME.json` is what `python -m studies NAME studies/rig.yaml -o DIR --json` gave.
"""

import json
import math
import re
from collections.abc import Iterator
from pathlib import Path
from typing import Any

import pytest

from studies import sensitivity
from studies.__main__ import STUDIES, Asked, main, perform
from studies.statistics import Estimate
from tdfscal.files.rig.reading import load_rig
from tests.cli.running import rows
from tests.docs.pages import text
from tests.reporting.samples import sketch

RECORDS = Path(__file__).parents[2] / "benchmarks" / "paper"
#: Fewer runs than the records', of another seed.
RUNS = {"accuracy": 12, "table2": 6, "causes": 10, "free-space": 3, "docking": 3}
_SPREAD = re.compile(r"−?\d+(?:\.\d+)? ± \d+(?:\.\d+)?")


def record(name: str) -> dict[str, Any]:
    found: dict[str, Any] = json.loads((RECORDS / f"{name}.json").read_text(encoding="utf-8"))
    return found


def cells(document: dict[str, Any]) -> Iterator[tuple[tuple[str, ...], Any]]:
    """Every cell of the tables by table, first words of its row, and column."""
    for table, lines in document["tables"].items():
        for row in lines:
            words = [cell for cell in row.values() if isinstance(cell, str)]
            for column, cell in row.items():
                yield (table, *words[:3], column), cell


def said(cell: Any) -> str:
    if isinstance(cell, dict) and "standard_error" in cell:
        value, std = cell["value"], cell["standard_error"]
        return str(Estimate(math.nan if value is None else value, std or math.nan))
    return str(cell)


def test_there_is_a_record_of_every_study() -> None:
    assert {path.stem for path in RECORDS.glob("*.json")} == set(STUDIES)
    for name in STUDIES:
        assert f"python -m studies {name} studies/rig.yaml -o DIR" in text("paper")


def test_every_number_with_a_spread_stands_in_a_record() -> None:
    known = set()
    for name in STUDIES:
        document = record(name)
        words = [said(cell) for _, cell in cells(document)] + document["notes"]
        known |= {match for word in words for match in _SPREAD.findall(word)}
    quoted = set(_SPREAD.findall(text("paper")))
    assert len(quoted) > 30
    assert quoted <= known, quoted - known


def test_the_record_of_what_has_no_chance_in_it() -> None:
    study = sensitivity.run(load_rig(RIG).rig)
    again = dict(cells(json.loads(json.dumps(study.document()))))
    for place, cell in cells(record("sensitivity")):
        number = isinstance(cell, float)
        assert again[place] == (pytest.approx(cell, rel=1e-9, abs=1e-9) if number else cell)


@pytest.mark.slow
@pytest.mark.parametrize("name", RUNS)
def test_other_seeds_agree_within_the_stated_spread(name: str, tmp_path: Path) -> None:
    """Of hundreds of numbers one in a hundred may lie outside four standard errors of few runs."""
    asked = Asked(name, RIG, tmp_path / "out", runs=RUNS[name], seed=77)
    study, _ = perform(asked)
    again = dict(cells(json.loads(json.dumps(study.document()))))
    far, count = [], 0
    for place, cell in cells(record(name)):
        if isinstance(cell, dict) and cell.get("standard_error"):
            other = again[place]
            if other["value"] is None or not other["standard_error"]:
                continue
            # Scatter of so few runs is itself hardly known: it is not taken below the record's.
            few = RUNS[name] / max(STUDIES[name][1], 1)
            spread = math.hypot(
                cell["standard_error"],
                max(other["standard_error"], cell["standard_error"] / math.sqrt(few)),
            )
            count += 1
            if abs(other["value"] - cell["value"]) > 4.0 * spread:
                far.append((place, cell["value"], other["value"], spread))
    assert len(far) <= 0.02 * count, far


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
