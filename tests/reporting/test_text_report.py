"""The report in a terminal and in a pipe."""

import re
import sys
from dataclasses import replace

import pytest

from tdfscal.catalogue import document
from tdfscal.files.calibration.document import Calibration, file_content
from tdfscal.findings import Finding
from tdfscal.reporting.calibration import calibration_report
from tdfscal.reporting.text import render as as_text
from tdfscal.reporting.text import shown
from tests.reporting.samples import NASTY, changed, sample, surveyed
from tests.words import found


def render(c: Calibration) -> str:
    return as_text(calibration_report(c))


def test_eighty_columns_and_verdict_first() -> None:
    for c in (sample(touched=True).calibration, *surveyed()):
        lines = render(c).splitlines()
        assert lines[0] == "Test rig: ACCEPTED"
        assert lines[-1] == f"Report {file_content(c)['content_sha256'][:8]}"
        assert max(map(len, lines)) <= 80
        assert not any(line != line.rstrip() for line in lines)


def test_a_summary_fits_a_terminal() -> None:
    """Verdict, one number for all angles, what it rests on, angles, what next: 24 lines of 80.

    Two are left for the files. The number is the farthest end of any interval, written as in
    the table; what is cut is counted.
    """
    for c in (sample().calibration, sample(n=6).calibration, *surveyed()):
        report = calibration_report(c)
        lines = as_text(report, whole=False).splitlines()
        assert len(lines) <= 22
        assert max(map(len, lines)) <= 80
        said = " ".join(" ".join(lines).split())
        half = max(
            max(value - (low or 0), (high or 0) - value)
            for m in c.mounted
            for low, value, high in zip(m.interval.low, m.rpy, m.interval.high, strict=True)
        )
        told = re.search(r"each is known to within ± ([\d.]+) mrad \(95 %\)", said)
        assert told
        assert ("constant" in said) == (c.method != "tracker")  # contact that no residual shows
        assert float(told[1]) == pytest.approx(1e3 * half, rel=0.05)
        beside = [(float(width), width) for width in re.findall(r"\d ± ([\d.]+)(?! mrad)", said)]
        assert max(beside)[1] == told[1]
    loud = changed(sample(n=6).calibration, findings=[found("a word " * 30)] * 9)
    lines = as_text(calibration_report(loud), whole=False).splitlines()
    assert len(lines) <= 22
    assert "Warnings (9; -v shows all)" in lines
    quiet = replace(calibration_report(loud), warnings=(), advice=("Look. " * 30, "Then " * 30))
    lines = as_text(quiet, whole=False).splitlines()
    assert "What next (the first of 2; -v shows all)" in lines


def test_all_lines_of_a_draft_stand_in_the_first_paragraph() -> None:
    """The whole summary still fits a terminal."""
    c = sample(n=6).calibration
    keys = [f"{s.name}.{key}" for s in c.supports for key in ("hinge", "zero", "nominal_rpy")]
    at = {f"supports.{key}": 23 + k + 2 * (k // 3) for k, key in enumerate(keys)}
    at = {"gravity": 8, "terminal.mass": 11, **at, "log.time": 70, "log.delay": 71}
    at["log.supports.support_1"] = 75
    lines = [f"{key}: {{value: 1}} (line {number})" for key, number in at.items()]
    lines[-1] = lines[-1].replace(": {value: 1}", "")  # a block has no value of its own
    draft = document(Finding("draft-unconfirmed", tuple(lines), len(lines)))
    open_ = changed(c, status="provisional", findings=(draft,))
    text = as_text(calibration_report(open_), whole=False)
    assert len(text.splitlines()) <= 22
    first = " ".join(text.split("\n\n")[0].split())
    assert f"{len(lines)} unconfirmed lines" in first
    assert "gravity (line 8); terminal: mass (line 11); supports: hinge, zero, nominal_rpy" in first
    assert "(line 23–25, 28–30, 33–35, 38–40, 43–45, 48–50); log: time, delay, supports" in first
    assert "(line 70–71, 75)" in first


def test_a_terminal_shows_the_same_with_colours(monkeypatch: pytest.MonkeyPatch) -> None:
    c = changed(sample(n=6, name=NASTY).calibration, findings=(found("[red]no markup[/red]"),))
    report = calibration_report(c)
    assert shown(report) == as_text(report)
    monkeypatch.setattr(sys.stdout, "isatty", lambda: True)
    for name in ("NO_COLOR", "FORCE_COLOR", "COLORTERM", "COLUMNS"):
        monkeypatch.delenv(name, raising=False)
    monkeypatch.setenv("TERM", "xterm-256color")
    coloured = shown(report)
    assert "\x1b[" in coloured
    assert re.sub(r"\x1b\[[0-9;]*m", "", coloured) == as_text(report)
    monkeypatch.setenv("NO_COLOR", "1")
    assert not re.search(r"\x1b\[[0-9;]*3[0-9]", shown(report))
