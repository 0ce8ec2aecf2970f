"""What a verdict rests on, and what it advises: the JSON's findings, and the deciding p in text."""

from dataclasses import replace
from functools import cache
from typing import Any

import numpy as np
import pytest

from tdfscal.catalogue import documents
from tdfscal.catalogue.numbers import p_text
from tdfscal.reporting.changes import allowed, changes
from tdfscal.reporting.text import render
from tdfscal.reporting.validation import validation_document, validation_report
from tdfscal.significance import VALIDATION_ALARM
from tdfscal.validation.residual_wrench import AS_STATED, KnownNoise, Validation, validate
from tests.reporting.test_validation_page import origin_of_check
from tests.wrench.held_out import turned, world
from tests.wrench.test_tared import tared

TRIALS = 100
#: Noise as a calibration of this many degrees of freedom knows it.
KNOWN = KnownNoise(birge=1.001, dof=90)


@cache
def validation(turn: float, trial: int = 0, known: KnownNoise = AS_STATED) -> Validation:
    """Of a rig tared anew whose second sensor turned about y, rad."""
    held = world(TRIALS)
    dwells = turned(held, trial, 1, np.array([0.0, turn, 0.0])) if turn else held.held(trial)
    return validate(held.given[trial], tared(dwells, trial)[0], known=known)


def written(v: Validation) -> tuple[dict[str, Any], str]:
    origin = origin_of_check()
    document = {**validation_document(v, (), origin), "findings": documents(changes(v))}
    return document, " ".join(render(validation_report(v, (), origin)).split())


@pytest.mark.parametrize("turn", [0.0, 1.5e-3, 2e-3, 8e-3])
def test_the_verdict_is_what_its_own_numbers_say(turn: float) -> None:
    v = validation(turn)
    found, text = written(v)
    below = {
        "search": found["search_p_value"] < found["search_limit"],
        "chi2": found["p_value"] < found["chi2_limit"],
    }
    assert found["holds"] is not any(below.values())
    assert found["search_limit"] + found["chi2_limit"] == pytest.approx(VALIDATION_ALARM)
    # What decides is among what rejects, and stands in the text with its limit.
    key = {"search": ("search_p_value", "search_limit"), "chi2": ("p_value", "chi2_limit")}
    p, limit = (found[name] for name in key[found["decided_by"]])
    assert below[found["decided_by"]] or found["holds"]
    claim = text.split("Residual contact wrench")[0]
    assert f"{p_text(p)}, limit {limit:.3g}" in claim
    for name, (p, limit) in key.items():
        printed = f"{p_text(found[p])}, limit {found[limit]:.3g}" in claim
        assert printed or not (below[name] or found["holds"])


@pytest.mark.parametrize(("limit", "side"), [(1e3, "within"), (1e-3, "beyond")])
def test_what_the_rig_file_allows_stands_beside_the_largest_residual(
    limit: float, side: str
) -> None:
    v = validation(0.0)
    assert not list(allowed(v))
    v = replace(v, rig=replace(v.rig, acceptance=replace(v.rig.acceptance, contact_force=limit)))
    assert f"is {side} the {limit:g} N that the rig file allows" in written(v)[1]


def test_zeros_that_moved_are_no_proof_that_nothing_turned() -> None:
    """By 0.5 mrad or not, behind a tare: what the check is sure to see is larger."""
    for turn in (0.0, 5e-4):
        v = validation(turn)
        assert v.holds
        assert v.zeros.moved
        assert v.detectable[:, :2].max() > 5e-4


def test_a_chi2_that_does_not_reject_gives_no_reason_to_recalibrate() -> None:
    """The search alone rejects here: a p of χ² above its limit would contradict the verdict."""
    tested = (validation(2e-3, t, KNOWN) for t in range(8))
    v = next(v for v in tested if not v.holds and v.judged.p_value >= 0.01)
    found = written(v)[0]
    assert found["decided_by"] == "search"
    assert p_text(v.judged.p_value) not in found["why"]


def codes(found: dict[str, Any]) -> dict[str, str | None]:
    return {each["code"]: each["cure"] for each in found["findings"]}


def test_no_tare_is_advised_where_the_rig_changed() -> None:
    v = validation(8e-3)
    assert v.zeros.moved
    said = codes(written(v)[0])
    assert "change-sensor-turned" in said
    assert "zeros-moved" not in said
    assert said["zeros-beside-change"] is None
    several = len(v.suspected) > 1
    assert str(said["change-sensor-turned"]).startswith("if it is this") is several
    (moved,) = (f for f in changes(v) if f.code == "zeros-beside-change")
    told = np.abs(v.zeros.change) / v.zeros.change_std
    assert v.rig.supports[told.max(axis=1).argmax()] == moved.subject[0]
    held = validation(0.0)
    assert held.zeros.moved
    assert set(codes(written(held)[0])) == {"zeros-moved"}
