"""Residuals of each axis, the next due date."""

from __future__ import annotations

import re

import numpy as np
import pytest

from tdfscal.files.calibration.document import Calibration
from tdfscal.files.calibration.parts import MeasuredResult
from tdfscal.files.rig.model import Sensor
from tdfscal.numerics.distributions import chi2_sf
from tdfscal.reporting.traceability import campaign_facts
from tests.reporting.samples import sample


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
    return dict(campaign_facts(c)).get("Next due", "")


def test_a_date_before_the_measurement_is_now() -> None:
    """Measured on 2026-11-20: a certificate that ended before is due, a later one at its end."""
    day = MeasuredResult(begin="2026-11-20T00:00:00Z", end="2026-11-20T00:00:00Z", source="log")
    for end, said in (("2026-01-01", "now: "), ("2027-01-01", "2027-01-01, ")):
        c = sample().calibration.model_copy(deep=True, update={"measured": day})
        support = c.rig.supports[0].model_copy(update={"sensor": Sensor(due=end)})
        supports = (support, *c.rig.supports[1:])
        c = c.model_copy(update={"rig": c.rig.model_copy(update={"supports": supports})})
        assert _due(c).startswith(said)
        assert end in _due(c)


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
