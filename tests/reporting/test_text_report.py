"""The report in a terminal and in a pipe."""

from __future__ import annotations

import io
import math
import re
import sys
from typing import Any

import pytest
from rich.console import Console

from tdfscal.catalogue import document
from tdfscal.files.calibration.document import Calibration
from tdfscal.findings import Finding, Value
from tdfscal.reporting.advice import advise
from tdfscal.reporting.calibration import calibration_report
from tdfscal.reporting.figures.log_time import clock
from tdfscal.reporting.history import short
from tdfscal.reporting.text import render as as_text
from tdfscal.reporting.text import show_on, shown, table
from tests.reporting.pages import render_page
from tests.reporting.samples import NASTY, changed, fit_with, sample, surveyed
from tests.words import found


def render(c: Calibration) -> str:
    return as_text(calibration_report(c))


EPOCH = 1_750_000_000.25


def shifted(c: Calibration, by: float) -> Calibration:
    """The same calibration from a log whose time starts later."""
    content = c.model_dump()
    for key in ("start", "end"):
        content["postures"][key] = [t + by for t in content["postures"][key]]
        for rejected in content["fit"]["rejected"]:
            rejected[key] += by
    return Calibration.model_validate(content)


def with_(c: Calibration, status: str = "rejected", **parts: Any) -> Calibration:
    return changed(c, status=status, findings=(found("a reason", "rejects"),), **parts)


def test_eighty_columns_and_verdict_first() -> None:
    for c in (sample(touched=True).calibration, *surveyed()):
        lines = render(c).splitlines()
        assert lines[0] == "Test rig: ACCEPTED"
        assert max(map(len, lines)) <= 80
        assert not any(line != line.rstrip() for line in lines)


def test_a_summary_fits_a_terminal() -> None:
    """Verdict, one number for all angles, what it rests on, angles, what next: 24 lines of 80.

    Two are left for the files. The number is the farthest end of any interval; what is cut is
    counted.
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
        assert f"each within ± {1e3 * half:.2g} mrad (95 %)" in said
    loud = changed(sample(n=6).calibration, findings=[found("a word " * 30)] * 9)
    lines = as_text(calibration_report(loud), whole=False).splitlines()
    assert len(lines) <= 22
    assert "Warnings: 9; see `tdfscal report` or the page" in lines


def test_forecasts_are_of_the_number_that_is_told() -> None:
    """Five more postures of 12 count their information 17/12 times."""
    c = sample().calibration
    assert c.observability is not None
    (more,) = (f for f in c.observability.forecasts if f.change == "postures")
    assert math.sqrt(12 / 17) <= more.worst_std / c.rpy_std.max() < 1
    assert "5 more such postures" in advise(c)[-1]
    rejected = with_(c)
    assert not any("such postures" in text for text in advise(rejected))


def test_every_angle_in_mrad() -> None:
    c = sample().calibration
    text = render(c)
    for support in c.mounted:
        for value, std in zip(support.rpy, support.rpy_std, strict=True):
            assert re.search(rf" {1e3 * value:.3f} +{1e3 * std:.3f} ", text)


def test_dates_in_the_log_are_counted_from_its_start() -> None:
    """Simulated logs start at 0, so that the words do not change when epoch seconds are added."""
    c = sample(touched=True).calibration
    assert c.postures is not None
    first = c.postures.start[0]
    assert 0 <= first < 1
    later = shifted(c, EPOCH - 0.25)
    assert clock(later).origin == EPOCH - 0.25
    assert [line for line in render(later).splitlines() if "posture 5" in line] == [
        line for line in render(c).splitlines() if "posture 5" in line
    ]


def test_small_times_stay_as_the_log_has_them() -> None:
    c = shifted(sample(touched=True).calibration, 3600.0)
    assert clock(c).origin == 0.0
    assert "posture 5 (36" in render(c)


def test_advice_follows_the_cause() -> None:
    c = sample().calibration
    fit = c.model_dump()["fit"]
    assert "tdfscal validate" in advise(c)[0]
    assert "Do not load this result into a controller" in advise(with_(c))[-1]
    assert "force_sensitivity" in advise(with_(c, fit=fit_with(c, 9.0)))[0]
    gone = [{"index": k, "reason": "contact"} for k in range(3)]
    assert "touched the terminal" in advise(with_(c, fit=fit | {"rejected": gone}))[0]
    rig = c.rig.model_dump(mode="json", exclude_none=True)
    rig["acceptance"]["angle_std"] = 1e-6
    assert "weakest angle" in advise(with_(c, rig=rig))[0]
    joint = surveyed()[1]
    worst: dict[str, Value] = {"angle": "yaw", "difference": 9.0, "en": 4.0, "above": 1, "of": 9}
    found_apart = document(Finding("methods-disagree", p_value=1e-9, values=worst, rejects=True))
    assert "each method alone" in " ".join(
        advise(changed(joint, status="rejected", findings=[found_apart]))
    )


def on_terminal(c: Calibration, monkeypatch: pytest.MonkeyPatch, **settings: str) -> str:
    for name in ("NO_COLOR", "TERM", "FORCE_COLOR", "COLORTERM", "COLUMNS"):
        monkeypatch.delenv(name, raising=False)
    monkeypatch.setenv("TERM", "xterm-256color")
    for name, value in settings.items():
        monkeypatch.setenv(name, value)
    stream = io.StringIO()
    show_on(
        Console(file=stream, force_terminal=True, width=80, highlight=False),
        calibration_report(c),
    )
    return stream.getvalue()


def test_terminal_shows_the_same_as_plain_text(monkeypatch: pytest.MonkeyPatch) -> None:
    c = sample(touched=True).calibration
    coloured = on_terminal(c, monkeypatch)
    assert "\x1b[" in coloured
    plain = re.sub(r"\x1b\[[0-9;]*m", "", coloured)
    assert max(map(len, plain.splitlines())) <= 80
    for token in render(c).replace("largest before", "").split():
        if re.fullmatch(r"-?\d+\.\d{2,}", token):
            assert token in plain


def test_no_color(monkeypatch: pytest.MonkeyPatch) -> None:
    said = on_terminal(sample().calibration, monkeypatch, NO_COLOR="1")
    assert not re.search(r"\x1b\[[0-9;]*3[0-9]", said)
    assert "✓ ACCEPTED" in said


def test_markup_in_names_is_only_text(monkeypatch: pytest.MonkeyPatch) -> None:
    c = changed(sample(n=6, name=NASTY).calibration, findings=(found("[red]not markup[/red]"),))
    assert "[red]not markup[/red]" in on_terminal(c, monkeypatch)


def test_a_pipe_gets_plain_text_and_a_terminal_a_frame(
    capsys: pytest.CaptureFixture[str], monkeypatch: pytest.MonkeyPatch
) -> None:
    c = sample().calibration
    assert shown(calibration_report(c)) == render(c)
    monkeypatch.setattr(sys.stdout, "isatty", lambda: True)
    assert "╭" in shown(calibration_report(c))
    assert capsys.readouterr().out == ""


def test_the_turn_from_a_nominal_mounting_is_shown(monkeypatch: pytest.MonkeyPatch) -> None:
    """A nominal yaw 20 mrad away, written a whole turn off: the short way round is shown."""
    c = sample().calibration
    assert "turn" not in render(c)
    rig = c.rig.model_dump(mode="json", exclude_none=True)
    yaw = c.mounted[1].rpy[2]
    near = yaw - 0.02
    rig["supports"][1]["nominal_rpy"] = [0.0, 0.0, near - math.copysign(2 * math.pi, near)]
    for text in (render(changed(c, rig=rig)), on_terminal(changed(c, rig=rig), monkeypatch)):
        plain = re.sub(r"\x1b\[[0-9;]*m", "", text)
        assert "turn from the nominal mounting" in plain
        assert re.search(rf"yaw +{1e3 * yaw:.3f} +\+20\.000 ", plain)
        assert max(map(len, plain.splitlines())) <= 80
    assert "+20.000" in render_page(changed(c, rig=rig))


def test_columns_that_go_on_below_are_not_cut_besides(monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setenv("COLUMNS", "40")
    header = ("sensor", "value", "interval", "dominant source")
    lines = table(header, [("ncp1", "-57.200", "-57.798 to -56.603", "earlier campaigns 99%")])
    assert max(map(len, lines)) <= 40
    assert any("earlier campaigns 99%" in line for line in lines)


def test_a_history_names_files_by_what_tells_them_apart() -> None:
    assert short(["2025/may.yaml", "2025/june.yaml"]) == ("may.yaml", "june.yaml")
    assert short(["may/c.yaml", "june/c.yaml"]) == ("may/c.yaml", "june/c.yaml")
