"""Where the paper's self-calibration is below the tracker, and where not (Table 2, as a map).

Standard deviations of Eq. 24, of maximum likelihood and of the tracker over postures × squeeze ×
noise × sources: the paper's own two, positioners and sensors' noise, and those of the rig file.
"""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import dataclass
from functools import partial
from itertools import product

import numpy as np
from matplotlib.colors import TwoSlopeNorm
from matplotlib.figure import Figure

from studies import campaigns
from studies.campaigns import METHODS, Setting
from studies.frame import Cell, Study, Table
from studies.statistics import Estimate, deviation, jackknife
from tdfscal.records import FloatArray, Rig
from tdfscal.reporting.figures.style import figure
from tdfscal.reporting.layout import Drawing
from tdfscal.simulation import SurveyOptions

POSTURES, SQUEEZES, NOISES = (12, 24, 100), (0.0, 200.0, 1000.0), (0.1, 0.3, 1.0)
SOURCES = ("paper", "rig")
#: Of the campaigns of Eq. 24, this share is solved by maximum likelihood too.
_SHARE = 4
PAPER = -30.1


@dataclass(frozen=True, slots=True)
class Against:
    """σ of a method over the tracker's, less 1, in per cent: mean of all angles; roll and pitch."""

    every: Estimate
    leaning: Estimate


Place = tuple[int, float, int, float, str]


def against(own: FloatArray, tracker: FloatArray) -> Against:
    """Of errors (N, n, 3), rad, that do not depend on each other."""
    (own,), (tracker,) = campaigns.found_by_all(own), campaigns.found_by_all(tracker)
    if len(own) < 3:
        return Against(Estimate(np.nan), Estimate(np.nan))
    parts = []
    for angles in (slice(0, 3), slice(0, 2)):
        a, b = (jackknife(deviation, error[..., angles]) for error in (own, tracker))
        share = a.value / b.value
        spread = share * np.hypot(a.std / a.value, b.std / b.value)
        parts.append(Estimate(100.0 * (share - 1.0), 100.0 * float(spread)))
    return Against(*parts)


def run(
    rig: Rig,
    survey: SurveyOptions,
    runs: int,
    seed: int,
    progress: Callable[[str], None] = lambda text: None,
) -> Study:
    """Fill the map; a tracker's survey depends on neither postures, squeeze nor noise."""
    rigs = (campaigns.papers_sources(rig), rig)
    seeds = np.random.SeedSequence(seed).spawn(3)
    found: dict[Place, Against] = {}
    for s, one in enumerate(rigs):
        progress(f"{SOURCES[s]}: surveys")
        quiet = Setting(3 * rig.n, 0.0, 0.1)
        tracker = campaigns.errors(one, quiet, ("tracker",), 2 * runs, seeds[0], survey)
        for noise, count, squeeze in product(NOISES, POSTURES, SQUEEZES):
            progress(f"{SOURCES[s]}: {noise:g} N, {count} postures, {squeeze:g} N")
            setting = Setting(count, squeeze, noise)
            for method, size, of in (("linear", runs, 1), ("ml", max(6, runs // _SHARE), 2)):
                fresh = np.random.SeedSequence(seeds[of].entropy, spawn_key=seeds[of].spawn_key)
                error = campaigns.errors(
                    one, setting, (method,), size, fresh, workers=1 if method == "linear" else None
                )[method]
                found[s, noise, count, squeeze, method] = against(error, tracker["tracker"])
    return Study(
        "table2",
        f"Table 2 as a map: {rig.name}",
        f"σ over the tracker's, less 1, in per cent; {runs} campaigns of each case by Eq. 24, "
        f"{max(6, runs // _SHARE)} by maximum likelihood, {2 * runs} surveys from "
        f"{survey.distance:g} m; the paper is {-PAPER:g} % below and names neither postures nor "
        "squeeze nor noise",
        (_table("linear", found), _table("ml", found)),
        notes=tuple(_counted(s, method, found) for method in ("linear", "ml") for s in (0, 1)),
        drawings=(
            Drawing("table2", "Eq. 24 against the tracker",
                    _counted(0, "linear", found), partial(_paint, found)),
        ),
    )  # fmt: skip


def _table(method: str, found: dict[Place, Against]) -> Table:
    head = ["sources", "noise, N", "postures"]
    head += [f"all, {q:g} N" for q in SQUEEZES] + [f"roll and pitch, {q:g} N" for q in SQUEEZES]
    rows: list[tuple[Cell, ...]] = []
    for s, noise, count in product(range(2), NOISES, POSTURES):
        cells = [found[s, noise, count, squeeze, method] for squeeze in SQUEEZES]
        rows.append((SOURCES[s], f"{noise:g}", f"{count}", *(c.every for c in cells),
                     *(c.leaning for c in cells)))  # fmt: skip
    caption = f"{METHODS[method]}: σ over the tracker's, less 1, %"
    return Table(f"map-{method}", caption, tuple(head), tuple(rows), left=3)


def _counted(s: int, method: str, found: dict[Place, Against]) -> str:
    """How many cells lie below the tracker by more than two standard errors, in a sentence."""
    own = [a for place, a in found.items() if (place[0], place[-1]) == (s, method)]
    parts = []
    for name, estimates in (
        ("all angles together", [a.every for a in own]),
        ("roll and pitch", [a.leaning for a in own]),
    ):
        known = [e for e in estimates if np.isfinite(e.value)]
        below = sum(e.value < -2.0 * e.std for e in known)
        ordered = sorted(known, key=lambda estimate: estimate.value)
        span = f" ({ordered[0]} to {ordered[-1]} %)" if ordered else ""
        parts.append(f"{name} in {below} of {len(known)} cases{span}")
    return (
        f"{METHODS[method]}, sources of the {SOURCES[s]}, is below the tracker: {'; '.join(parts)}."
    )


def _paint(found: dict[Place, Against]) -> Figure:
    """Of Eq. 24, all angles: a panel for each noise and sources."""
    fig = figure(4.6)
    grid = fig.subplots(2, len(NOISES), sharex=True, sharey=True, squeeze=False)
    norm, shown = TwoSlopeNorm(0.0, -1.0, 4.0), None
    for (s, sources), (k, noise) in product(enumerate(SOURCES), enumerate(NOISES)):
        ax = grid[s, k]
        value = np.array([
            [found[s, noise, count, q, "linear"].every.value for q in SQUEEZES]
            for count in POSTURES
        ])  # fmt: skip
        doubled = np.log2(1.0 + value / 100.0)
        shown = ax.imshow(doubled, cmap="PuOr_r", norm=norm, aspect="auto", origin="lower")
        for (i, j), v in np.ndenumerate(value):
            dark = doubled[i, j] > 2.5 or doubled[i, j] < -0.7
            said = f"{v:+.0f} %" if np.isfinite(v) else "–"
            ax.text(j, i, said.replace("-", "−"), ha="center", va="center", fontsize=8,
                    color="white" if dark else "black")  # fmt: skip
        ax.set_title(f"sources: {sources}; {noise:g} N", fontsize=8.5)
        ax.set_xticks(range(len(SQUEEZES)), [f"{q:g}" for q in SQUEEZES])
        ax.set_yticks(range(len(POSTURES)), [str(c) for c in POSTURES])
        ax.grid(visible=False)
        if s:
            ax.set_xlabel("squeeze, N")
        if not k:
            ax.set_ylabel("postures")
    assert shown is not None
    bar = fig.colorbar(shown, ax=grid, ticks=[-1, 0, 1, 2, 3, 4], extend="both")
    bar.set_ticklabels(["½", "1", "2", "4", "8", "16"])
    bar.set_label("σ of Eq. 24 over the tracker's")
    return fig
