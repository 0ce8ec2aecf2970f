"""What an auditor finds in a report: serial numbers, people, dates, assumptions, rules."""

from __future__ import annotations

import xml.etree.ElementTree as ET
from typing import Any

from tdfscal.exports.certificate import SPACES, certificate
from tdfscal.files.calibration.document import Calibration
from tdfscal.reporting.calibration import calibration_report
from tdfscal.reporting.layout import Facts, Table
from tdfscal.reporting.text import render
from tests.reporting.samples import changed, sample, surveyed


def stated(due: str = "2031-03-01", **more: Any) -> Calibration:
    c = sample().calibration
    rig = c.rig.model_dump(mode="json", exclude_none=True)
    rig |= {"serial": "RH-02", "campaign": {"operator": "A. Muster", "site": "Hall 3"}, **more}
    rig["supports"][1]["sensor"] = {"serial": "T-7", "certificate": "D-K-15", "due": due}
    return changed(c, rig=rig)


def facts(c: Calibration) -> dict[str, str]:
    blocks = (b for s in calibration_report(c).sections for b in s.blocks if isinstance(b, Facts))
    return {name: text for block in blocks for name, text in block.rows}


def test_papers_of_rig_and_sensors() -> None:
    c = stated()
    found = facts(c)
    assert (found["Serial number"], found["Operator"], found["Site"]) == (
        "RH-02",
        "A. Muster",
        "Hall 3",
    )
    tables = (b for s in calibration_report(c).sections for b in s.blocks if isinstance(b, Table))
    (papers,) = (t for t in tables if "serial number" in t.header)
    assert papers.rows == (("support_2", "T-7", "D-K-15", "2031-03-01"),)
    assert "A. Muster" in render(calibration_report(c))


def test_instruments_stand_on_the_page_and_in_the_certificate() -> None:
    """With the dates' origin, the assumptions and the rule."""
    papers = {"tracker": "LT-4711, D-K-20", "scale": "W-3, D-K-21", "date": "2026-11-21"}
    c = stated(campaign=papers)
    measured = {"begin": "2026-11-21T00:00:00Z", "end": "2026-11-22T00:00:00Z", "source": "file"}
    c = changed(c, measured=measured)
    found = facts(c)
    assert (found["Tracker"], found["Scale"]) == (papers["tracker"], papers["scale"])
    lines = [e.text for e in ET.fromstring(certificate(c)).iter(f"{{{SPACES['dcc']}}}content")]
    names = ("Tracker", "Scale", "Measured", "Taken as exact", "Decision rule")
    assert {f"{name}: {found[name]}" for name in names} <= set(lines)
    assert found["Measured"].endswith("by the file's date")


def test_a_rig_that_states_none_has_no_section() -> None:
    titles = [s.title for s in calibration_report(sample().calibration).sections]
    assert "Campaign and sensors" not in titles


def test_a_certificate_that_had_ended_is_a_warning() -> None:
    assert not any("certificate" in w for w in calibration_report(stated()).warnings)
    late = calibration_report(stated(due="2020-01-01")).warnings
    assert any("support_2" in w and "2020-01-01" in w for w in late)


def test_what_is_taken_as_exact() -> None:
    """The sample's rig declares noise, hinges and positioner, and prior zeros unknown."""
    exact = facts(sample().calibration)["Taken as exact"]
    assert "servo datums" in exact
    assert "direction of gravity" in exact
    assert "hinges" not in exact.replace("friction of the hinges", "")
    assert "mass" not in exact
    tilted = stated(gravity={"magnitude": 9.80665, "tilt_std": 1e-3})
    assert "direction of gravity" not in facts(tilted)["Taken as exact"]
    assert "direction of gravity" not in facts(surveyed()[0])["Taken as exact"]


def test_the_rule_states_the_limits_of_the_rig() -> None:
    limits = {"angle_std": 2e-3, "birge_max": 1.5, "contact": {"force": 5.0, "torque": 3.0}}
    rule = facts(stated(acceptance=limits))["Decision rule"]
    assert "at most 2 mrad" in rule
    assert "at most 1.5 times what is stated" in rule
    assert "guard band of the expanded uncertainty" in rule
    assert "expanded uncertainty" not in facts(stated())["Decision rule"]
    assert "postures" not in facts(surveyed()[0])["Decision rule"]
