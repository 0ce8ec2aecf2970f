"""The report in a terminal and in a pipe."""

import re
import sys

import pytest

from tdfscal.files.calibration.document import Calibration, file_content
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
    the table.
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


def test_a_tare_that_is_exact_on_one_sensor_has_no_error_of_typical_size() -> None:
    c = sample().calibration
    first, *others = c.rig.supports
    exact = first.model_copy(
        update={"zero": first.zero.model_copy(update={"std": (0.0, 0.0, 0.0)})}
    )
    rig = c.rig.model_copy(update={"supports": (exact, *others)})
    assert "tare counts" not in render(c.model_copy(update={"rig": rig}))
