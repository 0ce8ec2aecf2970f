"""A log as it passes under a calibration: samples on one time base, its head, the wrenches."""

from __future__ import annotations

from collections.abc import Iterable, Iterator
from dataclasses import dataclass, field

from tdfscal.checks.log_against_calibration import Inspection
from tdfscal.commands.calibration_in_use import InUse
from tdfscal.commands.log_pass import LogPass, Settings
from tdfscal.dwells.temperature import Thermometer
from tdfscal.errors import DataError
from tdfscal.findings import Finding, Value
from tdfscal.model.calibrated import Calibrated, about_point
from tdfscal.records import FloatArray
from tdfscal.wrench.contact_wrench import Wrenches, at_rest, in_motion
from tdfscal.wrench.observable import observable_text
from tdfscal.wrench.resampling import Samples, Tally, aligned
from tdfscal.wrench.sample_noise import LogHead, take_head


@dataclass(slots=True)
class WrenchPass:
    """What one reading of a log under a calibration needs, and leaves behind.

    given : about the point that moments are about.
    """

    use: InUse
    given: Calibrated
    log: LogPass
    inspection: Inspection
    tally: Tally = field(default_factory=Tally)
    thermometer: Thermometer = field(default_factory=Thermometer)

    @classmethod
    def of(cls, use: InUse, settings: Settings, point: FloatArray) -> WrenchPass:
        """Start with a point (3,), m, LCS."""
        given = about_point(use.given, point)
        return cls(use, given, LogPass(use.campaign, settings), Inspection(use.given))

    @property
    def moving(self) -> bool:
        """The wrench has its inertial terms."""
        return self.given.rig.inertia is not None

    def samples(self) -> tuple[LogHead | None, Iterator[Samples]]:
        """Begin to read: the beginning, and the samples from their first on."""
        pieces = aligned(self.thermometer.passing(self.log.pieces()), self.tally)
        averaged = self.use.campaign.averaged
        return take_head(self.inspection.watch(pieces), self.log.rig.supports, averaged=averaged)

    def wrenches(self, samples: Iterable[Samples]) -> Iterator[Wrenches]:
        """Work out the contact wrenches."""
        return (in_motion if self.moving else at_rest)(self.given, samples)

    def nothing(self) -> DataError:
        """Say that no instant holds a position and a force of every NCP."""
        return DataError(
            "there is no instant at which every NCP's position and force are known",
            where=", ".join(map(str, self.use.campaign.logs)),
            hint="check that all streams were recorded at the same time",
        )

    def findings(self) -> list[Finding]:
        """What a log that has passed says of itself, what was left out, what stays unknown."""
        found = [*self.log.messages, *self.inspection.finish()]
        if self.tally.uncovered:
            found.append(Finding("samples-uncovered", size=self.tally.uncovered))
        if self.tally.unreadable:
            found.append(Finding("samples-unreadable", size=self.tally.unreadable))
        if not self.use.given.rig.axes.all():
            values: dict[str, Value] = {"components": observable_text(self.use.given)}
            found.append(Finding("wrench-in-part", values=values))
        if self.use.given.open.any():
            found.append(Finding("calibration-open"))
        return found
