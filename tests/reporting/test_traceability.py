"""What an auditor finds in a report: serial numbers, people, dates, assumptions, rules."""

import re
from pathlib import Path
from typing import Any

import numpy as np
import pytest
import yaml

from tdfscal import apply, calibrate, capability, compare, validate
from tdfscal.catalogue import cure, document
from tdfscal.files.calibration.document import Calibration
from tdfscal.files.calibration.parts import MeasuredResult
from tdfscal.findings import Finding
from tdfscal.numerics.distributions import coverage_factor
from tdfscal.reporting.advice import advise
from tdfscal.reporting.calibration import calibration_report
from tdfscal.reporting.headline import exact_name, headline, uncounted
from tdfscal.reporting.layout import Facts
from tdfscal.reporting.text import render
from tdfscal.reporting.traceability import campaign_facts
from tests.reporting.samples import changed, sample


def stated(**more: Any) -> Calibration:
    c = sample().calibration
    rig = c.rig.model_dump(mode="json", exclude_none=True)
    rig |= {"serial": "RH-02", "campaign": {"operator": "A. Muster", "site": "Hall 3"}, **more}
    rig["supports"][1]["sensor"] = {"serial": "T-7", "certificate": "D-K-15", "due": "2031-03-01"}
    return changed(c, rig=rig)


def facts(c: Calibration) -> dict[str, str]:
    blocks = (b for s in calibration_report(c).sections for b in s.blocks if isinstance(b, Facts))
    return {name: text for block in blocks for name, text in block.rows}


@pytest.mark.parametrize(
    ("size", "apart", "named"), [((0.8, 0.7), 0, 2), ((0.8, 0.7), 1, 2), ((0.1, 1.1), 0, 1)]
)
def test_what_is_exact_adds_up(size: tuple[float, float], apart: int, named: int) -> None:
    """In quadrature, in units of the claim at k = 1; what is named is what is to be stated."""
    exact = {"base level": "gravity.tilt_std", "servo datums": "uncertainty.datum"}
    c = sample().calibration
    half = c.half_widths.max() / coverage_factor(0.95)
    names = [support.name for support in c.supports]
    quantities = [
        {
            "name": name, "error": 1.0, "unit": "N",
            "effect": [(half * part * np.eye(3)[k * apart]).tolist()] * len(names),
        }
        for k, (name, part) in enumerate(zip(exact, size, strict=True))
    ]  # fmt: skip
    c = changed(c, taken_as_exact=quantities)
    assert len(uncounted(c)) == named
    first = advise(c)[0]
    for name, key in exact.items():
        assert (f"{name} (" in headline(c)) == (f"`{key}`" in first)
    sizes = np.diag(size) if apart else np.diag([np.hypot(*size), 0.0])
    total = np.hypot(c.half_widths, c.half_widths.max() * np.pad(sizes.sum(0), (0, 1))).max()
    told = re.search(r"if so, reckon with ± ([\d.]+) mrad", headline(c))
    assert told
    assert float(told[1]) == pytest.approx(1e3 * total, rel=0.05)


def test_angles_of_perhaps_exchanged_cables_are_not_to_be_loaded() -> None:
    found = Finding("fields-crossed", ("ncp1", "ncp3"))
    c = changed(sample().calibration, findings=[document(found)])
    assert headline(c).startswith("Do not load these angles before the cables of ncp1 and ncp3 are")
    assert "You may load" not in headline(c)
    assert advise(c)[0].startswith("Trace the cables of ncp1, ncp3")


def test_what_is_not_stated_is_said() -> None:
    """Operator, site and serials; what is taken as exact: what the file lists, and what is 0."""
    bare, known = facts(sample().calibration), facts(stated())
    for name in ("Serial number", "Operator", "Site"):
        assert name in bare["Not stated"]
        assert name in known
    assert "certificates of the sensors" in bare["Not stated"]
    papers = [known[f"Sensor of support_{k}"] for k in (1, 2)]
    assert [text.count("not stated") for text in papers] == [3, 0]
    assert re.search(r"T-7\b.* D-K-15\b.* 2031-03-01", papers[1])
    exact = bare["Taken as exact"].split("; ")
    listed = [exact_name(stated(), q.name) for q in stated().taken_as_exact]
    assert exact[: len(listed)] == listed
    assert exact[-1].startswith("magnitude of gravity")
    for moment in (0.0, 0.3):
        c = sample().calibration
        rig = c.rig.model_dump(mode="json", exclude_none=True)
        rig["uncertainty"]["hinge_moment"] = moment
        told = facts(changed(c, rig=rig))
        assert ("friction" in told["Taken as exact"]) == (moment == 0.0)
        assert ("unknown effect" in told["uncertainty.hinge_moment"]) == (moment == 0.0)
        mass, bary = rig["terminal"]["mass"], rig["terminal"]["barycenter"]
        assert told["terminal.mass"] == f"{mass['value']:g}, std {mass['std']:g} kg"
        places = (f"({', '.join(f'{v:g}' for v in bary[key])})" for key in ("value", "std"))
        assert told["terminal.barycenter"] == f"{', std '.join(places)} m"


def test_conformity_stands_beside_the_rule() -> None:
    """Each quantity whose limit is stated."""
    limits = {"angle_std": 2e-3, "contact": {"force": 5.0}}
    part = {"expanded": 1.25, "exceeding": 1e-4, "conforms": True}
    judged = {"rpy": [0.0, 0.0, 0.0], "force": part | {"limit": 5.0}, "torque": part}
    c = changed(stated(acceptance=limits), conformity=judged)
    said = facts(c)["Contact wrench"]
    assert "probability < 0.001;" in said
    assert "force conforms: U = 1.25 N, limit 5 N" in said
    assert "torque" not in said
    assert f"({facts(c)['Taken as exact']}) is exact" in said
    finding = {"code": "gain-suspected", "severity": "rejects", "text": "the gain of support_1"}
    c = changed(c, status="rejected", findings=[finding])
    assert "conforms" not in render(calibration_report(c))
    assert facts(c)["Contact wrench"] == "not judged: the result is rejected"


def test_what_an_error_of_the_tare_does(request: pytest.FixtureRequest, tmp_path: Path) -> None:
    """One component of the zeros that is off by 1 N does no more than all of them in squares."""
    right = request.getfixturevalue("sample")
    told = re.search(
        r"tare counts .* 1 N off would move an angle by ([\d.]+) mrad", headline(right)
    )
    assert told
    folder = Path(__file__).parents[2] / "sample_data" / "parquet"
    rig = yaml.safe_load((folder / "rig.yaml").read_text())
    rig["supports"][0]["zero"]["value"] = [1.0, 0.0, 0.0]
    del rig["tracker"]
    (tmp_path / "rig.yaml").write_text(yaml.safe_dump(rig))
    wrong = calibrate(folder / "log.parquet", rig=tmp_path / "rig.yaml", trials=0)
    moved = 1e3 * float(np.abs(wrong.rpy - right.rpy).max())
    assert 0.1 * float(told[1]) < moved <= 1.05 * float(told[1])


@pytest.mark.parametrize("day", ["2021-01-01", "2019-01-01"])
def test_an_ended_certificate_is_told_wherever_the_calibration_is_used(
    tmp_path: Path, day: str
) -> None:
    """Ended before the data were recorded, or since."""
    rig = yaml.safe_load(Path("sample_data/csv/rig.yaml").read_text("utf-8"))
    rig["supports"][1]["sensor"] = {"serial": "T-7", "due": "2020-01-01"}
    rig["campaign"] = {"date": day}
    (tmp_path / "rig.yaml").write_text(yaml.safe_dump(rig), "utf-8")
    c = calibrate(["sample_data/csv/log.csv"], rig=tmp_path / "rig.yaml", trials=0)
    assert _due(c).startswith("now: ")
    told = [w for w in calibration_report(c).warnings if "ncp2" in w and "2020-01-01" in w]
    assert bool(told) is (day > "2020")
    check = ["sample_data/csv"]
    for used in (validate(c, check), apply(c, check), capability(c, check), compare(c, c)):
        ended = {f for f in used.findings if f.code == "sensor-overdue"}
        assert {f.subject for f in ended} == {("ncp2",)}
        renewed = f"{cure(ended.pop())}.".lower()
        report = used.to_report()
        assert report is not None
        assert renewed in report.advice[0].lower()
    assert (renewed in advise(c)[0].lower()) is (day > "2020")


def _due(c: Calibration) -> str:
    return dict(campaign_facts(c)).get("Next due") or ""


@pytest.mark.parametrize("walk", [1.2e-3, 2e-4])
def test_the_next_date_follows_from_the_drift_of_angles(walk: float) -> None:
    """limit² = std² + drift² months, at most two years."""
    c = sample().calibration
    day = "2026-01-01T00:00:00Z"
    rig = c.rig.model_copy(update={"drift": c.rig.drift.model_copy(update={"angle": walk})})
    measured = MeasuredResult(begin=day, end=day, source="log")
    known = c.model_copy(update={"rig": rig, "measured": measured})
    months = (known.rig.acceptance.angle_std**2 - known.rpy_std.max() ** 2) / walk**2
    found = re.match(r"\d{4}-\d{2}-\d{2}", _due(known))
    assert found is not None
    assert found[0] == str(np.datetime64("2026-01-01") + int(min(months, 24) * 30.4375))
    assert ("two years" in _due(known)) is bool(months > 24)
