"""How far the terminal strays in free space (Sect. 5.1, Table 4, Fig. 16)."""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import dataclass, field

import numpy as np

from tdfscal.errors import UsageError
from tdfscal.records import FloatArray, Rig
from tdfscal.simulation import rotations
from tdfscal.simulation.control.reference import move, require_within
from tdfscal.simulation.control.runs import Controller, Result
from tdfscal.simulation.equilibrium import Pose
from tdfscal.studies.compared_calibrations import LIKE, Arms
from tdfscal.studies.lanes import machines_of, simulate_lanes
from tdfscal.studies.ratios import Ratio, ratio

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
class FreeSpaceStudy:
    """C calibrations, M moves, N runs.

    deviation : (C, M, N, 6), of the final pose by the servos' encoders from the planned one: LCS
    origin, m, BCS, and rotation vector, rad, LCS.
    """

    setup: Setup
    arms: Arms
    seed: int
    deviation: FloatArray
    result: Result

    @property
    def names(self) -> tuple[str, ...]:
        """Names of the calibrations."""
        return self.arms.names

    @property
    def length(self) -> FloatArray:
        """(C, M, N, 2): length of the deviation of position (m) and posture (rad)."""
        parts = self.deviation.reshape(*self.deviation.shape[:-1], 2, 3)
        return np.asarray(np.linalg.norm(parts, axis=-1))

    def ratio(self, quantity: int, of: str, to: str) -> Ratio:
        """Ratio of mean lengths; moves of one run share a rig, so that the runs are the sample."""
        a, b = (self.length[self.names.index(n), ..., quantity].mean(axis=0) for n in (of, to))
        return ratio(a, b)


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
    UsageError : moves that are none, or leave the NCPs' travel.
    """
    rig, moves = setup.rig, np.asarray(setup.moves, dtype=np.float64)
    if moves.ndim != 3 or moves.shape[1:] != (2, 6) or not np.all(np.isfinite(moves)):
        raise UsageError(f"expected moves of shape (M, 2, 6), got {moves.shape}")
    pose = Pose(rotations.from_rpy(moves[..., :3]), np.asarray(setup.home) + moves[..., 3:])
    for end, what in enumerate(("initial posture of move", "target posture of move")):
        at = Pose(pose.rotation[:, end], pose.translation[:, end])
        require_within(rig, at, setup.home, setup.travel, what)
    count, runs, copies = len(moves), arms.runs, len(arms.arms)

    def lanes(end: int) -> Pose:
        R, T = (
            np.tile(np.repeat(v[:, end], runs, axis=0), (copies, *(1,) * (v.ndim - 2)))
            for v in (pose.rotation, pose.translation)
        )
        return Pose(R, T)

    goal = lanes(1)
    reference = move(lanes(0), goal, setup.duration, setup.rest, setup.controller.step)
    machines = machines_of(rig, setup.controller.servo, arms, seed.spawn(2), count)
    result = simulate_lanes(
        machines, setup.controller, reference, workers=workers, progress=progress
    )
    return FreeSpaceStudy(
        setup=setup,
        arms=arms,
        seed=number,
        deviation=_deviation(rig, result.servo, goal).reshape(copies, count, runs, 6),
        result=result,
    )


def _deviation(rig: Rig, servo: FloatArray, plan: Pose) -> FloatArray:
    """Deviation (L, 6) of the pose by encoder values (L, n, 3) from the planned one."""
    R, T = rotations.fit(rig.hinge, servo)
    turn = rotations.log(np.swapaxes(plan.rotation, -1, -2) @ R)
    return np.concatenate([T - plan.translation, turn], axis=1)
