"""Why Eq. 24 errs as it does: every cause is one that was taken away (theory, section 17).

Rows: a source of uncertainty that the rig does not have. Columns: 27 entries or the angles
themselves, with and without the force equations, maximum likelihood, the tracker.
"""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import replace

import numpy as np

from studies import campaigns
from studies.campaigns import METHODS, SOURCES, Setting
from studies.frame import Cell, Study, Table
from studies.statistics import SAME, Estimate, jackknife, root_mean_square
from tdfscal.records import FloatArray, Rig
from tdfscal.simulation import Options, SurveyOptions

ARMS = ("linear", "linear-forces", "angles", "angles-forces", "ml", "tracker")
WHOLE, PAPERS = "nothing", "all but the paper's two"
SQUEEZED = "positioners, their squeeze kept"
#: N, of a posture's mean force, of sensors that are as good as free of noise.
_SILENT = 1e-3


def run(
    rig: Rig,
    survey: SurveyOptions,
    runs: int,
    seed: int,
    progress: Callable[[str], None] = lambda text: None,
) -> Study:
    """The usual campaign, calibrated by every estimator, with one source after the other gone."""
    setting = campaigns.usual(rig)
    cases: dict[str, tuple[Rig, Setting]] = {WHOLE: (rig, setting)}
    for source in campaigns.stated(rig):
        quiet = replace(setting, noise=_SILENT) if source == "sensor noise" else setting
        cases[source] = campaigns.without(rig, source), quiet
    # What the positioners' errors do besides: they squeeze.
    pushed = rig.declared.positioner * float(Options().stiffness)
    if pushed:
        harder = replace(setting, squeeze=float(np.hypot(setting.squeeze, pushed)))
        cases[SQUEEZED] = campaigns.without(rig, "positioners"), harder
    cases[PAPERS] = campaigns.papers_sources(rig), setting
    found: dict[str, dict[str, FloatArray]] = {}
    for name, (one, how) in cases.items():
        progress(f"without {name}")
        # The same draws in every case: what differs is what was taken away.
        fresh = np.random.SeedSequence(seed)
        # Of all sources a survey has but the positioners', which `table2` has too.
        arms = ARMS if name == WHOLE else ARMS[:-1]
        found[name] = campaigns.errors(one, how, arms, runs, fresh, survey)
    nothing = np.full((runs, rig.n, 3), np.nan)
    rms = {
        name: {arm: _rms(case.get(arm, nothing)) for arm in ARMS} for name, case in found.items()
    }
    head = ("without", *(METHODS[arm] for arm in ARMS))
    rows: list[tuple[Cell, ...]] = [(name, *map(case.get, ARMS)) for name, case in rms.items()]
    caption = "Rms error of an angle, mrad; angles: instead of 27 entries; F: with force equations"
    return Study(
        "causes",
        f"Why Eq. 24 errs: {rig.name}",
        f"{runs} campaigns of {setting.postures} postures, {setting.squeeze:g} N of squeeze, the "
        "same draws in every row",
        (Table("causes", caption, head, tuple(rows)),),
        notes=(*_of_source(rms), *_of_estimator(found)),
    )  # fmt: skip


def _rms(error: FloatArray) -> Estimate:
    (own,) = campaigns.found_by_all(error)
    return jackknife(root_mean_square, 1e3 * own) if len(own) > 1 else Estimate(np.nan)


def _factor(before: FloatArray, after: FloatArray) -> Estimate:
    a, b = campaigns.found_by_all(before, after)
    return jackknife(lambda x, y: root_mean_square(x) / root_mean_square(y), a, b)


def _of_source(rms: dict[str, dict[str, Estimate]]) -> list[str]:
    """Of each estimator the source whose loss lowers its error most."""
    said = []
    for arm in ("linear", "linear-forces", "angles", "ml"):
        single = {name: case[arm] for name, case in rms.items() if name in SOURCES}
        if not single:
            continue
        name = min(single, key=lambda source: single[source].value)
        before = rms[WHOLE][arm]
        after, words = single[name], "no single source lowers the error beyond the spread"
        if after.value < before.value - SAME * np.hypot(after.std, before.std):
            words = f"of single sources, taking {name} away lowers the error most, from "
            words += f"{before} to {after} mrad"
        said.append(f"{METHODS[arm]}: {words}.")
    return said


def _of_estimator(found: dict[str, dict[str, FloatArray]]) -> list[str]:
    """What force equations, and angles instead of entries, do to Eq. 24, under both sources."""
    said = []
    for case, name in ((WHOLE, "the rig file's sources"), (PAPERS, "the paper's two sources")):
        changes, entries = [], 3 * found[case]["linear"][0].size
        for arm, change in (
            ("linear-forces", "force equations"),
            ("angles", f"angles instead of {entries} entries"),
            ("angles-forces", "both"),
        ):
            by = _factor(found[case]["linear"], found[case][arm])
            if abs(by.value - 1.0) <= SAME * by.std:
                changes.append(f"{change}: no change beyond the spread (÷ {by})")
            elif by.value > 1.0:
                changes.append(f"{change}: ÷ {by}")
            else:
                changes.append(f"{change}: × {_factor(found[case][arm], found[case]['linear'])}")
        said.append(f"With {name}, the error of Eq. 24 changes by {'; '.join(changes)}.")
    return said
