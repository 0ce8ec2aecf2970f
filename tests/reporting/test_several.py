"""Several calibrations: order, drift, E_n by hand, and the commands that show them."""

import hashlib
import json
from pathlib import Path

import numpy as np
import pytest
from scipy.spatial.transform import Rotation

from tdfscal.files.calibration.document import Calibration
from tdfscal.reporting.layout import Report, Table
from tdfscal.reporting.several import Several, by_date, several_report
from tdfscal.reporting.traceability import Making
from tests.cli.running import Cli
from tests.reporting.samples import by_hand, sample, saved
from tests.words import found

STD = 2e-4


def flat(yaw: float, created: str, status: str = "accepted", std: float = STD) -> Calibration:
    """Sensors at roll = pitch = 0, where rpy_std is the covariance's; yaw of the second is given.

    Turns about Z, so that differences of yaw are exact.
    """
    c = sample().calibration
    content = c.model_dump()
    content["covariance"]["matrix"] = (std**2 * np.eye(9)).tolist()
    for i, support in enumerate(content["supports"]):
        turn = yaw if i == 1 else 0.0
        rotation = Rotation.from_euler("z", turn)
        support |= {
            "rotation": rotation.as_matrix().tolist(),
            "rpy": (0.0, 0.0, turn),
            "rpy_std": (std, std, std),
            "turn_std": (std, std, std),
            "quaternion_xyzw": rotation.as_quat().tolist(),
        }
    reasons = ("too few postures",) if status == "rejected" else ()
    content |= {
        "created": created,
        "measured": {"begin": created, "end": created, "source": "log"},
        "dwells": None,
        "status": status,
        "findings": [found(reason, "rejects") for reason in reasons],
    }
    content["inputs"] = [
        {"path": "log.csv", "sha256": hashlib.sha256(created.encode()).hexdigest(), "bytes": 1}
        | {"integrity": "verified"}
    ]
    return by_hand(content)


JANUARY = flat(0.0, "2026-01-05T08:00:00Z")
FEBRUARY = flat(5e-4, "2026-02-05T08:00:00Z")
MARCH = flat(1.5e-3, "2026-03-05T08:00:00Z")


def several(calibrations: list[tuple[str, Calibration]]) -> Report:
    return several_report(Several.of(calibrations), Making("tdfscal report", ()))


def test_oldest_first_and_e_n_by_hand() -> None:
    given = [("m", MARCH), ("j", JANUARY), ("f", FEBRUARY)]
    view = Several.of(sorted(given, key=by_date))
    assert [name for name, _ in view.named] == ["j", "f", "m"]
    root = 2 * np.sqrt(2) * STD
    for comparison, change in zip(view.comparisons, (5e-4, 1.5e-3), strict=True):
        assert comparison.en[1, 2] == pytest.approx(change / root, rel=1e-9)
        assert comparison.chi2 == pytest.approx(change**2 / (2 * STD**2), rel=1e-9)
    assert not view.verified
    tables = [
        b for b in several_report(view, Making("", ())).blocks()
        if isinstance(b, Table) and "minus" in b.caption
    ]  # fmt: skip
    assert [table.caption.split(",")[0] for table in tables] == ["f minus j", "m minus j"]
    for table, en in zip(tables, ("0.88", "! 2.65"), strict=True):
        rows = {row[:2]: row[3] for row in table.rows}
        assert rows["support_2", "yaw"] == en
        assert rows["support_1", "yaw"] == "0.00"


def test_of_another_rig_nothing_agrees(tmp_path: Path, cli: Cli) -> None:
    """A serial that both state tells two rigs apart, whatever the angles say."""

    def of(calibration: Calibration, serial: str) -> Calibration:
        content = calibration.model_dump()
        content["rig"]["serial"] = serial
        return by_hand(content)

    mine, other = of(JANUARY, "R-1"), of(FEBRUARY, "R-2")
    paths = [saved(c, tmp_path, name) for c, name in ((mine, "a.json"), (other, "b.json"))]
    for command in ("report", "compare"):
        said = " ".join(cli(command, *paths).out.split())
        assert "R-2 instead of R-1" in said or "R-1 instead of R-2" in said
        assert "COMPATIBLE" not in said
        assert "Keep" not in said
        assert "where its rig file was only corrected" in said
    content = json.loads(paths[0].read_text())
    bare = tmp_path / "bare.json"
    bare.write_text(json.dumps({k: v for k, v in content.items() if k != "content_sha256"}))
    found = cli.json("compare", bare, saved(FEBRUARY, tmp_path, "f.json"))
    (pair,) = found["comparisons"]
    told = {each["code"]: each["subject"] for each in pair["findings"]}
    assert told == {key: [str(bare)] for key in ("serials-untold", "calibration-unsealed")}
    found = cli.json("report", bare, "--html", tmp_path / "bare.html")
    assert found["verified"] is False
    assert found["calibrations"][0]["content_sha256"] is None
    said = (tmp_path / "bare.html").read_text("utf-8") + cli("report", bare).out
    assert content["content_sha256"][:8] not in said
    assert cli.json("report", paths[0])["verified"] is True
    same = several([("a", mine), ("b", of(FEBRUARY, "R-1"))])
    assert same.verdict == "COMPATIBLE"
    assert several([("a", mine), ("b", other)]).verdict == "NOT COMPARABLE"
