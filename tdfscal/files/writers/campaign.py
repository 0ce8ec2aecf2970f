"""Simulated campaigns as folders: rig.yaml, a log, tracker files, truth.yaml."""

from __future__ import annotations

import os
from collections.abc import Callable, Mapping
from dataclasses import replace
from pathlib import Path
from typing import Any, Literal

import numpy as np

from tdfscal.errors import UsageError
from tdfscal.files.outputs import make_folder, replacing, together, writing
from tdfscal.files.saving import to_yaml, write_text
from tdfscal.files.writers import documents, logs
from tdfscal.records import Log, Rig, Rows
from tdfscal.simulation import (
    MOVING,
    Campaign,
    Options,
    Recorder,
    Run,
    SurveyOptions,
    reference_rig,
    run,
)
from tdfscal.simulation.scenarios import simulate_months

LogFormat = Literal["csv", "parquet", "mcap"]

#: What writes a log, and returns the rig file's `log` block that reads it.
_FORMATS: dict[LogFormat, Callable[[Path, Log], dict[str, Any]]] = {
    "csv": logs.write_csv,
    "parquet": logs.write_parquet,
    "mcap": logs.write_mcap,
}
#: What the rig file of a campaign in motion says of the delay, s.
STATED_DELAY = {"value": 0.0, "std": 0.02}
#: Relative standard uncertainty of the gain of the sample rig's sensors, as data sheets have it.
_GAIN = 1.0e-3
#: What a simulated campaign was made of.
TRUTH = "truth.yaml"


def sample_rig() -> Rig:
    """The reference rig with sensors whose gain is known as well as a data sheet says."""
    rig = reference_rig()
    return replace(rig, declared=replace(rig.declared, force_sensitivity=_GAIN))


def simulate_to_folder(
    folder: Path,
    rig: Rig | None = None,
    scenario: str = "self",
    *,
    format: LogFormat = "csv",
    postures: int = 24,
    tilt_deg: float = 5.0,
    squeeze: float = 200.0,
    seed: int = 0,
    recorder: Recorder | None = None,
    survey: SurveyOptions | None = None,
    rows: Rows = "timeseries",
    months: int = 12,
) -> Run:
    """Simulate a scenario on a rig (default: the reference rig) and write its campaign folder.

    tilt_deg : largest lean of a posture, degrees. squeeze : commanded internal forces, N, as
    `Options.squeeze`. recorder : rates, timing and noise; 100 Hz throughout by default.
    survey : the tracker session; by default 12 moves per NCP with the paper's tracker, 5 m away.
    months : of the scenario "months", which writes a folder each; the run is then the last one's.
    The same arguments and seed give the same bytes; another format gives the same numbers.

    Raises UsageError for an unknown scenario, impossible numbers, or a folder that is
    not empty; RigError and NotConvergedError as `simulate_campaign`.
    """
    check_folder(folder)
    options = Options(
        postures=postures,
        tilt=float(np.deg2rad(tilt_deg)),
        squeeze=squeeze,
        rows=rows,
        recorder=recorder or Recorder(),
    )
    rng, drawn = np.random.default_rng(seed), rig or sample_rig()
    if scenario == "months":  # the same gains every month: a turn shows against them
        drawn = rig or reference_rig()
        return _months(drawn, options, folder, format, months, seed)
    if scenario in MOVING:
        rate = options.recorder.force_rate
        moving = MOVING[scenario]
        if scenario in ("motion", "stops"):
            moving = replace(moving, tilt=options.tilt, squeeze=squeeze)
        played = run(drawn, scenario, replace(moving, rate=rate), rng, survey)
    else:
        played = run(drawn, scenario, options, rng, survey)
    write_run(played, folder, format=format, seed=seed)
    return played


def _months(
    rig: Rig,
    options: Options,
    folder: Path,
    format: LogFormat,
    months: int,
    seed: int,
) -> Run:
    """Write `<date>/` with rig.yaml, log and truth.yaml per campaign, and truth.yaml of all."""
    played = simulate_months(rig, options, np.random.default_rng(seed), months)
    runs = [Run("months", rig, c.truth, c, None) for c in played.campaigns]
    with together():
        make_folder(folder)
        for date, of_month in zip(played.dates, runs, strict=True):
            place = folder / date[:7]
            write_run(of_month, place, format=format, seed=seed)
        story = {"name": "months", "seed": seed}
        _write(folder / TRUTH, documents.months_document(played, story))
    return runs[-1]


def write_campaign(campaign: Campaign, folder: Path, *, format: LogFormat) -> None:
    """Write a campaign without a tracker session; see `write_run`."""
    played = Run("self", campaign.rig, campaign.truth, campaign, None)
    write_run(played, folder, format=format)


def write_run(
    played: Run,
    folder: Path,
    *,
    format: LogFormat,
    seed: int | None = None,
) -> None:
    """Write rig.yaml, log.csv | .parquet | .mcap, truth.yaml and, with a survey, tracker/*.csv.

    The log holds the campaign's doubles to the last bit (CSV: positions in mm, to one rounding);
    of one in motion a delay's std is stated. Nothing appears before all of it is written.

    Raises UsageError for signals that do not fit the format, or a folder that is not empty.
    """
    check_folder(folder)
    recorded, survey = played.campaign or played.moving, played.survey
    rig = played.rig if recorded is None else recorded.rig
    story = {"name": played.scenario} | ({} if seed is None else {"seed": seed})
    block: dict[str, Any] = {}
    tracker = None
    with writing(folder), together():
        make_folder(folder)
        if recorded is not None:
            with replacing(folder / f"log.{format}") as beside:
                block = _FORMATS[format](beside, recorded.log)
        if played.moving is not None:
            block["delay"] = STATED_DELAY
        if survey is not None:
            documents.write_session(folder / "tracker", survey.session)
            tracker = documents.tracker_block(survey)
        rig_file = documents.rig_document(rig, block or None, tracker)
        _write(folder / "rig.yaml", rig_file)
        _write(folder / TRUTH, documents.truth_document(played, rig, story))


def _write(path: Path, document: Mapping[str, Any]) -> None:
    write_text(path, to_yaml(document))


def check_folder(folder: Path) -> None:
    """Raise UsageError for a folder that cannot be made, or that is not empty."""
    there = next(p for p in (folder.absolute(), *folder.absolute().parents) if os.path.lexists(p))
    if not there.is_dir() or not os.access(there, os.W_OK):
        what = "may not be written to" if there.is_dir() else "this is a file, not a folder"
        raise UsageError(what, where=str(there), hint="choose another folder")
    if folder.is_dir() and any(folder.iterdir()):
        raise UsageError("the folder is not empty", where=str(folder), hint="name a new folder")
