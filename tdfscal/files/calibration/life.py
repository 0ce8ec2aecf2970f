"""The calibration file's blocks on time: when it was measured, and what it stands on."""

from __future__ import annotations

from datetime import UTC, datetime
from typing import Annotated, Any, Literal, Self

from pydantic import StringConstraints, model_validator

from tdfscal.files.calibration.parts import Input, OpenRows, OpenStdRows, TerminalResult
from tdfscal.files.field_types import Count, NotNegative, Sha256, Strict, Text, fault, key
from tdfscal.records import Measured

Instant = Annotated[
    str,
    StringConstraints(strict=True, pattern=r"^\d{4}-\d{2}-\d{2}T\d{2}:\d{2}:\d{2}(\.\d{1,6})?Z$"),
]
"""UTC, ISO 8601."""


class MeasuredResult(Strict):
    """When the data were recorded, and whether the log, the rig file or the file's date says so."""

    begin: Instant = key("UTC: first sample")
    end: Instant = key("UTC: last sample")
    source: Literal["log", "rig", "file"] = key(
        "what says so: the log's clock, campaign.date, or the file's date"
    )

    @model_validator(mode="after")
    def _ordered(self) -> Self:
        if seconds(self.begin) > seconds(self.end):
            raise fault("ends before it begins", "end")
        return self

    def record(self) -> Measured:
        """Return it in seconds since 1970."""
        return Measured(seconds(self.begin), seconds(self.end), self.source)


class CampaignResult(Strict):
    """One of several campaigns: zeros in N and load are its own; χ² and dof that it added.

    Zeros are null for axes that its sensors did not measure.
    """

    name: Text = key("its folder")
    measured: MeasuredResult | None = key("when it was recorded", None)
    inputs: tuple[Input, ...] = key("its files")
    zero: OpenRows = key("N: its own zeros, per sensor")
    zero_std: OpenStdRows = key("N: their standard uncertainties; null where open")
    terminal: TerminalResult = key("its own mass and barycentre")
    postures: Count = key("number of postures used")
    chi2: NotNegative = key("χ² that it added: its residuals, and its departure from earlier ones")
    dof: Count = key("degrees of freedom that it added")


class HistoryEntry(Strict):
    """A calibration that this one stands on, by the hash of its file; the oldest first."""

    created: Instant = key("UTC: when it was computed")
    measured: MeasuredResult | None = key("when its data were recorded", None)
    method: Literal["self", "tracker", "joint"] = key("self, tracker or joint")
    sha256: Sha256 = key("of the calibration's file")


def instant(time: float) -> str:
    """Write seconds since 1970 as an instant, to the second."""
    return datetime.fromtimestamp(round(time), UTC).strftime("%Y-%m-%dT%H:%M:%SZ")


def seconds(text: str) -> float:
    """Read an instant as seconds since 1970."""
    return datetime.fromisoformat(text).timestamp()


def measured_document(measured: Measured | None) -> dict[str, Any] | None:
    """The block of a file."""
    if measured is None:
        return None
    return {
        "begin": instant(measured.begin),
        "end": instant(measured.end),
        "source": measured.source,
    }
