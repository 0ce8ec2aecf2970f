"""`apply`: the contact wrench of a whole log."""

from __future__ import annotations

from collections.abc import Iterable, Iterator
from dataclasses import dataclass, field
from pathlib import Path
from typing import TYPE_CHECKING, Annotated, Any

import numpy as np

from tdfscal.catalogue import told
from tdfscal.commands import options
from tdfscal.commands.arguments import SILENT, PathLike, one, triple, window
from tdfscal.commands.calibration_in_use import InUse, WrenchPass, take, zeros_since
from tdfscal.commands.log_pass import Settings
from tdfscal.commands.options import Option
from tdfscal.commands.result import Result
from tdfscal.files.writers.wrenches import (
    COLUMNS,
    SUFFIXES,
    columns_of,
    numbers_only,
    read_recording,
    write_wrenches,
)
from tdfscal.findings import Finding
from tdfscal.frozen import record
from tdfscal.model.zero_motion import ZeroAge
from tdfscal.records import LCS_FRAME, FloatArray
from tdfscal.reporting.layout import Drawing, Report, document, plain
from tdfscal.reporting.summaries import wrench_report
from tdfscal.wrench.contact_wrench import COMPONENTS, Wrenches
from tdfscal.wrench.filtering import WALK, Kind, Walk, filter_for, filtered
from tdfscal.wrench.kinematics import Standstill
from tdfscal.wrench.sample_noise import (
    SampleNoise,
    with_sample_noise,
)
from tdfscal.wrench.zero_wander import ZeroVariance

if TYPE_CHECKING:
    import pandas as pd

#: What the roots of the mean squares are called.
_ROOTS = ("rms", "rms_uncalibrated", "std", "std_calibration")


@record(eq=False)
class ApplyResult(Result):
    """Contact wrenches of a log.

    summary : what the command prints. output : the file that holds the samples; without one,
    columns : the samples in memory, by name.
    """

    summary: dict[str, Any]
    findings: tuple[Finding, ...]
    output: Path | None
    columns: dict[str, FloatArray] | None = None

    @property
    def notes(self) -> tuple[str, ...]:
        """What was found of calibration and log: the text does not repeat it."""
        return tuple(map(told, self.findings))

    def to_report(self) -> Report:
        """Return size of the wrench with and without the calibration."""
        return wrench_report(self.summary)

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
        if self.output.suffix.lower() == ".csv":
            from pyarrow import csv

            frame: pd.DataFrame = csv.read_csv(self.output).to_pandas()
            return frame
        if self.output.suffix.lower() == ".mcap":
            return pd.DataFrame(read_recording(self.output))
        return pd.read_parquet(self.output)

    def drawings(self) -> tuple[Drawing, ...]:
        """Return the figure of the contact wrench over the time of the log."""
        from tdfscal.reporting.figures.timeline import contact_wrench

        frame = self.to_frame()
        columns = {name: frame[name].to_numpy() for name in ("time", *_DRAWN)}
        return (contact_wrench(columns, self.summary["largest"]["force"]),)


_DRAWN = (*COMPONENTS, *(f"raw_{name}" for name in COMPONENTS))


@options.command("apply calibration.yaml assembly/log.csv -o wrench.csv")
def apply(
    calibration: options.OneCalibration,
    paths: options.Paths,
    *,
    output: Annotated[
        PathLike | None,
        options.written(
            "result: .csv, .parquet or .mcap, written as the log passes",
            *SUFFIXES,
            holds="",
        ),
    ] = None,
    rig: options.RigFile = None,
    from_: options.Begin = None,
    to: options.End = None,
    filter: Annotated[
        Kind, Option("Kalman filter: causal, as a controller's; or smoothed, without delay")
    ] = "none",
    at: options.LcsPoint = (0.0, 0.0, 0.0),
    progress: options.Telling = SILENT,
) -> ApplyResult:
    """Work out the contact force and torque over a whole log.

    Raises
    ------
    UsageError, RigError, DataError
    """
    target = one(output)
    walk = None if filter == "none" else WALK
    point = np.array(triple("--at", at))
    use = take(calibration, paths, rig)
    log = WrenchPass.of(use, Settings(progress, window(from_, to)), point)
    moving = log.given.rig.inertia is not None
    progress.stage("reading the log and working out the contact wrench")
    noises, totals = list[SampleNoise](), Totals()
    head, samples = log.read()
    effect = None
    if walk is not None and head is not None:
        with np.errstate(all="ignore"):
            model = filter_for(walk, head.samples)
        samples = filtered(samples, filter, model)
        effect = filter_effect(filter, walk, model)
    wrenches = log.wrenches(totals.standstill.watch(samples))
    age, moved, scatter = ZeroAge(), None, use.posture_std
    if head is not None:
        age, moved = zeros_since(use, head, log.thermometer, scatter)
        wrenches = with_sample_noise(
            wrenches,
            head,
            log.given,
            posture_std=scatter,
            shares=use.sensor_shares,
            zero_variance=moved,
            tell=noises.append,
        )
    wrenches, kept = totals.passing(wrenches), list[dict[str, FloatArray]]()
    # Numbers out of all proportion are refused by name, not warned of by numpy.
    with np.errstate(all="ignore"):
        if target is not None:
            about = metadata(use, filter, walk, point, moving=moving)
            # A wrench is about the origin of its frame.
            frame = f"{LCS_FRAME}_at" if point.any() else LCS_FRAME
            write_wrenches(target, wrenches, about, frame=frame)
        else:
            kept += [columns_of(piece) for piece in numbers_only(wrenches)]
        if not totals.rows:
            raise log.nothing()
        found = (*use.findings, *log.findings())
    columns = None
    if target is None:
        columns = {name: np.concatenate([part[name] for part in kept]) for name in COLUMNS}
    summary = summary_of(log, target, totals, moving=moving)
    summary["about"] = point.tolist()
    summary["noise"] = noise_effect(noises[0], scatter) if noises else None
    summary["zeros"] = zero_effect(age, moved, summary["end"])
    summary["filter"] = effect
    return ApplyResult(summary, found, target, columns)


@dataclass(slots=True)
class Totals:
    """What the summary says of the rows.

    squares : (4, 6), sums of squares of the wrench, of the uncalibrated one, of its standard
    uncertainty and of the calibration's part of that. largest : (2,), lengths. begin, end : s.
    still_squares : (6,), of the wrench at the stops, and still_rows, how many.
    """

    squares: FloatArray = field(default_factory=lambda: np.zeros((4, 6)))
    largest: FloatArray = field(default_factory=lambda: np.zeros(2))
    rows: int = 0
    begin: float = np.nan
    end: float = np.nan
    standstill: Standstill = field(default_factory=Standstill)
    still_squares: FloatArray = field(default_factory=lambda: np.zeros(6))
    still_rows: int = 0

    def passing(self, pieces: Iterable[Wrenches]) -> Iterator[Wrenches]:
        """Count the pieces of a log as they pass."""
        for piece in pieces:
            each = (piece.value, piece.raw, piece.std, piece.calibration_std)
            self.squares += [np.einsum("ka,ka->a", part, part) for part in each]
            lengths = np.sqrt(np.sum(piece.value.reshape(-1, 2, 3) ** 2, axis=2)).max(axis=0)
            self.largest = np.maximum(self.largest, lengths)
            if not self.rows:
                self.begin = float(piece.time[0])
            self.end = float(piece.time[-1])
            self.rows += len(piece.time)
            still = piece.value[self.standstill.at(piece.time)]
            self.still_squares += np.einsum("ka,ka->a", still, still)
            self.still_rows += len(still)
            yield piece


def filter_effect(kind: str, walk: float, model: Walk) -> dict[str, Any]:
    """What the filter does, SI units; noise_left as a share, None where there is no noise."""
    smooth = kind == "smooth"
    return {
        "kind": kind,
        "walk": walk,
        "gain": model.gain,
        "noise": float(np.sqrt(model.r)),
        "noise_left": model.noise_left(smooth=smooth) if model.r > 0 else None,
        "delay": 0.0 if smooth else model.delay,
    }


def noise_effect(noise: SampleNoise, posture: float) -> dict[str, Any]:
    """What a sample adds by its noise, SI units, and what that was measured on.

    posture : N per axis, noise of a force at a posture.
    """
    return document(noise, "dwells windows", std=_by_component(noise.std), posture=posture)


def zero_effect(age: ZeroAge, moved: ZeroVariance | None, end: float) -> dict[str, Any]:
    """How old the zeros are at the log's end, s, and by how much they may have moved, N."""
    variance = 0.0 if moved is None else moved(np.array([end])).max()
    return document(age, "age=seconds age_known=known", moved=np.sqrt(variance))


def metadata(
    use: InUse, kind: str, walk: float | None, point: FloatArray, *, moving: bool
) -> dict[str, str]:
    """Metadata of a Parquet file."""
    place = f"the point ({', '.join(f'{x:g}' for x in point)}) m" if point.any() else "the origin"
    return {
        "quantity": f"contact wrench on the terminal: force, and moment about {place} of the LCS",
        "frame": "LCS",
        "units": "s, N, N·m",
        "u_": "standard uncertainty (k = 1) of the single sample, its noise included",
        "u_cal_": "the part of the calibration and the rig's constants, common to all samples",
        "raw_": "the same with the nominal mounting and the stated zeros, mass and barycentre",
        "filter": "none" if walk is None else f"{kind}, walk {walk:g} N in 1 s",
        "inertia": "included" if moving else "not included (quasi-static)",
        "calibration": f"{use.calibration.method}, {use.calibration.created}, "
        f"{use.calibration.status}",
        "rig": use.given.rig.name,
    }


def summary_of(
    log: WrenchPass,
    output: Path | None,
    totals: Totals,
    *,
    moving: bool,
) -> dict[str, Any]:
    """Return the document of the command, SI units; rms of each component over the rows."""
    roots = {
        what: _by_component(np.sqrt(squares / totals.rows))
        for what, squares in zip(_ROOTS, totals.squares, strict=True)
    }
    return {
        "output": None if output is None else str(output),
        "rows": totals.rows,
        "start": totals.begin,
        "end": totals.end,
        "quasi_static": not moving,
        "calibration_status": log.use.calibration.status,
        "left_out": document(log.tally, "uncovered unreadable"),
        **roots,
        "stops": _stops(totals),
        "largest": dict(zip(("force", "torque"), totals.largest.tolist(), strict=True)),
    }


def _stops(totals: Totals) -> dict[str, Any] | None:
    """Samples at standstill and the rms of the wrench there; None where nothing else moves."""
    if not 0 < totals.still_rows < totals.rows:
        return None
    rms = _by_component(np.sqrt(totals.still_squares / totals.still_rows))
    return {"rows": totals.still_rows, "rms": rms}


def _by_component(values: FloatArray) -> dict[str, float | None]:
    """Values (6,) by the wrench's components, None where one is unknown."""
    return {name: plain(value) for name, value in zip(COMPONENTS, values, strict=True)}
