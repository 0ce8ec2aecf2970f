"""The calibrations that a control study compares, and the machines that they meet.

The methods give angles: zeros, mass and barycentre are the rig file's in every arm, or are tared
away in every arm that it is compared with.
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass, replace

import numpy as np

from studies import campaigns
from studies.campaigns import Setting
from studies.control.terminal import stated
from tdfscal.numerics import so3
from tdfscal.records import FloatArray, Rig
from tdfscal.simulation import SurveyOptions, Truth, simulate_dwells

#: What each controller knows.
KNOWS = {
    "none": "nominal angles",
    "none, 3 mrad": "nominal angles of a machine that was mounted to 3 mrad about every axis",
    "none, yaw 30": "nominal angles of a machine that was mounted to 3, 3 and 30 mrad",
    "tracker": "the tracker's angles",
    "Eq. 24": "the angles of the paper's self-calibration",
    "ML": "the angles of self-calibration by maximum likelihood",
    "true angles": "true angles; zeros, mass and barycentre are the rig file's, as in those above",
}
TARED = ("tracker", "Eq. 24", "ML", "true angles")
#: Where all of it comes from.
ORIGIN = "campaign and survey simulated and calibrated, a rig of its own in every run"
#: rad, of better mountings: roll, pitch, yaw.
MOUNTED = {"none, 3 mrad": (3e-3, 3e-3, 3e-3), "none, yaw 30": (3e-3, 3e-3, 3e-2)}


@dataclass(frozen=True, slots=True)
class Arm:
    """One calibration at work on N machines.

    truth, assumed : (N,), what is, and what the controller takes for true. tared : before each
    run. failed : runs in which the calibration gave no result and nominal angles were used.
    """

    name: str
    truth: Truth
    assumed: Truth
    tared: bool = False
    failed: int = 0

    @property
    def angle_error(self) -> float:
        """Rms over the runs of the angles' errors, rad."""
        turn = self.truth.rotation @ np.swapaxes(self.assumed.rotation, -1, -2)
        return float(np.sqrt(np.mean(so3.log(turn) ** 2)))


def tared(arm: Arm) -> Arm:
    """The same controller, which takes the wrench at the start for none."""
    return replace(arm, name=f"{arm.name}, tared", tared=True)


def simulated(
    rig: Rig,
    survey: SurveyOptions,
    runs: int,
    rng: np.random.Generator,
    setting: Setting,
) -> tuple[Arm, ...]:
    """Arms of `KNOWS`, then those of `TARED`. Every run has a rig of its own, whose campaign and
    survey are simulated, as `setting` has them, and calibrated by each method.
    """
    batch = simulate_dwells(rig, setting.options, rng, runs)
    truth, nominal = batch.truth, stated(rig, runs).rotation
    states = campaigns.likeliest(rig, batch)
    found: dict[str, Sequence[FloatArray | None]] = {
        "none": list(nominal),
        "tracker": campaigns.surveyed(rig, batch, survey, rng),
        "Eq. 24": campaigns.linear_rotations(rig, batch),
        "ML": [None if state is None else state.rotation for state in states],
        "true angles": list(truth.rotation),
    }
    arms = [_arm(rig, name, truth, each) for name, each in found.items()]
    unit = rng.standard_normal((runs, rig.n, 3))
    for place, (name, std) in enumerate(MOUNTED.items()):
        turn = so3.from_rpy(rig.nominal_rpy + np.array(std) * unit)
        better = replace(truth, rotation=turn, rpy=so3.to_rpy(turn))
        arms.insert(1 + place, _arm(rig, name, better, list(nominal)))
    return (*arms, *(tared(arm) for arm in arms if arm.name in TARED))


def _arm(rig: Rig, name: str, truth: Truth, found: Sequence[FloatArray | None]) -> Arm:
    """Angles that were found, or nominal ones; the rest as the rig file states it."""
    nominal = so3.from_rpy(rig.nominal_rpy)
    rotation = np.stack([nominal if X is None else X for X in found])
    assumed = replace(stated(rig, len(found)), rotation=rotation, rpy=so3.to_rpy(rotation))
    return Arm(name, truth, assumed, failed=sum(X is None for X in found))
