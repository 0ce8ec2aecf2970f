"""Simulated campaigns as folders: rig.yaml, a log, tracker files, truth.yaml."""

from __future__ import annotations

import os
from collections.abc import Mapping
from dataclasses import asdict, replace
from pathlib import Path
from typing import Any

import numpy as np

from tdfscal.errors import UsageError
from tdfscal.files.outputs import make_folder, replacing, together
from tdfscal.files.rig.reading import DRIFT_UNITS
from tdfscal.files.saving import to_yaml, write_text
from tdfscal.files.writers.logs import LogFormat, write_log
from tdfscal.records import CampaignInfo, Drift, Rig, SensorInfo, TrackerSession
from tdfscal.simulation import MOVING, Campaign, Options, Run, SurveyOptions, reference_rig, run
from tdfscal.simulation.options import MovingOptions
from tdfscal.simulation.scenarios import simulate_months

#: What the rig file of a campaign in motion says of the delay, s.
STATED_DELAY = {"value": 0.0, "std": 0.02}
#: Relative standard uncertainty of the gain of the sample rig's sensors, as data sheets have it.
_GAIN = 1.0e-3
SQUEEZE = 200.0
"""Internal forces that are commanded where nothing else is asked for, N."""
#: What a simulated campaign was made of.
TRUTH = "truth.yaml"
_TRACKER: dict[str, Any] = {
    "targets": {"nominal": "tracker/nominal.csv", "measured": "tracker/targets.csv"},
    "moves": {"servo": "tracker/servo.csv", "measured": "tracker/moves.csv"},
}
#: Of the truth, what each support has of its own.
_OF_A_SUPPORT = ("rotation", "rpy", "zero", "sensitivity", "hinge", "datum", "stiffness")
#: What a SpatialAnalyzer export begins with.
_EXPORT = (
    "// SpatialAnalyzer export",
    "// AXES = CARTESIAN: X,  Y,  Z (mm)",
    "// Group,  Point,  X,  Y,  Z",
    "",
)


def rig_document(
    rig: Rig, log: Mapping[str, Any] | None = None, tracker: Mapping[str, Any] | None = None
) -> dict[str, Any]:
    """The rig file (`tdfscal-rig/1`) of a rig, with its `log` and `tracker` blocks."""
    terminal: dict[str, Any] = {"mass": rig.mass, "barycenter": rig.barycentre}
    if rig.inertia is not None:
        terminal["inertia"] = {"value": rig.inertia.value, "std": rig.inertia.std.max()}
    declared, compliance = _apart(asdict(rig.declared), "compliance_")
    if any(compliance.values()):
        declared["compliance"] = compliance
    acceptance, contact = _apart(asdict(rig.acceptance), "contact_")
    if rig.acceptance.states_contact:
        acceptance["contact"] = _stated(contact)
    drift = {name: getattr(rig.drift, name) * unit for name, unit in DRIFT_UNITS.items()}
    document = {
        "format": "tdfscal-rig/1",
        "name": rig.name,
        "gravity": {"magnitude": rig.gravity, "tilt_std": rig.gravity_tilt_std},
        "terminal": terminal,
        "supports": [_support(rig, i) for i in range(rig.n)],
        "uncertainty": declared,
        "drift": None if rig.drift == Drift() else drift,
        "campaign": _stated(rig.campaign) or None,
        "serial": rig.serial,
        "log": log,
        "tracker": tracker,
        "acceptance": acceptance,
    }
    return _stated(document)


def _apart(block: dict[str, Any], prefix: str) -> tuple[dict[str, Any], dict[str, Any]]:
    """Part a record's fields from those with a prefix, which are a block of their own."""
    inner = {n.removeprefix(prefix): value for n, value in block.items() if n.startswith(prefix)}
    return {n: value for n, value in block.items() if not n.startswith(prefix)}, inner


def _stated(block: CampaignInfo | SensorInfo | dict[str, Any]) -> dict[str, Any]:
    """Return what is not None."""
    items = block if isinstance(block, dict) else asdict(block)
    return {name: value for name, value in items.items() if value is not None}


def _support(rig: Rig, i: int) -> dict[str, Any]:
    axes = [axis for axis, used in zip("xyz", rig.axes[i], strict=True) if used]
    return _stated(
        {
            "name": rig.supports[i],
            "hinge": rig.hinge[i],
            "zero": {"value": rig.zero.value[i], "std": rig.zero.std[i]},
            "nominal_rpy": rig.nominal_rpy[i],
            "rpy_std": rig.rpy_std[i] if np.isfinite(rig.rpy_std[i]).any() else None,
            "capacity": rig.capacity[i] if np.isfinite(rig.capacity[i]).any() else None,
            "axes": axes if len(axes) < 3 else None,
            "sensor": (_stated(rig.sensors[i]) or None) if rig.sensors else None,
        }
    )


def truth_document(played: Run, rig: Rig, scenario: Mapping[str, Any]) -> dict[str, Any]:
    """truth.yaml: what an estimate is to be judged by, and how the campaign was made."""
    truth, recorded = played.truth, played.campaign or played.moving
    options = {} if recorded is None else {"options": recorded.options}
    own = {key: getattr(truth, key) for key in _OF_A_SUPPORT}
    own["sensitivity"] = np.eye(3) + truth.sensitivity
    terminal = {"mass": float(truth.mass), "barycenter": truth.barycentre}
    if played.moving is not None:
        terminal["inertia"] = played.moving.inertia
    return {
        "format": "tdfscal-truth/1",
        "convention": "F_bcs = rotation · sensitivity⁻¹ · (F_sensor − zero); "
        "rotation = Rz(yaw)·Ry(pitch)·Rx(roll); hinge centre = servo + datum + deflection",
        "scenario": {**scenario, **options},
        "supports": [
            {"name": name, **{key: value[i] for key, value in own.items()}}
            for i, name in enumerate(rig.supports)
        ],
        "terminal": terminal,
        "gravity": truth.gravity,
    }


def write_session(folder: Path, session: TrackerSession) -> None:
    """nominal.csv and servo.csv (plain), targets.csv and moves.csv (SpatialAnalyzer); all in mm."""
    make_folder(folder)
    # Nanometres, a thousandth of what the instrument resolves.
    for name, points, head, between, text in (
        ("nominal", session.nominal, ("group,point,x,y,z",), ",", repr),
        ("servo", session.servo, ("group,point,x,y,z",), ",", repr),
        ("targets", session.targets, _EXPORT, ",  ", "{:.6f}".format),
        ("moves", session.moves, _EXPORT, ",  ", "{:.6f}".format),
    ):
        table = zip(points.group, points.point, (1e3 * points.xyz).tolist(), strict=True)
        rows = [between.join([group, point, *map(text, xyz)]) for group, point, xyz in table]
        write_text(folder / f"{name}.csv", "\n".join([*head, *rows]) + "\n")


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
    seed: int = 0,
    survey: SurveyOptions | None = None,
    months: int = 12,
    **driven: Any,
) -> Run:
    """Simulate a scenario on a rig (default: the reference rig) and write its campaign folder.

    survey : the tracker session; by default 12 moves per NCP with the paper's tracker, 5 m away.
    months : of the scenario "months", which writes a folder each; the run is then the last one's.
    driven : fields of `Options`, such as postures and recorder; squeezed with 200 N by default.
    The same arguments and seed give the same bytes; another format gives the same numbers.

    Raises UsageError for an unknown scenario, impossible numbers, or a folder that is
    not empty; RigError and NotConvergedError as `simulate_campaign`.
    """
    check_folder(folder)
    options = Options(**{"squeeze": SQUEEZE, **driven})
    rng = np.random.default_rng(seed)
    if scenario == "months":
        runs, steps = simulate_months(rig or sample_rig(), options, rng, months)
        with together():
            make_folder(folder)
            for month in runs:
                write_run(
                    month, folder / str(month.rig.campaign.date)[:7], format=format, seed=seed
                )
            story = {"scenario": {"name": scenario, "seed": seed}, "steps": steps}
            write_text(folder / TRUTH, to_yaml({"format": "tdfscal-truth/1", **story}))
        return runs[-1]
    how: Options | MovingOptions = options
    if scenario in MOVING:
        how = replace(MOVING[scenario], rate=options.recorder.force_rate)
        if scenario in ("motion", "stops"):
            how = replace(how, tilt=options.tilt, squeeze=options.squeeze)
    of = run(rig or sample_rig(), scenario, how, rng, survey)
    write_run(of, folder, format=format, seed=seed)
    return of


def write_campaign(campaign: Campaign, folder: Path, *, format: LogFormat) -> None:
    """Write a campaign without a tracker session; see `write_run`."""
    played = Run("self", campaign.rig, campaign.truth, campaign, None)
    write_run(played, folder, format=format)


def write_run(played: Run, folder: Path, *, format: LogFormat, seed: int | None = None) -> None:
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
    tracker: dict[str, Any] | None = None
    with together():
        make_folder(folder)
        if recorded is not None:
            with replacing(folder / f"log.{format}") as beside:
                block = write_log(beside, recorded.log, format)
        if played.moving is not None:
            block["delay"] = STATED_DELAY
        if survey is not None:
            write_session(folder / "tracker", survey.session)
            session, drawn = survey.session, survey.misalignment
            tracker = {"instrument": session.instrument, "drawing": session.drawing}
            tracker |= {"misalignment": drawn} if drawn > 0.0 else {}
            tracker |= {"length_unit": "mm", **_TRACKER}
        rig_file = rig_document(rig, block or None, tracker)
        write_text(folder / "rig.yaml", to_yaml(rig_file))
        write_text(folder / TRUTH, to_yaml(truth_document(played, rig, story)))


def check_folder(folder: Path) -> None:
    """Raise UsageError for a folder that cannot be made, or that is not empty."""
    there = next(p for p in (folder.absolute(), *folder.absolute().parents) if os.path.lexists(p))
    if not there.is_dir() or not os.access(there, os.W_OK):
        what = "may not be written to" if there.is_dir() else "this is a file, not a folder"
        raise UsageError(what, where=str(there), hint="choose another folder")
    if folder.is_dir() and any(folder.iterdir()):
        raise UsageError("the folder is not empty", where=str(folder), hint="name a new folder")
