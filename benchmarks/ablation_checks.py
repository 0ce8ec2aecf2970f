"""What each screening and test of the self-calibration buys: one left out at a time."""

from __future__ import annotations

from collections.abc import Callable
from contextlib import ExitStack
from dataclasses import dataclass, replace
from typing import Any
from unittest.mock import patch

import numpy as np

from benchmarks.selfcal_faults import BASE, NONE, RIG, turn
from tdfscal import simulation
from tdfscal.checks import faulty_sensors, log_against_rig
from tdfscal.errors import TdfscalError
from tdfscal.records import Dwells
from tdfscal.selfcal import outliers, pipeline, preparation
from tdfscal.selfcal.pipeline import self_calibrate
from tdfscal.selfcal.repeatability import Stability
from tdfscal.selfcal.result import SelfCalibration
from tdfscal.simulation import Contact, Crosstalk, DeadAxis, Drift, Faults, Slip, ZeroShift

HEADS = ("left out", "fault", "accepted, in silence, harmed", "without it")


@dataclass(frozen=True)
class Fault:
    """What happens on the rig, and to the record of its dwells."""

    faults: Faults = NONE
    record: Callable[[Dwells], Dwells] = lambda dwells: dwells
    tilt: float = 0.0


def _forces(change: Callable[[Any], Any]) -> Callable[[Dwells], Dwells]:
    def record(dwells: Dwells) -> Dwells:
        return replace(
            dwells, force=change(dwells.force), force_min=change(dwells.force_min),
            force_max=change(dwells.force_max),
        )  # fmt: skip

    return record


def _positions(change: Callable[[Any], Any]) -> Callable[[Dwells], Dwells]:
    return lambda dwells: replace(dwells, position=change(dwells.position))


def _mirrored(force: Any) -> Any:
    return force * np.array([1.0, -1.0, 1.0])


def _contacts(count: int) -> Faults:
    return Faults(
        contacts=tuple(
            Contact(5 + 6 * k, (5.0, -8.0, 10.0), (2.0, 1.0, -1.0)) for k in range(count)
        )
    )


def _frozen(dwells: Dwells) -> Dwells:
    """One axis stands still in a third of the dwells, as a loose plug makes it."""
    force, low, high = (x.copy() for x in (dwells.force, dwells.force_min, dwells.force_max))
    for values in (force, low, high):
        values[:8, 1, 0] = force[8, 1, 0]
    return replace(dwells, force=force, force_min=low, force_max=high)


FAULTS: dict[str, Fault] = {
    "none": Fault(),
    "contact of 14 N in 1 posture": Fault(_contacts(1)),
    "contact of 14 N in 2 postures": Fault(_contacts(2)),
    "crosstalk of 0.1 %": Fault(Faults(crosstalk=(Crosstalk(0, (1e-3,) * 3),))),
    "BCS tilted by 0.5 mrad": Fault(tilt=5e-4),
    "zero drifts by 1 N": Fault(Faults(drifts=(Drift(0, (1.0, 1.0, 1.0)),))),
    "zero jumps by 1 N": Fault(Faults(zero_shifts=(ZeroShift(0, 12, (1.0, -1.0, 1.0)),))),
    "sensor slips by 2 mrad about Z": Fault(Faults(slips=(Slip(0, 12, (0.0, 0.0, 2e-3)),))),
    "axis frozen in 8 postures": Fault(record=_frozen),
    "axis dead": Fault(Faults(dead_axes=(DeadAxis(0, 0, 0),))),
    "positions in mm": Fault(record=_positions(lambda p: 1e3 * p)),
    "positions of two supports exchanged": Fault(record=_positions(lambda p: p[:, [1, 0, 2]])),
    "forces in kN": Fault(record=_forces(lambda f: 1e-3 * f)),
    "forces of opposite sign": Fault(record=_forces(lambda f: -f)),
    "sensors exchanged": Fault(Faults(swapped=((0, 1),))),
    "Fy of all sensors mirrored": Fault(record=_forces(_mirrored)),
}  # fmt: skip


def _nothing(*_: Any, **__: Any) -> None:
    return None


def _all_pass(result: Any, used: Any, *_: Any, **__: Any) -> Any:
    return np.ones(len(used), dtype=bool)


def _all_kept(rig: Any, dwells: Dwells) -> Any:
    return faulty_sensors.Screened(np.ones(len(dwells), dtype=bool), {})


#: Part → (what takes its place, faults that it is there for).
PARTS: dict[str, tuple[tuple[tuple[Any, str, Any], ...], tuple[str, ...]]] = {
    "outliers": (((outliers, "sound", _all_pass),),
        ("contact of 14 N in 1 posture", "contact of 14 N in 2 postures")),
    "score tests": (((pipeline, "suspicions", lambda *_, **__: ()),),
        ("crosstalk of 0.1 %", "BCS tilted by 0.5 mrad", "zero drifts by 1 N")),
    "slip": (((pipeline, "find_slip", _nothing),),
        ("sensor slips by 2 mrad about Z", "zero jumps by 1 N")),
    "repeatability": (((Stability, "warnings", ()),),
        ("zero drifts by 1 N", "sensor slips by 2 mrad about Z")),
    "score tests, slip and repeatability": (((pipeline, "suspicions", lambda *_, **__: ()),
        (pipeline, "find_slip", _nothing), (Stability, "warnings", ())),
        ("zero drifts by 1 N", "BCS tilted by 0.5 mrad", "sensor slips by 2 mrad about Z")),
    "cross-validation": (((pipeline, "cross_validate", _nothing),),
        ("crosstalk of 0.1 %", "zero drifts by 1 N", "contact of 14 N in 1 posture")),
    "faulty sensors": (((faulty_sensors, "screen", _all_kept),),
        ("axis frozen in 8 postures", "axis dead")),
    "geometry against the rig file": (((log_against_rig, "check_geometry", _nothing),),
        ("positions in mm", "positions of two supports exchanged")),
    "forces against the rig file": (((preparation, "check_forces", _nothing),),
        ("forces in kN", "forces of opposite sign", "sensors exchanged",
         "Fy of all sensors mirrored")),
}  # fmt: skip


def _calibrated(dwells: Dwells) -> SelfCalibration | None:
    try:
        return self_calibrate(RIG, dwells, rng=np.random.default_rng(0), max_trials=0)
    except TdfscalError:
        return None


def _judged(fault: Fault, campaigns: int) -> tuple[int, int, int]:
    """How many were accepted; of those, how many without any word, and how many harmed.

    Harmed: an angle moves by more than twice its standard uncertainty.
    """
    options = replace(BASE, faults=fault.faults)
    real = replace(RIG, gravity_tilt_std=fault.tilt)
    batch = simulation.simulate_dwells(real, options, np.random.default_rng(3), campaigns)
    plain = simulation.simulate_dwells(RIG, BASE, np.random.default_rng(3), campaigns)
    accepted = silent = harmed = 0
    for i in range(campaigns):
        result = _calibrated(fault.record(batch.dwells(i)))
        if result is None or result.reasons:
            continue
        accepted += 1
        silent += not (result.warnings or result.rejected)
        clean = _calibrated(plain.dwells(i))
        assert clean is not None
        std = np.sqrt(np.diagonal(clean.uncertainty.covariance))
        moved = turn(batch.truth.rotation[i], result) - turn(plain.truth.rotation[i], clean)
        harmed += bool((np.abs(moved) > 2 * std).any())
    return accepted, silent, harmed


def check_table(campaigns: int) -> list[str]:
    """Rows of the table of the estimator's screenings and tests."""
    rows = []
    whole: dict[str, tuple[int, int, int]] = {}
    for name, (places, faults) in PARTS.items():
        for fault in (*faults, "none"):
            if fault not in whole:
                whole[fault] = _judged(FAULTS[fault], campaigns)
            with ExitStack() as stack:
                for module, attribute, neutral in places:
                    stack.enter_context(patch.object(module, attribute, neutral))
                without = _judged(FAULTS[fault], campaigns)
            rows.append(f"| {name} | {fault} | {_cell(whole[fault])} | {_cell(without)} |")
            print(rows[-1], flush=True)
    return rows


def _cell(judged: tuple[int, int, int]) -> str:
    return ", ".join(map(str, judged))
