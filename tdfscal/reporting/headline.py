"""What a calibration says first: one number for all, what it does not count, what it rests on."""

from __future__ import annotations

from collections.abc import Sequence

import numpy as np

from tdfscal.catalogue.entry import upwards
from tdfscal.estimation.uncertainty import EARLIER
from tdfscal.files.calibration.consistency import UNCONFIRMED
from tdfscal.files.calibration.document import Calibration
from tdfscal.files.calibration.evidence import LeftOutStretch
from tdfscal.files.calibration.parts import RejectedPosture
from tdfscal.records import FloatArray
from tdfscal.reporting.assumptions import assumption_sentences
from tdfscal.reporting.traceability import expired_sentence, not_whole_sentence

#: Postures named at most.
_NAMED = 8
_LEFT_OUT = {
    "stretch-frozen": "a frozen channel",
    "stretch-standing": "a frozen position",
    "stretch-over-capacity": "a sensor at its capacity",
}
#: Why a sensor itself spoils a posture, and does not show that something touched.
SPOILT = {
    **dict.fromkeys(("posture-over-capacity", "posture-saturated"), "a saturated axis"),
    "posture-frozen": "a frozen axis",
}
#: Sources of the budget in words, and what would lower them.
SOURCES = {
    "noise": ("noise", "more postures, or a harder squeeze if the sensors bear it,"),
    "zero": ("the zeros", "a tare just before the campaign"),
    "positioner": ("the repeatability of the NCPs", "a harder squeeze"),
    "mass": ("the mass", "weighing the terminal"),
    "barycentre": ("the barycentre", "more tilt, or a better known barycentre,"),
    "hinge": ("the places of the hinges", "measuring the hinge centres"),
    "datum": ("the servo datums", "measuring the servo datums"),
    "gravity": ("the level of the base", "levelling the BCS"),
    "sensitivity": ("the gain of the sensors", "calibrated gains"),
    "instrument angles": ("the angles of the tracker", "a tracker nearer to the rig"),
    "instrument range": ("the range of the tracker", ""),
    "noise spectrum": ("the spectrum of the noise", "a longer motion"),
    EARLIER: ("the calibration that was updated", ""),
    "walk": ("the walk of the angles", "calibrating more often"),
    "undeclared error": (
        "an undeclared error that the residuals suspect",
        "declaring or mending what the residuals suspect",
    ),
    "motion": (
        "what the motion adds",
        "a slower motion, or an inertia, a friction and a delay that are stated,",
    ),
}


def half_widths(c: Calibration) -> FloatArray:
    """Return half (m, 3) of each mounted sensor's 95 % intervals, rad, by the farther end.

    Where roll and yaw are not separable: the expanded uncertainty of the turns.
    """
    return np.array([mounting.half_widths for mounting in c.mounted])


def within(c: Calibration) -> str:
    """What holds for all angles, each by itself, mrad: never less than any of them."""
    return f"± {upwards(1e3 * half_widths(c).max(), 2)} mrad"


def headline(c: Calibration) -> str:
    """One number for all angles, what it counts, what it does not, and what it rests on."""
    which = "each" if c.determined.all() else "each that is determined"
    said = f"{which} is known to within {within(c)} (95 %)"
    if c.rig.uncertainty.force_sensitivity > 0 and c.method != "tracker":
        said += ", the gain's tolerance included"
    first = f"You may load these angles: {said}."
    if draft := draft_lines(c):
        first = (
            f"Confirm {len(draft)} lines of the drafted rig file before you load these angles. If "
            f"the lines are right, {said}."
        )
    assumed = assumption_sentences(c, half_widths(c).max())
    sentences = (first, assumed, expired_sentence(c), not_whole_sentence(c), _rests_on(c))
    return " ".join(filter(None, sentences))


def draft_lines(c: Calibration) -> list[str]:
    """Return lines of a draft that are still to be confirmed, the terminal's first."""
    lines = [line for finding in c.found(UNCONFIRMED) for line in finding.subject]
    return sorted(lines, key=lambda line: not line.startswith("terminal."))


def _rests_on(c: Calibration) -> str:
    """How much went in, how it fits, and what limits the least known angle, in sentences."""
    parts = []
    if c.motion is not None:
        parts.append(f"{c.motion.seconds:.0f} s of motion{_without(c.motion.rejected)}")
    if c.fit is not None and (c.motion is None or c.fit.postures):
        parts.append(f"{c.fit.postures} postures{_besides(c.fit.rejected)}")
    contact = bool(parts)
    if c.tracker is not None:
        alone = " alone, since the log of the rig file is missing" if c.found("log-missing") else ""
        parts.append(f"{c.tracker.points} points of the tracker{alone}")
    parts += [f"{k.recorder}'s clock to ± {upwards(1e3 * k.offset_std, 2)} ms" for k in c.clocks]
    said = f"Used: {', '.join(parts)}"
    if c.fit is not None and c.fit.dof:
        said += f"; residuals {c.fit.birge:.2f} times as large as stated"
    if contact:  # zeros or load take it
        said += " (a constant contact would not show)"
    if c.budget is None or len(c.budget.sources) < 2:
        return f"{said}."
    worst = int(np.argmax(c.rpy_std[c.determined].ravel()))
    share, angle = c.budget.shares[worst], c.budget.angles[worst]
    name = c.budget.sources[int(share.argmax())]
    if name == EARLIER and not c.history:  # given at once: of no campaign in particular
        return f"{said}."
    source, _ = source_words(name)
    of = f"{share.max():.0%} of the variance of {angle.support}'s {angle.angle}"
    return f"{said}. The largest part of the uncertainty is from {source} ({of})."


def _without(rejected: Sequence[LeftOutStretch]) -> str:
    """How much of a motion was left out, and why, in brackets."""
    by: dict[str, float] = {}
    for r in rejected:
        why = _LEFT_OUT.get(r.code or "", "contact")
        by[why] = by.get(why, 0.0) + r.end - r.begin
    said = "; ".join(f"{seconds:.1f} s left out: {why}" for why, seconds in by.items())
    return f" ({said})" if said else ""


def _besides(rejected: Sequence[RejectedPosture]) -> str:
    """Numbers of the postures left out, and why, in brackets."""
    by: dict[str, list[RejectedPosture]] = {}
    for r in rejected:
        by.setdefault(SPOILT.get(r.code or "", "contact or a jolt"), []).append(r)
    said = "; ".join(f"{numbers(some)} left out: {why}" for why, some in by.items())
    return f" ({said})" if said else ""


def numbers(rejected: Sequence[RejectedPosture]) -> str:
    """Return numbers of postures, the first of many, by which to find them in the log."""
    more = ", …" if len(rejected) > _NAMED else ""
    return ", ".join(str(r.index + 1) for r in rejected[:_NAMED]) + more


def source_words(name: str) -> tuple[str, str]:
    """Return what a source of the budget is called, and what would lower it."""
    return SOURCES.get(name, (name, ""))
