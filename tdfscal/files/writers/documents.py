"""rig.yaml and truth.yaml as plain structures, and how they are written."""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import asdict
from pathlib import Path
from typing import Any

import numpy as np

from tdfscal.files.rig.reading import HOUR
from tdfscal.files.saving import to_yaml, write_text
from tdfscal.records import CampaignInfo, Drift, Rig, SensorInfo, UncertainValue
from tdfscal.simulation import Run, Survey
from tdfscal.simulation.scenarios import Months

_TRACKER: dict[str, Any] = {
    "targets": {"nominal": "tracker/nominal.csv", "measured": "tracker/targets.csv"},
    "moves": {"servo": "tracker/servo.csv", "measured": "tracker/moves.csv"},
}
TRACKER_FILES = tuple(path for block in _TRACKER.values() for path in block.values())
#: Of the truth, what each support has of its own.
_OF_A_SUPPORT = ("rotation", "rpy", "zero", "sensitivity", "hinge", "datum", "stiffness")


def rig_document(
    rig: Rig,
    log: Mapping[str, Any] | None = None,
    tracker: Mapping[str, Any] | None = None,
) -> dict[str, Any]:
    """The rig file (`tdfscal-rig/1`) of a rig, with its `log` and `tracker` blocks."""
    terminal: dict[str, Any] = {"mass": _known(rig.mass), "barycenter": _known(rig.barycentre)}
    if rig.inertia is not None:
        inertia = rig.inertia
        terminal["inertia"] = {"value": inertia.value.tolist(), "std": float(inertia.std.max())}
    declared: dict[str, Any] = asdict(rig.declared)
    compliance = {axis: declared.pop(f"compliance_{axis}") for axis in ("lateral", "vertical")}
    if any(compliance.values()):
        declared["compliance"] = compliance
    limits = rig.acceptance
    acceptance: dict[str, Any] = {
        "angle_std": limits.angle_std,
        "identifiable": limits.identifiable,
        "birge_max": limits.birge_max,
    }
    contact = {"force": limits.contact_force, "torque": limits.contact_torque}
    if stated := {name: limit for name, limit in contact.items() if limit is not None}:
        acceptance["contact"] = {**stated, "rpy": list(limits.contact_rpy)}
    drift = {
        "time": rig.drift.time * HOUR,
        "temperature": rig.drift.temperature,
        "walk": rig.drift.walk * HOUR**0.5,
        "angle": rig.drift.angle,
    }
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
    return {name: block for name, block in document.items() if block is not None}


def tracker_block(survey: Survey) -> dict[str, Any]:
    """The rig file's `tracker` block for the point files of a survey."""
    block: dict[str, Any] = {
        "instrument": asdict(survey.session.instrument),
        "drawing": survey.session.drawing,
    }
    if survey.misalignment > 0.0:
        block["misalignment"] = survey.misalignment
    return {**block, "length_unit": "mm", **_TRACKER}


def _known(known: UncertainValue) -> dict[str, Any]:
    return {"value": known.value.tolist(), "std": known.std.tolist()}


def _stated(record: CampaignInfo | SensorInfo) -> dict[str, str]:
    return {name: value for name, value in asdict(record).items() if value is not None}


def _support(rig: Rig, i: int) -> dict[str, Any]:
    support: dict[str, Any] = {
        "name": rig.supports[i],
        "hinge": rig.hinge[i].tolist(),
        "zero": {"value": rig.zero.value[i].tolist(), "std": rig.zero.std[i].tolist()},
        "nominal_rpy": rig.nominal_rpy[i].tolist(),
    }
    if np.any(np.isfinite(rig.rpy_std[i])):
        std = rig.rpy_std[i].tolist()
        support["rpy_std"] = std[0] if len(set(std)) == 1 else std
    if np.any(np.isfinite(rig.capacity[i])):
        support["capacity"] = rig.capacity[i].tolist()
    if not rig.axes[i].all():
        support["axes"] = [axis for axis, used in zip("xyz", rig.axes[i], strict=True) if used]
    if rig.sensors and (papers := _stated(rig.sensors[i])):
        support["sensor"] = papers
    return support


def truth_document(played: Run, rig: Rig, scenario: Mapping[str, Any]) -> dict[str, Any]:
    """truth.yaml: what an estimate is to be judged by, and how the campaign was made.

    Of postures: dwells (s), forces (N, BCS), commanded rotations.
    """
    truth, campaign, moving = played.truth, played.campaign, played.moving
    recorded = campaign or moving
    options = {} if recorded is None else {"options": plain(asdict(recorded.options))}
    document: dict[str, Any] = {
        "format": "tdfscal-truth/1",
        "convention": "F_bcs = rotation · (I + sensitivity)⁻¹ (F_sensor − zero); "
        "rotation = Rz(yaw)·Ry(pitch)·Rx(roll); hinge centre = servo + datum + deflection",
        "scenario": {**scenario, **options},
        "supports": [
            {"name": name, **{key: getattr(truth, key)[i].tolist() for key in _OF_A_SUPPORT}}
            for i, name in enumerate(rig.supports)
        ],
        "terminal": {"mass": float(truth.mass), "barycenter": truth.barycentre.tolist()},
        "gravity": truth.gravity.tolist(),
    }
    if played.survey is not None:
        keys = ("rotation", "translation", "body", "offset")
        document["tracker"] = {key: getattr(played.survey, key).tolist() for key in keys}
    if campaign is not None:
        rotation = campaign.postures.pose.rotation
        columns = (campaign.start, campaign.end, campaign.force, rotation)
        document["postures"] = [
            dict(zip(("start", "end", "force", "rotation"), row, strict=True))
            for row in zip(*(column.tolist() for column in columns), strict=True)
        ]
    if moving is not None:
        document["terminal"]["inertia"] = moving.inertia.tolist()
        document["motion"] = {
            "delay": moving.options.delay,
            "friction": moving.options.friction,
            "contacts": [
                {"begin": touch.begin, "end": touch.end, "force": list(touch.force)}
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
                "turn": list(step.turn),
            }
            for step in played.steps
        ],
    }


def plain(value: object) -> Any:
    """Options, faults and their like as structures that YAML knows."""
    if isinstance(value, np.ndarray | np.generic):
        return value.tolist()
    if isinstance(value, dict):
        return {key: plain(item) for key, item in value.items()}
    if isinstance(value, list | tuple):
        return [plain(item) for item in value]
    return value


def write_yaml(path: Path, document: Mapping[str, Any]) -> None:
    """Plain YAML, keys in the order given, doubles to the last bit."""
    write_text(path, to_yaml(dict(document)))
