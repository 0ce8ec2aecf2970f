"""How far the terminal strays in free space (Sect. 5.1, Table 4, Fig. 16)."""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import dataclass, replace
from functools import partial

import numpy as np
from matplotlib.figure import Figure

from studies import controlled
from studies.control.contact import GearPair
from studies.control.reference import move, require_within
from studies.control.runs import Controller
from studies.controlled import ORIGIN, Arm
from studies.frame import Study, Table
from studies.statistics import mean, ratio
from tdfscal.records import FloatArray, Rig
from tdfscal.reporting.figures.style import figure, legend_outside, logarithmic
from tdfscal.reporting.layout import Drawing
from tdfscal.simulation import rotations
from tdfscal.simulation.equilibrium import Pose

#: The paper's means over six moves, mm and mrad: tracker, self.
PAPER = ((1.002, 0.592), (7.088, 5.071))
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
_NAMES, _UNITS = ("position", "posture"), ("mm", "mrad")
#: Of a move, and of the rest behind it, s.
_DURATION, _REST = 10.0, 40.0


@dataclass(frozen=True, slots=True)
class Deviations:
    """C calibrations, M moves, N runs.

    value : (C, M, N, 6), of the final pose by the servos' encoders from the planned one: LCS
    origin, m, BCS, and rotation vector, rad, LCS.
    """

    arms: tuple[Arm, ...]
    value: FloatArray

    def lengths(self, which: int) -> dict[str, FloatArray]:
        """(N,) by arm: mean length over the moves, position in mm (0) or posture in mrad (1).

        The moves of one run share a rig, so that the runs are the sample.
        """
        part = self.value[..., 3 * which : 3 * which + 3]
        length = 1e3 * np.linalg.norm(part, axis=-1).mean(axis=1)
        return {arm.name: own for arm, own in zip(self.arms, length, strict=True)}


def simulate(
    rig: Rig, controller: Controller, arms: tuple[Arm, ...], seed: np.random.SeedSequence
) -> Deviations:
    """Make every move once per calibration and run, with the same draws for all calibrations.

    Raises UsageError where moves leave the NCPs' travel, or the loop is unstable.
    """
    pose = Pose(rotations.from_rpy(MOVES[..., :3]), np.asarray(controlled.HOME) + MOVES[..., 3:])
    for end, what in enumerate(("initial posture of move", "target posture of move")):
        at = Pose(pose.rotation[:, end], pose.translation[:, end])
        require_within(rig, at, controlled.HOME, controlled.TRAVEL, what)
    runs = len(arms[0].truth.mass)
    start, goal = (
        Pose(*(np.repeat(v[:, end], runs, axis=0) for v in (pose.rotation, pose.translation)))
        for end in (0, 1)
    )
    way = move(start, goal, _DURATION, _REST, controller.step)
    result = controlled.simulate_lanes(rig, controller, arms, way, seed.spawn(2))
    # Where the encoders have the terminal in the end.
    servo = result.servo.reshape(len(arms), len(goal.rotation), rig.n, 3)
    R, T = rotations.fit(rig.hinge, servo)
    turn = rotations.log(np.swapaxes(goal.rotation, -1, -2) @ R)
    deviation = np.concatenate([T - goal.translation, turn], axis=-1)
    return Deviations(arms, deviation.reshape(len(arms), len(MOVES), runs, 6))


def run(
    rig: Rig,
    cases: dict[str, tuple[Arm, ...]],
    seed: np.random.SeedSequence,
    progress: Callable[[str], None] = lambda text: None,
) -> Study:
    """Fig. 16 on this rig, of machines and calibrations under each case's sources."""
    controller = controlled.controller_of(rig, GearPair())
    impedance, tables, like, drawings = controller.impedance, [], [], []
    chosen: list[tuple[str, str, str]] = []
    for case, arms in cases.items():
        runs = len(arms[0].truth.mass)
        progress(f"{case}: {len(MOVES)} moves, {runs} runs, {len(arms)} calibrations")
        fresh = np.random.SeedSequence(seed.entropy, spawn_key=seed.spawn_key)
        found = simulate(rig, controller, arms, fresh)
        tables += _tables(case, found)
        for k in (0, 1):
            values, printed = found.lengths(k), PAPER[k][1] / PAPER[k][0]
            pairs = [(f"{a}{end}", f"tracker{end}") for a in ("Eq. 24", "true angles")
                     for end in ("", ", tared")]  # fmt: skip
            what = f"{_NAMES[k]}, {case}"
            like += controlled.beside("Fig. 16", what, dict.fromkeys(pairs, printed), values)
            if case == next(iter(cases)):
                unit = ("N/m", "N·m/rad")[k]
                chosen += [
                    (f"{_NAMES[k]}, {arm}",
                     f"{mean(values[arm])} {_UNITS[k]} (Fig. 16: {own:g})",
                     f"goes with 1/K: {impedance.stiffness[3 * k]:g} {unit} chosen")
                    for arm, own in zip(("tracker", "Eq. 24"), PAPER[k], strict=True)
                ]  # fmt: skip
        said = "Rms over runs of each component and move, by what the controller knows."
        title = f"Deviation of the final pose after each move: {case}"
        drawings.append(Drawing(f"fig-16-{case}", title, said, partial(_paint, found)))
    return Study(
        "free-space",
        f"Free space: {rig.name}",
        f"{len(MOVES)} moves of 50 mm, {runs} runs of each case, `rig`: all that the rig file "
        "states, the usual campaign; `paper`: the paper's two sources alone, the campaign where "
        f"Eq. 24 leads; virtual mass {impedance.mass[0]:g} kg, damping "
        f"{impedance.damping[0]:.3g} N·s/m, stiffness {impedance.stiffness[0]:g} N/m; {ORIGIN}",
        tuple(tables),
        beside=tuple(like),
        chosen=tuple(chosen),
        drawings=tuple(drawings),
    )


def _tables(case: str, found: Deviations) -> list[Table]:
    position, posture = found.lengths(0), found.lengths(1)
    ratios = tuple(
        (f"{a} / {b}", ratio(position[a], position[b]), ratio(posture[a], posture[b]))
        for a, b in controlled.pairs(found.arms)
    )
    means = tuple((n, mean(position[n]), mean(posture[n])) for n in position)
    head = ("position, mm", "posture, mrad")
    caption = f"Deviation of the final pose, mean over moves and runs; {case}"
    knows = controlled.knowledge(found.arms)
    return [
        Table(f"deviation-{case}", caption, ("calibration", *head), means),
        Table(f"ratios-{case}", f"Ratios of the means, like with like; {case}",
              ("calibrations", "position", "posture"), ratios),
        replace(knows, name=f"arms-{case}"),
    ]  # fmt: skip


def _paint(found: Deviations) -> Figure:
    fig = figure(4.8)
    grid = fig.subplots(2, 3, sharex=True, sharey="row")
    names = ("x", "y", "z", "about x", "about y", "about z")
    rms = 1e3 * np.sqrt(np.mean(found.value**2, axis=2))  # (C, M, 6)
    at = np.arange(1.0, rms.shape[1] + 1.0)
    for axis, ax in enumerate(grid.flat):
        for c, arm in enumerate(found.arms):
            colour, line, marker = controlled.MARKS[c % len(controlled.MARKS)]
            fill = "none" if arm.tared else "full"
            ax.plot(at, rms[c, :, axis], color=colour, linestyle=line, marker=marker,
                    markersize=4, fillstyle=fill, label=arm.name)  # fmt: skip
        logarithmic(ax)
        ax.set_title(names[axis])
        ax.set_xticks(at)
        if axis % 3 == 0:
            ax.set_ylabel("rms over runs, " + ("mm" if axis < 3 else "mrad"))
        if axis >= 3:
            ax.set_xlabel("move")
    legend_outside(fig, grid.flat[0])
    return fig
