"""How a terminal that never stops is driven and recorded in simulation."""

from __future__ import annotations

from dataclasses import dataclass, field, replace
from typing import Literal

import numpy as np

from tdfscal.errors import UsageError
from tdfscal.records import FloatArray
from tdfscal.simulation.faults import Faults

Drive = Literal["multisine", "approach", "stops"]


@dataclass(frozen=True, slots=True)
class Touch:
    """A contact while the terminal moves: a constant wrench that comes and goes within 50 ms.

    force (N) and moment (N·m, about the LCS origin) on the terminal, BCS.
    """

    begin: float
    end: float
    force: tuple[float, float, float]
    moment: tuple[float, float, float] = (0.0, 0.0, 0.0)


@dataclass(frozen=True, slots=True)
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
        if not 2.0 <= self.duration <= 86400.0:
            raise UsageError(f"the duration is {self.duration} s", hint="give 2 s to one day")
        if not 1.0 <= self.rate <= 20e3:
            raise UsageError(f"the rate is {self.rate} Hz", hint="give 1 Hz to 20 kHz")
        for name in ("tilt", "travel", "squeeze", "noise", "slow_noise", "encoder", "quantum"):
            if not 0.0 <= getattr(self, name) < np.inf:
                raise UsageError(f"{name} is {getattr(self, name)}", hint="give a number ≥ 0")
        if self.tilt > np.pi / 4:
            raise UsageError("the tilt is above 45°", hint="stay within 45°")

    @classmethod
    def stops(cls) -> MovingOptions:
        """Ten random postures in 96 s: rests of 6 s and moves of 4 s by turns."""
        return replace(cls(), drive="stops", duration=96.0)

    @classmethod
    def approach(cls) -> MovingOptions:
        """One ordinary straight approach: 50 mm in 33 s, nothing turned, nothing squeezed."""
        return replace(cls(), drive="approach", duration=33.0, tilt=0.0, squeeze=0.0)
