"""Calibrations at work: the machines they meet, lanes over several processes, what is said alike.

The methods give angles: zeros, mass and barycentre are the rig file's in every arm, or are tared
away in every arm that it is compared with.
"""

from __future__ import annotations

import os
from collections.abc import Sequence
from dataclasses import dataclass, fields, replace
from typing import Any, TypeVar

import numpy as np
from matplotlib.axes import Axes
from matplotlib.ticker import FixedLocator, FuncFormatter, NullLocator

from studies import campaigns
from studies.campaigns import Setting, mapped
from studies.control.contact import GearPair
from studies.control.loop import simulate
from studies.control.machine import PositionErrors, draw_errors
from studies.control.reference import Reference
from studies.control.runs import Controller, Docking, Machines, Result, Traces
from studies.control.stability import designed, real_mass
from studies.control.terminal import stated
from studies.frame import Beside, Table
from studies.statistics import ratio
from tdfscal.numerics import so3
from tdfscal.records import FloatArray, IntArray, Rig
from tdfscal.reporting.figures import style
from tdfscal.reporting.figures.style import signed
from tdfscal.simulation import Pose, SurveyOptions, Truth, simulate_dwells

#: Colour, line and marker of each calibration: each tells them apart on its own.
_SELF = (style.ORANGE, style.RED, style.BLUE, style.GREEN)
_COLOURS = (style.BLACK, style.GREY, style.GREY, *_SELF, *_SELF)
_LINES = (":", ":", "--", "--", "-.", "-", "-.", ":", ":", ":", ":")
MARKS = tuple(zip(_COLOURS, _LINES, "x+vsDo^sDo^", strict=True))
#: Lane steps below which a second process costs more than it saves, and lanes per block at least.
#: The blocks go by the work alone, so that the number of processes changes no number.
_WORTH, _BLOCK = 1_000_000, 200
#: Where the LCS origin starts in the BCS, m, and the travel of each NCP about there.
HOME, TRAVEL = (0.05, -0.03, 1.2), (0.25, 0.25, 0.5)
_R = TypeVar("_R", Truth, PositionErrors, Pose)


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


def controller_of(rig: Rig, gears: GearPair, *, relative: bool = False) -> Controller:
    """The real mass, and the least damping that is stable in free space and at these gears.

    Raises UsageError where none is.
    """
    base = Controller()
    impedance = replace(base.impedance, mass=real_mass(rig, base), relative=relative)
    return designed(rig, replace(base, impedance=impedance), gears)


def simulate_lanes(
    rig: Rig,
    controller: Controller,
    arms: Sequence[Arm],
    reference: Reference,
    seeds: Sequence[np.random.SeedSequence],
    docking: Docking | None = None,
) -> Result:
    """Go the way of every run with every calibration; lane = calibration · runs + run.

    reference : ways of all runs; of more than there are machines, which then go several. seeds : of
    the positions' errors and of the noise, which are the same for all calibrations.

    Raises as `loop.simulate`.
    """
    runs, copies, count = len(reference.start.translation), len(arms), len(arms[0].truth.mass)
    rng = np.random.default_rng(seeds[0])
    errors = draw_errors(controller.servo, rig.declared.positioner, runs, rig.n, rng)
    noise = seeds[1].spawn(runs)

    def task(part: IntArray) -> tuple[Machines, Controller, Reference, Docking | None]:
        run, machine = np.tile(part, copies), part % count
        machines = Machines(
            rig,
            _together([_taken(arm.truth, machine) for arm in arms]),
            _taken(errors, run),
            _together([_taken(arm.assumed, machine) for arm in arms]),
            np.repeat([arm.tared for arm in arms], len(part)),
            tuple(noise[i] for i in part),
        )
        start, goal = _taken(reference.start, run), _taken(reference.goal, run)
        return machines, controller, replace(reference, start=start, goal=goal), docking

    worth = copies * runs * len(reference.share) >= _WORTH
    blocks = min(runs, max(2, copies * runs // _BLOCK)) if worth else 1
    parts = np.array_split(np.arange(runs), blocks)
    tasks = list(map(task, parts))
    workers = min(os.cpu_count() or 1, blocks)
    results = list(mapped(simulate, *zip(*tasks, strict=True), workers=workers))
    lanes = np.arange(copies * runs).reshape(copies, runs)
    return _joined(results, np.argsort(np.concatenate([lanes[:, part].ravel() for part in parts])))


def _values(record: Any) -> tuple[Any, ...]:
    return tuple(getattr(record, f.name) for f in fields(record))


def _taken(record: _R, lanes: IntArray) -> _R:
    """These lanes of a record of arrays, which lie in memory alike whatever is taken."""
    return type(record)(*(np.take(value, lanes, axis=0) for value in _values(record)))


def _together(records: Sequence[Truth]) -> Truth:
    return Truth(*(np.concatenate(each) for each in zip(*map(_values, records), strict=True)))


def _joined(results: list[Result], order: IntArray) -> Result:
    """Results of blocks as one, lanes in their order; the last record stands for what follows."""
    longest = max((r.traces.time for r in results), key=len)

    def full(trace: Any) -> Any:
        missing = len(longest) - len(trace)
        return np.concatenate([trace, np.repeat(trace[-1:], missing, axis=0)])

    traces = [
        np.take(np.concatenate(list(map(full, part)), axis=1), order, axis=1)
        for part in zip(*(_values(r.traces)[1:] for r in results), strict=True)
    ]
    values = {
        f.name: np.take(np.concatenate([getattr(r, f.name) for r in results]), order, axis=0)
        for f in fields(Result)
        if f.name != "traces"
    }
    return Result(traces=Traces(longest, *traces), **values)


def knowledge(arms: Sequence[Arm]) -> Table:
    """What each controller knows, and how far its angles are off."""
    rows = tuple(
        (arm.name, KNOWS[arm.name], 1e3 * arm.angle_error, arm.failed)
        for arm in arms
        if not arm.tared
    )
    head = ("calibration", "knows", "angles off, mrad", "none found")
    return Table("arms", "What each controller knows", head, rows, left=2)


def pairs(arms: Sequence[Arm]) -> list[tuple[str, str]]:
    """Which arms are compared: like with like, untared with untared and tared with tared."""
    names = [arm.name for arm in arms]
    found = [("tracker", "none"), *(("tracker", name) for name in MOUNTED)]
    found += [(name, "tracker") for name in ("Eq. 24", "ML", "true angles")]
    found += [(f"{a}, tared", f"{b}, tared") for a, b in found]
    return [(a, b) for a, b in found if a in names and b in names]


def beside(
    figure: str,
    quantity: str,
    paper: dict[tuple[str, str], float],
    values: dict[str, FloatArray],
) -> list[Beside]:
    """Ratios of two arms over paired runs, the paper's beside; values : (N,) by arm."""
    items = []
    for (a, b), printed in paper.items():
        if a in values and b in values:
            with np.errstate(invalid="ignore", divide="ignore"):
                draws = values[a] / values[b]
            here = ratio(values[a], values[b])
            items.append(Beside(figure, f"{quantity}, {a} / {b}", "", printed, here, draws=draws))
    return items


def linear_then_log(ax: Axes, which: str, linear: float) -> None:
    """Scale an axis, "x" or "y", linearly up to ± a limit and logarithmically beyond it."""
    getattr(ax, f"set_{which}scale")("symlog", linthresh=linear, linscale=2.0)
    steps = [*(linear * k / 3 for k in (1, 2, 3)), *(linear / 0.3 * 10**k for k in range(3))]
    axis = getattr(ax, f"{which}axis")
    axis.set_major_locator(FixedLocator([-step for step in reversed(steps)] + [0.0, *steps]))
    axis.set_major_formatter(FuncFormatter(lambda value, _: signed(value, "g")))
    axis.set_minor_locator(NullLocator())
