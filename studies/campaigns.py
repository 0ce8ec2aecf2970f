"""Simulated campaigns and surveys, calibrated by each method; the only place that calls estimators.

A campaign is drawn anew in every run: the rig's truth within what its file states, postures,
errors of the positioners, noise.
"""

from __future__ import annotations

import os
from collections.abc import Callable, Iterable, Iterator, Sequence
from concurrent.futures import ProcessPoolExecutor
from dataclasses import dataclass, replace
from multiprocessing import get_context
from typing import Any, TypeVar

import numpy as np

from studies.linear import by_angles, by_entries, readings
from tdfscal.errors import TdfscalError, UsageError
from tdfscal.files.rig.reading import LoadedRig
from tdfscal.model.parameters import State
from tdfscal.model.statics import postures
from tdfscal.numerics import so3
from tdfscal.records import FloatArray, Rig, UncertainValue
from tdfscal.selfcal.outliers import fit_robust
from tdfscal.simulation import (
    Batch,
    Options,
    Recorder,
    SurveyOptions,
    simulate_dwells,
    simulate_survey,
)
from tdfscal.trackercal.pipeline import calibrate_tracker

#: Methods in words: Eq. 24 as corrected (27 entries from moments), the same with force equations;
#: the angles themselves from the same equations; maximum likelihood; the laser tracker.
METHODS = {
    "linear": "Eq. 24",
    "linear-forces": "Eq. 24 + F",
    "angles": "angles",
    "angles-forces": "angles + F",
    "ml": "ML",
    "tracker": "tracker",
}
#: Campaigns that are simulated together; seeds go by blocks, so that the number of processes
#: changes no number.
BLOCK = 10
_THREADS = ("OPENBLAS_NUM_THREADS", "OMP_NUM_THREADS", "MKL_NUM_THREADS")
_T = TypeVar("_T")


@dataclass(frozen=True, slots=True)
class Setting:
    """A campaign: squeeze in N per internal mode, noise of a posture's mean force in N per axis
    (None: as the recorder's samples give it), tilt in rad.
    """

    postures: int = 24
    squeeze: float = 200.0
    noise: float | None = None
    tilt: float = float(np.deg2rad(5.0))

    @property
    def options(self) -> Options:
        """As the simulator takes it."""
        return Options(
            postures=self.postures,
            squeeze=self.squeeze,
            tilt=self.tilt,
            recorder=Recorder(mean_sd=self.noise),
        )


#: Where Eq. 24 leads (see `table2`).
LEADING = Setting(100, 1000.0, 0.1)


def usual(rig: Rig) -> Setting:
    """The campaign that `tdfscal simulate` makes, with postures enough for Eq. 24."""
    return Setting(postures=max(24, 3 * rig.n))


def papers_sources(rig: Rig) -> Rig:
    """The rig with the paper's two sources alone: positioners' errors, and the sensors' noise."""
    for source in SOURCES:
        if source not in ("positioners", "sensor noise"):
            rig = without(rig, source)
    return replace(rig, declared=replace(rig.declared, force_noise=0.0))


#: What can be uncertain on a rig, and the fields that say so.
SOURCES: dict[str, tuple[str, ...]] = {
    "sensor noise": ("force_noise",),
    "zeros": ("zero",),
    "mass": ("mass",),
    "barycentre": ("barycentre",),
    "hinges": ("hinge", "datum"),
    "positioners": ("positioner",),
    "gravity's direction": ("gravity_tilt_std",),
    "sensitivity": ("force_sensitivity",),
    "friction of the hinges": ("hinge_moment",),
}


def without(rig: Rig, source: str) -> Rig:
    """The rig with what a source of `SOURCES` states known exactly."""
    for name in SOURCES[source]:
        if name in ("zero", "mass", "barycentre"):
            exact: dict[str, Any] = {name: UncertainValue.exact(getattr(rig, name).value)}
            rig = replace(rig, **exact)
        elif name == "gravity_tilt_std":
            rig = replace(rig, gravity_tilt_std=0.0)
        else:
            rig = replace(rig, declared=replace(rig.declared, **{name: 0.0}))
    return rig


def stated(rig: Rig) -> tuple[str, ...]:
    """Sources that the rig file states at all; sensors are never without noise."""

    def size(name: str) -> float:
        if name in ("zero", "mass", "barycentre"):
            return float(np.max(getattr(rig, name).std))
        return float(getattr(rig if name == "gravity_tilt_std" else rig.declared, name))

    return tuple(s for s in SOURCES if s == "sensor noise" or any(map(size, SOURCES[s])))


def require_whole(loaded: LoadedRig) -> Rig:
    """Return the rig; refuse one whose sensors do not measure all axes.

    Raises UsageError.
    """
    rig = loaded.rig
    if not rig.axes.all():
        lacking = [
            name for name, axes in zip(rig.supports, rig.axes, strict=True) if not axes.all()
        ]
        raise UsageError(
            f"the paper's methods need all three axes of every sensor, and {', '.join(lacking)} "
            "measures fewer",
            where=str(loaded.path),
            hint="run the studies on a rig file whose `axes` are x, y, z",
        )
    if float(rig.mass.value) <= 0.0:
        raise UsageError("a terminal without weight shows no angle", where=str(loaded.path))
    return rig


def attempted(calibrate: Callable[[int], _T], runs: int) -> list[_T | None]:
    """What `calibrate` makes of each run; None where a calibration has no result."""
    found: list[_T | None] = []
    for run in range(runs):
        try:
            found.append(calibrate(run))
        except (TdfscalError, np.linalg.LinAlgError):
            found.append(None)
    return found


def surveyed(
    rig: Rig, batch: Batch, survey: SurveyOptions, rng: np.random.Generator
) -> list[FloatArray | None]:
    """Rotations (n, 3, 3) that the tracker finds of each campaign's rig."""

    def one(run: int) -> FloatArray:
        session = simulate_survey(rig, batch.truth.trial(run), survey, rng).session
        found = calibrate_tracker(rig, session, misalignment=survey.body_misalignment, trials=0)
        return found.rotations.rotation

    return attempted(one, len(batch))


def likeliest(rig: Rig, batch: Batch) -> list[State | None]:
    """What `tdfscal calibrate` finds of each campaign."""
    return attempted(lambda run: fit_robust(rig, postures(rig, batch.dwells(run))).fit.state,
                     len(batch))  # fmt: skip


def linear_rotations(rig: Rig, batch: Batch) -> list[FloatArray | None]:
    """Rotations (n, 3, 3) of each campaign by Eq. 24; None where it has fewer than 3 n postures."""
    given = readings(rig, batch.means.position, batch.means.force)
    if given.load.shape[1] < 3 * rig.n:
        return [None] * len(batch)
    return list(by_entries(given))


def errors(
    rig: Rig,
    setting: Setting,
    methods: Sequence[str],
    runs: int,
    seed: np.random.SeedSequence,
    survey: SurveyOptions | None = None,
    workers: int | None = None,
) -> dict[str, FloatArray]:
    """Estimate less truth, rad, roll, pitch, yaw, (runs, n, 3) by method; NaN without result.

    All methods see the same campaigns; workers : processes, one per core; they change no number.
    """
    sizes = [min(BLOCK, runs - start) for start in range(0, runs, BLOCK)]
    each = seed.spawn(len(sizes))
    tasks = ([v] * len(sizes) for v in (rig, setting, tuple(methods), survey))
    shared_by = min(workers or os.cpu_count() or 1, len(sizes))
    blocks = list(mapped(_block, *tasks, sizes, each, workers=shared_by))
    return {m: np.concatenate([block[m] for block in blocks]) for m in methods}


def _block(
    rig: Rig,
    setting: Setting,
    methods: tuple[str, ...],
    survey: SurveyOptions | None,
    size: int,
    seed: np.random.SeedSequence,
) -> dict[str, FloatArray]:
    campaign_rng, survey_rng = (np.random.default_rng(s) for s in seed.spawn(2))
    batch = simulate_dwells(rig, setting.options, campaign_rng, size)
    given = readings(rig, batch.means.position, batch.means.force)
    start = np.broadcast_to(so3.from_rpy(rig.nominal_rpy), (size, rig.n, 3, 3))
    found: dict[str, Sequence[FloatArray | None]] = {}
    for method in methods:
        if method == "tracker":
            found[method] = surveyed(rig, batch, survey or SurveyOptions(), survey_rng)
        elif method == "ml":
            states = likeliest(rig, batch)
            found[method] = [None if s is None else s.rotation for s in states]
        elif method == "linear":
            found[method] = linear_rotations(rig, batch)
        else:
            forces = method.endswith("forces")
            enough = (2 if forces else 1) * setting.postures >= 3 * rig.n
            if method.startswith("linear"):
                found[method] = list(by_entries(given, forces=forces)) if enough else [None] * size
            else:
                found[method] = list(by_angles(given, start, forces=forces))
    out = {}
    for method, rotations in found.items():
        out[method] = np.full((size, rig.n, 3), np.nan)
        for i, rotation in enumerate(rotations):
            if rotation is not None:
                out[method][i] = so3.wrapped(so3.to_rpy(rotation) - batch.truth.rpy[i])
    return out


def found_by_all(*samples: FloatArray) -> list[FloatArray]:
    """The runs (N, …) of which every sample has a result."""
    whole = np.all([np.isfinite(s).all(axis=tuple(range(1, s.ndim))) for s in samples], axis=0)
    return [sample[whole] for sample in samples]


def mapped(function: Callable[..., _T], *arguments: Iterable[Any], workers: int) -> Iterator[_T]:
    """`map`, here or in so many processes of one thread each for linear algebra."""
    if workers == 1:
        yield from map(function, *arguments)
        return
    for name in _THREADS:  # libraries heed them when they are loaded, in new processes alone
        os.environ.setdefault(name, "1")
    with ProcessPoolExecutor(workers, get_context("spawn")) as running:
        yield from running.map(function, *arguments)
