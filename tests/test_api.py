"""The Python interface, as its documentation shows it."""

from __future__ import annotations

import doctest
from pathlib import Path

import numpy as np
import pytest

import tdfscal

SAMPLES = Path(__file__).parents[1] / "sample_data"


def test_the_example_in_the_documentation(monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.chdir(SAMPLES.parent)
    assert doctest.testmod(tdfscal).failed == 0


def test_step_by_step(tmp_path: Path) -> None:
    rig = tdfscal.load_rig(SAMPLES / "mcap" / "rig.yaml")
    dwells = tdfscal.find_dwells(tdfscal.read_log(SAMPLES / "mcap" / "log.mcap", rig))
    frame = tdfscal.dwells_frame(dwells)
    assert len(frame) == 3 * len(dwells) == 3 * 16
    result = tdfscal.calibrate(SAMPLES / "mcap", trials=0)
    tdfscal.save_calibration(result, tmp_path / "c.json")
    again = tdfscal.load_calibration(tmp_path / "c.json")
    assert np.array_equal(again.rpy, result.rpy)
    assert np.allclose(again.to_frame()["value"], result.rpy.ravel(), rtol=0, atol=0)


def test_errors_are_the_projects_own() -> None:
    with pytest.raises(tdfscal.TdfscalError, match="no-such-folder"):
        tdfscal.calibrate("no-such-folder")


def test_every_public_name_is_there_and_documented() -> None:
    for name in set(tdfscal.__all__) - {"__version__"}:
        assert getattr(tdfscal, name).__doc__, name
    assert set(tdfscal.__all__) == set(dir(tdfscal))


def test_a_notebook_shows_the_verdict_in_its_colour_and_mrad() -> None:
    c = tdfscal.calibrate(SAMPLES / "parquet", trials=0)
    card = c._repr_html_()
    assert '<strong style="color: #0f6b33">✓ ACCEPTED</strong>' in card
    for value in 1e3 * c.rpy.ravel():
        assert f"{value:.3f} ± ".replace("-", "−") in card
    assert "mrad" in card


def test_tab_shows_what_is_ours() -> None:
    c = tdfscal.calibrate(SAMPLES / "parquet", trials=0)
    for result in (c, tdfscal.validate(c, SAMPLES / "parquet")):
        names = dir(result)
        assert {"plot", "to_frame", "to_dict", "exit_status"} <= set(names)
        assert not [name for name in names if name.startswith(("_", "model_"))]
        assert not {"copy", "json", "dict", "construct", "schema"} & set(names)
    assert "annotations" not in dir(tdfscal)
