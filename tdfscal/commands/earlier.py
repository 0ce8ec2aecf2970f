"""A calibration file as what is known before another campaign speaks."""

from __future__ import annotations

from dataclasses import dataclass
from datetime import datetime
from hashlib import sha256
from pathlib import Path
from typing import Any

import numpy as np

from tdfscal.commands.calibration import Calibration, CalibrationSource, read_source
from tdfscal.commands.calibration_in_use import calibrated
from tdfscal.commands.recordings import Recording
from tdfscal.comparison.rig_history import EarlierCalibration
from tdfscal.files.calibration.document import Calibration as CalibrationFile
from tdfscal.files.calibration.document import dump_calibration
from tdfscal.files.calibration.parts import measured_document
from tdfscal.model.calibrated import with_rotations
from tdfscal.model.earlier import constants_known
from tdfscal.records import BoolArray, FloatArray, InputFile, Measured


@dataclass(frozen=True, slots=True, kw_only=True)
class Earlier(EarlierCalibration):
    """A calibration file as what is known before another campaign."""

    file: Calibration

    @property
    def inputs(self) -> list[InputFile]:
        """The files that it was calibrated from."""
        return [entry.record() for entry in self.file.inputs]

    def campaigns(self) -> tuple[dict[str, Any], ...]:
        """The campaigns that it stands on, as a file lists them."""
        if self.file.campaigns:
            return tuple(c.model_dump(mode="json") for c in self.file.campaigns)
        return (_alone(self),)

    def recordings(self) -> list[Recording]:
        """The recordings that it stands on."""
        if not self.file.campaigns:
            return [Recording(self.name, self.inputs, self.measured)]
        return [
            Recording(
                c.name, [i.record() for i in c.inputs], c.measured.record() if c.measured else None
            )
            for c in self.file.campaigns
        ]

    def history(self) -> tuple[dict[str, Any], ...]:
        """The calibrations that one which stands on this one stands on."""
        own = {
            "created": self.file.created,
            "measured": measured_document(self.measured),
            "method": self.file.method,
            "sha256": self.sha256,
        }
        return (*(entry.model_dump(mode="json") for entry in self.file.history), own)


def read_earlier(source: CalibrationSource) -> Earlier:
    """Read a calibration as what is known before another campaign.

    Raises DataError, UsageError where it is none, or cannot be read.
    """
    name, file = read_source(source)
    known = calibrated(file, name)
    covariance = known.covariance
    if file.parameters is not None and file.parameters.unscaled is not None:
        covariance = _unscaled(covariance, file.determined, np.array(file.parameters.unscaled))
    # In motion the noise is estimated with the fit: its χ² tells nothing of what was stated.
    alone = () if file.fit is None or file.motion is not None else (file.fit,)
    fits = file.campaigns or alone
    in_memory = isinstance(source, CalibrationFile) or str(source) == "-"
    content = dump_calibration(file, "yaml").encode() if in_memory else Path(name).read_bytes()
    last = file.history[-1] if file.history else None
    return Earlier(
        name=name,
        file=file,
        rig=known.rig,
        state=known.state,
        information=constants_known(known.rig, covariance),
        determined=file.determined,
        measured=_measured(file),
        sha256=sha256(content).hexdigest(),
        chi2=sum(fit.chi2 for fit in fits),
        dof=sum(fit.dof for fit in fits),
        base=None if last is None else (last.sha256, last.created),
        pooled=bool(file.campaigns),
    )


def _unscaled(covariance: FloatArray, determined: BoolArray, own: FloatArray) -> FloatArray:
    """Covariance (P, P) with that of the determined sensors' turns replaced by their own."""
    stand = np.zeros(len(covariance), dtype=np.bool_)
    stand[: 3 * len(determined)] = np.repeat(determined, 3)
    order = np.argsort(~stand, kind="stable")  # with_rotations replaces the first block
    back = np.argsort(order)
    moved = with_rotations(covariance[np.ix_(order, order)], int(stand.sum()), own)
    return np.asarray(moved[np.ix_(back, back)])


def _measured(file: CalibrationFile) -> Measured:
    """When its data were recorded; a file of old says when it was computed."""
    if file.measured is not None:
        return file.measured.record()
    moment = datetime.fromisoformat(file.created).timestamp()
    return Measured(moment, moment, "file")


def _alone(earlier: Earlier) -> dict[str, Any]:
    """The one campaign of a calibration, as a file with several lists it."""
    file = earlier.file
    return {
        "name": earlier.name,
        "measured": measured_document(earlier.measured),
        "inputs": file.inputs,
        "zero": [support.zero for support in file.supports],
        "zero_std": [support.zero_std for support in file.supports],
        "terminal": file.terminal,
        "postures": 0 if file.fit is None else file.fit.postures,
        "chi2": earlier.chi2,
        "dof": earlier.dof,
    }
