"""Free space and docking in words, tables and plain rows, beside the paper's figures."""

from __future__ import annotations

import numpy as np

from tdfscal.records import BoolArray, FloatArray
from tdfscal.reporting.controldata import DOCKING_NOTE, FREE_SPACE_NOTE, Study, outcomes, pairs
from tdfscal.reporting.layout import Block, Facts, Items, Report, Section, Table
from tdfscal.reporting.paper import Item, docking_items, free_space_items, sentence
from tdfscal.studies import docking, free_space
from tdfscal.studies.compared_calibrations import KNOWS, LIKE, Arms
from tdfscal.studies.docking import DockingStudy
from tdfscal.studies.free_space import FreeSpaceStudy
from tdfscal.studies.ratios import Ratio, Share


def _said(ratio: Ratio) -> str:
    if np.isnan(ratio.value):
        return "–"
    std = "" if np.isnan(ratio.std) else f" ± {ratio.std:.2g}"
    return f"{ratio.value:.3g}{std}"


def mean_se(values: FloatArray, runs: int) -> str:
    """Mean ± standard error of runs, and of how many where some did not come so far."""
    if values.size == 0:
        return f"– (0 of {runs})"
    std = f" ± {np.std(values, ddof=1) / np.sqrt(values.size):.2g}" if values.size > 1 else ""
    lost = f" ({values.size} of {runs})" if values.size < runs else ""
    return f"{values.mean():.3g}{std}{lost}"


def share_said(share: Share) -> str:
    """Share of runs with its interval, in per cent."""
    return f"{100 * share.value:.0f} ({100 * share.low:.0f}–{100 * share.high:.0f})"


def _paper_ratio(paper: dict[str, tuple[float, float]], of: str, to: str, quantity: int) -> str:
    if of not in paper or to not in paper:
        return ""
    return f"{paper[of][quantity] / paper[to][quantity]:.3g}"


def free_space_report(study: FreeSpaceStudy) -> Report:
    """Lay out the deviations, their ratios, what of the paper they reproduce, and why."""
    rows = []
    for c, arm in enumerate(study.arms.arms):
        paper = free_space.PAPER.get(arm.name)
        row = [arm.name, f"{1e3 * arm.angle_error:.3g}"]
        for quantity in (0, 1):
            values = 1e3 * study.length[c, ..., quantity].mean(axis=0)
            row += [mean_se(values, study.arms.runs), f"{paper[quantity]:.3f}" if paper else ""]
        rows.append(tuple(row))
    header = ("", "rms angle error, mrad", "position, mm", "paper", "posture, mrad", "paper")
    caption = "Deviation of the final pose, mean over moves and runs ± standard error"
    blocks = (
        Table(caption, header, tuple(rows)),
        _ratio_table("Ratios of the means ± standard error", ("position", "posture"), study,
                     free_space.PAPER),
        _knows(study.arms),
        *_against_paper(study.arms, free_space_items(study)),
        FREE_SPACE_NOTE,
    )  # fmt: skip
    return Report(
        title=f"Free space: {study.setup.rig.name}",
        subtitle=f"{len(study.setup.moves)} moves in free space, {study.arms.runs} runs; "
        f"{_machine(study)}; {study.arms.origin}",
        sections=(Section("Free space", blocks),),
    )


def _against_paper(arms: Arms, items: list[Item]) -> tuple[Block, ...]:
    """What of the paper is reproduced; nothing where given calibrations are at work."""
    if not set(LIKE) <= set(arms.names):
        return ()
    return (Items("Beside the paper", tuple(sentence(item) for item in items if item.like)),)


def _knows(arms: Arms) -> Block:
    """What each controller knows, and which calibrations gave no result."""
    rows = []
    for arm in arms.arms:
        text = KNOWS.get(arm.name, "a given calibration: all that it states")
        if arm.failed:
            text += f"; no result in {arm.failed} of {arms.runs} runs, which keep the nominal ones"
        rows.append((arm.name, text))
    return Facts(tuple(rows))


def _ratio_table(
    caption: str,
    names: tuple[str, str],
    study: Study,
    paper: dict[str, tuple[float, float]],
    **which: bool,
) -> Table:
    rows = []
    for of, to in pairs(study.names):
        row = [f"{of} / {to}"]
        for quantity in (0, 1):
            found = study.ratio(quantity, of, to, **which)
            row += [_said(found), _paper_ratio(paper, of, to, quantity)]
        rows.append(tuple(row))
    return Table(caption, ("", names[0], "paper", names[1], "paper"), tuple(rows))


def _machine(study: Study) -> str:
    """The controller in a few words."""
    c = study.setup.controller
    said = (
        f"virtual mass {c.impedance.mass[0]:g} kg, damping {c.impedance.damping[0]:.3g} N·s/m, "
        f"stiffness {c.impedance.stiffness[0]:g} N/m, servos {c.servo.bandwidth:g} Hz"
    )
    if c.sensing.gain < 1.0:
        said += f", a filter that is {1e3 * c.sensing.delay:.2g} ms late"
    return said


def docking_report(study: DockingStudy) -> Report:
    """Lay out the maxima, outcomes, ratios, what of the paper they reproduce, and why."""
    setup = study.setup
    limits = ", ".join(f"{v:g}" for v in setup.controller.thresholds)
    blocks: tuple[Block, ...] = (
        _maxima("true", study, study.average, study.touched, {}),
        _maxima("seen", study, study.average_seen, study.touched, docking.PAPER),
        Table(
            f"Outcome: runs, and success without a force above its limit ({limits} N) in % with "
            "its 95 % interval",
            ("", "seated", "jammed", "false contact", "not finished", "success, %"),
            tuple(
                (arm.name, *map(str, outcomes(study, c)), share_said(study.success(c)))
                for c, arm in enumerate(study.arms.arms)
            ),
        ),
        *(
            _ratio_table(f"Ratios of the means ± standard error, {name}, runs in which both made "
                         "contact", ("force", "torque"), study, paper, **which)
            for name, paper, which in (
                ("true", {}, {}), ("seen", docking.PAPER, {"seen": True})
            )
        ),
        _knows(study.arms),
        *_against_paper(study.arms, docking_items(study)),
        DOCKING_NOTE,
    )  # fmt: skip
    return Report(
        title=f"Docking: {setup.rig.name}",
        subtitle=f"{1e3 * setup.speed:g} mm/s over {1e3 * setup.gap:g} mm of free space and "
        f"{1e3 * setup.gears.length:.3g} mm of engagement, contact "
        f"{1e-6 * setup.gears.stiffness:.2g} N/µm, {study.arms.runs} runs; "
        f"{_machine(study)}; {study.arms.origin}",
        sections=(Section("Docking", blocks),),
    )


def _maxima(
    name: str,
    study: DockingStudy,
    average: FloatArray,
    counted: BoolArray,
    published: dict[str, tuple[float, float]],
) -> Table:
    """Mean and standard error of the maxima (C, R, 2) of the runs that count (C, R)."""
    rows = []
    for c, arm in enumerate(study.arms.arms):
        paper = published.get(arm.name)
        row = [arm.name, f"{1e3 * arm.angle_error:.3g}"]
        for quantity in (0, 1):
            row.append(mean_se(average[c, counted[c], quantity], study.arms.runs))
            if published:
                row.append(f"{paper[quantity]:.2f}" if paper else "")
        rows.append(tuple(row))
    caption = f"Maxima, {name}, mean of x, y and z: mean over runs ± standard error"
    header = ["", "rms angle error, mrad", "force, N", "torque, N·m"]
    if published:
        header = [*header[:3], "paper", header[3], "paper"]
    return Table(caption, tuple(header), tuple(rows))
