"""What a simulated campaign's folder holds beside the log: rig.yaml, truth.yaml, point files."""

from __future__ import annotations

from collections.abc import Callable, Mapping
from dataclasses import asdict
from pathlib import Path
from typing import Any

import numpy as np

from tdfscal.files.outputs import make_folder
from tdfscal.files.rig.reading import DRIFT_UNITS
from tdfscal.files.saving import write_text
from tdfscal.records import CampaignInfo, Drift, PointSet, Rig, SensorInfo, TrackerSession
from tdfscal.simulation import Run, Survey
from tdfscal.simulation.scenarios import Months

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
    rig: Rig,
    log: Mapping[str, Any] | None = None,
    tracker: Mapping[str, Any] | None = None,
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
    support: dict[str, Any] = {
        "name": rig.supports[i],
        "hinge": rig.hinge[i],
        "zero": {"value": rig.zero.value[i], "std": rig.zero.std[i]},
        "nominal_rpy": rig.nominal_rpy[i],
    }
    if np.any(np.isfinite(rig.rpy_std[i])):
        std = rig.rpy_std[i]
        support["rpy_std"] = std[0] if np.all(std == std[0]) else std
    if np.any(np.isfinite(rig.capacity[i])):
        support["capacity"] = rig.capacity[i]
    if not rig.axes[i].all():
        support["axes"] = [axis for axis, used in zip("xyz", rig.axes[i], strict=True) if used]
    if rig.sensors and (papers := _stated(rig.sensors[i])):
        support["sensor"] = papers
    return support


def tracker_block(survey: Survey) -> dict[str, Any]:
    """The rig file's `tracker` block for the point files of a survey."""
    session = survey.session
    block: dict[str, Any] = {"instrument": session.instrument, "drawing": session.drawing}
    if survey.misalignment > 0.0:
        block["misalignment"] = survey.misalignment
    return {**block, "length_unit": "mm", **_TRACKER}


def truth_document(played: Run, rig: Rig, scenario: Mapping[str, Any]) -> dict[str, Any]:
    """truth.yaml: what an estimate is to be judged by, and how the campaign was made.

    Of postures: dwells (s), forces (N, BCS), commanded rotations.
    """
    truth, campaign, moving = played.truth, played.campaign, played.moving
    recorded = campaign or moving
    options = {} if recorded is None else {"options": recorded.options}
    document: dict[str, Any] = {
        "format": "tdfscal-truth/1",
        "convention": "F_bcs = rotation · (I + sensitivity)⁻¹ (F_sensor − zero); "
        "rotation = Rz(yaw)·Ry(pitch)·Rx(roll); hinge centre = servo + datum + deflection",
        "scenario": {**scenario, **options},
        "supports": [
            {"name": name, **{key: getattr(truth, key)[i] for key in _OF_A_SUPPORT}}
            for i, name in enumerate(rig.supports)
        ],
        "terminal": {"mass": float(truth.mass), "barycenter": truth.barycentre},
        "gravity": truth.gravity,
    }
    if played.survey is not None:
        keys = ("rotation", "translation", "body", "offset")
        document["tracker"] = {key: getattr(played.survey, key) for key in keys}
    if campaign is not None:
        rotation = campaign.postures.pose.rotation
        columns = (campaign.start, campaign.end, campaign.force, rotation)
        document["postures"] = [
            dict(zip(("start", "end", "force", "rotation"), row, strict=True))
            for row in zip(*columns, strict=True)
        ]
    if moving is not None:
        document["terminal"]["inertia"] = moving.inertia
        document["motion"] = {
            "delay": moving.options.delay,
            "friction": moving.options.friction,
            "contacts": [
                {"begin": touch.begin, "end": touch.end, "force": touch.force}
                for touch in moving.options.touches
            ],
        }
    return document


def months_document(played: Months, story: Mapping[str, Any]) -> dict[str, Any]:
    """truth.yaml of several campaigns: what happened between them."""
    rig = played.campaigns[0].rig
    return {
        "format": "tdfscal-truth/1",
        "scenario": dict(story),
        "walk": rig.drift.angle,
        "campaigns": [date[:7] for date in played.dates],
        "steps": [
            {
                "campaign": played.dates[step.month][:7],
                "support": rig.supports[step.sensor],
                "turn": step.turn,
            }
            for step in played.steps
        ],
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
        rows = _rows(points, between, text)
        write_text(folder / f"{name}.csv", "\n".join([*head, *rows]) + "\n")


def _rows(points: PointSet, between: str, text: Callable[[float], str]) -> list[str]:
    rows = zip(points.group, points.point, (1e3 * points.xyz).tolist(), strict=True)
    return [between.join([group, point, *map(text, xyz)]) for group, point, xyz in rows]
