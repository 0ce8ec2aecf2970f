"""How well each method finds the angles: Monte Carlo of campaigns (Figs. 7–9, 12–14, Table 3)."""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import dataclass
from functools import partial

import numpy as np
from matplotlib.axes import Axes
from matplotlib.figure import Figure

from studies import campaigns
from studies.campaigns import METHODS, Setting
from studies.frame import Beside, Cell, Study, Table
from studies.statistics import FALSE_BIAS, bias_probability, deviation, jackknife, mean
from tdfscal.errors import NotConvergedError
from tdfscal.records import ANGLES, FloatArray, Rig
from tdfscal.reporting.figures import style
from tdfscal.reporting.figures.style import figure, signed
from tdfscal.reporting.layout import Drawing
from tdfscal.simulation import SurveyOptions

ARMS = ("linear", "ml", "tracker")
_MOST_BINS = 30
_COLUMN = {"ml": "ML", "linear": "Eq. 24", "tracker": "tracker"}
_SHORT = {"ml": "self, ML", "linear": "self, Eq. 24", "tracker": "tracker"}


@dataclass(frozen=True, slots=True)
class Case:
    """Errors (N, n, 3), rad, of the runs with a result, by method, under some sources."""

    name: str
    sources: str
    setting: Setting
    error: dict[str, FloatArray]
    runs: int

    @property
    def said(self) -> str:
        """In words."""
        noise = "" if self.setting.noise is None else f", {self.setting.noise:g} N"
        return (
            f"{self.sources}; {self.setting.postures} postures, {self.setting.squeeze:g} N of "
            f"squeeze{noise}"
        )


def simulate(
    name: str,
    rig: Rig,
    setting: Setting,
    sources: str,
    survey: SurveyOptions,
    runs: int,
    seed: np.random.SeedSequence,
) -> Case:
    """Simulate campaigns and surveys and calibrate each by every method.

    Raises NotConvergedError where a method finds almost nothing.
    """
    found = campaigns.errors(rig, setting, ARMS, runs, seed, survey)
    kept = {}
    for method, error in found.items():
        (own,) = campaigns.found_by_all(error)
        if len(own) >= 2:
            kept[method] = own
        elif method != "linear" or setting.postures >= 3 * rig.n:
            raise NotConvergedError(
                f"{METHODS[method]} gives a result in {len(own)} of {runs} campaigns"
            )
    return Case(name, sources, setting, kept, runs)


def run(
    rig: Rig,
    survey: SurveyOptions,
    runs: int,
    seed: int,
    progress: Callable[[str], None] = lambda text: None,
) -> Study:
    """Both cases."""
    first, second = np.random.SeedSequence(seed).spawn(2)
    own = campaigns.papers_sources(rig)
    cases = []
    for name, one, setting, sources, own_seed in (
        ("paper", own, campaigns.LEADING, "the paper's two sources", first),
        ("rig", rig, campaigns.usual(rig), "all that the rig file states", second),
    ):
        progress(f"{runs} campaigns with {sources}")
        cases.append(simulate(name, one, setting, sources, survey, runs, own_seed))
    tables = [_table(rig, case) for case in cases]
    tables.append(Table(
        "bias", "Is the mean error zero? Student's t; chance, all tests together",
        ("case", "method", "runs", "largest |mean|/σ", "chance", "bias"),
        tuple(row for case in cases for row in _biases(case, sum(len(c.error) for c in cases))),
        left=2,
    ))  # fmt: skip
    tables.append(Table(
        "errors", "Every error, rad",
        ("case", "method", "run", *(f"{name} {a}" for name in rig.supports for a in ANGLES)),
        tuple(
            (case.name, method, k, *map(float, row))
            for case in cases for method, error in case.error.items()
            for k, row in enumerate(error.reshape(len(error), -1))
        ), left=2, shown=False,
    ))  # fmt: skip
    return Study(
        "accuracy",
        f"Accuracy of the methods: {rig.name}",
        f"{runs} campaigns each, every one a rig, postures and a survey of its own; tracker "
        f"{survey.distance:g} m away, {len(survey.targets)} targets per sensor",
        tuple(tables),
        beside=tuple(item for case in cases for item in _table_3(case)),
        chosen=(
            ("postures, squeeze, noise", "; ".join(f"{c.name}: {c.said}" for c in cases),
             "the study `table2` has other choices"),
        ),
        drawings=tuple(_figure(rig, case, i) for case in cases for i in range(rig.n)),
    )  # fmt: skip


def _table(rig: Rig, case: Case) -> Table:
    """Mean and standard deviation of every angle, as Table 2 has them."""
    head = ["sensor", "angle"]
    for method in case.error:
        head += [f"{_COLUMN[method]} mean", f"{_COLUMN[method]} σ"]
    rows = []
    for i, name in enumerate(rig.supports):
        for j, angle in enumerate(ANGLES):
            row: list[Cell] = [name, angle]
            for error in case.error.values():
                std = jackknife(lambda e: float(np.std(e, ddof=1)), 1e3 * error[:, i, j])
                row += [mean(1e3 * error[:, i, j]), std]
            rows.append(tuple(row))
    rows.append((
        "mean", "", *(cell for error in case.error.values()
                      for cell in (None, jackknife(deviation, 1e3 * error))),
    ))  # fmt: skip
    return Table(f"angles-{case.name}", f"Error, mrad; {case.said}", tuple(head), tuple(rows), 2)


def _biases(case: Case, tests: int) -> list[tuple[Cell, ...]]:
    """Each method's chance, Bonferroni over all tests of the study."""
    rows: list[tuple[Cell, ...]] = []
    for method, error in case.error.items():
        p = min(1.0, tests * bias_probability(error))
        size = float((np.abs(error.mean(axis=0)) / error.std(axis=0, ddof=1)).max())
        verdict = "shown" if p < FALSE_BIAS else "not shown"
        rows.append((case.name, _SHORT[method], len(error), size, p, verdict))
    return rows


def _table_3(case: Case) -> list[Beside]:
    """Self and tracker on one rig: largest difference of an angle; the paper's is one rig."""
    items = []
    for method in ("linear", "ml"):
        if {method, "tracker"} <= set(case.error) and len(case.error[method]) == case.runs:
            tracker = case.error["tracker"]
            count = min(len(tracker), case.runs)
            apart = 1e3 * np.abs(case.error[method][:count] - tracker[:count]).max(axis=(1, 2))
            what = f"|{_COLUMN[method]} − tracker|, {case.name}"
            items.append(Beside("Table 3", what, "mrad", 1.0, mean(apart), "<", apart))
    return items


def _figure(rig: Rig, case: Case, i: int) -> Drawing:
    name = rig.supports[i]
    return Drawing(
        f"errors-{case.name}-{i + 1}",
        f"Errors of the installation angles of {name}: {case.sources}",
        f"{case.runs} campaigns; {case.said}.",
        partial(_paint_errors, rig, case, i),
    )


def _paint_errors(rig: Rig, case: Case, i: int) -> Figure:
    fig = figure(0.5 + 1.9 * len(case.error))
    grid = fig.subplots(len(case.error), 3, sharex=True, squeeze=False)
    for row, (method, error) in enumerate(case.error.items()):
        for j in range(3):
            ax = grid[row, j]
            _histogram(ax, 1e3 * error[:, i, j])
            title = f"{rig.supports[i]}  {ANGLES[j]}: {_SHORT[method]}"
            ax.set_title(title, fontsize=8, pad=3)
            ax.set_xlabel("error, mrad", fontsize=7.5)
        grid[row, 0].set_ylabel("campaigns")
    return fig


def _histogram(ax: Axes, error: FloatArray) -> None:
    """Errors (N,), mrad, with their mean and deviation; 2 ∛N bins."""
    bins = min(_MOST_BINS, int(np.ceil(2 * np.cbrt(len(error)))))
    counts, edges = np.histogram(error, bins=bins)
    middle, std = float(error.mean()), float(error.std(ddof=1))
    ax.stairs(counts, edges, fill=True, color="#c6d6ea")
    ax.stairs(counts, edges, color=style.BLACK, linewidth=0.5)
    ax.axvline(0.0, color=style.BLACK, linewidth=0.8, linestyle="--")
    ax.set_ylim(0.0, 1.45 * float(counts.max()))
    said = f"mean {signed(middle, '+.2g')}\nσ {std:.3g}"
    ax.text(0.03, 0.96, said, transform=ax.transAxes, va="top", fontsize=7)
    ax.grid(visible=False)
    ax.tick_params(labelsize=7)
