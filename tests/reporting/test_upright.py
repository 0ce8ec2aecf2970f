"""A sensor pitched by 90°: roll and yaw are one turn, and no interval of them stands anywhere."""

import re
from dataclasses import replace
from pathlib import Path

import numpy as np
import pytest

from tdfscal.commands.result import Calibration as InPython
from tdfscal.files.calibration.document import Calibration, load_calibration
from tdfscal.files.calibration.from_results import from_self
from tdfscal.files.rig.reading import parse_rig
from tdfscal.numerics import so3
from tdfscal.reporting.calibration import calibration_report
from tdfscal.reporting.text import render
from tdfscal.selfcal.pipeline import self_calibrate
from tdfscal.simulation import Options, simulate_dwells
from tests.reporting.pages import render_page
from tests.reporting.samples import RIG, provenance, saved, sketch

UPRIGHT = 1


@pytest.fixture(scope="module", params=[0, 500], ids=["linear", "trials"])
def upright(request: pytest.FixtureRequest) -> Calibration:
    turns = 2 * np.pi * np.arange(3) / 3
    pitch = [np.pi / 2 if i == UPRIGHT else 0.0 for i in range(3)]
    lines = [
        f"  - {{name: s{i}, hinge: [{0.6 * np.cos(a)}, {0.6 * np.sin(a)}, 0.0], "
        f"nominal_rpy: [0.0, {pitch[i]}, 0.0], zero: {{value: [0, 0, 0], std: [0.5, 0.5, 0.5]}}}}"
        for i, a in enumerate(turns)
    ]
    loaded = parse_rig(RIG.format(name="R", supports="\n".join(lines)).encode(), "rig.yaml")
    near = replace(loaded.rig, rpy_std=np.full((3, 3), 1e-3))
    batch = simulate_dwells(near, Options(postures=12, squeeze=200.0), np.random.default_rng(3), 1)
    assert so3.locked(batch.truth.rotation[0]).tolist() == [False, True, False]
    result = self_calibrate(
        loaded.rig, batch.dwells(0), rng=np.random.default_rng(0), max_trials=request.param
    )
    return from_self(result, provenance(loaded))


def test_the_file_states_no_uncertainty(upright: Calibration, tmp_path: Path) -> None:
    read = load_calibration(saved(upright, tmp_path, "c.yaml"))
    for i, support in enumerate(read.supports):
        assert support.rpy_interval is not None
        open_ = [i == UPRIGHT] * 3
        for stated in (support.rpy_std, support.rpy_interval.low, support.rpy_interval.high):
            assert [value is None for value in stated] == open_


def test_frame_text_and_page(upright: Calibration, monkeypatch: pytest.MonkeyPatch) -> None:
    sketch(monkeypatch)
    frame = InPython.of(upright).to_frame()
    own = frame["support"] == f"s{UPRIGHT}"
    assert frame.loc[own, ["low", "high"]].isna().all(axis=None)
    assert frame.loc[~own, ["low", "high"]].notna().all(axis=None)
    rows = re.findall(r"(s\d) +(?:roll|pitch|yaw) .* to ", render(calibration_report(upright)))
    assert rows == [f"s{k}" for k in range(3) if k != UPRIGHT for _ in range(3)]
    assert not re.search(r"\b(inf|nan|None)\b", render_page(upright))
