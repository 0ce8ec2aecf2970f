"""`apply`: the contact wrench of a whole log."""

from __future__ import annotations

from collections.abc import Iterable, Iterator
from dataclasses import dataclass, field
from pathlib import Path
from typing import TYPE_CHECKING, Annotated, Any

import numpy as np

from tdfscal.commands import options
from tdfscal.commands.calibration_in_use import LogInUse, take
from tdfscal.commands.campaign import PathLike, one
from tdfscal.commands.log_pass import Settings
from tdfscal.commands.options import Option, silent, triple, window
from tdfscal.commands.result import CommandResult
from tdfscal.detection.path import Largest
from tdfscal.errors import UsageError
from tdfscal.files.writers.logs import (
    COLUMNS,
    STATUS,
    SUFFIXES,
    columns_of,
    numbers_only,
    write_wrenches,
)
from tdfscal.findings import Finding
from tdfscal.frozen import record
from tdfscal.model.samples_in_motion import Samples, Standstill
from tdfscal.records import LCS_FRAME, FloatArray
from tdfscal.reporting.layout import Drawing, Report, document, plain
from tdfscal.reporting.wrench import wrench_report
from tdfscal.validation.residual_wrench import ENOUGH
from tdfscal.wrench.contact_wrench import COMPONENTS, Wrenches
from tdfscal.wrench.filtering import WALK, Kind, filter_for, filtered
from tdfscal.wrench.wrench_noise import LogHead, SampleNoise, StopWrenches, with_sample_noise

if TYPE_CHECKING:
    import pandas as pd

#: What the roots of the mean squares are called.
_ROOTS = ("rms", "rms_uncalibrated", "std", "std_calibration")
#: What says already that the wrench is none.
_ODD = ("wrench-rewired", "wrench-large")
#: Times its standard uncertainty, which no noise reaches.
_FAR = 5.0
_DRAWN = ("time", *COMPONENTS, *(f"raw_{name}" for name in COMPONENTS))


@record(eq=False)
class ApplyResult(CommandResult):
    """Contact wrenches of a log.

    summary : what the command prints. output : the file that holds the samples; without one,
    columns : the samples in memory, by name.
    """

    summary: dict[str, Any]
    findings: tuple[Finding, ...]
    output: Path | None
    columns: dict[str, FloatArray] | None = None

    def to_report(self, drawings: tuple[Drawing, ...] = ()) -> Report:
        """Return size of the wrench with and without the calibration."""
        return wrench_report(self.summary, self.findings)

    def document(self) -> dict[str, Any]:
        """Return the summary as plain JSON values."""
        return self.summary

    def to_frame(self) -> pd.DataFrame:
        """One row per sample: time in s, wrench, `u_` standard uncertainty, `u_cal_` the
        calibration's part of it, `raw_` uncalibrated.
        """
        import pandas as pd

        if self.columns is not None:
            return pd.DataFrame(self.columns)
        assert self.output is not None
        if self.output.suffix.lower() == ".mcap":
            hint = "name a .csv or .parquet file for them, or none"
            raise UsageError("the samples are in a recording", where=str(self.output), hint=hint)
        read = pd.read_csv if self.output.suffix.lower() == ".csv" else pd.read_parquet
        return read(self.output)

    def drawings(self) -> tuple[Drawing, ...]:
        """Return the figure of the contact wrench over the time of the log."""
        from tdfscal.reporting.figures.timeline import contact_wrench

        frame = self.to_frame()
        columns = {name: frame[name].to_numpy() for name in _DRAWN}
        return (contact_wrench(columns, self.summary["largest"]["force"]),)


@options.command("apply calibration.yaml assembly/log.csv -o wrench.csv")
def apply(
    calibration: options.OneCalibration,
    paths: options.Paths,
    *,
    output: Annotated[
        PathLike | None,
        options.written(
            "result: .csv, .parquet or .mcap, written as the log passes", *SUFFIXES, holds=""
        ),
    ] = None,
    rig: options.RigFile = None,
    from_: options.Begin = None,
    to: options.End = None,
    filter: Annotated[
        Kind, Option("Kalman filter: causal, as a controller's; or smoothed, without delay")
    ] = "none",
    at: options.LcsPoint = (0.0, 0.0, 0.0),
    progress: options.Telling = silent,
) -> ApplyResult:
    """Work out the contact force and torque over a whole log."""
    target, point = one(output), triple("--at", at)
    log = take(calibration, paths, rig, Settings(progress, window(from_, to)), point)
    head, samples = log.passing()
    totals, noises, columns = Totals(StopWrenches(head.averaged)), list[SampleNoise](), None
    samples, effect = _behind(filter, head, samples)
    age, moved = log.moved_zeros(head)
    wrenches = with_sample_noise(
        log.wrenches(totals.standstill.watch(samples)),
        head,
        log.given,
        posture_std=log.posture_std,
        zero_variance=moved,
        tell=noises.append,
    )
    # Numbers out of all proportion are refused by name, not warned of by numpy.
    with np.errstate(all="ignore"):
        if target is not None:
            # A wrench is about the origin of its frame.
            frame = f"{LCS_FRAME}_at" if any(point) else LCS_FRAME
            write_wrenches(target, totals.passing(wrenches), _about(log, filter), frame=frame)
        else:
            kept = [columns_of(piece) for piece in numbers_only(totals.passing(wrenches))]
            columns = {name: np.concatenate([part[name] for part in kept]) for name in COLUMNS}
        found = log.findings()
        if (odd := totals.stops.beyond(noises[0])) and not any(f.code in _ODD for f in found):
            found.append(odd)
        # A motion with hardly a stop.
        if not head.averaged and len(head.start) < ENOUGH and totals.far():
            found += log.touched()
        variance = 0.0 if moved is None else moved(np.array([totals.end])).max()
    summary = {
        "output": None if target is None else str(target),
        **totals.document(log, noises[0]),
        "zeros": document(age, "age=seconds age_known=known", moved=np.sqrt(variance)),
        "filter": effect,
    }
    return ApplyResult(summary, tuple(found), target, columns)


def _behind(
    kind: Kind, head: LogHead, samples: Iterator[Samples]
) -> tuple[Iterator[Samples], dict[str, Any] | None]:
    """Samples behind a filter, and what it does, SI units.

    noise_left : as a share, None where there is no noise.
    """
    if kind == "none":
        return samples, None
    with np.errstate(all="ignore"):
        model = filter_for(WALK, head.samples)
    smooth = kind == "smooth"
    return filtered(samples, kind, model), {
        "kind": kind,
        "walk": WALK,
        "gain": model.gain,
        "noise": float(np.sqrt(model.r)),
        "noise_left": model.noise_left(smooth=smooth) if model.r > 0 else None,
        "delay": 0.0 if smooth else model.delay,
    }


def _about(log: LogInUse, kind: Kind) -> dict[str, str]:
    """What a file of wrenches says of them."""
    x, y, z = log.point
    place = f"the point ({x:g}, {y:g}, {z:g}) m" if log.point.any() else "the origin"
    c = log.calibration
    return {
        "quantity": f"contact wrench on the terminal: force, and moment about {place} of the LCS",
        "frame": "LCS",
        "units": "s, N, N·m",
        "u_": "standard uncertainty (k = 1) of the single sample, its noise included",
        "u_cal_": "the part of the calibration and the rig's constants, common to all samples",
        "raw_": "the same with the nominal mounting and the stated zeros, mass and barycentre",
        "filter": "none" if kind == "none" else f"{kind}, walk {WALK:g} N in 1 s",
        "inertia": "not included (quasi-static)" if log.given.rig.inertia is None else "included",
        "calibration": f"{c.method}, {c.created}",
        STATUS: c.status,
        "rig": log.given.rig.name,
    }


@dataclass(slots=True)
class Totals:
    """What the summary says of the rows.

    stops : the wrench at these. squares : (5, 6), sums of squares of the wrench, of the
    uncalibrated one, of its standard uncertainty and of the calibration's part of that; of the
    wrench at the stops, which have still_rows. largest : lengths (2,), and when, s. begin, end : s.
    """

    stops: StopWrenches
    squares: FloatArray = field(default_factory=lambda: np.zeros((5, 6)))
    largest: Largest = field(default_factory=lambda: Largest(2))
    rows: int = 0
    begin: float = np.nan
    end: float = np.nan
    standstill: Standstill = field(default_factory=Standstill)
    still_rows: int = 0

    def passing(self, pieces: Iterable[Wrenches]) -> Iterator[Wrenches]:
        """Count the pieces of a log as they pass."""
        for piece in pieces:
            still = self.standstill.at(piece.time)
            self.stops.add(piece, still)
            each = (piece.value, piece.raw, piece.std, piece.calibration_std, piece.value[still])
            self.squares += [np.einsum("ka,ka->a", part, part) for part in each]
            self.largest.add(piece.time, np.linalg.norm(piece.value.reshape(-1, 2, 3), axis=2))
            self.begin = float(piece.time[0]) if not self.rows else self.begin
            self.end = float(piece.time[-1])
            self.rows += len(piece.time)
            self.still_rows += int(still.sum())
            yield piece

    def far(self) -> bool:
        """The largest force or torque is no noise."""
        stated = np.sqrt(self.squares[2].reshape(2, 3).sum(axis=1) / self.rows)
        return bool(np.any(self.largest.size > _FAR * stated))

    def document(self, log: LogInUse, noise: SampleNoise) -> dict[str, Any]:
        """Return the rms of each component over all rows, and at the stops where some move."""
        std, posture = _by_component(noise.std), log.posture_std
        roots = map(_by_component, np.sqrt(self.squares[:-1] / self.rows))
        stops = None
        if 0 < self.still_rows < self.rows:
            rms = _by_component(np.sqrt(self.squares[-1] / self.still_rows))
            stops = {"rows": self.still_rows, "rms": rms, "mean_std": None}
            if len(known := self.stops.means(noise)[2]):
                stops["mean_std"] = _by_component(np.sqrt(np.mean(known**2, axis=0)))
        return {
            "rows": self.rows,
            "quasi_static": log.given.rig.inertia is None,
            STATUS: log.calibration.status,
            "left_out": document(log.tally, "uncovered unreadable"),
            "start": self.begin,
            "end": self.end,
            **dict(zip(_ROOTS, roots, strict=True)),
            "stops": stops,
            "largest": {
                **dict(zip(("force", "torque"), self.largest.size.tolist(), strict=True)),
                **dict(zip(("force_time", "torque_time"), self.largest.when.tolist(), strict=True)),
            },
            "about": log.point.tolist(),
            "noise": document(noise, "dwells windows", std=std, posture=posture),
        }


def _by_component(values: FloatArray) -> dict[str, float | None]:
    """Values (6,) by the wrench's components, None where one is unknown."""
    return {name: plain(value) for name, value in zip(COMPONENTS, values, strict=True)}
