"""`export`: a calibration in the form that a controller takes."""

from __future__ import annotations

from pathlib import Path
from typing import Annotated, Any, Literal

import numpy as np

from tdfscal.catalogue import told
from tdfscal.commands import options
from tdfscal.commands.arguments import SILENT, PathLike, one
from tdfscal.commands.calibration import (
    Calibration,
    read_source,
)
from tdfscal.commands.capability import CapabilityResult
from tdfscal.commands.options import Option
from tdfscal.commands.result import Result
from tdfscal.errors import DataError, RejectedError, UsageError
from tdfscal.exports import FORMATS, WITH_THRESHOLDS
from tdfscal.exports.formats import ContactThresholds
from tdfscal.exports.statements import cautions
from tdfscal.files.calibration.defects import below_accepted
from tdfscal.files.yaml import read_document
from tdfscal.frozen import record
from tdfscal.records import BCS_FRAME
from tdfscal.reporting.layout import Drawing

Target = Literal["urdf", "ros", "csv", "c"]


@record(eq=False)
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
        """Return the format, the calibration's status, and the content or its place."""
        where = {"content": self.content} if self.output is None else {"output": str(self.output)}
        return {"to": self.format, "calibration_status": self.calibration.status, **where}

    def table(self) -> dict[str, list[Any]]:
        """One row per angle that is exported, in rad."""
        return self.calibration.table()

    def drawings(self) -> tuple[Drawing, ...]:
        """Return the calibration's figures."""
        return self.calibration.drawings()

    def __repr__(self) -> str:
        where = f"in {self.output}" if self.output else f"{len(self.content)} characters"
        return f"ExportResult: {self.format} of {self.calibration.rig.name}, {where}"


@options.command("export calibration.yaml --to urdf -o sensors.urdf", output="content")
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
    capability: Annotated[
        PathLike | CapabilityResult | None,
        Option(
            "thresholds of a path, for ROS and C: what `capability --json` printed",
            Path | None,
            "FILE",
            python="or its result",
            reads=True,
        ),
    ] = None,
    progress: options.Telling = SILENT,
) -> ExportResult:
    """Write the rotations for a controller: URDF, ROS, CSV or C.

    Raises
    ------
    RejectedError
        The quality gate rejected the calibration.
    UsageError, DataError
        The calibration cannot be read, or the file not be written.
    """
    name, loaded = read_source(calibration)
    if not loaded.accepted and not allow_rejected:
        raise RejectedError(
            "the quality gate rejected this calibration; nothing was written",
            where=name,
            hint="use --allow-rejected to export it all the same",
        )
    found = map(told, below_accepted(name, loaded))
    limits = None if capability is None else _thresholds(capability, loaded, to, allow_rejected)
    text = FORMATS[to](loaded, parent, limits)
    return ExportResult(to, text, loaded, one(output), (*found, *cautions(loaded)))


def _thresholds(
    capability: PathLike | CapabilityResult, loaded: Calibration, to: Target, allow_rejected: bool
) -> ContactThresholds:
    """Thresholds of a path, noise included, of what `capability --json` prints."""
    if to not in WITH_THRESHOLDS:
        raise UsageError(
            f"{to} holds no thresholds", where="--capability", hint="leave it out, or take ros or c"
        )
    if isinstance(capability, CapabilityResult):
        name, found = "capability", capability.to_dict()
    else:
        name, found = str(capability), read_document(Path(capability), DataError).content
    try:
        noiseless = [f["text"] for f in found["findings"] if f["code"] == "path-without-noise"]
        rejected = [f["text"] for f in found["findings"] if f["severity"] == "rejects"]
        reasons = [] if found["for_machine"] and not rejected else rejected + noiseless
        created, cutoff = found["calibration_created"], found["filter"]
        x, y, z = map(float, found["about"])
        values = [
            np.nan if axis["threshold"] is None else axis["threshold"] for axis in found["axes"]
        ]
        band = f"behind {cutoff:g} Hz" if cutoff else "unfiltered"
        path = f"on a path of {found['duration']:.4g} s, {band}"
        path += ", WITHOUT the noise of samples: too low" if noiseless else ""
        limits = ContactThresholds(
            np.array(values, dtype=np.float64).reshape(6), (x, y, z), found["false_stops"], path
        )
    except (KeyError, TypeError, ValueError) as error:
        raise DataError(
            "holds no thresholds",
            where=name,
            hint="write it with tdfscal capability CALIBRATION PATH --json > FILE",
        ) from error
    if created != loaded.created:
        raise DataError(
            "holds the thresholds of another calibration",
            where=name,
            hint="run capability with the calibration that is exported",
        )
    if reasons and not allow_rejected:
        raise RejectedError(
            f"no thresholds for a machine: {'; '.join(reasons)}",
            where=name,
            hint="use --allow-rejected to export its thresholds all the same",
        )
    return limits
