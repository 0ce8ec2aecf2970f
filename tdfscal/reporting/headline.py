"""What a calibration is good for: one number for all angles, what it counts and what not."""

from __future__ import annotations

import math
import re
from collections.abc import Callable, Iterator, Sequence
from pathlib import PurePath
from typing import TypeVar

import numpy as np

from tdfscal.catalogue.entry import begun
from tdfscal.catalogue.numbers import count, measured, quantity, spans, two_digits
from tdfscal.estimation.exact_quantities import UNMOVED
from tdfscal.estimation.uncertainty import EARLIER
from tdfscal.files.calibration.document import Calibration
from tdfscal.files.calibration.evidence import ExactQuantityResult, LeftOutStretch
from tdfscal.files.calibration.parameters import UNCONFIRMED
from tdfscal.files.calibration.parts import FindingResult, RejectedPosture
from tdfscal.numerics.distributions import INTERVAL_FACTOR
from tdfscal.numerics.streams import covered
from tdfscal.records import FloatArray
from tdfscal.reporting.layout import Block, Facts, Table

#: Postures, and quantities taken as exact, named at most; the share of the half width from which on
#: these are.
_POSTURES, _QUANTITIES, _NOTABLE = 8, 2, 0.1
#: Why a sensor itself spoils a posture, and does not show that something touched.
SPOILT = {
    **dict.fromkeys(("posture-over-capacity", "posture-saturated"), "a saturated axis"),
    "posture-frozen": "a frozen axis",
}
_LEFT_OUT = SPOILT | {
    "stretch-frozen": "a frozen channel",
    "stretch-standing": "a frozen position",
    "stretch-over-capacity": "a sensor at its capacity",
    "stretch-touched": "contact",
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
    "instrument angles": ("the tracker's angles", "a tracker nearer to the rig"),
    "instrument range": ("the tracker's range", ""),
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
#: What may be taken as exact, and the key of the rig file that states how well it is known.
STATED_BY = {
    "hinge drawing": "uncertainty.hinge",
    "servo datums": "uncertainty.datum",
    "gain, crosstalk": "uncertainty.force_sensitivity",
    "base level": "gravity.tilt_std",
    "mass": "terminal.mass.std",
    "barycentre": "terminal.barycenter.std",
    "zeros": "zero.std",
    "delay": "log.delay.std",
    "body against axes": "tracker.misalignment",
    "target drawing": "tracker.drawing",
    UNMOVED: "drift.angle",
    "repeatability of the NCPs": "uncertainty.positioner",
    "friction of the hinges": "uncertainty.hinge_moment",
    "compliance": "uncertainty.compliance",
    "drift of the zeros": "drift.time",
}
_Part = TypeVar("_Part", RejectedPosture, LeftOutStretch)
_CAPTION = "What a typical error of each quantity taken as exact would do to roll/pitch/yaw, mrad"


def within(c: Calibration) -> str:
    """What holds for all angles, each by itself, mrad; rounded as the tables are."""
    return _bounds(c.half_widths)


def _bounds(half: FloatArray) -> str:
    return f"± {two_digits(1e3 * float(half.max()))} mrad"


def headline(c: Calibration) -> str:
    """One number for all angles, what it counts, what it does not, and what it rests on.

    Before it, cables that may be exchanged, and sensors far from where the rig file has them.
    """
    traced = (
        f"Do not load these angles before the cables of {' and '.join(found.subject)} are traced."
        for found in c.found("fields-crossed")
    )
    turned = (begun(f"{found.text}: {found.cure}", ".") for found in c.found("sensor-turned"))
    return " ".join((*traced, *turned, _of_the_angles(c)))


def _of_the_angles(c: Calibration) -> str:
    said = f"each {'' if c.determined.all() else 'that is determined '}is known to within "
    said += f"{within(c)} (95 %)"
    if c.rig.uncertainty.force_sensitivity > 0 and c.method != "tracker":
        said += ", the gain's tolerance included"
    beside = (_not_whole(c), _rests_on(c))
    if lines := draft_lines(c):
        places = sorted({int(n) for line in lines for n in re.findall(r"\(line (\d+)\)$", line)})
        where = f" (lines {spans(places)})" if places else ""
        first = (
            f"Do not load these angles yet: they rest on {count(len(lines), 'unconfirmed line')} "
            f"of the drafted rig file{where}. If these are right, {said}."
        )
        return " ".join(filter(None, (first, _not_counted(c), *beside)))
    sealed = ", if nobody edited this file (it does not tell)" if c.unsealed else ""
    first = f"You may load these angles{sealed}: {said}."
    if c.found("fields-crossed"):
        first = f"If nothing is exchanged{sealed}, {said}."
    return " ".join(filter(None, (first, _not_counted(c), *_trusted(c), *beside, _limited_by(c))))


def _not_whole(c: Calibration) -> str:
    """What there is of a log of which a part is missing."""
    parts = [
        ("the first rows" if f.size is None else f"{f.size:.1f} s")
        + f" of {', '.join(PurePath(name).name for name in f.subject)}"
        for f in not_whole(c)
    ]
    return f"The log is not whole; what is there was used: {', '.join(parts)}." if parts else ""


def draft_lines(c: Calibration) -> list[str]:
    """Return lines of a draft that are still to be confirmed, each as `key: value (line N)`."""
    return [line for finding in c.found(UNCONFIRMED) for line in finding.subject]


def _not_counted(c: Calibration) -> str:
    """What is taken as exact, with what a typical error of it does, and what all make of ±."""
    if not (each := uncounted(c)[:_QUANTITIES]):
        return ""
    half = [(1.0 if q.name == UNMOVED else INTERVAL_FACTOR, q.effect) for q in c.taken_as_exact]
    together = np.sum([np.square(factor * np.array(effect)) for factor, effect in half], axis=0)
    said, counted = list[str](), _bounds(np.sqrt(np.square(c.half_widths) + together))
    for q in each:
        off = ":" if said else " off moves an angle by"
        move = measured(1e3 * np.max(q.effect))
        said.append(f"{exact_name(c, q.name)} ({_typical_error(q)}{off} {move} mrad)")
    said += [f"{len(uncounted(c)) - len(each)} more"] * (len(uncounted(c)) > len(each))
    first = f"Taken as exact, not counted: {', '.join(said)}"
    if counted != within(c):
        first += f"; if so, reckon with {counted}"
    others = len(without_effect(c))
    return f"{first}. {others} more are of unknown effect." if others else f"{first}."


def _trusted(c: Calibration) -> Iterator[str]:
    """What an error of typical size does of what is stated to be better, as a tare that is none.

    Linear, and so by the budget: errors of all components of a group add in squares.
    """
    if c.budget is None or c.method == "tracker":
        return
    terminal = c.rig.terminal
    for source, name, error, unit, std in (
        ("zero", "tare", 1.0, "N", [std for s in c.rig.supports for std in s.zero.std]),
        ("barycentre", "barycentre", 1e-3, "m", list(terminal.barycenter.std)),
        ("mass", "mass", 1e-3 * terminal.mass.value, "kg", [terminal.mass.std]),
    ):
        if not 0 < min(std) == max(std) < error:
            continue
        variance = max((angle.variance.get(source, 0.0) for angle in c.budget.angles), default=0.0)
        move = math.sqrt(variance) * error / std[0]
        if move > _NOTABLE * c.half_widths.max():
            yield (
                f"The {name} counts as good to {quantity(std[0], unit)}: "
                f"{quantity(error, unit)} off would move an angle by {measured(1e3 * move)} mrad."
            )


def _by_effect(c: Calibration) -> list[ExactQuantityResult]:
    """Quantities taken as exact, the one whose typical error moves an angle most first."""
    return sorted(c.taken_as_exact, key=lambda q: -float(np.max(q.effect)))


def uncounted(c: Calibration) -> list[ExactQuantityResult]:
    """Return those of them whose typical errors are not small against the half widths."""
    return [q for q in _by_effect(c) if np.max(q.effect) > _NOTABLE * c.half_widths.max()]


def exact_blocks(c: Calibration) -> tuple[Block, ...]:
    """Effect of each quantity on roll, pitch, yaw of each sensor, mrad; which keys would state it.

    Those of unknown effect stand among the keys alone.
    """
    names = [mounting.name for mounting in c.mounted]
    rows = tuple(
        (
            f"{exact_name(c, quantity.name)}, {_typical_error(quantity)}",
            *("/".join(f"{1e3 * v:.2f}" for v in row) for row in quantity.effect),
        )
        for quantity in _by_effect(c)
    )
    unknown = ((name, ", of unknown effect") for name in without_effect(c))
    keys = tuple(
        (STATED_BY.get(name, ""), f"{exact_name(c, name)}{effect}")
        for name, effect in (*((q.name, "") for q in _by_effect(c)), *unknown)
    )
    effects = (Table(_CAPTION, ("", *names), rows),) if rows else ()
    return (*effects, Facts(keys)) if keys else ()


def exact_names(c: Calibration) -> str:
    """What has no uncertainty in the rig file, and so none in the result."""
    names = [exact_name(c, q.name) for q in c.taken_as_exact] + without_effect(c)
    if c.method != "tracker":
        names.append("no contact force constant in the BCS, which would pass for zeros or load")
        names.append("magnitude of gravity, which scales the mass and hardly turns an angle")
    if any(support.sensitivity is not None for support in c.supports):
        names.append("symmetry of gain and crosstalk: what is not symmetric counts as rotation")
    return "; ".join(names) or "nothing"


def parts(c: Calibration) -> str:
    """What a calibration pools: campaigns, or parts of one log."""
    files = [{file.sha256 for file in one.inputs} for one in c.campaigns]
    return "parts of the log" if files and set.intersection(*files) else "campaigns"


def exact_name(c: Calibration, name: str) -> str:
    """Words for what a calibration takes as exact."""
    return {
        "gain, crosstalk": "gain and crosstalk",
        "body against axes": "how a sensor's body lies to its axes",
        UNMOVED: f"no turn between {parts(c)}",
    }.get(name, name)


def without_effect(c: Calibration) -> list[str]:
    """Return what of this no typical error, and so no effect, is known of."""
    if c.method == "tracker":
        return []
    u, drift, known = c.rig.uncertainty, c.rig.drift, [q.name for q in c.taken_as_exact]
    known += ["friction of the hinges"] * (c.motion is not None)
    stated = {
        UNMOVED: drift.angle or len(c.campaigns) < 2,
        "repeatability of the NCPs": u.positioner,
        "friction of the hinges": u.hinge_moment,
        "compliance": u.compliance.lateral + u.compliance.vertical,
        "drift of the zeros": drift.time + drift.temperature + drift.walk,
    }
    return [name for name, std in stated.items() if not std and name not in known]


def _typical_error(of: ExactQuantityResult) -> str:
    """The error of each component, in a unit that reads well."""
    if of.unit in ("relative", "of it"):
        return f"{100 * of.error:g} %"
    return quantity(of.error, of.unit)


def _rests_on(c: Calibration) -> str:
    """How much went in, and how it fits."""
    parts = []
    contact = "" if c.method == "tracker" else " A contact constant in the BCS would not show."
    if c.motion is not None:
        few = (f", since {found.size:.0f} dwells are too few" for found in c.found("dwells-few"))
        without = _without(c.motion.rejected, lambda some: f"{covered(some):.1f} s")
        parts.append(f"{c.motion.seconds:.0f} s of motion{''.join(few)}{without}")
    if c.fit is not None and (c.motion is None or c.fit.postures):
        parts.append(f"{count(c.fit.postures, 'posture')}{_without(c.fit.rejected, numbers)}")
    if c.tracker is not None:
        alone = " alone, since the log of the rig file is missing" if c.found("log-missing") else ""
        parts.append(f"{c.tracker.points} points of the tracker{alone}")
    parts += [
        f"{k.recorder}'s clock to ± {two_digits(1e3 * INTERVAL_FACTOR * k.offset_std)} ms"
        for k in c.clocks
    ]
    if c.fit is not None and c.fit.dof:
        parts[-1] += f"; residuals {c.fit.birge:.2f} times as large as stated"
    return f"Used: {', '.join(parts)}.{contact}"


def _without(left_out: Sequence[_Part], told: Callable[[Sequence[_Part]], str]) -> str:
    """What was left out, by reasons, in brackets."""
    by: dict[str, list[_Part]] = {}
    for each in left_out:
        by.setdefault(_LEFT_OUT.get(each.code or "", "contact or a jolt"), []).append(each)
    said = "; ".join(f"{told(some)} left out: {why}" for why, some in by.items())
    return f" ({said})" if said else ""


def numbers(rejected: Sequence[RejectedPosture]) -> str:
    """Return postures by their numbers, the first of many, by which to find them in the log."""
    more = ", …" if len(rejected) > _POSTURES else ""
    listed = ", ".join(str(r.index + 1) for r in rejected[:_POSTURES])
    return f"posture{'s' * (len(rejected) > 1)} {listed}{more}"


def largest_source(c: Calibration, angle: int | None = None) -> tuple[str, float]:
    """What contributes most to the variance of an angle, or of all on average, and its share."""
    if c.budget is None or not c.budget.sources:
        return "noise", 0.0
    share = c.budget.shares.mean(axis=0) if angle is None else c.budget.shares[angle]
    return c.budget.sources[int(share.argmax())], float(share.max())


def _limited_by(c: Calibration) -> str:
    """The largest source of the least known angle's variance."""
    name, share = largest_source(c, int(np.argmax(c.rpy_std[c.determined].ravel())))
    if share in (0.0, 1.0) or (name == EARLIER and not c.history):  # no campaign in particular
        return ""
    said = SOURCES.get(name, (name, ""))[0]
    return f"Largest share of the worst angle: {said} ({share:.0%})."


def not_whole(c: Calibration) -> tuple[FindingResult, ...]:
    """What tells that a part of the log is missing: its files, or else recorders that ran apart."""
    return c.found("log-truncated") or c.found("recorders-overlap-in-part")
