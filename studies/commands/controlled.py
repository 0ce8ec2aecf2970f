"""What the studies of the controlled rig share: calibrations at work, controller, files."""

from __future__ import annotations

from collections.abc import Callable, Sequence
from dataclasses import replace
from typing import Any, get_args

import numpy as np

from studies.commands.result import calibrations_named
from studies.control.contact import GearPair
from studies.control.runs import Controller
from studies.control.stability import designed, real_mass, require_stable
from studies.runs.compared_calibrations import BEST, SQUEEZE, Arms, drifted, given, simulated
from tdfscal.errors import UsageError
from tdfscal.files.rig.reading import LoadedRig
from tdfscal.files.writers.campaign import LogFormat
from tdfscal.records import Rig
from tdfscal.simulation import Options
from tdfscal.workflows.arguments import Numbers, at_least, numbers, one_of, triple
from tdfscal.workflows.calibration import CalibrationSource, sources_of
from tdfscal.workflows.calibration_in_use import calibrated
from tdfscal.workflows.progress import Progress
from tdfscal.workflows.survey import survey_of
from tdfscal.wrench.filtering import Walk, checked_walk

#: Filters that a controller can run.
FILTERS = ("low-pass", "kalman", "none")
#: Rotational over translational stiffness, damping or mass where one number is given, m².
_TURNS = 0.3
#: Hz, of records that are written as logs.
_LOG_RATE = 25.0


def gear_pair(
    contact_stiffness: float | None = None,
    friction: float | None = None,
    clearance: float | None = None,
    engagement: float | None = None,
) -> GearPair:
    """Return the gears: N/m of a tooth, mm, mm; None is the study's choice. Raises UsageError."""
    changes: dict[str, Any] = {
        "stiffness": contact_stiffness,
        "seat_stiffness": None if contact_stiffness is None else 2.0 * contact_stiffness,
        "friction": friction,
        "clearance": None if clearance is None else 1e-3 * clearance,
        "length": None if engagement is None else 1e-3 * engagement,
    }
    return replace(GearPair(), **{name: v for name, v in changes.items() if v is not None})


def filtering_controller(
    filter: str, walk: float | None, logs: LogFormat | None = None
) -> Controller:
    """Return the controller with a filter, and with records where logs are to be written.

    Raises UsageError.
    """
    one_of("--filter", filter, FILTERS)
    one_of("--logs", logs, get_args(LogFormat))
    intensity = checked_walk("kalman" if filter == "kalman" else "none", walk)
    base = Controller()
    if logs is not None:
        base = replace(base, trace_rate=_LOG_RATE, readings=True)
    if filter == "low-pass":
        return base
    sensing, gain = base.sensing, 1.0
    if intensity is not None:
        gain = Walk.of(intensity, sensing.noise, 1.0 / sensing.rate).gain
    return replace(base, sensing=replace(sensing, gain=gain))


def stable_controller(
    rig: Rig,
    base: Controller,
    gears: GearPair,
    stiffness: Numbers | float | None,
    damping: Numbers | float | None,
    virtual_mass: Numbers | float | None,
    servo: float | None,
) -> Controller:
    """Return a controller with this impedance and servos (Hz); the rest so that it is stable.

    stiffness, damping, virtual_mass : of translations, or of translations and turns.

    Raises UsageError.
    """
    stiff, damp = _six("--stiffness", stiffness), _six("--damping", damping)
    mass = _six("--virtual-mass", virtual_mass)
    if servo is not None:
        base = replace(base, servo=replace(base.servo, bandwidth=servo))
    chosen: dict[str, Any] = {
        "stiffness": stiff,
        "damping": damp,
        "mass": mass or real_mass(rig, base),
    }
    chosen = {name: value for name, value in chosen.items() if value is not None}
    base = replace(base, impedance=replace(base.impedance, **chosen))
    if damp is None:
        base = designed(rig, base, gears)
    require_stable(rig, base, gears)
    return base


def _six(option: str, value: Numbers | float | None) -> tuple[float, ...] | None:
    """Translations and turns of one number or two. Raises UsageError."""
    if value is None:
        return None
    found = numbers(option, (value,) if isinstance(value, int | float) else value)
    if len(found) > 2 or min(found) <= 0.0:
        raise UsageError(
            f"{value!r} is not one or two numbers above zero",
            where=option,
            hint="give it for translations, or for translations and turns, as 1e4,3e3",
        )
    turns = found[1] if len(found) > 1 else _TURNS * found[0]
    return (found[0],) * 3 + (turns,) * 3


def compared_arms(
    loaded: LoadedRig,
    calibration: CalibrationSource | Sequence[CalibrationSource],
    truth: CalibrationSource | None,
    runs: int,
    perfect: bool,
    mounting: Numbers | None,
    drift: float,
    tare: bool,
    seed: int,
    progress: Progress,
) -> tuple[Arms, np.random.SeedSequence]:
    """Calibrations and machines, given or simulated, and the seed of the study itself.

    Raises TdfscalError.
    """
    at_least("--drift", drift, 0)
    arm_seed, study_seed = np.random.SeedSequence(seed).spawn(2)
    rng = np.random.default_rng(arm_seed)
    sources = sources_of(calibration)
    if sources:
        if mounting is not None:
            raise UsageError(
                "given calibrations say how the sensors are mounted",
                where="--mounting",
                hint="leave it out, or leave --calibration out",
            )
        named = calibrations_named(sources, loaded, ("none", *BEST))
        each = [(name, calibrated(c, name)) for name, c in named.items()]
        judge = None
        if truth is not None:
            ((name, found),) = calibrations_named([truth], loaded).items()
            judge = name, calibrated(found, name)
        arms = given(loaded.rig, each, runs, rng, truth=judge, best=perfect)
    else:
        if truth is not None:
            raise UsageError(
                "simulated calibrations have a truth of their own",
                where="--truth",
                hint="leave it out, or name calibrations with --calibration",
            )
        options = Options(squeeze=SQUEEZE)
        if mounting is not None:
            roll, pitch, yaw = triple("--mounting", mounting)
            options = replace(options, installation_std=(abs(roll), abs(pitch), abs(yaw)))
        progress.count(f"{runs} campaigns and surveys, simulated and calibrated")
        survey = survey_of(loaded)
        arms = simulated(loaded.rig, runs, rng, best=perfect, options=options, survey=survey)
    if tare:
        tared = tuple(replace(arm, tared=True) for arm in arms.arms)
        arms = replace(arms, arms=tared, origin=f"{arms.origin}; all tare before each run")
    return (drifted(arms, drift, rng) if drift else arms), study_seed


def steps_of(progress: Progress, what: str) -> Callable[[float], None]:
    """Return what says each tenth of a simulation as it is done."""
    said = 0

    def tell(share: float) -> None:
        nonlocal said
        if int(10 * share) > said:
            said = int(10 * share)
            progress.count(f"{what}: {10 * said} %")

    return tell
