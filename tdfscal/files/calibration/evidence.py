"""The evidence behind a calibration, which a report draws and `update` and `compare` go by."""

from collections.abc import Sized
from typing import Self

import numpy as np
from pydantic import model_validator

from tdfscal.files import field_types as kind
from tdfscal.files.calibration.parts import (
    Agreement,
    Angle,
    Input,
    MeasuredResult,
    Stretch,
    TerminalResult,
    Texts,
)
from tdfscal.files.field_types import Known, Strict, fault, key
from tdfscal.numerics.distributions import trials_decide
from tdfscal.records import FloatArray


class Table(Strict):
    """Columns of one length, but for what is a list of its own."""

    @model_validator(mode="after")
    def _rectangular(self) -> Self:
        columns = {n: c for n, c in self if c is not None and n not in ("left_out", "noise")}
        rows = len(next(iter(columns.values())))
        for name, column in columns.items():
            if len(column) != rows:
                raise fault(f"must have {rows} rows", name)
        return self


class AngleBudget(Strict):
    """Variance of one angle by source, rad²."""

    support: kind.Name = key("name of the support")
    angle: Angle = key("roll, pitch or yaw")
    variance: dict[kind.Text, kind.NotNegative] = key("rad²: contribution of each source")


class Budget(Strict):
    """Contribution of each source to each angle's variance."""

    sources: Texts = key("names of the sources")
    angles: tuple[AngleBudget, ...] = key("one entry per angle")

    @property
    def shares(self) -> FloatArray:
        """(angles, sources), share of each angle's variance; 0 where it has none."""
        table = np.array([[angle.variance[s] for s in self.sources] for angle in self.angles])
        total = table.sum(axis=1, keepdims=True)
        return np.asarray(np.divide(table, total, out=np.zeros_like(table), where=total > 0))


class ExactQuantityResult(Strict):
    """A quantity that was taken as exact, and a typical error of each of its components."""

    name: kind.Text = key("the quantity")
    error: kind.NotNegative = key("a typical error of each component, in `unit`")
    unit: kind.Text = key("of the error")
    effect: kind.Vectors = key(
        "rad: what it does to roll, pitch, yaw of each sensor that has a rotation; to its turns "
        "about the BCS axes where these are not separable"
    )
    common: kind.Matrix | None = key(
        "SI: move of each of `parameters` (without these, of `covariance`) by that error of each "
        "component, which campaigns of the rig have in common; for `update`",
        None,
    )
    apart: kind.Matrix | None = key("SI: the same by errors that each campaign has anew", None)


class MonteCarloResult(Strict):
    """What trials show; where they decide, the intervals stated are theirs."""

    trials: kind.PositiveCount = key("number of trials")
    tolerance: kind.NotNegative = key("rad: numerical tolerance δ (JCGM 101, 7.9.2)")
    linear_interval_validated: kind.Flag = key("linear interval agrees (JCGM 101, 8)")

    @property
    def decides(self) -> bool:
        """Whether the intervals stated are those of the trials."""
        return trials_decide(self.trials, validated=self.linear_interval_validated)

    @property
    def verdict(self) -> str:
        """What the trials say of the linear intervals."""
        if self.linear_interval_validated:
            return "confirm"
        return "do not confirm" if self.decides else "are too few to judge"


class ResidualWrench(Strict):
    """Residual of held-out postures without and with the calibration: N or N·m."""

    rms_before: kind.NotNegative = key("root mean square, with the nominal mounting")
    rms_after: kind.NotNegative = key("root mean square, calibrated")
    max_before: kind.NotNegative = key("largest, with the nominal mounting")
    max_after: kind.NotNegative = key("largest, calibrated")

    @classmethod
    def of(cls, before: FloatArray, after: FloatArray) -> dict[str, Self]:
        """Of lengths (K, 2) of the residual force, N, and moment, N·m."""
        found = {}
        for k, name in enumerate(("force", "moment")):
            sizes = {"before": before[:, k], "after": after[:, k]}
            rms = {f"rms_{when}": float(np.sqrt(np.mean(size**2))) for when, size in sizes.items()}
            largest = {f"max_{when}": float(size.max()) for when, size in sizes.items()}
            found[name] = cls.model_validate(rms | largest)
        return found


class ValidationResult(Strict):
    """Cross-validation: residual contact wrench of leave-one-out postures."""

    method: kind.Text = key("how postures were held out")
    postures: kind.Count = key("number of postures")
    force: ResidualWrench = key("N: residual contact force")
    moment: ResidualWrench = key("N·m: residual contact moment")


class LimitedResult(Strict):
    """A contact force or torque, N or N·m: expanded uncertainty (k = 2), limit, and their verdict.

    Decision rule: guard band, |deviation| + U ≤ limit (JCGM 106).
    """

    expanded: kind.NotNegative = key("uncertainty of the length, coverage 95.45 %")
    limit: kind.NotNegative | None = key("the rig file's; null where it states none", None)
    exceeding: kind.Probability = key("that the error is beyond the limit")
    conforms: kind.Flag | None = key("of release 1.0: what follows from the two", None)


class ConformityResult(Strict):
    """The contact wrench's uncertainty at a posture against the rig file's limits."""

    rpy: kind.Vector = key("rad: posture of the terminal")
    force: LimitedResult = key("N: length of the force's error")
    torque: LimitedResult = key("N·m: length of the torque's error")


class PointResiduals(Table):
    """Residuals of a survey's points, in the tracker's frame."""

    points: Texts = key("names")
    residual: kind.Vectors = key("m: measured less fitted")
    normalised: kind.Vectors = key("over their standard uncertainties")


class TrackerResult(Agreement):
    """How a survey fits."""

    points: kind.Count = key("number of points used")
    rejected: Texts = key("names of points left out")
    consistency_p_value: kind.Probability | None = key("that both methods differ so", None)
    largest_en: kind.NotNegative | None = key("E_n of the angle in which they differ most", None)
    residuals: PointResiduals = key("of each point")


class ReadingsTable(Table):
    """Mean readings, sensor frames, by which a recording is known again."""

    force: tuple[kind.Vectors, ...] = key("N: of each dwell, those of all supports")
    noise: kind.Vectors = key("N: per support, a mean's typical standard error by noise")


class DwellTable(ReadingsTable):
    """All dwells: when they were, and their mean readings, as tdfscal's sign has them."""

    start: kind.Numbers = key("s: begin of each dwell, as the log counts")
    end: kind.Numbers = key("s: end of each dwell")
    temperature: kind.Numbers | None = key("°C: mean of all sensors in each dwell", None)


class CampaignResult(Strict):
    """One of several campaigns: its own zeros and load, and what it added to χ²."""

    name: kind.Text = key("its folder")
    measured: MeasuredResult = key("when it was recorded")
    inputs: tuple[Input, ...] = key("its files")
    rig_sha256: kind.Sha256 | None = key("of its rig file", None)
    zero: kind.OpenRows = key("N: its own zeros, per sensor; null where not measured")
    zero_std: kind.OpenStdRows = key("N: their standard uncertainties; null where open")
    terminal: TerminalResult = key("its own mass and barycentre")
    postures: kind.Count = key("number of postures used")
    chi2: kind.NotNegative = key("χ² that its residuals and its departure from earlier ones add")
    dof: kind.Count = key("degrees of freedom that it added")
    readings: ReadingsTable | None = key("by which its recording is known again", None)
    span: tuple[kind.Number, kind.Number] | None = key(
        "s in its log's time: begin and end of the part that was used; null without a log", None
    )


class ClockResult(Strict):
    """A recorder's clock against the first one's; the offset is its stamp of the instant of the
    first recorder's first stamp, less that, and grows by the rate.
    """

    recorder: kind.Text = key("its files, as the rig file names them")
    offset: kind.Number = key(
        "s: its stamps minus the first's, at the first's first stamp, delay included"
    )
    offset_std: kind.NotNegative = key("s: standard uncertainty")
    rate: kind.Number = key("relative: growth of the offset")
    rate_std: kind.NotNegative = key("relative: standard uncertainty")


def has_delay(clocks: Sized) -> bool:
    """Whether the clocks beside the first hold the delay: of one it is, of more nothing says."""
    return len(clocks) == 1


class PostureTable(Table):
    """The postures in the fit, column by column: length of the contact wrench that remains.

    Moments are about the LCS origin; before: nominal mounting and stated zeros, after: calibrated
    without the posture.
    """

    index: kind.Counts = key("number of the dwell, from 0")
    start: kind.Numbers = key("s in the log's time")
    end: kind.Numbers = key("s in the log's time")
    before: kind.Pairs = key("N and N·m: residual force and moment with the nominal mounting")
    after: kind.Pairs = key("N and N·m: residual force and moment, calibrated")
    left_out: tuple[Stretch, ...] = key("stretches of rest that are no posture", ())


class LeftOutStretch(Strict):
    """A stretch of the log that was not used, s in the log's time."""

    begin: kind.Number = key("s in the log's time")
    end: kind.Number = key("s in the log's time")
    code: kind.Text = key("of the finding about it")
    reason: kind.Text = key("contact, a frozen channel, a sensor at its capacity")


Scalar = Known[kind.Number, kind.NotNegative]
Inertia = Known[kind.Matrix3, kind.Matrix3]


class MotionResidual(Table):
    """Length of the residual wrench over time, in means of a second or more.

    Moments are about the barycentre; before: nominal mounting and stated zeros, after: calibrated.
    """

    time: kind.Numbers = key("s in the log's time: middles of the means")
    before: kind.Pairs = key("N and N·m: residual force and moment with the nominal mounting")
    after: kind.Pairs = key("N and N·m: residual force and moment, calibrated")


class MotionResult(Strict):
    """Samples in motion: from when, how long, what was left out, and what they tell besides."""

    begin: kind.Number = key("s in the log's time: first sample")
    seconds: kind.Positive = key("s: length of what went in")
    dwells: kind.Count = key("number of static postures that went in too", 0)
    rejected: tuple[LeftOutStretch, ...] = key("stretches of the log that were left out", ())
    delay: Scalar = key(
        "s: force stamps minus position stamps, in the middle of the log; beyond `clocks`"
    )
    rate: Scalar | None = key("growth of that delay, where the log says it", None)
    inertia: Inertia = key("kg m²: of the terminal, about the LCS origin")
    friction: Scalar = key("N·m: Coulomb friction of each hinge")
    residual: MotionResidual = key("of the wrench, over time")
