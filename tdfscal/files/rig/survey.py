"""The `tracker` block of the rig file: a laser tracker's survey, and where its files are."""

from pathlib import Path
from typing import Self

from pydantic import model_validator

from tdfscal.files.field_types import LengthUnit, NotNegative, Strict, Text, fault, key
from tdfscal.frozen import record
from tdfscal.records import Instrument


class InstrumentBlock(Strict):
    """Standard uncertainties of a spherical instrument: m, ppm of the range, arcseconds."""

    range: NotNegative = key("m: constant part of the range")
    range_ppm: NotNegative = key("ppm: part that grows with the range")
    angle_arcsec: NotNegative = key("″: each angle")

    @model_validator(mode="after")
    def _not_perfect(self) -> Self:
        if self.range == self.range_ppm == self.angle_arcsec == 0:
            raise fault("an instrument without any uncertainty", hint="see its data sheet")
        return self


class Targets(Strict):
    """Point files of the targets on the sensors: TDFS frames, and the tracker's frame."""

    nominal: Text = key("point file, sensor frames")
    measured: Text = key("point file, tracker frame")


class Moves(Strict):
    """Point files of the NCPs' moves: by the servo in the BCS, and in the tracker's frame."""

    servo: Text = key("point file, hinge centres in the BCS")
    measured: Text = key("point file, tracker frame")


class TrackerBlock(Strict):
    """A laser-tracker survey; drawing in m, misalignment of body against sensing axes in rad."""

    instrument: InstrumentBlock = key("standard uncertainties, k = 1")
    drawing: NotNegative = key("m: nominal points, per coordinate", 0.0)
    misalignment: NotNegative = key("rad: sensing axes against the sensor's body, per axis", 0.0)
    length_unit: LengthUnit | None = key("of point files that name none: m, cm, mm, um, in", None)
    targets: Targets = key("targets on the sensors")
    moves: Moves = key("one point on each NCP, moved")


@record
class TrackerFiles:
    """A laser-tracker survey as the rig file in a folder declares it; not read yet."""

    stated: TrackerBlock
    folder: Path

    @property
    def instrument(self) -> Instrument:
        """Its standard uncertainties."""
        return Instrument(**dict(self.stated.instrument))

    @property
    def paths(self) -> tuple[Path, ...]:
        """The four point files: targets nominal and measured, moves by servo and measured."""
        targets, moves = self.stated.targets, self.stated.moves
        names = (targets.nominal, targets.measured, moves.servo, moves.measured)
        return tuple(self.folder / name for name in names)
