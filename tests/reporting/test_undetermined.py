"""The page of a calibration without angles: what is weak, the log, what next; never an angle."""

from dataclasses import replace

import numpy as np
import pytest

from tdfscal.errors import NotIdentifiableError
from tdfscal.records import InputFile
from tdfscal.reporting.html import render
from tdfscal.reporting.undetermined import Attempt, undetermined_drawings, undetermined_report
from tdfscal.simulation import Options, simulate_dwells
from tests.reporting.samples import rig_of
from tests.reporting.test_page import read
from tests.selfcal.campaigns import fitted

FLOATING = Options(postures=16, stiffness=np.array([1e3, 1e3, 2e7]))
TOUCHED = 5


def attempt() -> Attempt:
    """Carriages that give way sideways and no squeeze; something pushes at one posture."""
    loaded = rig_of(3, "Test rig")
    dwells = simulate_dwells(loaded.rig, FLOATING, np.random.default_rng(1), 1).dwells(0)
    force = dwells.force.copy()
    force[TOUCHED - 1, 0] += [0.0, 0.0, 60.0]
    with pytest.raises(NotIdentifiableError) as caught:
        fitted(loaded.rig, replace(dwells, force=force))
    log = InputFile("campaign/<1>.csv", "ab" * 32, 1234, "verified")
    return Attempt(
        caught.value, loaded, (log,), ("a gap of 3 s",), ("campaign",), "tdfscal calibrate"
    )


def test_what_cannot_be_seen_is_named_and_what_can_is_not(monkeypatch: pytest.MonkeyPatch) -> None:
    """Under vertical loads alone a sensor's turn about the vertical is free, its others are not."""
    monkeypatch.setattr("tdfscal.reporting.html.to_svg", lambda drawing: "<svg></svg>")
    made = attempt()
    page = read(render(undetermined_report(made, undetermined_drawings(made)))).words
    said = " ".join(" ".join(page).split())
    assert "✗ NOT IDENTIFIABLE" in said
    assert "6 of 9 turns are determined" in said
    why = said[said.index("Why") : said.index("What next")]
    assert "do not determine yaw of every sensor, but" in why
    assert "turn about X and turn about Y of every sensor to ±" in why
    assert said.index("Squeeze the NCPs") < said.index("tdfscal plan RIG -o plan.csv")
    assert "tdfscal plan RIG -o plan.csv" in page  # as code
