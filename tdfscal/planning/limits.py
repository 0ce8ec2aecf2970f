"""What a plan may ask of the machine, and the checks at the door."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np

from tdfscal.errors import UsageError
from tdfscal.records import FloatArray, Rig

#: Lean beyond which nobody tilts a terminal on hinges.
MOST_TILT = np.deg2rad(45.0)


@dataclass(frozen=True, slots=True)
class Limits:
    """What a posture may ask of the machine.

    tilt : rad, largest lean; the turn about the vertical stays within it, too.
    squeeze : N, largest internal force at any NCP. force : N, largest force at any NCP in all.
    travel : (n, 3), m, how far each NCP goes from its place at home, either way along each axis
    of the BCS. home : (3,), m, BCS, the LCS origin at home, where the terminal stands level.
    stiffness : N/m, of each NCP, isotropic; None where forces are servoed to.
    """

    tilt: float
    squeeze: float
    travel: FloatArray
    home: FloatArray
    force: float = np.inf
    stiffness: float | None = None

    def repeatability_force(self, rig: Rig) -> float:
        """Standard deviation, N per internal mode, of the forces that the NCPs' scatter makes.

        Unplanned, but read by the sensors like any other: they carry information.
        """
        return (self.stiffness or 0.0) * rig.declared.positioner


def travel_limits(rig: Rig, entries: dict[str | None, tuple[float, ...]]) -> FloatArray:
    """Half ranges (n, 3), m, from support → (all axes,) or (x, y, z); None is every support.

    Raises UsageError for an unknown support or an impossible range.
    """
    travel = np.full((rig.n, 3), np.inf)
    for name, value in sorted(entries.items(), key=lambda item: item[0] is not None):
        if name is not None and name not in rig.supports:
            raise UsageError(
                f"there is no support {name!r}",
                where="travel",
                hint=f"the rig has {', '.join(rig.supports)}",
            )
        if len(value) not in (1, 3):
            raise UsageError(
                f"{len(value)} ranges are given", where="travel", hint="give one, or x, y and z"
            )
        travel[slice(None) if name is None else rig.supports.index(name)] = value
    return travel


def check_limits(rig: Rig, limits: Limits) -> None:
    """Refuse what no machine can be asked for. Raises UsageError."""
    if not 0.0 <= limits.tilt <= MOST_TILT:
        raise UsageError(
            f"the tilt limit is {np.rad2deg(limits.tilt):.4g}°", hint="give 0 to 45 degrees"
        )
    for what, value in (("squeeze", limits.squeeze), ("force limit", limits.force)):
        if not value >= 0.0 or (what == "squeeze" and np.isinf(value)):
            raise UsageError(f"the {what} is {value:g} N", hint="give a number of newtons")
    if limits.stiffness is not None and not 0.0 < limits.stiffness < np.inf:
        raise UsageError(
            f"the stiffness is {limits.stiffness:g} N/m", hint="give a number above zero"
        )
    if limits.travel.shape != (rig.n, 3) or not np.all(limits.travel >= 0.0):
        raise UsageError("a range is negative or no number", where="travel", hint="give metres")
    if limits.home.shape != (3,) or not np.all(np.isfinite(limits.home)):
        raise UsageError("home is no point", where="home", hint="give x,y,z in metres")


def check_reach(rig: Rig, limits: Limits, rotation: FloatArray, what: str) -> None:
    """Raise UsageError where a posture (rotation (3, 3), LCS → BCS) lies outside the travel.

    Home is fixed and the middle of the hinges stays there, as in every planned posture.
    """
    offset = displacement(rig, rotation)
    over = np.abs(offset) - limits.travel
    i, axis = np.unravel_index(int(np.argmax(over)), over.shape)
    if over[i, axis] > 0.0:
        raise UsageError(
            f"{what} takes {rig.supports[i]} {abs(offset[i, axis]):.4g} m along {'xyz'[axis]} from "
            f"home, beyond its travel of {limits.travel[i, axis]:.4g} m",
            hint="tilt less, or state the travel that the NCPs really have",
        )


def displacement(rig: Rig, rotation: FloatArray) -> FloatArray:
    """Way (..., n, 3), m, BCS, of each hinge from home with the middle of the hinges at rest."""
    spoke = rig.hinge - rig.hinge.mean(axis=0)
    return np.asarray(spoke @ np.swapaxes(rotation, -1, -2) - spoke)
