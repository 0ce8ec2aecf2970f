"""The Python interface, as its documentation shows it."""

import doctest
import pickle
from pathlib import Path

import numpy as np
import pytest

import tdfscal
from tdfscal.frozen import FrozenInstanceError, replace

SAMPLES = Path(__file__).parents[1] / "sample_data"


def test_the_example_in_the_documentation(monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.chdir(SAMPLES.parent)
    assert doctest.testmod(tdfscal).failed == 0


def test_step_by_step(sample: tdfscal.Calibration, tmp_path: Path) -> None:
    rig = tdfscal.load_rig(SAMPLES / "mcap" / "rig.yaml")
    dwells = tdfscal.find_dwells(tdfscal.read_log(SAMPLES / "mcap" / "log.mcap", rig))
    assert len(dwells) == 16
    tdfscal.save_calibration(sample, tmp_path / "c.json")
    again = tdfscal.load_calibration(tmp_path / "c.json")
    assert np.array_equal(again.to_frame()["value"], sample.rpy.ravel())


def test_every_public_name_is_there_and_documented() -> None:
    for name in set(tdfscal.__all__) - {"__version__"}:
        assert getattr(tdfscal, name).__doc__, name
    assert set(tdfscal.__all__) == set(dir(tdfscal))


def test_an_error_says_the_same_in_another_process() -> None:
    with pytest.raises(tdfscal.UsageError) as caught:
        tdfscal.calibrate("")
    again = pickle.loads(pickle.dumps(pickle.loads(pickle.dumps(caught.value))))
    assert type(again) is tdfscal.UsageError
    assert (str(again), again.hint) == (str(caught.value), caught.value.hint)


def test_a_calibration_goes_to_another_process(sample: tdfscal.Calibration) -> None:
    assert pickle.loads(pickle.dumps(sample)) == sample


def test_what_is_read_twice_is_equal() -> None:
    once, twice = (tdfscal.load_rig(SAMPLES / "mcap" / "rig.yaml") for _ in range(2))
    assert once == twice
    assert hash(once) == hash(twice)
    moved = replace(once.rig, hinge=once.rig.hinge + 1e-3)
    assert once != replace(twice, rig=moved)


def test_a_calibration_is_not_made_or_changed_by_hand(sample: tdfscal.Calibration) -> None:
    with pytest.raises(tdfscal.UsageError, match="load_calibration"):
        tdfscal.Calibration(status="accepted")
    for part, name in ((sample, "status"), (sample.rig, "name"), (sample.supports[0], "name")):
        with pytest.raises(FrozenInstanceError):
            setattr(part, name, "x")
