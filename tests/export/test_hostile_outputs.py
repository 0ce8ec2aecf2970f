"""Hostile names into certificates' pages, monitor pages, recordings, plans and drafts of rig files.

Each output is read by a parser of its format and says the same string.
"""

from __future__ import annotations

import csv
import json
from dataclasses import replace
from functools import cache
from pathlib import Path
from typing import Any

import numpy as np
import pytest
import yaml
from mcap.reader import make_reader

import tdfscal
from tdfscal.checks.rig_from_log import RigSketch
from tdfscal.commands.monitor import MonitorResult
from tdfscal.errors import visible
from tdfscal.files.rig.draft import draft
from tdfscal.files.writers.campaign import simulate_to_folder
from tdfscal.files.writers.plan import plan_csv
from tdfscal.files.writers.wrenches import recording
from tdfscal.findings import Finding
from tdfscal.planning.choice import make_plan
from tdfscal.planning.plan import Plan, Request
from tdfscal.reporting.text import render
from tdfscal.simulation import Recorder, reference_rig
from tests.export.test_hostile_text import (
    EACH,
    WILD,
    no_controls,
    squeezed,
    unescaped,
)
from tests.planning.limits import limits
from tests.reporting.test_page import read


@cache
def plan() -> Plan:
    rig = reference_rig()
    return make_plan(rig, Request(limits(rig), candidates=20), 4, np.random.default_rng(0))


@pytest.fixture(scope="module")
def monitored(tmp_path_factory: pytest.TempPathFactory) -> MonitorResult:
    home = tmp_path_factory.mktemp("monitor")
    made: list[tdfscal.Calibration] = []
    for name in ("a", "b"):
        recorder = Recorder(mean_sd=0.5)
        simulate_to_folder(home / name, postures=10, rows="postures", seed=1, recorder=recorder)
        rig = yaml.safe_load((home / name / "rig.yaml").read_text(encoding="utf-8"))
        rig["campaign"] = {"date": f"2026-0{len(made) + 1}-01"}
        (home / name / "rig.yaml").write_text(yaml.safe_dump(rig), encoding="utf-8")
        log = (home / name / "log.csv").read_text()
        (home / name / "log.csv").write_text(log + "\n" * len(made))
        made.append(tdfscal.calibrate(home / name, trials=0))
    return tdfscal.monitor(*made)


def on_page(text: str) -> str:
    """As a page shows a sentence: what stands between backquotes is set as code, without them."""
    return squeezed(visible(text)).replace("`", "")


@EACH
def test_monitor_pages_and_documents(
    line: str, wild: str, monitored: MonitorResult, monkeypatch: pytest.MonkeyPatch
) -> None:
    monkeypatch.setattr("tdfscal.reporting.html.to_svg", lambda drawing: "<svg></svg>")
    names = (f"folder/first {wild}", f"folder/second {wild}")
    result = replace(
        monitored,
        rig=replace(monitored.rig, name=f"rig {line}"),
        life=replace(monitored.life, names=names),
        findings=(Finding("campaign-noisy", (f"warning {line}",), 2.0),),
    )
    document = json.loads(json.dumps(result.to_dict(), ensure_ascii=False, allow_nan=False))
    assert document["rig"] == f"rig {line}"
    assert document["findings"][0]["subject"] == [f"warning {line}"]
    assert [check["name"] for check in document["checks"]] == list(names)
    words = " ".join(read(result.html).words)
    no_controls(words)
    report = result.to_report()
    assert report is not None
    no_controls(render(report))
    for text in (f"rig {line}", f"warning {line}"):
        assert on_page(text) in on_page(words)


@EACH
def test_recordings_of_wrenches(line: str, wild: str, tmp_path: Path) -> None:
    about = {"rig": f"rig {line}", "calibration": wild}
    with recording(tmp_path / "w.mcap", about, "lcs"):
        pass
    with (tmp_path / "w.mcap").open("rb") as file:
        (found,) = make_reader(file).iter_metadata()
    assert found.metadata == about


@EACH
def test_plans(line: str, wild: str) -> None:
    named = replace(plan(), rig=replace(plan().rig, name=f"rig {line}"))
    text = plan_csv(named, f"command {wild}")
    no_controls(text)
    # Lines as CSV readers and spreadsheets take them.
    remarks = [row for row in text.splitlines() if row.startswith("#")]
    assert unescaped(remarks[0]) == f"# tdfscal plan for rig {line}"
    assert unescaped(remarks[1]) == f"# command: command {wild}"
    rows = list(csv.DictReader(row for row in text.splitlines() if not row.startswith("#")))
    assert [row["posture"] for row in rows] == ["1", "2", "3", "4"]


@pytest.mark.parametrize("text", WILD, ids=ascii)
def test_drafts_of_rig_files(text: str) -> None:
    fields = [f"{text} {axis}" for axis in "xyz"]
    log: dict[str, Any] = {
        "time": {"field": f"time {text}", "unit": "s"},
        "supports": {f"ncp {text} {i}": {"position": fields, "force": text} for i in range(3)},
    }
    written = draft(
        text,
        RigSketch(
            hinge=np.zeros((3, 3)),
            spread=0.0,
            mass=500.0,
            barycentre=np.zeros(2),
            nominal_rpy=np.zeros((3, 3)),
            upright=(True,) * 3,
            turned=True,
            reference=0,
        ),
        {"mass": "x", "hinge": "y", "nominal_rpy": "z"},
        log,
        [f"the unit is taken from {text}"],
    )
    document = yaml.safe_load(written)
    assert document["name"] == text
    assert [support["name"] for support in document["supports"]] == list(log["supports"])
    assert document["log"]["supports"] == log["supports"]
    assert document["log"]["time"]["field"] == f"time {text}"
    assert document["log"]["delay"] == {"value": 0.0, "std": 0.005}
    assert len(document) == 8
