"""How a simulated campaign is driven and recorded: options; the timeline of dwells and moves."""

from __future__ import annotations

from typing import Literal

import numpy as np

from tdfscal.errors import UsageError
from tdfscal.frozen import field, record, replace
from tdfscal.records import FloatArray, Instrument, IntArray, Rig, Rows
from tdfscal.simulation.faults import Faults, Place


@record
class Recorder:
    """Timing of the moves, sensors and sampling."""

    dwell: tuple[float, float] = (3.2, 4.8)
    """Shortest and longest dwell, s (uniform)."""
    move: tuple[float, float] = (2.0, 4.0)
    """Shortest and longest move, s (uniform); minimum jerk."""
    force_rate: float = 100.0
    """Hz."""
    position_rate: float = 100.0
    """Hz."""
    force_sd: tuple[float, float] = (1.5, 2.0)
    """Smallest and largest noise of a single force sample, N; one draw per sensor."""
    encoder_sd: float = 0.3e-6
    """White noise of a servo coordinate, m."""
    vibration: float = 3.0
    """Amplitude of each force component's vibration at the top speed of a move, N."""
    settling: float = 0.3
    """Time after a stop in which the settling falls to 5 %, s."""
    settling_force: float = 8.0
    """Standard deviation of the settling's amplitude per force component, N."""
    mean_sd: float | None = None
    """Noise of a dwell's mean force, N, for dwell means and posture rows; None: from the above."""


@record
class Options:
    """What is driven, on which machine, and what goes wrong.

    The installation angles are drawn about the rig's nominal ones: with its `rpy_std` where that
    is finite, else with `installation_std`; or they are `rpy`.
    """

    postures: int = 24
    tilt: float = np.deg2rad(5.0)
    """Postures lean by up to this angle, uniformly over that disc, and turn about the vertical
    by up to it either way, rad."""
    travel: float = 0.02
    """Postures lie within this distance of `home` along each axis, m."""
    home: tuple[float, float, float] = (0.05, -0.03, 1.2)
    """The LCS origin's usual place in the BCS, m."""
    command: FloatArray | None = None
    """(K, n, 3), m, BCS: commanded hinge centres to drive instead of random postures."""
    squeeze: float = 0.0
    """Commanded internal forces, N. Of the 3n internal force components at a posture, the vector
    is normal with covariance squeeze² P, P projecting on the 3n − 6 internal modes: each
    orthonormal mode has an independent coefficient with this standard deviation."""
    stiffness: float | FloatArray = 20.0e6
    """Of each carriage, N/m: a number, (3,) per BCS axis, or (n, 3, 3)."""
    internal: float | None = None
    """Standard deviation, per orthonormal internal mode, of the internal forces that the NCPs'
    repeatability makes, N; sets the stiffness to internal / positioner."""
    rpy: FloatArray | None = None
    """(n, 3), rad: true installation angles."""
    installation_std: tuple[float, float, float] = (0.02, 0.02, 0.05)
    """rad: roll, pitch, yaw."""
    rows: Rows = "timeseries"
    recorder: Recorder = field(default_factory=Recorder)
    faults: Faults = field(default_factory=Faults)

    def __post_init__(self) -> None:
        if self.postures < 1:
            raise UsageError(f"{self.postures} postures asked for", hint="ask for one or more")
        _check_sizes(self, "tilt", "travel", "squeeze")

    @property
    def count(self) -> int:
        """Number of postures K."""
        return self.postures if self.command is None else len(self.command)


def minimum_jerk(u: FloatArray) -> FloatArray:
    """Share of a move that lies behind at a share u of its time: quintic."""
    return np.asarray(u**3 * (10.0 + u * (6.0 * u - 15.0)))


@record
class Moment:
    """Instants of a campaign, (N,) each.

    index : the dwell last entered. share : of the move that follows it, 0 in the dwell, 1 at the
    next. speed : 0 at rest, 1 at the top speed of the move.
    """

    index: IntArray
    share: FloatArray
    speed: FloatArray

    def blend(self, value: FloatArray) -> FloatArray:
        """Values per posture (K, ...) carried over from posture to posture, (N, ...)."""
        after = np.minimum(self.index + 1, len(value) - 1)
        share = self.share.reshape(-1, *(1,) * (value.ndim - 1))
        here = value[self.index]
        return np.asarray(here + share * (value[after] - here), dtype=np.float64)


@record
class Timeline:
    """start, end : (K,), s, of the dwells; the campaign runs from start[0] to end[-1]."""

    start: FloatArray
    end: FloatArray

    def at(self, time: FloatArray) -> Moment:
        """Where the campaign is at times (N,), s."""
        index = np.clip(np.searchsorted(self.start, time, side="right") - 1, 0, None)
        onward = np.append(self.start[1:], np.inf)[index]
        u = np.clip((time - self.end[index]) / (onward - self.end[index]), 0.0, 1.0)
        share = minimum_jerk(u)
        return Moment(index.astype(np.int64), share, 16.0 * (u * (1.0 - u)) ** 2)

    def place(self, time: FloatArray) -> Place:
        """The same, as faults count it."""
        moment = self.at(time)
        return Place(moment.index + moment.share, time / self.end[-1])

    def samples(self, rate: float) -> FloatArray:
        """Sampling times at `rate` (Hz) over the whole campaign, s."""
        count = int(np.floor(self.end[-1] * rate * (1.0 + 1e-12))) + 1
        return np.arange(count) / rate


def draw_timeline(recorder: Recorder, postures: int, rng: np.random.Generator) -> Timeline:
    """Dwells and moves of random lengths, the first dwell from time 0."""
    dwell = rng.uniform(*recorder.dwell, postures)
    move = rng.uniform(*recorder.move, postures - 1)
    start = np.concatenate([[0.0], np.cumsum(dwell[:-1] + move)])
    return Timeline(start, start + dwell)


PAPERS_TRACKER = Instrument(range=1.0e-5, range_ppm=5.0, angle_arcsec=2.0)
"""Leica AT901b, Sect. 4.2."""


@record
class SurveyOptions:
    """A laser-tracker survey of the rig."""

    instrument: Instrument = PAPERS_TRACKER
    distance: float = 5.0
    """From the instrument to the middle of the rig, m."""
    targets: tuple[tuple[float, float, float], ...] = (
        (0.05, 0.05, 0.0),
        (-0.05, 0.05, 0.0),
        (-0.05, -0.05, 0.0),
        (0.05, -0.05, 0.02),
    )
    """Nominal points on each sensor's body, its frame, m."""
    drawing: float = 0.0
    """Standard deviation of the real points about the nominal ones, m per axis."""
    moves: int = 12
    travel: float = 0.15
    """Moves reach this far from home along each axis, m."""
    body_misalignment: float = 0.0
    """Standard deviation of the sensing axes against the body, rad per axis."""


def carriage_stiffness(rig: Rig, options: Options) -> FloatArray:
    """Stiffness matrices of the carriages, (n, 3, 3), N/m.

    Raises UsageError where they cannot follow from `internal`.
    """
    value = np.asarray(options.stiffness, dtype=np.float64)
    if options.internal is not None:
        if rig.declared.positioner <= 0.0:
            raise UsageError(
                "internal forces cannot come from NCPs that repeat exactly",
                where="uncertainty.positioner",
                hint="state a positioner repeatability, or give the stiffness itself",
            )
        value = np.asarray(options.internal / rig.declared.positioner)
    value = value * np.eye(3) if value.ndim < 2 else value
    return np.array(np.broadcast_to(value, (rig.n, 3, 3)), dtype=np.float64)


Drive = Literal["multisine", "approach", "stops"]


@record
class Touch:
    """A contact while the terminal moves: a constant wrench that comes and goes within 50 ms.

    force (N) and moment (N·m, about the LCS origin) on the terminal, BCS.
    """

    begin: float
    end: float
    force: tuple[float, float, float]
    moment: tuple[float, float, float] = (0.0, 0.0, 0.0)


@record
class MovingOptions:
    """What is driven without a stop, on which machine, and how it is recorded."""

    drive: Drive = "multisine"
    duration: float = 60.0
    """s."""
    frequency: float = 0.06
    """Middle frequency of the multisine, Hz; its lines lie between 0.4 and 1.6 times that."""
    tilt: float = np.deg2rad(4.0)
    """Largest rotation about each axis, rad."""
    travel: float = 0.05
    """Largest displacement along each axis of the BCS, m; the way of an approach."""
    squeeze: float = 200.0
    """Largest commanded internal force of each orthonormal internal mode, N."""
    home: tuple[float, float, float] = (0.05, -0.03, 1.2)
    """The LCS origin's usual place in the BCS, m."""
    stiffness: tuple[float, float, float] = (20.0e6, 20.0e6, 150.0e6)
    """Of each carriage along the axes of the BCS, N/m."""
    field_correlation: float = 0.02
    """Distance, m, over which the positioners' errors change; their size is the rig's
    `positioner`."""
    rate: float = 250.0
    """Hz, of all streams."""
    noise: float = 1.75
    """White noise of a force sample, N."""
    slow_noise: float = 0.0
    """Further noise of each channel, N, an Ornstein–Uhlenbeck process …"""
    slow_time: float = 2.0
    """… with this correlation time, s."""
    encoder: float = 0.3e-6
    """White noise of a servo coordinate, m."""
    quantum: float = 0.0
    """Least step of a recorded servo coordinate, m; 0: none."""
    delay: float = 0.005
    """s, by which the force stamps lie behind the position stamps."""
    friction: float = 0.2
    """Coulomb friction of each hinge, N·m."""
    inertia: FloatArray | None = None
    """(3, 3), kg m², about the LCS origin; None: drawn within what the rig states, else that of
    a body of the hinges' extent."""
    touches: tuple[Touch, ...] = ()
    faults: Faults = field(default_factory=Faults)
    """Of the zeros alone: drifts, and a hall that warms, whose temperature is logged."""
    rpy: FloatArray | None = None
    """(n, 3), rad: true installation angles; None: drawn as in a static campaign."""

    def __post_init__(self) -> None:
        _check_sizes(self, "tilt", "travel", "squeeze")

    @property
    def machine(self) -> Options:
        """The same machine at rest."""
        return Options(stiffness=np.array(self.stiffness), rpy=self.rpy)

    @classmethod
    def stops(cls) -> MovingOptions:
        """Ten random postures in 96 s: rests of 6 s and moves of 4 s by turns."""
        return replace(cls(), drive="stops", duration=96.0)

    @classmethod
    def approach(cls) -> MovingOptions:
        """One ordinary straight approach: 50 mm in 33 s, nothing turned, nothing squeezed."""
        return replace(cls(), drive="approach", duration=33.0, tilt=0.0, squeeze=0.0)


def _check_sizes(options: Options | MovingOptions, *names: str) -> None:
    """Raise UsageError where one of these is no number from 0 on, or the tilt is above 45°."""
    for name in names:
        if not 0.0 <= getattr(options, name) < np.inf:
            raise UsageError(f"{name} is {getattr(options, name)}", hint="give a number ≥ 0")
    if options.tilt > np.pi / 4:
        raise UsageError(
            f"the tilt limit is {np.rad2deg(options.tilt):.0f}°", hint="stay within 45°"
        )
