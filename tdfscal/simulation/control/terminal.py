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


def cross(a: FloatArray, b: FloatArray) -> FloatArray:
    """a × b, (..., 3), without the overhead of numpy's."""
    out = np.empty(np.broadcast_shapes(a.shape, b.shape))
    out[..., 0] = a[..., 1] * b[..., 2] - a[..., 2] * b[..., 1]
    out[..., 1] = a[..., 2] * b[..., 0] - a[..., 0] * b[..., 2]
    out[..., 2] = a[..., 0] * b[..., 1] - a[..., 1] * b[..., 0]
    return out


class Terminal:
    """Poses and hinge forces of L terminals at once.

    rotation : (L, 3, 3), LCS → BCS. translation : (L, 3), m. force : (L, n, 3), N, BCS, of the
    NCPs on the terminal.
    """

    def __init__(self, truth: Truth, stand: FloatArray, start: Pose) -> None:
        """stand : (L, n, 3), m, BCS, carriages. Raises NotConvergedError where nothing stands."""
        lanes = len(stand)
        load = Load(np.zeros((lanes, 1, 2, 3)), np.zeros((lanes, 1, 3)))
        first = Pose(start.rotation[:, None], start.translation[:, None])
        rest = settle(truth, stand[:, None], load, first)
        self.rotation = rest.pose.rotation[:, 0]
        self.translation = rest.pose.translation[:, 0]
        self.force = rest.force[:, 0]
        self._hinge, self._barycentre = truth.hinge, truth.barycentre[:, :, None]
        self._stiffness = truth.stiffness
        self._weight = truth.mass[:, None] * truth.gravity
        self._age = _REFRESH
        self._stand = stand

    def move(self, stand: FloatArray, force: FloatArray, moment: FloatArray) -> None:
        """Let the carriages stand at `stand` under a contact force (L, 3), N, and moment (L, 3),
        N·m about the LCS origin, BCS.
        """
        # The mean of the carriages' move is exact for a translation; Newton does the rest.
        self.translation = self.translation + (stand - self._stand).mean(axis=1)
        self._stand = stand
        arm = self._hinge @ np.swapaxes(self.rotation, -1, -2)
        if self._age >= _REFRESH:
            self._yield, self._age = self._flexibility(arm), 0
        self._age += 1
        pull = self._pull(arm, stand)
        bary = (self.rotation @ self._barycentre)[..., 0]
        net = np.empty((len(stand), 6, 1))
        net[:, :3, 0] = pull.sum(axis=1) + self._weight + force
        net[:, 3:, 0] = cross(arm, pull).sum(axis=1) + cross(bary, self._weight) + moment
        step = (self._yield @ net)[..., 0]
        self.translation = self.translation + step[:, :3]
        turn = rotations.hat(step[:, 3:])
        # To the third order in a turn of microradians.
        self.rotation = self.rotation + turn @ (self.rotation + 0.5 * (turn @ self.rotation))
        self.force = self._pull(self._hinge @ np.swapaxes(self.rotation, -1, -2), stand)

    def _pull(self, arm: FloatArray, stand: FloatArray) -> FloatArray:
        stretch = arm + self.translation[:, None, :] - stand
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
        return np.linalg.inv(slope)
