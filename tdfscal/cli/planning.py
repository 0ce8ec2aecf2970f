"""`tdfscal plan`."""

from __future__ import annotations

from pathlib import Path

import numpy as np

from tdfscal.cli.app import command_line, emit
from tdfscal.cli.rigs import rig_named
from tdfscal.dwells import find_dwells
from tdfscal.errors import UsageError
from tdfscal.files.writers.plan import save_plan
from tdfscal.logs import iter_log
from tdfscal.planning import (
    Limits,
    Objective,
    Request,
    make_plan,
    plan_for_target,
    travel_limits,
)
from tdfscal.planning.recorded_postures import recorded, scatter_of
from tdfscal.reporting.planning import plan_document, plan_report
from tdfscal.reporting.terminal import show
from tdfscal.selfcal.estimator import Fit
from tdfscal.workflows.campaign import resolve

DEFAULT_POSTURES = 24
DEFAULT_NOISE = 1.0
"""N per axis and posture, where nothing is recorded yet."""


def run(
    rig: Path,
    *,
    output: Path,
    postures: int | None,
    target: float | None,
    tilt: float,
    squeeze: float,
    force_limit: float | None,
    travel: list[str],
    home: str | None,
    stiffness: float | None,
    noise: float | None,
    candidates: int,
    objective: Objective,
    at: str | None,
    given: list[Path],
    seed: int,
    json: bool,
) -> None:
    """Plan, print, write."""
    if postures is not None and target is not None:
        raise UsageError(
            "--postures and --target ask for two different things", hint="give one of them"
        )
    loaded = rig_named(rig).rig
    limits = Limits(
        tilt=float(np.deg2rad(tilt)),
        squeeze=squeeze,
        force=np.inf if force_limit is None else force_limit,
        travel=travel_limits(loaded, dict(map(_travel, travel))),
        home=np.array(_triple("--home", home) if home else (0.0, 0.0, 0.0)),
        stiffness=stiffness,
    )
    before = _given(rig, given, noise or DEFAULT_NOISE) if given else None
    request = Request(
        limits=limits,
        noise=noise if noise is not None else _noise(before),
        candidates=candidates,
        objective=objective,
        at=_triple("--at", at) if at else None,
    )
    rng = np.random.default_rng(seed)
    if target is None:
        plan = make_plan(loaded, request, postures or DEFAULT_POSTURES, rng, given=before)
    else:
        plan = plan_for_target(loaded, request, 1e-3 * target, rng, given=before)
    save_plan(plan, output, command_line(), seed)
    if json:
        emit(plan_document(plan, str(output), seed))
        return
    show(plan_report(plan))
    print(f"\nwrote {output}")


def _given(rig: Path, paths: list[Path], noise: float) -> Fit:
    """The fit of the postures that are recorded already."""
    campaign = resolve(paths, rig_named(rig).path)
    if not campaign.logs:
        raise UsageError("there is no log to build on", where=", ".join(map(str, paths)))
    record = campaign.rig.rig
    pieces = iter_log(campaign.logs, campaign.rig.log, record.supports)
    return recorded(record, find_dwells(pieces), noise)


def _noise(before: Fit | None) -> float:
    """Return the noise to expect of a posture, N: that of the recorded ones."""
    return DEFAULT_NOISE if before is None else scatter_of(before)


def _numbers(option: str, text: str) -> tuple[float, ...]:
    try:
        values = tuple(float(part) for part in text.split(","))
    except ValueError:
        values = ()
    if not values or not all(np.isfinite(values)):
        raise UsageError(
            f"{text!r} is no list of numbers", where=option, hint="write numbers as 0.1,0.1,0.2"
        )
    return values


def _triple(option: str, text: str) -> tuple[float, float, float]:
    values = _numbers(option, text)
    if len(values) != 3:
        raise UsageError(f"{text!r} is not three numbers", where=option, hint="write 0,0,0")
    return values[0], values[1], values[2]


def _travel(text: str) -> tuple[str | None, tuple[float, ...]]:
    name, equals, value = text.rpartition("=")
    return (name if equals else None), _numbers("--travel", value)
