"""The records that pass from room to room: frozen, SI units, shapes in the docstrings.

n is the number of supports (one NCP with its TDFS each), K the number of postures.
Frames: BCS, the base of the mechanism; LCS, the terminal; a sensor's own frame.
"""

from __future__ import annotations

from collections.abc import Iterable, Mapping, Sequence
from typing import Final, Literal, Self

import numpy as np
import numpy.typing as npt

from tdfscal.findings import Finding
from tdfscal.frozen import field, record, replace

FloatArray = npt.NDArray[np.float64]
IntArray = npt.NDArray[np.int64]
BoolArray = npt.NDArray[np.bool_]

#: The installation angles, in the order of every array of them.
ANGLES = ("roll", "pitch", "yaw")

Rows = Literal["timeseries", "postures"]
Integrity = Literal["verified", "unverified"]


@record
class UncertainValue:
    """A quantity known as value ± std: std 0 is known exactly, std ∞ is unknown.

    value, std : arrays of one shape.
    """

    value: FloatArray
    std: FloatArray

    @classmethod
    def exact(cls, value: npt.ArrayLike) -> UncertainValue:
        """Return a quantity known exactly."""
        array = np.array(value, dtype=np.float64)
        return cls(array, np.zeros_like(array))


@record
class DeclaredUncertainty:
    """Standard uncertainties that the log's own scatter cannot show (rig.yaml, `uncertainty`)."""

    positioner: float = 0.0
    """NCP repeatability, m per axis and posture."""
    hinge: float = 0.0
    """Hinge coordinates in the LCS, m per coordinate, constant."""
    datum: float = 0.0
    """Offset between an NCP's servo coordinates and its hinge centre, m per axis, constant."""
    force_noise: float = 0.0
    """Force, N per axis and posture, beyond the standard error of the dwell's mean."""
    force_sensitivity: float = 0.0
    """Gain and crosstalk, relative, constant."""
    hinge_moment: float = 0.0
    """Friction of the hinges, N·m per axis and posture."""
    compliance_lateral: float = 0.0
    """What gives sideways between encoder and hinge, m/N, constant."""
    compliance_vertical: float = 0.0
    """The same along Z of the BCS, m/N, constant."""


@record
class Drift:
    """How zeros move within a campaign, per channel, and angles between campaigns."""

    time: float = 0.0
    """Standard uncertainty of a slope in time, N/s; ∞ unknown."""
    temperature: float = 0.0
    """Standard uncertainty of a slope in temperature, N/K; ∞ unknown."""
    walk: float = 0.0
    """Random-walk intensity of a zero, N/√s."""
    angle: float = 0.0
    """Random-walk intensity of each turn of a sensor between campaigns, rad/√month."""
    parabola: float = 0.0
    """Standard uncertainty of a parabola in time, N/s²; none but where the residuals ask for it."""


BCS_FRAME, LCS_FRAME = "bcs", "lcs"
"""Names of frames in every file that is written: of the base, and of the terminal, which moves."""


def sensor_frame(support: str) -> str:
    """Name of a sensor's frame, in recordings as in exports."""
    return f"{support}_tdfs"


@record
class CampaignInfo:
    """When (ISO 8601), where, by whom and with what a campaign was recorded (rig.yaml)."""

    date: str | None = None
    operator: str | None = None
    site: str | None = None
    tracker: str | None = None
    scale: str | None = None
    note: str | None = None


@record
class SensorInfo:
    """A sensor's papers (rig.yaml, `sensor`); due is a day in ISO 8601."""

    serial: str | None = None
    certificate: str | None = None
    due: str | None = None


@record
class Acceptance:
    """Limits of the quality gate (rig.yaml, `acceptance`)."""

    angle_std: float = 5.0e-3
    identifiable: float = 0.05
    birge_max: float = 2.0
    contact_force: float | None = None
    contact_torque: float | None = None
    contact_rpy: tuple[float, float, float] = (0.0, 0.0, 0.0)

    @property
    def states_contact(self) -> bool:
        """A limit of the contact wrench is stated."""
        return self.contact_force is not None or self.contact_torque is not None

    @property
    def contact_limits(self) -> tuple[tuple[str, str, slice, float | None], ...]:
        """Of force and torque: name, unit, rows of a wrench (6,), limit or None."""
        force = ("force", "N", slice(0, 3), self.contact_force)
        return force, ("torque", "N·m", slice(3, 6), self.contact_torque)


@record
class ExactMoves:
    """How parameters, or scores of them, move with errors of a quantity taken as exact.

    error : typical, in `unit`, of each of its components. common : (P, c), by that error of each
    component by itself, which is the rig's and the same in all campaigns. apart : (P, c'), by
    errors that are others in each campaign, or under each terminal.
    """

    name: str
    error: float
    unit: str
    common: FloatArray
    apart: FloatArray

    @property
    def columns(self) -> FloatArray:
        """All of them (P, c + c'), independent of each other."""
        return np.concatenate([self.common, self.apart], axis=1)

    def turns(self, n: int) -> FloatArray:
        """Turns (3n, c + c'), rad, BCS, of the sensors: the first of the parameters."""
        return self.columns[: 3 * n]

    def by(self, matrix: FloatArray) -> ExactMoves:
        """Return what follows from it by a matrix (Q, P)."""
        sides = matrix @ self.common, matrix @ self.apart
        return ExactMoves(self.name, self.error, self.unit, *sides)

    def all_apart(self) -> ExactMoves:
        """Return the same where another campaign has none of these errors in common with it."""
        sides = self.common[:, :0], self.columns
        return ExactMoves(self.name, self.error, self.unit, *sides)


@record
class JointPrior:
    """What earlier campaigns know of the rig's constants: one Gaussian of all of them together.

    It takes the place of the priors that the rig file states for them. P parameters in the order
    of `model.parameters.layout`; those of which nothing is known here have columns of 0.
    rotation : (n, 3, 3), estimate. vector : (P,), estimates of the other constants.
    root : (m, P), W with WᵀW the information on a deviation from the estimate; SI, rad, BCS.
    chi2, dof : of the fits behind it. exact : (P,) rows, moves of the estimate by errors of what
    they took as exact. sources : (n, 3), share of each source in the variance of their roll, pitch,
    yaw; none where that is not told.
    """

    rotation: FloatArray
    vector: FloatArray
    root: FloatArray
    chi2: float
    dof: int
    exact: tuple[ExactMoves, ...] = ()
    sources: Mapping[str, FloatArray] = field(default_factory=dict)

    @property
    def places(self) -> BoolArray:
        """Parameters (P,) that it knows something of."""
        return np.asarray(self.root.any(axis=0))


@record
class Rig:
    """What is known of the rig, resolved to arrays."""

    name: str
    supports: tuple[str, ...]
    gravity: float
    """Magnitude, m/s², along −Z of the BCS."""
    gravity_tilt_std: float
    """rad, per horizontal axis of the BCS."""
    mass: UncertainValue
    """(), kg."""
    barycentre: UncertainValue
    """(3,), m, LCS."""
    inertia: UncertainValue | None
    """(3, 3), kg m² about the LCS origin, used in motion only; None: unknown."""
    hinge: FloatArray
    """(n, 3), SHC in the LCS, m."""
    zero: UncertainValue
    """(n, 3), N, sensor frames."""
    nominal_rpy: FloatArray
    """(n, 3), rad, roll, pitch, yaw of the nominal mounting."""
    rpy_std: FloatArray
    """(n, 3), rad, prior about the nominal mounting; ∞ where there is none."""
    capacity: FloatArray
    """(n, 3), full scale in N; ∞ where not stated."""
    axes: BoolArray
    """(n, 3), which components each sensor measures."""
    declared: DeclaredUncertainty
    acceptance: Acceptance
    drift: Drift = Drift()
    serial: str | None = None
    campaign: CampaignInfo = CampaignInfo()
    sensors: tuple[SensorInfo, ...] = ()
    """Per support; empty where the rig file names none."""
    earlier: JointPrior | None = None
    """What earlier campaigns know of the constants; no part of the rig file."""
    zeros_common: bool = False
    """The zeros are other campaigns' too, and so among the constants; no part of the rig file."""

    @property
    def n(self) -> int:
        """Number of supports."""
        return len(self.supports)

    @property
    def certificates(self) -> tuple[tuple[str, str], ...]:
        """Day on which the certificate of a sensor ends, and its support, where it is stated."""
        named = zip(self.supports, self.sensors, strict=False)
        return tuple((each.due[:10], name) for name, each in named if each.due)


#: Relative: by which a recorder's clock may run fast or slow, where nothing is stated.
CLOCK_RATE_STD: Final = 1e-4


@record
class ClockPrior:
    """What is stated of a recorder's clock against the first one's (rig.yaml, `clock`).

    offset : s, its stamps minus the first's for the same instant. rate_std : relative.
    """

    offset: UncertainValue = field(
        default_factory=lambda: UncertainValue(np.array(0.0), np.array(np.inf))
    )
    rate_std: float = CLOCK_RATE_STD

    @property
    def exact(self) -> bool:
        """Whether nothing is left to find."""
        return float(self.offset.std) == 0.0 and self.rate_std == 0.0


@record
class RecorderClock:
    """A recorder's clock against the first one's, as found; times in s.

    reference : time of the first clock at which `offset` holds, its first stamp. offset : this
    clock's stamp of that instant minus the first's. rate : by which the offset grows.
    """

    recorder: str
    reference: float
    offset: float
    offset_std: float
    rate: float
    rate_std: float

    def to_first(self, time: FloatArray) -> FloatArray:
        """Stamps (N,) of this clock as the first clock would have them."""
        since = time - (self.reference + self.offset)
        return np.asarray(self.reference + since / (1.0 + self.rate))


@record
class Series:
    """One vector signal: time (N,) in s, ascending; value (N, 3)."""

    time: FloatArray
    value: FloatArray


@record
class InputFile:
    """A file that went into a result."""

    path: str
    sha256: str
    bytes: int
    integrity: Integrity


@record
class Measured:
    """When data were recorded, s since 1970 UTC, and what says so."""

    begin: float
    end: float
    source: Literal["log", "rig", "file"]

    @property
    def month(self) -> float:
        """The end in months of 30.4375 days since 1970."""
        return self.end / (30.4375 * 86400.0)


#: A log whose times lie between 1990 and 2100 has a wall clock; others count from some start, s.
_WALL_CLOCK = (631152000.0, 4102444800.0)


def by_wall_clock(*times: float) -> bool:
    """Tell whether times of a log, s, are those of a wall clock."""
    return all(_WALL_CLOCK[0] <= time <= _WALL_CLOCK[1] for time in times)


@record
class Log:
    """A recorded campaign, or a piece of one, in SI units and tdfscal's sign.

    position : per support, hinge centre in the BCS by the NCP's servo, m.
    force : per support, the force the NCP exerts on the terminal, in the sensor's frame, N.
    temperature : of all sensors or one per support, °C, as value[:, 0]; empty where not recorded.
    With rows == "postures" each row is one static posture and time is the row's number
    where the file has no time. clocks : of all recorders but the first, whose clock holds.
    """

    supports: tuple[str, ...]
    position: tuple[Series, ...]
    force: tuple[Series, ...]
    rows: Rows = "timeseries"
    inputs: tuple[InputFile, ...] = ()
    findings: tuple[Finding, ...] = ()
    temperature: tuple[Series, ...] = ()
    clocks: tuple[RecorderClock, ...] = ()

    @property
    def streams(self) -> tuple[Series, ...]:
        """Positions, forces, temperatures."""
        return (*self.position, *self.force, *self.temperature)

    def with_streams(self, streams: Iterable[Series]) -> Self:
        """The log with other streams, as many positions and forces."""
        every, n = tuple(streams), len(self.supports)
        move, load, warm = every[:n], every[n : 2 * n], every[2 * n :]
        return replace(self, position=move, force=load, temperature=warm)


@record
class LeftOut:
    """A stretch of the log, or a posture, that is not used, and why."""

    start: float
    end: float
    reason: Finding


@record
class Absence:
    """Why a log holds no dwell: what was seen, and what would do.

    stop : s, how long each posture would have to be held; None where that is not what is missing.
    """

    seen: str
    advice: str
    stop: float | None = None


@record
class Dwells:
    """Static dwells: NCPs at rest, forces settled.

    start, end : (K,), s, the stretch that was averaged.
    position : (K, n, 3), m, BCS; mean. position_cov : (K, n, 3, 3), m², of the mean.
    force : (K, n, 3), N, sensor frames; mean. force_cov : (K, n, 3, 3), N², of the mean,
    by the effective sample size; zeros with rows == "postures".
    force_min, force_max : (K, n, 3), N, extremes within the dwell.
    count : (K, n), force samples averaged. effective : (K, n), effective sample size.
    temperature : (K, n), °C at each sensor; None where the log has none.
    absence : where there is no dwell, why.
    force_range : (2, n, 3), N, smallest and largest reading of the whole log; None where unknown.
    force_still : (n, 3), s, since when a reading stays the same to the end of the log, at no value
    that bounded it before; NaN where it does not, None where unknown.
    """

    supports: tuple[str, ...]
    start: FloatArray
    end: FloatArray
    position: FloatArray
    position_cov: FloatArray
    force: FloatArray
    force_cov: FloatArray
    force_min: FloatArray
    force_max: FloatArray
    count: IntArray
    effective: FloatArray
    left_out: tuple[LeftOut, ...] = ()
    findings: tuple[Finding, ...] = ()
    temperature: FloatArray | None = None
    absence: Absence | None = None
    force_range: FloatArray | None = None
    force_still: FloatArray | None = None

    def __len__(self) -> int:
        return len(self.start)


@record
class PointSet:
    """Named points of one file.

    group : support's name, per point; "" in a file without groups. point : its label. xyz :
    (N, 3), m, in the file's frame. std : (N, 3), m, standard uncertainties that the file gives; a
    row of NaN where it gives none for a point, None where it gives none at all. resolution : m,
    worth of the last digit that the coordinates are written with; 0 where they are design values.
    """

    group: tuple[str, ...]
    point: tuple[str, ...]
    xyz: FloatArray
    std: FloatArray | None
    source: str
    resolution: float = 0.0

    def take(self, which: Sequence[int] | IntArray) -> Self:
        """Only the points with these indices."""
        return replace(
            self,
            group=tuple(self.group[i] for i in which),
            point=tuple(self.point[i] for i in which),
            xyz=self.xyz[which],
            std=None if self.std is None else self.std[which],
        )


@record
class Instrument:
    """A spherical instrument's standard uncertainties: range (m), range_ppm, angle_arcsec."""

    range: float
    range_ppm: float
    angle_arcsec: float


@record
class TrackerSession:
    """A laser-tracker survey: targets on the sensors, and one point moved by each NCP.

    nominal : TDFS frames (drawing). targets, moves : tracker's frame. servo : BCS.
    drawing : standard uncertainty of the nominal points, m per axis.
    """

    instrument: Instrument
    drawing: float
    nominal: PointSet
    targets: PointSet
    servo: PointSet
    moves: PointSet


@record
class Rotations:
    """Installation rotations X_i of all sensors with their covariance.

    rotation : (n, 3, 3), sensor frame → BCS, det = +1.
    covariance : (3n, 3n), rad², of d with R_true = exp([d]×) · rotation, d in the BCS.
    """

    supports: tuple[str, ...]
    rotation: FloatArray
    covariance: FloatArray
