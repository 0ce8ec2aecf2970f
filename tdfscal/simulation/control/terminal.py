"""The terminal on its elastic NCPs, followed quasi-statically.

The lowest natural frequency of the rig (three carriages of 20 N/µm under 500 kg: above 50 Hz) is
far above the impedance's (below 2 Hz in free space, 5 Hz in contact): at every step the terminal
rests where springs, weight and contact balance. One Newton step from the last rest suffices, since
contact is soft against the carriages.
"""

from __future__ import annotations

import numpy as np

from tdfscal.records import FloatArray
from tdfscal.simulation import rotations
from tdfscal.simulation.equilibrium import Load, Pose, settle
from tdfscal.simulation.truth import Truth

#: Steps after which the springs' slope is worked out anew; until then the terminal hardly turns.
_REFRESH = 25


def moment(arm: FloatArray, force: FloatArray) -> FloatArray:
    """Σ a_i × F_i, (L, 3), of (L, m, 3): the skew part of Σ F_i a_iᵀ."""
    return rotations.vee(np.swapaxes(force, -1, -2) @ arm)


class Terminal:
    """Poses and hinge forces of L terminals at once.

    rotation : (L, 3, 3), LCS → BCS. translation : (L, 3), m.
    """

    def __init__(self, truth: Truth, stand: FloatArray, start: Pose) -> None:
        """Stand : (L, n, 3), m, BCS, carriages. Raises NotConvergedError where nothing stands."""
        lanes = len(stand)
        load = Load(np.zeros((lanes, 1, 2, 3)), np.zeros((lanes, 1, 3)))
        first = Pose(start.rotation[:, None], start.translation[:, None])
        rest = settle(truth, stand[:, None], load, first)
        self.rotation = rest.pose.rotation[:, 0]
        self.translation = rest.pose.translation[:, 0]
        self._levers = np.concatenate([truth.hinge, truth.barycentre[:, None, :]], axis=1)
        self._acting = np.empty_like(self._levers)
        self._stiffness = truth.stiffness
        self._acting[:, -1] = truth.mass[:, None] * truth.gravity
        self._age = _REFRESH
        self._stand = stand

    @property
    def force(self) -> FloatArray:
        """(L, n, 3), N, BCS, of the NCPs on the terminal."""
        return self._pull(self._levers[:, :-1] @ np.swapaxes(self.rotation, -1, -2))

    def move(self, stand: FloatArray, contact: FloatArray) -> None:
        """Let the carriages stand at `stand` under a contact wrench (L, 6), N, and N·m about the
        LCS origin, BCS.
        """
        # The mean of the carriages' move is exact for a translation; Newton does the rest.
        self.translation = self.translation + (stand - self._stand).mean(axis=1)
        self._stand = stand
        levers = self._levers @ np.swapaxes(self.rotation, -1, -2)
        arm = levers[:, :-1]
        if self._age >= _REFRESH:
            self._yield, self._age = self._flexibility(arm), 0
        self._age += 1
        self._acting[:, :-1] = self._pull(arm)
        net = contact.copy()
        net[:, :3] += self._acting.sum(axis=1)
        net[:, 3:] += moment(levers, self._acting)
        step = (self._yield @ net[..., None])[..., 0]
        self.translation = self.translation + step[:, :3]
        turn = rotations.hat(step[:, 3:])
        # To the third order in a turn of microradians.
        self.rotation = self.rotation + turn @ (self.rotation + 0.5 * (turn @ self.rotation))

    def yield_to(self, wrench: FloatArray) -> None:
        """Give way to a small change of the contact wrench (L, 6), so that no step is lost."""
        step = (self._yield @ wrench[..., None])[..., 0]
        self.translation = self.translation + step[:, :3]
        turn = rotations.hat(step[:, 3:])
        self.rotation = self.rotation + turn @ self.rotation

    def _pull(self, arm: FloatArray) -> FloatArray:
        stretch = arm + (self.translation[:, None, :] - self._stand)
        return np.asarray(-(self._stiffness @ stretch[..., None])[..., 0])

    def _flexibility(self, arm: FloatArray) -> FloatArray:
        """(L, 6, 6): small translation and rotation by a small net force and moment."""
        lever = rotations.hat(arm)
        coupling = (self._stiffness @ lever).sum(axis=1)
        slope = np.empty((len(arm), 6, 6))
        slope[:, :3, :3] = self._stiffness.sum(axis=1)
        slope[:, :3, 3:] = -coupling
        slope[:, 3:, :3] = -np.swapaxes(coupling, -1, -2)
        slope[:, 3:, 3:] = -(lever @ self._stiffness @ lever).sum(axis=1)
        return np.asarray(np.linalg.inv(slope), dtype=np.float64)
