"""What a calibration does to an assembly: docking of the gears (Sect. 5.2, Figs. 17 and 18)."""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import dataclass, replace
from functools import partial

import numpy as np
from matplotlib.figure import Figure

from studies import controlled
from studies.control.contact import GearPair
from studies.control.reference import advance, require_within, survey_error
from studies.control.runs import PHASES, Controller, Docking, Result
from studies.controlled import ORIGIN, Arm
from studies.frame import Beside, Cell, Study, Table
from studies.statistics import mean, ratio
from tdfscal.records import BoolArray, FloatArray, Rig
from tdfscal.reporting.figures import style
from tdfscal.reporting.figures.style import figure, legend_outside
from tdfscal.reporting.layout import Drawing
from tdfscal.simulation import SurveyOptions
from tdfscal.simulation.equilibrium import Pose

#: Path beyond the planned seat, m: the seat is felt, not known.
_ON = 0.01
#: Depth that the controller may lack when it takes a threshold for the seat, m.
_SHORT = 0.002
#: N/m of a tooth: near the paper's newtons, and our stand's (`contact.SERIES`, None).
SOFT = 2.0e5
#: The paper's means of the maxima, N and N·m: none, tracker, self.
PAPER = ((8.41, 6.58, 6.58 * (1 - 0.363)), (5.22, 3.89, 3.89 * (1 - 0.221)))
_FORCES = ("Fx, N", "Fy, N", "Fz, N", "Mx, N·m", "My, N·m", "Mz, N·m")
#: The scale is linear up to here, N and N·m, and logarithmic beyond: the paper's range is 12 N.
_LINEAR = (12.0, 6.0)


@dataclass(frozen=True, slots=True)
class Setup:
    """A docking. slug : of its files. gap : m, before contact. speed : m/s. ramp : s."""

    rig: Rig
    controller: Controller
    gears: GearPair
    slug: str = "docking"
    gap: float = 0.05
    speed: float = 1.5e-3
    ramp: float = 5.0


@dataclass(frozen=True, slots=True)
class Dockings:
    """Every machine docked once with each of C calibrations, N runs."""

    setup: Setup
    arms: tuple[Arm, ...]
    result: Result

    def _grid(self, values: FloatArray) -> FloatArray:
        return values.reshape(len(self.arms), -1, *values.shape[1:])

    @property
    def peak(self) -> FloatArray:
        """(C, N, 6): largest |contact wrench| from first contact to the seat, N, and N·m about the
        LCS origin, LCS; NaN of runs without contact.
        """
        largest = self._grid(self.result.peak[:, 1:3].max(axis=1))
        return np.where(self.touched[..., None], largest, np.nan)

    @property
    def seen(self) -> FloatArray:
        """(C, N, 6): largest |wrench| that the controller saw from the start to the seat, or until
        it stopped; NaN of runs without contact.
        """
        largest = self._grid(self.result.peak_measured[:, :3].max(axis=1))
        return np.where(self.touched[..., None], largest, np.nan)

    @property
    def starts(self) -> FloatArray:
        """(C, N, 4), s: of each phase; NaN where it was not reached."""
        return self._grid(self.result.phase_start)

    @property
    def touched(self) -> BoolArray:
        """(C, N): contact was made; without it the controller stopped at a false force."""
        return np.isfinite(self.starts[..., 1])

    @property
    def seated(self) -> BoolArray:
        """(C, N): stopped at depth."""
        return self.result.seated.reshape(len(self.arms), -1)

    @property
    def jammed(self) -> BoolArray:
        """(C, N): stopped before."""
        return self.result.jammed.reshape(len(self.arms), -1)

    @property
    def succeeded(self) -> BoolArray:
        """(C, N): seated, and no true force before beyond its limit along any axis."""
        limits = np.asarray(self.setup.controller.thresholds)
        return np.asarray(self.seated & np.all(self.peak[..., :3] <= limits, axis=-1))

    @property
    def early(self) -> BoolArray:
        """(C, N): the largest true force comes at first contact, not in the insertion."""
        each = self._grid(self.result.peak[:, 1:3, :3].max(axis=2))
        return np.asarray(each[..., 0] >= each[..., 1])

    def maxima(self, which: int, *, seen: bool) -> dict[str, FloatArray]:
        """(N,) by arm: mean of the maxima along x, y and z of force, N (0), or torque, N·m (1)."""
        part = (self.seen if seen else self.peak)[..., 3 * which : 3 * which + 3].mean(axis=-1)
        return {arm.name: own for arm, own in zip(self.arms, part, strict=True)}


def simulate(setup: Setup, arms: tuple[Arm, ...], seed: np.random.SeedSequence) -> Dockings:
    """Dock once per calibration and run; a run's draws (rig, survey, positioning errors, noise) are
    the same for all calibrations.

    Raises UsageError where the way leaves the NCPs' travel, or the loop is unstable.
    """
    rig, gears, controller = setup.rig, setup.gears, setup.controller
    survey_seed, *machine_seeds = seed.spawn(3)
    runs, home, tip = len(arms[0].truth.mass), np.asarray(controlled.HOME), np.asarray(gears.tip)
    mouth = home + tip + np.array([0.0, 0.0, setup.gap])
    # The way is planned by a survey of the outer gear.
    rng = np.random.default_rng(survey_seed)
    turn, shift = survey_error(rig, SurveyOptions(), mouth, home, runs, rng)
    # The impedance lags by B v / K, and presses its threshold of force on the seat.
    impedance = controller.impedance
    lag = setup.speed * impedance.damping[2] / impedance.stiffness[2]
    way = setup.gap + gears.length + _ON + (0.0 if impedance.relative else lag)
    start, goal = (
        Pose(turn, mouth + shift + turn @ (np.array([0.0, 0.0, s]) - tip))
        for s in (-setup.gap, way - setup.gap)
    )
    for pose, what in ((start, "start posture of run"), (goal, "end posture of run")):
        require_within(rig, pose, controlled.HOME, controlled.TRAVEL, what)
    result = controlled.simulate_lanes(
        rig,
        controller,
        arms,
        advance(start, goal, way=way, speed=setup.speed, ramp=setup.ramp, step=controller.step),
        machine_seeds,
        Docking(gears, mouth, setup.gap + gears.length - _SHORT),
    )
    return Dockings(setup, arms, result)


def cases(rig: Rig) -> dict[str, Setup]:
    """Contacts and damping terms that are docked at, by name."""
    stand, of = GearPair(), controlled.controller_of
    soft = replace(stand, stiffness=SOFT, seat_stiffness=2.0 * SOFT)
    stiff = f"{1e-6 * stand.stiffness:.2g}"
    return {
        "0.2 N/µm, B ẋ": Setup(rig, of(rig, soft), soft, "soft"),
        "0.2 N/µm, B (ẋ − ẋ_d)": Setup(rig, of(rig, soft, relative=True), soft, "soft-relative"),
        f"{stiff} N/µm, B ẋ": Setup(rig, of(rig, stand), stand, "stand"),
    }


def run(
    rig: Rig,
    arms: tuple[Arm, ...],
    seed: np.random.SeedSequence,
    progress: Callable[[str], None] = lambda text: None,
) -> Study:
    """Figs. 17 and 18 on this rig, for every case."""
    found: dict[str, Dockings] = {}
    for name, setup in cases(rig).items():
        progress(f"docking at {name}: {len(arms[0].truth.mass)} runs, {len(arms)} calibrations")
        fresh = np.random.SeedSequence(seed.entropy, spawn_key=seed.spawn_key)
        found[name] = simulate(setup, arms, fresh)
    first = next(iter(found.values()))
    tables = [_maxima(name, one) for name, one in found.items()]
    tables += [_ratios(found), controlled.knowledge(arms)]
    limits = ", ".join(f"{v:g}" for v in first.setup.controller.thresholds)
    return Study(
        "docking",
        f"Docking: {rig.name}",
        f"{1e3 * first.setup.speed:g} mm/s over {1e3 * first.setup.gap:g} mm of free space and "
        f"{1e3 * first.setup.gears.length:.3g} mm of engagement, {len(arms[0].truth.mass)} runs of "
        f"each case; success is a seat without a true force above {limits} N; {ORIGIN}",
        tuple(tables),
        beside=tuple(item for name, one in found.items() for item in _like(name, one)),
        chosen=tuple(item for name, one in found.items() for item in _chosen(name, one)),
        drawings=tuple(d for name, one in found.items() for d in drawings(name, one)),
    )


def _maxima(name: str, one: Dockings) -> Table:
    values = [one.maxima(k, seen=seen) for seen in (False, True) for k in (0, 1)]
    rows: list[tuple[Cell, ...]] = []
    for c, arm in enumerate(one.arms):
        touched, jammed = one.touched[c], one.jammed[c]
        rows.append((
            arm.name, *(mean(v[arm.name]) for v in values), int(one.succeeded[c].sum()),
            int(one.seated[c].sum()), int((jammed & touched).sum()), int((jammed & ~touched).sum()),
            int(one.early[c][touched].sum()),
        ))  # fmt: skip
    head = ("calibration", "force, N", "torque, N·m", "seen, N", "seen, N·m", "success",
            "seated", "jammed", "false", "peak at contact")  # fmt: skip
    caption = "Largest contact wrench of a run, true and as the controller sees it, mean of x, y, z"
    return Table(f"maxima-{one.setup.slug}", f"{caption}; {name}", head, tuple(rows))


def _ratios(found: dict[str, Dockings]) -> Table:
    rows = []
    for name, one in found.items():
        force, torque = (one.maxima(k, seen=True) for k in (0, 1))
        rows += [
            (name, f"{a} / {b}", ratio(force[a], force[b]), ratio(torque[a], torque[b]))
            for a, b in controlled.pairs(one.arms)
        ]
    head = ("contact, damping", "calibrations", "force", "torque")
    return Table("ratios", "Ratios of the means as seen, like with like", head, tuple(rows), 2)


def _like(name: str, one: Dockings) -> list[Beside]:
    """Fig. 18: what a calibration takes away, as the controller sees it."""
    items = []
    for k, what in enumerate(("force", "torque")):
        none, tracker, own = PAPER[k]
        paper = {("tracker", "none"): tracker / none, ("Eq. 24", "tracker"): own / tracker}
        items += controlled.beside("Fig. 18", f"{what}, {name}", paper, one.maxima(k, seen=True))
    return items


def _chosen(name: str, one: Dockings) -> list[tuple[str, str, str]]:
    """Numbers of Figs. 17 and 18 that go with what was chosen."""
    arms = [arm.name for arm in one.arms]
    damping = one.setup.controller.impedance.damping[2]
    said = []
    for k, (what, unit) in enumerate((("force", "N"), ("torque", "N·m"))):
        values = one.maxima(k, seen=True)
        for arm, printed in zip(("none", "tracker", "Eq. 24"), PAPER[k], strict=True):
            if arm in values:
                said.append((
                    f"{what}, {arm}, {name}",
                    f"{mean(values[arm])} {unit} (Fig. 18: {printed:.3g})",
                    f"goes with contact and the least stable damping, {damping:.2g} N·s/m",
                ))  # fmt: skip
    if "Eq. 24" in arms:
        c = arms.index("Eq. 24")
        for what, value, why in (
            ("first contact", f"{mean(one.starts[c, :, 1])} s (Fig. 17: 45)",
             f"the ramp of {one.setup.ramp:g} s and the damping term are chosen"),
            ("largest Fz seen", f"{mean(one.seen[c, :, 2])} N (Fig. 17: 12.1)",
             "contact and damping"),
            ("largest Mx seen", f"{mean(one.seen[c, :, 3])} N·m (Fig. 17: 3.48)",
             "contact, damping, and the point that moments are about"),
        ):  # fmt: skip
            said.append((f"{what}, Eq. 24, {name}", value, why))
    return said


def drawings(name: str, one: Dockings) -> list[Drawing]:
    """Fig. 17, of the median run of the paper's self-calibration, and Fig. 18."""
    arms = [arm.name for arm in one.arms]
    c = arms.index("Eq. 24") if "Eq. 24" in arms else len(arms) - 1
    force = one.maxima(0, seen=False)[arms[c]]
    drawings = []
    if np.isfinite(force).any():
        run = int(np.argsort(force, kind="stable")[np.isfinite(force).sum() // 2])
        peak = one.peak[c, run]
        drawings.append(Drawing(
            f"fig-17-{one.setup.slug}",
            f"Contact wrench of one docking, {name}: {arms[c]}, the run of middle force",
            f"First contact at {one.starts[c, run, 1]:.1f} s, largest true force "
            f"{peak[:3].max():.3g} N along {'xyz'[int(peak[:3].argmax())]}.",
            partial(_paint_docking, one, c, run),
        ))  # fmt: skip
    drawings.append(Drawing(
        f"fig-18-{one.setup.slug}", f"Largest contact wrench of each docking, {name}",
        "Every run a mark, the mean a bar with its standard error.", partial(_paint_maxima, one),
    ))  # fmt: skip
    return drawings


def _paint_docking(one: Dockings, c: int, run: int) -> Figure:
    lane = c * one.seated.shape[1] + run
    traces, starts, stop = one.result.traces, one.result.phase_start[lane], one.result.stopped[lane]
    last = len(traces.time) if np.isnan(stop) else int(np.searchsorted(traces.time, stop)) + 1
    time = traces.time[:last]
    fig = figure(5.4)
    grid = fig.subplots(2, 3, sharex=True, sharey="row")
    for axis, ax in enumerate(grid.flat):
        seen, true = traces.measured[:last, lane, axis], traces.contact[:last, lane, axis]
        ax.plot(time, seen, color=style.ORANGE, linewidth=0.7, label="as the controller sees it")
        ax.plot(time, true, color=style.BLACK, linewidth=1.0, label="true")
        for phase, start, line in zip(PHASES[1:], starts[1:], ("--", ":", "-."), strict=True):
            if np.isfinite(start):
                ax.axvline(start, color=style.BLUE, linewidth=0.9, linestyle=line,
                           label=f"{phase}, {start:.1f} s")  # fmt: skip
        ax.set_title(f"{_FORCES[axis]}; largest true {one.peak[c, run, axis]:.3g}")
        controlled.linear_then_log(ax, "y", _LINEAR[axis // 3])
        if axis < 3:
            limit = one.setup.controller.thresholds[axis]
            ax.axhline(limit, color=style.RED, linewidth=0.7)
            ax.axhline(-limit, color=style.RED, linewidth=0.7, label="limit" if axis == 0 else None)
        else:
            ax.set_xlabel("time, s")
    legend_outside(fig, grid.flat[0])
    return fig


def _paint_maxima(one: Dockings) -> Figure:
    names = [arm.name for arm in one.arms]
    fig = figure(1.2 + 0.38 * len(names))
    grid = fig.subplots(2, 3, sharex="row", sharey=True)
    spread = np.linspace(-0.25, 0.25, one.seated.shape[1])
    for axis, ax in enumerate(grid.flat):
        for c in range(len(names)):
            colour, _, marker = controlled.MARKS[c % len(controlled.MARKS)]
            met = one.touched[c]
            values = one.peak[c, met, axis]
            if not values.size:
                ax.text(0.2, c, "no contact", fontsize=6.5, va="center")
                continue
            ax.plot(values, c + spread[met], marker, color=colour, markersize=2.5, alpha=0.6,
                    linestyle="none")  # fmt: skip
            middle = mean(values)
            ax.errorbar(middle.value, c, xerr=np.nan_to_num(middle.std), color=style.BLACK,
                        marker="|", markersize=8, capsize=2)  # fmt: skip
        if axis < 3:
            ax.axvline(one.setup.controller.thresholds[axis], color=style.RED, linewidth=0.8)
        controlled.linear_then_log(ax, "x", _LINEAR[axis // 3])
        ax.set_xlabel(_FORCES[axis] + ("" if axis > 2 else "; limit in red"))
        ax.grid(axis="y", visible=False)
    for row in grid:
        row[0].set_xlim(left=0.0)
    grid[0, 0].set_yticks(range(len(names)), names)
    grid[0, 0].set_ylim(len(names) - 0.4, -0.6)
    return fig
