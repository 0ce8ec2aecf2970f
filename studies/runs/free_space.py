"""How far the terminal strays in free space (Sect. 5.1, Table 4, Fig. 16)."""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import dataclass, field

import numpy as np

from studies.control.reference import move, require_within
from studies.control.runs import Controller
from studies.runs.compared_calibrations import LIKE, Arms
from studies.runs.lanes import ControlStudy, simulate_lanes
from tdfscal.records import FloatArray, Rig
from tdfscal.simulation import rotations
from tdfscal.simulation.equilibrium import Pose

#: The paper's averages, mm and mrad, over its calibrations; beside the arms that are like them.
_PUBLISHED = {"tracker": (1.002, 7.088), "self": (0.592, 5.071)}
PAPER = {arm: _PUBLISHED[name] for arm, name in LIKE.items() if name in _PUBLISHED}
_DEG = np.pi / 180.0
#: Six moves of 50 mm along z: roll, pitch, yaw (rad) and place about home (m), at start and goal.
#: Table 4 is empty in the text at hand; a few degrees from general to assembly posture are usual.
MOVES = np.array(
    [
        [[0, 0, 0, 0, 0, -0.025], [0, 0, 0, 0, 0, 0.025]],
        [[2 * _DEG, 0, 0, 0.005, 0, -0.025], [0, 0, 0, 0, 0, 0.025]],
        [[0, -2 * _DEG, 0, 0, -0.005, -0.025], [0, 0, 0, 0, 0, 0.025]],
        [[-1 * _DEG, 1 * _DEG, 2 * _DEG, -0.005, 0.005, -0.025], [0, 0, 0, 0, 0, 0.025]],
        [[0, 0, 0, 0, 0, -0.025], [1 * _DEG, -2 * _DEG, -1 * _DEG, 0.005, 0.005, 0.025]],
        [[2 * _DEG, 2 * _DEG, -2 * _DEG, 0, 0, -0.025], [-2 * _DEG, 1 * _DEG, 0, 0, 0, 0.025]],
    ],
    dtype=np.float64,
)


@dataclass(frozen=True, slots=True)
class Setup:
    """Moves (M, 2, 6) as `MOVES`, each of `duration` (s) and `rest` (s).

    home : m, BCS. travel : m, of each NCP about home.
    """

    rig: Rig
    controller: Controller = field(default_factory=Controller)
    moves: FloatArray = field(default_factory=lambda: MOVES.copy())
    duration: float = 10.0
    rest: float = 20.0
    home: tuple[float, float, float] = (0.05, -0.03, 1.2)
    travel: tuple[float, float, float] = (0.25, 0.25, 0.5)


@dataclass(frozen=True, slots=True)
class FreeSpaceStudy(ControlStudy):
    """C calibrations, M moves, N runs.

    deviation : (C, M, N, 6), of the final pose by the servos' encoders from the planned one: LCS
    origin, m, BCS, and rotation vector, rad, LCS.
    """

    setup: Setup
    deviation: FloatArray

    @property
    def length(self) -> FloatArray:
        """(C, M, N, 2): length of the deviation of position (m) and posture (rad)."""
        parts = self.deviation.reshape(*self.deviation.shape[:-1], 2, 3)
        return np.asarray(np.linalg.norm(parts, axis=-1))

    def sample(self, quantity: int) -> FloatArray:
        """(C, N): mean length over the moves, position (m) or posture (rad); moves of one run share
        a rig, so that the runs are the sample.
        """
        return np.asarray(self.length[..., quantity].mean(axis=1))


def free_space(
    setup: Setup,
    arms: Arms,
    seed: np.random.SeedSequence,
    number: int,
    *,
    workers: int = 1,
    progress: Callable[[float], None] = lambda share: None,
) -> FreeSpaceStudy:
    """Make every move once per calibration and run, with the same draws for all calibrations.
    workers : processes; they change no number.

    Raises
    ------
    UsageError : moves leave the NCPs' travel, or the loop is unstable.
    """
    rig, moves = setup.rig, setup.moves
    pose = Pose(rotations.from_rpy(moves[..., :3]), np.asarray(setup.home) + moves[..., 3:])
    for end, what in enumerate(("initial posture of move", "target posture of move")):
        at = Pose(pose.rotation[:, end], pose.translation[:, end])
        require_within(rig, at, setup.home, setup.travel, what)
    start, goal = (
        Pose(*(np.repeat(v[:, end], arms.runs, axis=0) for v in (pose.rotation, pose.translation)))
        for end in (0, 1)
    )
    controller = setup.controller
    reference = move(start, goal, setup.duration, setup.rest, controller.step)
    result = simulate_lanes(
        rig, controller, arms, reference, seed.spawn(2), workers=workers, progress=progress
    )
    # Where the encoders have the terminal in the end.
    servo = result.servo.reshape(len(arms.arms), len(goal.rotation), rig.n, 3)
    R, T = rotations.fit(rig.hinge, servo)
    turn = rotations.log(np.swapaxes(goal.rotation, -1, -2) @ R)
    deviation = np.concatenate([T - goal.translation, turn], axis=-1)
    each = deviation.reshape(len(arms.arms), len(moves), arms.runs, 6)
    return FreeSpaceStudy(arms, number, result, setup, each)
