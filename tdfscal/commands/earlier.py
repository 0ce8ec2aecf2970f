"""Earlier calibrations, as files hold them, for what is made of them and further campaigns."""

from __future__ import annotations

from collections.abc import Sequence
from hashlib import sha256
from pathlib import Path

import numpy as np

from tdfscal.commands.recordings import Recording
from tdfscal.commands.result import Calibration, CalibrationSource, read_source
from tdfscal.comparison.members import EarlierCalibration
from tdfscal.errors import UsageError
from tdfscal.files.calibration.compared import campaigns_of, files_of, readings_of
from tdfscal.files.calibration.document import Calibration as CalibrationFile
from tdfscal.files.calibration.document import dump_calibration
from tdfscal.files.calibration.evidence import CampaignResult
from tdfscal.files.calibration.parameters import exact_moves, unscaled
from tdfscal.files.calibration.parts import HistoryEntry
from tdfscal.findings import Finding
from tdfscal.frozen import record, replace
from tdfscal.numerics import so3
from tdfscal.records import FloatArray, Measured


@record(kw_only=True)
class Earlier(EarlierCalibration):
    """A calibration file as what is known before another campaign."""

    file: Calibration
    measured: Measured
    sha256: str

    @property
    def campaigns(self) -> tuple[CampaignResult, ...]:
        """The campaigns that it stands on, as a file lists them."""
        return campaigns_of(self.file, self.name)

    def recordings(self) -> list[Recording]:
        """The recordings that it stands on."""
        known = files_of(self.file), readings_of(self.file, self.rig.supports)
        return [
            Recording(one.name, files, one.measured.record(), means)
            for one, files, means in zip(self.campaigns, *known, strict=True)
        ]

    def history(self) -> tuple[HistoryEntry, ...]:
        """The calibrations that one which stands on this one stands on."""
        own = {"created": self.file.created, "method": self.file.method, "sha256": self.sha256}
        last = HistoryEntry.model_validate({**own, "measured": self.file.measured})
        return (*self.file.history, last)


def read_earlier(source: CalibrationSource) -> Earlier:
    """Read a calibration as what is known before another campaign.

    Raises DataError, UsageError where it is none, or cannot be read.
    """
    name, file = read_source(source)
    known = unscaled(file)
    fits, measured = campaigns_of(file), file.measured.record()
    in_memory = isinstance(source, CalibrationFile) or str(source) == "-"
    content = dump_calibration(file, "yaml").encode() if in_memory else Path(name).read_bytes()
    return Earlier(
        name=name,
        month=measured.month,
        rig=known.rig,
        estimate=known,
        exact=exact_moves(file),
        contributions=_contributions(file, known.state.rotation, known.covariance),
        determined=file.determined,
        chi2=sum(fit.chi2 for fit in fits),
        dof=sum(fit.dof for fit in fits),
        file=file,
        measured=measured,
        sha256=sha256(content).hexdigest(),
    )


def _contributions(
    file: CalibrationFile, rotation: FloatArray, covariance: FloatArray
) -> dict[str, FloatArray]:
    """Variances (n, 3) of roll, pitch, yaw by source; none where the shares are not told."""
    if file.budget is None:
        return {}
    shares = np.zeros((len(file.determined), 3, len(file.budget.sources)))
    shares[file.determined] = file.budget.shares.reshape(-1, *shares.shape[1:])
    turns = 3 * len(rotation)
    variance = so3.rpy_variance(rotation, covariance[:turns, :turns])
    each = np.moveaxis(shares, 2, 0) * variance
    return dict(zip(file.budget.sources, each, strict=True))


def on_one_another(known: Sequence[Earlier]) -> list[Earlier]:
    """Let each calibration know the one among them that it updates.

    Raises UsageError where that is not among them, and older ones are.
    """
    found, first = list[Earlier](), min(e.month for e in known) if known else 0.0
    for e in known:
        last = e.file.history[-1] if e.file.history else None
        base = next((one for one in known if last and one.sha256 == last.sha256), None)
        if last and base is None and first < e.month:
            unnamed = Finding("calibration-unnamed", values={"date": last.created[:10]})
            raise UsageError(unnamed, where=e.name)
        found.append(replace(e, base=base))
    return found
