"""`apply`: the contact wrench of a whole log."""

from __future__ import annotations

from dataclasses import dataclass
from pathlib import Path
from typing import TYPE_CHECKING, Annotated, Any

import numpy as np

from tdfscal.catalogue import told_of
from tdfscal.checks.log_against_calibration import Inspection
from tdfscal.dwells.temperature import Thermometer
from tdfscal.errors import DataError
from tdfscal.files.outputs import check_outputs
from tdfscal.files.writers.wrenches import (
    COLUMNS,
    SUFFIXES,
    columns_of,
    numbers_only,
    read_recording,
    write_wrenches,
)
from tdfscal.model.calibrated import about_point
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
from tdfscal.workflows.calibration_in_use import InUse, take, zeros_since
from tdfscal.workflows.campaign import inputs_read
from tdfscal.workflows.log_pass import LogPass, Settings
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
from tdfscal.workflows.wrench_summary import (
    Totals,
    filter_effect,
    left_out,
    metadata,
    noise_effect,
    summary_of,
    zero_effect,
)
from tdfscal.wrench.contact_wrench import COMPONENTS, at_rest, in_motion
from tdfscal.wrench.filtering import WALK, Kind, filter_for, filtered
from tdfscal.wrench.resampling import Tally, aligned
from tdfscal.wrench.sample_noise import SampleNoise, coloured_noise, take_head, with_sample_noise

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
    given = about_point(use.given, point)
    moving = use.given.rig.inertia is not None
    log = LogPass(use.campaign, settings)
    progress.stage("reading the log and working out the contact wrench")
    tally, noises = Tally(), list[SampleNoise]()
    totals = Totals()
    inspection, thermometer = Inspection(use.given), Thermometer()
    samples = inspection.watch(aligned(thermometer.passing(log.pieces()), tally))
    head, samples = take_head(samples, log.rig.supports, averaged=use.campaign.averaged)
    effect = None
    if walk is not None and head is not None:
        noise = coloured_noise(head, log.rig.axes)
        with np.errstate(all="ignore"):
            model = filter_for(filter, walk, head.samples, noise)
        samples, effect = (
            filtered(samples, filter, model),
            filter_effect(filter, walk, model, noise),
        )
    wrenches = in_motion(given, samples) if moving else at_rest(given, samples)
    age, moved, scatter = ZeroAge(), None, _posture_std(use)
    if head is not None:
        age, moved = zeros_since(use, head, thermometer, scatter)
        wrenches = with_sample_noise(
            wrenches,
            head,
            given,
            posture_std=scatter,
            shares=_shares(use),
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
            raise DataError(
                "there is no instant at which every NCP's position and force are known",
                where=", ".join(map(str, files)),
                hint="check that all streams were recorded at the same time",
            )
        notes = [*log.messages, *inspection.finish(), *left_out(tally, use)]
    columns = None
    if target is None:
        columns = {name: np.concatenate([part[name] for part in kept]) for name in COLUMNS}
    summary = summary_of(use, target, tally, totals, notes, moving=moving)
    summary["about"] = point.tolist()
    summary["noise"] = noise_effect(noises[0], scatter) if noises else None
    summary["zeros"] = zero_effect(age, moved, summary["end"])
    summary["filter"] = effect
    return ApplyResult(summary, target, columns)


def _posture_std(use: InUse) -> float:
    """Noise of a force at a posture, N per axis, as the calibration's own residuals show it."""
    fit = use.calibration.fit
    if fit is None or fit.dof <= 0:
        return 0.0
    return use.reading_noise * float(np.sqrt(max(6 * fit.postures / fit.dof, 1.0)))


def _shares(use: InUse) -> FloatArray | None:
    """Share (n,) of each sensor in the noise of a posture, 1 on average; None where alike."""
    fit = use.calibration.fit
    if fit is None or fit.channel_noise is None:
        return None
    variance = np.sum(np.square(fit.channel_noise), axis=1)
    return np.asarray(variance / variance.mean())
