"""`export`: a calibration in the form that a controller or a registry takes."""

from __future__ import annotations

from dataclasses import dataclass
from pathlib import Path
from typing import Any, Literal

from tdfscal.errors import RejectedError, UsageError
from tdfscal.exports import FORMATS
from tdfscal.exports.certificate import certificate
from tdfscal.files.output_places import check_outputs
from tdfscal.files.outputs import together
from tdfscal.files.saving import write_text
from tdfscal.reporting.layout import Drawing
from tdfscal.workflows.arguments import PathLike, one, one_of
from tdfscal.workflows.calibration import (
    Calibration,
    CalibrationSource,
    paths_of,
    read_source,
    unsealed,
)
from tdfscal.workflows.progress import SILENT, Progress
from tdfscal.workflows.result import Result

Target = Literal["urdf", "ros", "ros-parameters", "ros-launch", "csv", "c", "dcc", "certificate"]


@dataclass(frozen=True, slots=True, repr=False)
class ExportResult(Result):
    """A calibration in another form. content : the text. output : the file that holds it.

    notes : what the command says beside it.
    """

    format: Target
    content: str
    calibration: Calibration
    output: Path | None
    notes: tuple[str, ...] = ()

    @property
    def text(self) -> str:
        """The export itself, where it is not in a file."""
        return self.content if self.output is None else ""

    def to_dict(self) -> dict[str, Any]:
        """Return format, the calibration's status, and the content or its place."""
        where = {"content": self.content} if self.output is None else {"output": str(self.output)}
        return {"format": self.format, "calibration_status": self.calibration.status, **where}

    def table(self) -> dict[str, list[Any]]:
        """One row per angle that is exported, in rad."""
        return self.calibration.table()

    def drawings(self) -> tuple[Drawing, ...]:
        """Return the calibration's figures."""
        return self.calibration.drawings()

    def __repr__(self) -> str:
        where = f"in {self.output}" if self.output else f"{len(self.content)} characters"
        return f"ExportResult: {self.format} of {self.calibration.rig.name}, {where}"


@together()
def export(
    calibration: CalibrationSource,
    to: Target,
    *,
    output: PathLike | None = None,
    parent: str = "bcs",
    schema: PathLike | None = None,
    allow_rejected: bool = False,
    progress: Progress = SILENT,
) -> ExportResult:
    """Write the rotations for a controller: URDF, ROS, CSV, C, or a draft certificate.

    Parameters
    ----------
    calibration : file, or a calibration in memory.
    to : urdf, ros (transforms), ros-parameters, ros-launch, csv, c, dcc (XML) or
        certificate (a page to print).
    output : file to write; without it the text is the result's `content`.
    parent : frame with the BCS's axes (URDF, ROS).
    schema : XSD that a DCC is checked against.
    allow_rejected : export what the quality gate rejected.
    progress : called as the work goes on.

    Raises
    ------
    RejectedError
        The quality gate rejected the calibration.
    UsageError, DataError
        The calibration cannot be read, or the file not be written.
    """
    del progress
    target = one(output)
    one_of("--to", to, list(FORMATS))
    if schema is not None and to != "dcc":
        raise UsageError("only a DCC has a schema", where="--schema", hint="use --to dcc")
    reads = [*paths_of([calibration]), *([Path(schema)] if schema is not None else [])]
    check_outputs({"--output": (target, ())}, reads)
    name, loaded = read_source(calibration)
    if not loaded.accepted and not allow_rejected:
        raise RejectedError(
            "the quality gate rejected this calibration; nothing was written",
            where=name,
            hint="use --allow-rejected to export it all the same",
        )
    if schema is not None:
        from tdfscal.exports.schemacheck import check, schema_version

        text = certificate(loaded, schema_version(Path(schema)))
        check(text, Path(schema))
    else:
        text = FORMATS[to](loaded, parent)
    if target is not None:
        write_text(target, text)
    return ExportResult(to, text, loaded, target, unsealed(loaded, name))
