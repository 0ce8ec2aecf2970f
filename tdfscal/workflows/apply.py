"""`apply`: the contact wrench of a whole log."""

from __future__ import annotations

from dataclasses import dataclass
from pathlib import Path
from typing import TYPE_CHECKING, Annotated, Any

import numpy as np

from tdfscal.catalogue import told_of
from tdfscal.files.outputs import check_outputs
from tdfscal.files.writers.wrenches import (
    COLUMNS,
    SUFFIXES,
    columns_of,
    numbers_only,
    read_recording,
    write_wrenches,
)
from tdfscal.model.zero_motion import ZeroAge
from tdfscal.records import FloatArray
from tdfscal.reporting.contact_wrench import summary_report
from tdfscal.reporting.layout import Drawing, Report
from tdfscal.workflows.arguments import (
    PathLike,
    listed,
    one,
    triple,
    window,
)
from tdfscal.workflows.calibration import paths_of
from tdfscal.workflows.calibration_in_use import take, zeros_since
from tdfscal.workflows.campaign import inputs_read
from tdfscal.workflows.log_pass import Settings
from tdfscal.workflows.options import (
    Begin,
    End,
    LcsPoint,
    OneCalibration,
    Option,
    Paths,
    RigFile,
    Telling,
    command,
)
from tdfscal.workflows.progress import SILENT
from tdfscal.workflows.result import Result
from tdfscal.workflows.wrench_pass import WrenchPass
from tdfscal.workflows.wrench_summary import (
    Totals,
    filter_effect,
    metadata,
    noise_effect,
    summary_of,
    zero_effect,
)
from tdfscal.wrench.contact_wrench import COMPONENTS
from tdfscal.wrench.filtering import WALK, Kind, filter_for, filtered
from tdfscal.wrench.sample_noise import SampleNoise, coloured_noise, with_sample_noise

if TYPE_CHECKING:
    import pandas as pd


@dataclass(frozen=True, slots=True, repr=False)
class ApplyResult(Result):
    """Contact wrenches of a log.

    summary : what the command prints. output : the file that holds the samples; without one,
    columns : the samples in memory, by name.
    """

    summary: dict[str, Any]
    output: Path | None
    columns: dict[str, FloatArray] | None = None

    @property
    def notes(self) -> tuple[str, ...]:
        """What was found of calibration and log: the text does not repeat it."""
        return tuple(told_of(finding) for finding in self.summary["findings"])

    def to_report(self) -> Report:
        """Return size of the wrench with and without the calibration."""
        return summary_report(self.summary)

    def to_dict(self) -> dict[str, Any]:
        """Return the summary as plain JSON values."""
        return dict(self.summary)

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


@command("apply calibration.yaml assembly/log.csv -o wrench.csv")
def apply(
    calibration: OneCalibration,
    paths: Paths,
    *,
    output: Annotated[
        PathLike | None,
        Option(
            "result: .csv, .parquet or .mcap, written as the log passes",
            Path,
            "FILE",
            ("--output", "-o"),
            default=...,
            python="without it the samples stay in memory",
        ),
    ] = None,
    rig: RigFile = None,
    from_: Begin = None,
    to: End = None,
    filter: Annotated[
        Kind, Option("Kalman filter: causal, as a controller's; or smoothed, without delay")
    ] = "none",
    at: LcsPoint = (0.0, 0.0, 0.0),
    progress: Telling = SILENT,
) -> ApplyResult:
    """Work out the contact force and torque over a whole log.

    Raises
    ------
    UsageError, RigError, DataError
    """
    target, files = one(output), listed(paths)
    reads = inputs_read(files, one(rig), files=paths_of([calibration]))
    check_outputs({"--output": (target, SUFFIXES)}, reads)
    walk = None if filter == "none" else WALK
    point = np.array(triple("--at", at))
    settings = Settings(progress, window(from_, to))
    use = take(calibration, files, one(rig))
    passing = WrenchPass.of(use, settings, point)
    log, given, moving = passing.log, passing.given, passing.moving
    progress.stage("reading the log and working out the contact wrench")
    noises, totals = list[SampleNoise](), Totals()
    head, samples = passing.samples()
    effect = None
    if walk is not None and head is not None:
        noise = coloured_noise(head, log.rig.axes)
        with np.errstate(all="ignore"):
            model = filter_for(filter, walk, head.samples, noise)
        samples, effect = (
            filtered(samples, filter, model),
            filter_effect(filter, walk, model, noise),
        )
    wrenches = passing.wrenches(samples)
    age, moved, scatter = ZeroAge(), None, use.posture_std
    if head is not None:
        age, moved = zeros_since(use, head, passing.thermometer, scatter)
        wrenches = with_sample_noise(
            wrenches,
            head,
            given,
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
            write_wrenches(target, wrenches, about, frame="lcs_at" if point.any() else "lcs")
        else:
            kept += [columns_of(piece) for piece in numbers_only(wrenches)]
        if not totals.rows:
            raise passing.nothing()
        notes = passing.findings()
    columns = None
    if target is None:
        columns = {name: np.concatenate([part[name] for part in kept]) for name in COLUMNS}
    summary = summary_of(use, target, passing.tally, totals, notes, moving=moving)
    summary["about"] = point.tolist()
    summary["noise"] = noise_effect(noises[0], scatter) if noises else None
    summary["zeros"] = zero_effect(age, moved, summary["end"])
    summary["filter"] = effect
    return ApplyResult(summary, target, columns)
