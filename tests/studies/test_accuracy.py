"""Campaigns calibrated by each method; sources of uncertainty that can be taken away."""

from __future__ import annotations

from dataclasses import replace
from typing import Any

import numpy as np
import pytest

from studies import accuracy, campaigns, causes, table2
from studies.campaigns import Setting, errors
from studies.statistics import deviation
from tdfscal.numerics import so3
from tdfscal.selfcal.pipeline import self_calibrate
from tdfscal.simulation import SurveyOptions, make_rig, reference_rig, simulate_dwells

RIG = reference_rig()
FEW = Setting(postures=10)


def test_maximum_likelihood_is_that_of_the_product() -> None:
    seed = np.random.SeedSequence(7)
    found = errors(RIG, Setting(), ("ml",), 2, seed)["ml"]
    block = np.random.SeedSequence(7).spawn(1)[0]
    batch = simulate_dwells(RIG, Setting().options, np.random.default_rng(block.spawn(2)[0]), 2)
    for k in range(2):
        own = self_calibrate(RIG, batch.dwells(k), rng=np.random.default_rng(0), max_trials=0)
        theirs = so3.to_rpy(own.fit.state.rotation) - batch.truth.rpy[k]
        assert (np.abs(found[k] - theirs) < 1e-9 * own.uncertainty.rpy_std).all()


def test_processes_change_no_number() -> None:
    one, two = (
        errors(RIG, FEW, ("linear", "angles"), 12, np.random.SeedSequence(3), workers=workers)
        for workers in (1, 2)
    )
    for method, error in one.items():
        np.testing.assert_array_equal(error, two[method])


def test_too_few_postures_give_no_entries() -> None:
    seed = np.random.SeedSequence(0)
    found = errors(RIG, Setting(postures=8), ("linear", "linear-forces"), 2, seed)
    assert np.isnan(found["linear"]).all()
    assert np.isfinite(found["linear-forces"]).all()


def test_the_papers_sources_are_positioners_and_noise() -> None:
    rig = replace(RIG, gravity_tilt_std=1e-3)
    assert campaigns.stated(rig) == (
        "sensor noise", "zeros", "mass", "barycentre", "hinges", "positioners",
        "gravity's direction",
    )  # fmt: skip
    own = campaigns.papers_sources(rig)
    assert campaigns.stated(own) == ("sensor noise", "positioners")
    assert own.declared.positioner == 1e-5
    assert own.declared.force_noise == 0.0


def test_eq_24_alone_of_noise_is_exact_without_it() -> None:
    """No source left: every estimator finds the truth."""
    rig = campaigns.without(campaigns.papers_sources(RIG), "positioners")
    silent = replace(Setting(), noise=0.0)
    arms = ("linear", "linear-forces", "angles", "angles-forces")
    found = errors(rig, silent, arms, 2, np.random.SeedSequence(1))
    for error in found.values():
        # The servo coordinates have 0.3 µm of encoder noise over 0.6 m, some of a microradian.
        assert np.abs(error).max() < 1e-4


@pytest.mark.slow
def test_where_eq_24_is_below_the_tracker_and_where_not() -> None:
    """Theory, section 17: ahead with 100 postures and 1000 N, behind with 24 and 200 N."""
    own = campaigns.papers_sources(RIG)
    seed = np.random.SeedSequence(2)
    tracker = errors(own, Setting(9), ("tracker",), 20, seed, SurveyOptions())["tracker"]
    ahead = errors(own, Setting(100, 1000.0, 0.1), ("linear",), 20, seed)["linear"]
    behind = errors(own, Setting(24, 200.0, 0.1), ("linear",), 20, seed)["linear"]
    assert table2.against(ahead, tracker).every.value < -30.0
    found = table2.against(behind, tracker)
    assert found.every.value > 100.0
    # Roll and pitch alone are ahead even there.
    assert found.leaning.value < 0.0
    share = deviation(behind) / deviation(tracker)
    assert found.every.value == pytest.approx(100 * (share - 1))


@pytest.mark.slow
def test_the_map_has_every_cell(monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setattr(table2, "NOISES", (0.1,))
    monkeypatch.setattr(table2, "POSTURES", (6, 24))
    monkeypatch.setattr(table2, "SQUEEZES", (200.0,))
    study = table2.run(RIG, SurveyOptions(), 4, 1)
    cells = next(t for t in study.all_tables if t.name == "cells")
    assert len(cells.rows) == 2 * 1 * 2 * 1 * 2
    # Six postures are too few for 27 numbers, and the sentence counts what is known.
    assert any("Eq. 24, sources of the paper" in note and "of 1 cases" in note
               for note in study.notes)  # fmt: skip
    assert study.drawings[0].paint()


@pytest.mark.slow
def test_causes_are_those_that_were_taken_away() -> None:
    study = causes.run(RIG, SurveyOptions(), 6, 1)
    table = study.tables[0]
    rows: dict[Any, Any] = {row[0]: row[1:] for row in table.rows}
    assert set(rows) == {causes.WHOLE, causes.PAPERS, causes.SQUEEZED, *campaigns.stated(RIG)}
    # Theory, section 17: angles by moments alone put the barycentre's millimetre into roll.
    angles = {name: row[2].value for name, row in rows.items()}
    assert angles["barycentre"] < 0.3 * angles[causes.WHOLE]
    forces = {name: row[1].value for name, row in rows.items()}
    assert forces[causes.WHOLE] < 0.5 * rows[causes.WHOLE][0].value
    assert any("angles: of single sources, taking barycentre away" in note for note in study.notes)


def test_accuracy_of_both_cases() -> None:
    study = accuracy.run(make_rig(4), SurveyOptions(), 4, 1)
    bias = next(t for t in study.tables if t.name == "bias")
    assert len(bias.rows) == 6
    every = next(t for t in study.tables if t.name == "errors")
    assert len(every.rows) == 6 * 4
    table = next(t for t in study.tables if t.name == "angles-rig")
    own = [row[3:] for row in every.rows if row[:2] == ("rig", "tracker")]
    assert len(table.columns) == 2 + 6
    said: Any = table.rows[-1][-1]
    assert said.value == pytest.approx(1e3 * deviation(np.array(own, dtype=float)))
    assert {item.figure for item in study.beside} == {"Table 3"}
