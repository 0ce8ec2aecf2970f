"""The page of `validate --html`: verdict, cause, figure and where it comes from."""

from __future__ import annotations

from dataclasses import replace
from functools import cache

import numpy as np
import pytest

from tdfscal.files.calibration.parameters import calibrated
from tdfscal.findings import Finding
from tdfscal.records import InputFile
from tdfscal.reporting.text import render
from tdfscal.reporting.validation import Origin, validation_report
from tdfscal.validation.residual_wrench import Validation, validate
from tests.reporting.pages import render_validation
from tests.reporting.samples import sample
from tests.reporting.test_page import read

LOG = InputFile("march/log.csv", "cd" * 32, 4321, "verified")
COMMAND = "tdfscal validate january.yaml march"


@cache
def validation(push: float, offset: float = 0.0) -> Validation:
    """Of the sample's own dwells; at the third of them something pushes along x, N."""
    dwells = sample().dwells
    force = dwells.force.copy()
    force[2, 0, 0] += push
    times = {name: getattr(dwells, name) + offset for name in ("start", "end")}
    given = calibrated(sample().calibration)
    return validate(given, replace(dwells, force=force, **times), rig=sample().rig.rig)


def words(v: Validation, *found: Finding) -> str:
    origin = Origin(sample().calibration, "january.yaml", COMMAND, "2026-03-02 10:00", (LOG,))
    page = render_validation(v, found, origin)
    assert "http" not in page.split("</style>")[1].split("<svg")[0]
    assert page.count("<svg") == 1
    return " ".join(read(page).words)


def test_still_valid() -> None:
    v = validation(0.0)
    assert v.holds
    said = words(v, Finding("rig-renamed", values={"own": "a warning", "other": "b"}))
    assert "STILL VALID" in said
    assert "Keep this calibration in use" in said
    assert "a warning" in said
    assert f"{len(v.dwells)} of {len(v.dwells)}" in said
    assert all(text in said for text in ("january.yaml", COMMAND, LOG.sha256, "4,321"))


def test_what_changed_is_named_with_its_posture() -> None:
    v = validation(60.0)
    assert not v.holds
    said = words(v)
    assert v.outcome == "touched"
    assert "RECORD AGAIN" in said
    assert "contact in posture 3" in said
    worst = np.linalg.norm(v.calibrated[:, :3], axis=1).max()
    assert f"the largest is {worst:.2g} N, at posture 3" in said


@pytest.mark.parametrize("push", [0.0, 60.0])
def test_dates_count_from_the_first_dwell(push: float) -> None:
    start = float(sample().dwells.start[0])
    assert 0 <= start < 1
    dated, counted = (render(validation_report(validation(push, t), ())) for t in (1.75e9, 0.0))
    assert dated == counted
