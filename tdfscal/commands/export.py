"""`export`: a calibration in the form that a controller takes."""

from __future__ import annotations

from pathlib import Path
from typing import Annotated, Any, Literal

from tdfscal.catalogue import told
from tdfscal.commands import options
from tdfscal.commands.campaign import PathLike, one
from tdfscal.commands.options import Option, silent
from tdfscal.commands.result import Calibration, CommandResult, read_source
from tdfscal.errors import RejectedError
from tdfscal.exports import FORMATS, SUFFIXES, cautions
from tdfscal.files.calibration.compared import defects
from tdfscal.files.outputs import check_suffix
from tdfscal.findings import Finding
from tdfscal.frozen import record
from tdfscal.records import BCS_FRAME

Target = Literal["urdf", "ros", "csv"]


@record(eq=False)
class ExportResult(CommandResult):
    """A calibration in another form. content : the text. output : the file that holds it."""

    format: Target
    content: str
    calibration: Calibration
    output: Path | None
    findings: tuple[Finding, ...] = ()

    @property
    def notes(self) -> tuple[str, ...]:
        """What must be known of the calibration, and of what no controller takes from it."""
        own = (told(found) for found in self.findings if found.code != "calibration-unsealed")
        return (*own, *cautions(self.calibration))

    @property
    def text(self) -> str:
        """The export itself, where it is not in a file."""
        return self.content if self.output is None else ""

    def document(self) -> dict[str, Any]:
        """Return the format, the calibration's status, and the content or its place."""
        where = {"content": self.content} if self.output is None else {"output": str(self.output)}
        return {"to": self.format, "calibration_status": self.calibration.status, **where}

    def table(self) -> dict[str, list[Any]]:
        """One row per angle that is exported, in rad."""
        return self.calibration.table()

    def __repr__(self) -> str:
        where = f"in {self.output}" if self.output else f"{len(self.content)} characters"
        return f"ExportResult: {self.format} of {self.calibration.rig.name}, {where}"


@options.command("export calibration.yaml --to urdf -o sensors.urdf")
def export(
    calibration: options.OneCalibration,
    to: Annotated[Target, Option("format", names=("--to",), default=...)],
    *,
    output: Annotated[
        PathLike | None,
        options.written("file to write", default=Path("-"), shell="default: stdout"),
    ] = None,
    parent: Annotated[
        str, Option("frame with the BCS's axes (URDF, ROS)", metavar="FRAME")
    ] = BCS_FRAME,
    allow_rejected: Annotated[bool, Option("export what the quality gate rejected")] = False,
    progress: options.Telling = silent,
) -> ExportResult:
    """Write the rotations for a controller: URDF, ROS, or CSV."""
    place = one(output)
    if place is not None:
        check_suffix(place, SUFFIXES[to])
    name, loaded = read_source(calibration)
    if not loaded.accepted and not allow_rejected:
        raise RejectedError(
            "the quality gate rejected this calibration; nothing was written",
            where=name,
            hint="use --allow-rejected to export it all the same",
        )
    text = FORMATS[to](loaded, parent)
    return ExportResult(to, text, loaded, place, defects(name, loaded))
