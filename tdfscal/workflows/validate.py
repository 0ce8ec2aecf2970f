"""`validate`: does a calibration still hold on a log recorded without contact?"""

from __future__ import annotations

from dataclasses import dataclass
from datetime import UTC, datetime
from os import PathLike
from typing import TYPE_CHECKING, Any

import numpy as np

from tdfscal.files.output_places import PAGE_SUFFIXES, check_outputs
from tdfscal.files.outputs import together
from tdfscal.files.saving import write_text
from tdfscal.records import FloatArray, InputFile
from tdfscal.reporting.validation import Origin, document, validation_report
from tdfscal.validation import residual_wrench
from tdfscal.validation.residual_wrench import Validation
from tdfscal.workflows.arguments import PathLikes, listed, one
from tdfscal.workflows.calibration import Calibration, CalibrationSource, paths_of
from tdfscal.workflows.calibration_in_use import InUse, take
from tdfscal.workflows.inputs_read import inputs_read
from tdfscal.workflows.log_pass import LogPass
from tdfscal.workflows.progress import SILENT, Progress
from tdfscal.workflows.result import Result
from tdfscal.wrench.contact_wrench import COMPONENTS

if TYPE_CHECKING:
    import pandas as pd

    from tdfscal.reporting.figures.style import Drawing
    from tdfscal.reporting.layout import Report


@dataclass(frozen=True, slots=True, repr=False)
class ValidateResult(Result):
    """Verdict of `validate`.

    validation : the test, with the residual contact wrench of every posture. warnings : of the
    calibration, the log and the test. inputs : the logs.
    """

    validation: Validation
    calibration: Calibration
    warnings: tuple[str, ...]
    inputs: tuple[InputFile, ...]

    @property
    def holds(self) -> bool:
        """The residual wrenches are what the stated uncertainties explain."""
        return self.validation.holds

    @property
    def exit_status(self) -> int:
        """1 where the calibration does not hold."""
        return 0 if self.holds else 1

    def to_report(self) -> Report:
        """Return verdict, causes, residual wrenches."""
        return validation_report(self.validation, self.warnings)

    @property
    def notes(self) -> tuple[str, ...]:
        """What concerns the calibration's use, said beside the verdict too."""
        own = set(self.validation.warnings)
        return tuple(text for text in self.warnings if text not in own)

    def to_dict(self) -> dict[str, Any]:
        """Return the verdict and all residual wrenches as plain JSON values."""
        return document(self.validation, self.warnings)

    def to_frame(self) -> pd.DataFrame:
        """One row per posture and component: residual before and after, its std; N, N·m, LCS."""
        import pandas as pd

        v = self.validation
        count, parts = v.calibrated.shape

        def each(values: FloatArray) -> FloatArray:
            return np.repeat(values[v.used], parts)

        return pd.DataFrame(
            {
                "dwell": np.repeat(v.used, parts),
                "start": each(v.dwells.start),
                "end": each(v.dwells.end),
                "component": np.tile(np.array(COMPONENTS), count),
                "uncalibrated": v.nominal.ravel(),
                "calibrated": v.calibrated.ravel(),
                "std": v.std.ravel(),
            }
        )

    def drawings(self) -> tuple[Drawing, ...]:
        """Return the figure of the residual wrench, before and after."""
        from tdfscal.reporting.figures import validation

        return (validation.draw(self.validation),)


@together()
def validate(
    calibration: CalibrationSource,
    paths: PathLikes,
    *,
    rig: str | PathLike[str] | None = None,
    html: str | PathLike[str] | None = None,
    command: str = "tdfscal.validate",
    progress: Progress = SILENT,
) -> ValidateResult:
    """Check a calibration on static postures without contact: still valid, or what changed.

    Parameters
    ----------
    calibration : file, or a calibration in memory.
    paths : campaign folder, or log files.
    rig : rig.yaml, where no folder holds one; else the one that the calibration embeds.
    html : report page to write.
    command : kept on the page, as what was asked for.
    progress : called as the work goes on.

    Raises
    ------
    TdfscalError
        By cause: UsageError, RigError, DataError.
    """
    files, page = listed(paths), one(html)
    reads = inputs_read(files, rigs=[one(rig)], files=paths_of([calibration]))
    check_outputs({"--html": page}, reads, {"--html": PAGE_SUFFIXES})
    use = take(calibration, files, one(rig))
    log = LogPass(use.campaign, progress)
    with log.explaining():
        dwells = log.dwells()
        progress.stage(f"testing the calibration on {len(dwells)} dwells")
        result = residual_wrench.validate(
            use.given,
            dwells,
            rig=use.campaign.rig.rig,
            noise=_fit_noise(use),
        )
    # The log's own warnings come with its dwells.
    warnings = (*use.warnings, *_used_before(use, log), *result.warnings)
    if page is not None:
        from tdfscal.reporting.html import render_validation

        progress.stage("drawing the report")
        created = datetime.now(UTC).strftime("%Y-%m-%d %H:%M:%S UTC")
        origin = Origin(use.calibration, use.name, command, created, tuple(log.inputs))
        write_text(page, render_validation(result, warnings, origin))
    return ValidateResult(result, use.calibration, warnings, tuple(log.inputs))


def _used_before(use: InUse, log: LogPass) -> list[str]:
    """Warnings of logs that went into the calibration itself."""
    used = {entry.sha256 for entry in use.calibration.inputs}
    return [
        f"{entry.path} went into this calibration: what it shows is no proof"
        for entry in log.inputs
        if entry.sha256 in used
    ]


def _fit_noise(use: InUse) -> float | None:
    """Noise per reading and axis that the calibration's own residuals show, N."""
    fit = use.calibration.fit
    # The residual force of a posture is the sum of n readings, three axes each.
    return None if fit is None else float(fit.rms_force / np.sqrt(3 * use.given.rig.n))
