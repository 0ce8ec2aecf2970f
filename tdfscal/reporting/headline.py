"""What a calibration says first: one number for all, what it does not count, what it rests on."""

from __future__ import annotations

from collections.abc import Sequence

import numpy as np

from tdfscal.catalogue.entry import upwards
from tdfscal.files.calibration.consistency import UNCONFIRMED
from tdfscal.files.calibration.document import Calibration
from tdfscal.files.calibration.parts import RejectedPosture
from tdfscal.records import FloatArray
from tdfscal.reporting.traceability import exact_sentence, expired_sentence, not_whole_sentence

#: Postures named at most.
_NAMED = 8
#: Why a sensor itself spoils a posture, and does not show that something touched.
SPOILT = {
    **dict.fromkeys(("posture-over-capacity", "posture-saturated"), "a saturated axis"),
    "posture-frozen": "a frozen axis",
}
#: Sources of the budget in words, and what would lower them.
_SOURCES = {
    "noise": ("noise", "more postures, or a harder squeeze if the sensors bear it,"),
    "zero": ("the zeros", "a tare just before the campaign"),
    "positioner": ("the NCPs' repeatability", "a harder squeeze"),
    "mass": ("the mass", "weighing the terminal"),
    "barycentre": ("the barycentre", "more tilt, or a better barycentre,"),
    "hinge": ("the hinges' places", "measuring the hinge centres"),
    "datum": ("the servo datums", "measuring the servo datums"),
    "gravity": ("the base's level", "levelling the BCS"),
    "sensitivity": ("the sensors' gain", "calibrated gains"),
    "instrument angles": ("the tracker's angles", "a tracker nearer to the rig"),
    "instrument range": ("the tracker's range", ""),
    "noise spectrum": ("the noise's spectrum", "a longer motion"),
    "undeclared error": ("undeclared error", "declaring or mending what the residuals suspect"),
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
    which = "each by itself" if c.determined.all() else "each that is determined, by itself,"
    said = f"{which} within {within(c)} (95 %)"
    if c.rig.uncertainty.force_sensitivity > 0 and c.method != "tracker":
        said += ", the gain's tolerance included"
    loaded = f"You may load these angles: {said}."
    if draft := draft_lines(c):
        loaded = (
            f"Confirm {len(draft)} lines of the rig file's draft before you load the angles. If "
            f"they are right, the angles are known, {said}."
        )
    exact = exact_sentence(c, half_widths(c).max())
    first = (loaded, exact, expired_sentence(c), not_whole_sentence(c), _rests_on(c))
    return " ".join(filter(None, first))


def draft_lines(c: Calibration) -> list[str]:
    """Return lines of a draft that are still to be confirmed, the terminal's first."""
    lines = [line for finding in c.found(UNCONFIRMED) for line in finding.subject]
    return sorted(lines, key=lambda line: not line.startswith("terminal."))


def _rests_on(c: Calibration) -> str:
    """How much went in, how it fits, and what limits the least known angle, in a sentence."""
    parts = []
    if c.motion is not None:
        parts.append(f"{c.motion.seconds:.0f} s of motion")
    if c.fit is not None and (c.motion is None or c.fit.postures):
        parts.append(f"{c.fit.postures} postures{_besides(c.fit.rejected)}")
    if parts:  # zeros or load take it
        parts[-1] += " free of contact (a constant one may hide)"
    if c.tracker is not None:
        alone = " alone, for the rig file's log is not there" if c.found("log-missing") else ""
        parts.append(f"{c.tracker.points} points of the tracker{alone}")
    if c.fit is not None and c.fit.dof:
        parts.append(f"scatter against stated {c.fit.birge:.2f}")
    parts += [f"{k.recorder}'s clock to ± {upwards(1e3 * k.offset_std, 2)} ms" for k in c.clocks]
    limit = ""
    if c.budget is not None and len(c.budget.sources) > 1:
        worst = int(np.argmax(c.rpy_std[c.determined].ravel()))
        share, angle = c.budget.shares[worst], c.budget.angles[worst]
        source, _ = source_words(c.budget.sources[int(share.argmax())])
        if not c.history:  # given at once, none before another
            source = source.replace("earlier campaigns", "the other campaigns")
        of = f"{share.max():.0%} of {angle.support}'s {angle.angle} variance"
        limit = f"; limited by {source} ({of})"
    return f"It rests on {', '.join(parts)}{limit}."


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
    return _SOURCES.get(name, (name, ""))
