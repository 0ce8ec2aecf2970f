"""As found and as left, residuals of each axis, the next due date."""

from __future__ import annotations

import re
from pathlib import Path

import numpy as np
import pytest

from tdfscal.files.calibration.document import Calibration, save_calibration
from tdfscal.files.calibration.parts import MeasuredResult
from tdfscal.numerics import so3
from tdfscal.numerics.distributions import chi2_sf
from tdfscal.reporting.layout import Facts, Table
from tdfscal.reporting.several import as_found
from tdfscal.reporting.traceability import campaign
from tests.cli.running import run
from tests.reporting.samples import of_another_log, sample, sketch


def test_the_change_is_what_lies_between_the_two() -> None:
    one, other = of_another_log(sample(seed=1).calibration), sample(seed=2).calibration
    table = as_found(other, "before.yaml", one).blocks[0]
    assert isinstance(table, Table)
    cells = np.array([[float(x) for x in row[2:]] for row in table.rows])
    np.testing.assert_allclose(cells[:, 0], 1e3 * one.rpy.ravel(), atol=5e-4)
    np.testing.assert_allclose(cells[:, 1], 1e3 * other.rpy.ravel(), atol=5e-4)
    change = 1e3 * so3.deviations(other.rotation, one.rotation).ravel()
    np.testing.assert_allclose(cells[:, 2], change, atol=5e-4)
    expanded = 2e3 * np.hypot(one.rpy_std, other.rpy_std).ravel()
    np.testing.assert_allclose(cells[:, 3], expanded, atol=5e-4)
    np.testing.assert_allclose(cells[:, 4], np.abs(change) / expanded, atol=6e-3)


def test_report_takes_the_calibration_before(
    tmp_path: Path, capsys: pytest.CaptureFixture[str], monkeypatch: pytest.MonkeyPatch
) -> None:
    sketch(monkeypatch)
    files = [tmp_path / "now.yaml", tmp_path / "before.yaml"]
    for path, seed in zip(files, (2, 1), strict=True):
        save_calibration(sample(seed=seed).calibration, path)
    page = tmp_path / "page.html"
    seen = run(capsys, "report", files[0], "--previous", files[1], "--html", page, "-q")
    assert seen.status == 0, seen.err
    assert "as found" in seen.out
    assert "As found, as left" in page.read_text()
    both = run(capsys, "report", *files, "--previous", files[1])
    assert both.status == 2
    assert "leave --previous out" in both.err


def test_residuals_of_each_axis_are_as_uncertain_as_is_said() -> None:
    """Leave-one-out residuals of many campaigns, each axis over its std: mean square 1."""
    squares = []
    for seed in range(1, 5):
        table = sample(seed=seed).calibration.postures
        assert table is not None
        assert table.force_std is not None
        assert table.moment_std is not None
        for value, std in ((table.force_after, table.force_std),
                           (table.moment_after, table.moment_std)):  # fmt: skip
            squares.append((np.array(value) / np.array(std)) ** 2)
    total, count = float(np.sum(squares)), np.size(squares)
    # Leave-one-out residuals are correlated, which widens the sum: half the count is safe.
    assert 1e-4 < chi2_sf(total / 2, count // 2) < 1 - 1e-4


def _due(c: Calibration) -> str:
    block = campaign(c)[0].blocks[0]
    assert isinstance(block, Facts)
    said = dict(block.rows)
    return str(said.get("Next due", ""))


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
