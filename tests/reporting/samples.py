"""Calibrations to report on: from simulated dwells, through the real steps, once per session."""

from dataclasses import dataclass, replace
from functools import cache
from pathlib import Path
from typing import Any

import numpy as np
import pytest

from tdfscal.comparison.compatibility import combine
from tdfscal.files.calibration.document import Calibration, save_calibration
from tdfscal.files.calibration.from_results import Provenance, from_joint, from_self, from_tracker
from tdfscal.files.rig.reading import LoadedRig, parse_rig
from tdfscal.files.saving import plain
from tdfscal.records import Dwells, InputFile, Measured, Rotations
from tdfscal.reporting.figures import style
from tdfscal.selfcal.pipeline import SelfCalibration, self_calibrate
from tdfscal.simulation import Options, SurveyOptions, simulate_dwells, simulate_survey
from tdfscal.trackercal.pipeline import calibrate_tracker

RIG = """\
format: tdfscal-rig/1
name: "{name}"
terminal:
  mass: {{value: 500.0, std: 0.2}}
  barycenter: {{value: [0.01, -0.015, 0.25], std: [0.001, 0.001, 0.001]}}
supports:
{supports}
uncertainty: {{positioner: 1.0e-5, hinge: 2.0e-5, force_noise: 0.1}}
"""
NASTY = "Rig <b>$x_2$</b> & <script>alert(1)</script> {{ 7*7 }}"


@dataclass(frozen=True)
class Sample:
    """A result with the records behind it."""

    rig: LoadedRig
    dwells: Dwells
    result: SelfCalibration
    calibration: Calibration


def rig_of(n: int, name: str, last: str = "xyz") -> LoadedRig:
    turns = 2 * np.pi * np.arange(n) / n + 0.2
    lines = [
        f"  - {{name: support_{i + 1}, hinge: [{0.6 * np.cos(a):.4f}, {0.6 * np.sin(a):.4f}, "
        f"{0.02 * (-1) ** i:.2f}], zero: {{value: [0, 0, 0], std: [0.5, 0.5, 0.5]}}}}"
        for i, a in enumerate(turns)
    ]
    lines[-1] = f"{lines[-1][:-1]}, axes: [{', '.join(last)}]}}"
    text = RIG.format(name=name, supports="\n".join(lines))
    return parse_rig(text.encode(), "rig.yaml")


@cache
def sample(
    n: int = 3, postures: int = 12, seed: int = 1, name: str = "Test rig", touched: bool = False
) -> Sample:
    """A self-calibration; touched: a force of 80 N pushes at posture 5."""
    loaded = rig_of(n, name)
    options = Options(postures=postures, squeeze=200.0)
    dwells = simulate_dwells(loaded.rig, options, np.random.default_rng(seed), 1).dwells(0)
    if touched:
        force = dwells.force.copy()
        force[4, 0] += [80.0, 0.0, 0.0]
        dwells = replace(dwells, force=force)
    result = self_calibrate(loaded.rig, dwells, rng=np.random.default_rng(0), max_trials=4000)
    return Sample(loaded, dwells, result, from_self(result, provenance(loaded)))


@cache
def with_load_cell(axes: str = "z") -> Calibration:
    """Four supports, the last with the given axes only, which leave its mounting undetermined."""
    whole = rig_of(4, "Test rig")
    dwells = simulate_dwells(
        whole.rig, Options(postures=24, squeeze=200.0), np.random.default_rng(1), 1
    ).dwells(0)
    used = np.ones((4, 3), dtype=np.bool_)
    used[3] = [axis in axes for axis in "xyz"]
    loaded = rig_of(4, "Test rig", axes)
    dwells = replace(dwells, force=np.where(used, dwells.force, 0.0))
    result = self_calibrate(loaded.rig, dwells, rng=np.random.default_rng(0), max_trials=200)
    return from_self(result, provenance(loaded))


def provenance(loaded: LoadedRig) -> Provenance:
    log = InputFile("campaign/<1>.csv", "ab" * 32, 1234, "verified")
    when = Measured(1.7e9, 1.7e9 + 600.0, "log")
    return Provenance(loaded, (log,), "tdfscal calibrate campaign", 7, when)


@cache
def surveyed() -> tuple[Calibration, Calibration]:
    """A tracker's calibration and the joint one, of the rig and truth of one self-calibration."""
    base = sample()
    truth = simulate_dwells(
        base.rig.rig, Options(postures=12, squeeze=200.0), np.random.default_rng(1), 1
    ).truth
    survey = simulate_survey(
        base.rig.rig, truth.trial(0), SurveyOptions(), np.random.default_rng(3)
    )
    tracker = calibrate_tracker(base.rig.rig, survey.session, trials=1000)
    origin = provenance(base.rig)
    own = Rotations(
        base.rig.rig.supports, base.result.fit.state.rotation, base.result.uncertainty.covariance
    )
    both = combine(own, tracker.rotations)
    return (from_tracker(tracker, origin, ()), from_joint(both, base.result, tracker, origin, ()))


def changed(c: Calibration, **changes: Any) -> Calibration:
    """The same file with some fields altered, checked again; nothing marks its rig as edited."""
    return Calibration.model_validate(plain(c.model_dump() | changes))


def without_parameters(content: dict[str, Any]) -> dict[str, Any]:
    """No block of all parameters, nor what has its rows."""
    exact = [one | {"common": None, "apart": None} for one in content["taken_as_exact"]]
    return {"parameters": None, "taken_as_exact": exact}


def by_hand(content: dict[str, Any]) -> Calibration:
    """A calibration whose angles or covariance were put in by hand, without what would disagree."""
    content |= {"budget": None, "monte_carlo": None} | without_parameters(content)
    for support in content["supports"]:
        rpy, std = np.array(support["rpy"]), np.array(support["rpy_std"])
        ends = {"low": (rpy - 2 * std).tolist(), "high": (rpy + 2 * std).tolist()}
        support["rpy_interval"] = {"coverage": 0.95, **ends}
    return Calibration.model_validate(content)


def saved(c: Calibration, folder: Path, name: str) -> Path:
    path = folder / name
    save_calibration(c, path)
    return path


def sketch(patch: pytest.MonkeyPatch) -> None:
    """Let figures be painted for pages and files, and not rendered, which takes longer."""

    def svg(drawing: style.Drawing) -> str:
        style.to_figure(drawing)
        return "<svg></svg>"

    def save(drawing: style.Drawing, folder: Path) -> tuple[Path, ...]:
        folder.mkdir(exist_ok=True)
        path = folder / f"{drawing.name}.svg"
        path.write_text(svg(drawing))
        return (path,)

    patch.setattr("tdfscal.reporting.html.to_svg", svg)
    patch.setattr("studies.frame.save_drawing", save)
