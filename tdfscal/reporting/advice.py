"""What a calibration says first and last: one number for all, what it rests on, what next."""

from __future__ import annotations

import re
from collections.abc import Iterable, Iterator, Sequence
from math import ceil

import numpy as np

from tdfscal.catalogue import CATALOGUE
from tdfscal.catalogue.campaign import SUSPECTS
from tdfscal.catalogue.entry import upwards
from tdfscal.catalogue.in_use import MISFITS
from tdfscal.files.calibration.consistency import UNCONFIRMED
from tdfscal.files.calibration.document import Calibration
from tdfscal.files.calibration.parts import FindingResult, RejectedPosture
from tdfscal.records import ANGLES, FloatArray
from tdfscal.reporting.layout import begun
from tdfscal.reporting.traceability import exact_sentence, not_whole, not_whole_sentence
from tdfscal.significance import MOST_REJECTED

#: Cures named at most; one fault makes others appear, so that the first few count.
_TRIED = 3
#: Noise that is more than stated: what touched is looked for first.
_NOISE = ("force-noise-suspected", "sensor-noise-suspected")
#: Postures named at most.
_NAMED = 8
#: Why a sensor itself spoils a posture, and does not show that something touched.
_SPOILT = {
    **dict.fromkeys(("posture-over-capacity", "posture-saturated"), "a saturated axis"),
    "posture-frozen": "a frozen axis",
}
#: What is asked for beyond the bare limit.
_SPARE = 1.2
#: Uncertainty, as a share of that of now, at which a change of the campaign is worth a word.
_WORTH = 0.93
#: A source worth naming contributes at least this share of the angles' variance.
_NOTABLE = 0.25
#: Changes of a campaign, by their forecast.
_CHANGES = {
    "postures": "with {:.0f} more such postures",
    "squeeze": "with squeezes of {:.0f} N",
    "tare": "with zeros known to {:g} N by a tare",
}
#: Sources of the budget in words, and what would lower them.
_SOURCES = {
    "noise": ("noise", "more postures, or a harder squeeze,"),
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
#: What would lower them in motion, where it is something else.
_IN_MOTION = {
    "noise": "a longer motion, a larger tilt, or a harder squeeze (`tdfscal plan RIG --motion` "
    "finds the best)",
    "positioner": "a harder squeeze, or a faster motion,",
}


def half_widths(c: Calibration) -> FloatArray:
    """Half (m, 3) of each mounted sensor's 95 % intervals, rad, by the farther end.

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
    draft = [line for finding in c.found(UNCONFIRMED) for line in finding.subject]
    loaded = f"You may load these angles: {said}."
    if draft:
        loaded = (
            "Confirm these lines of the rig file's draft before you load the angles: "
            f"{_by_block(draft)}. If they are right, the angles are known, {said}."
        )
    exact = exact_sentence(c, half_widths(c).max())
    return " ".join(filter(None, (loaded, not_whole_sentence(c), exact, _rests_on(c))))


def _by_block(lines: Iterable[str]) -> str:
    """Lines of a draft, each as `key (line N)`, by the block of the rig file that they are in."""
    blocks: dict[str, list[list[int]]] = {}
    for line in lines:
        key, _, number = line.rstrip(")").rpartition(" (line ")
        spans = blocks.setdefault(key.split(".")[0] or line, [])
        if not (n := int(number) if number.isdecimal() else 0):
            continue
        if spans and spans[-1][1] == n - 1:
            spans[-1][1] = n
        else:
            spans.append([n, n])
    said = {
        block: ", ".join("–".join(map(str, dict.fromkeys(span))) for span in spans)
        for block, spans in blocks.items()
    }
    return ", ".join(f"{block} ({spans})" if spans else block for block, spans in said.items())


def _rests_on(c: Calibration) -> str:
    """How much went in, how it fits, and what limits the least known angle, in a sentence."""
    parts = []
    if c.motion is not None:
        parts.append(f"{c.motion.seconds:.0f} s of motion")
    if c.fit is not None and (c.motion is None or c.fit.postures):
        parts.append(f"{c.fit.postures} postures{_besides(c.fit.rejected)}")
    if c.tracker is not None:
        alone = " alone, for the rig file's log is not there" if c.found("log-missing") else ""
        parts.append(f"{c.tracker.get('points')} points of the tracker{alone}")
    if c.fit is not None and c.fit.dof:
        parts.append(f"scatter against stated {c.fit.birge:.2f}")
    parts += [f"{k.recorder}'s clock to ± {upwards(1e3 * k.offset_std, 2)} ms" for k in c.clocks]
    limit = ""
    if c.budget is not None and len(c.budget.sources) > 1:
        worst = int(np.argmax(c.rpy_std[c.determined].ravel()))
        share, angle = c.budget.shares[worst], c.budget.angles[worst]
        source, _ = _source(c.budget.sources[int(share.argmax())])
        of = f"{share.max():.0%} of the variance of {angle.angle} of {angle.support}"
        limit = f"; limited by {source} ({of})"
    return f"It rests on {', '.join(parts)}{limit}."


def _besides(rejected: Sequence[RejectedPosture]) -> str:
    """Numbers of the postures left out, and why, in brackets."""
    by: dict[str, list[RejectedPosture]] = {}
    for r in rejected:
        by.setdefault(_SPOILT.get(r.code or "", "contact or a jolt"), []).append(r)
    said = "; ".join(f"{_numbers(some)} left out: {why}" for why, some in by.items())
    return f" ({said})" if said else ""


def _numbers(rejected: Sequence[RejectedPosture]) -> str:
    """Numbers of postures, the first of many, by which to find them in the log."""
    more = ", …" if len(rejected) > _NAMED else ""
    return ", ".join(str(r.index + 1) for r in rejected[:_NAMED]) + more


def _source(name: str) -> tuple[str, str]:
    return _SOURCES.get(name, (name, ""))


def advise(c: Calibration) -> tuple[str, ...]:
    """Return sentences in the order in which to act: the first is the cure that counts most."""
    if c.status == "rejected":
        cures = tuple(filter(None, _cures(c)))
        first, *others = cures[:_TRIED] or (
            "record again: hold each posture for 3 s and touch nothing",
        )
        return (
            begun(first, "."),
            *(f"If that does not mend it: {cure}." for cure in others),
            "Do not load this result into a controller; calibrate again first.",
        )
    advice = [f"Mend what the residuals say: {found.cure}." for found in _suspected(c)[:1]]
    looks = (*dict.fromkeys(f.cure or "" for f in not_whole(c)), *_of_those_left_out(c))
    advice += (begun(looked, ".") for looked in looks)
    new = "new postures" if c.motion is None else "a motion without contact"
    advice.append(f"Prove it on {new}, monthly: tdfscal validate {_file(c)} LOG")
    better = tuple(_forecasts(c))
    if better:
        return (*advice, f"The {within(c)} of now would be {', '.join(better)}.")
    source, share = _largest_source(c)
    if share > _NOTABLE and (remedy := _remedy(c, source)):
        advice.append(begun(remedy, "."))
    return tuple(advice)


def _forecasts(c: Calibration) -> Iterator[str]:
    """What changes of the campaign would make of the headline's number, the best first."""
    seen = c.observability
    if seen is None or c.method != "self" or c.motion is not None:
        return
    worst, half = float(c.rpy_std[c.determined].max()), 1e3 * half_widths(c).max()
    found = []
    for f in seen.forecasts:
        amount = float(f"{f.amount:.2g}") if f.change == "squeeze" else f.amount
        found.append((f.worst_std / worst, _CHANGES[f.change].format(amount)))
    if seen.with_moves is not None and not c.campaigns and not c.found("moves-add-nothing"):
        share = seen.with_moves / float(np.sqrt(np.mean(c.rpy_std[c.determined] ** 2)))
        found.append((share, "with `--samples all`, which uses the moves between the stops"))
    for share, change in sorted(found):
        if share < _WORTH:
            yield f"{half * share:.2g} {change}"


def _file(c: Calibration) -> str:
    """The calibration file's name, as the command that made it gave it."""
    named = re.search(r"(?:-o|--output)[= ]([^ -][^ ]*)", c.command)
    if named:
        return named[1]
    return "calibration.yaml" if c.command.startswith("tdfscal calibrate") else "CALIBRATION"


def _cures(c: Calibration) -> Iterator[str]:
    """What each reason of the gate asks for, sentences without their capital and full stop.

    Damage first, for it hides the rest; then a campaign that cannot be used, or does not fit those
    before it, which no wider statement of what is doubtful beside it would mend; then sensors,
    which spoil postures; then what the residuals say, which makes postures misfit; then what
    touched, which looks like noise; precision last, for it is judged with the noise that all of
    these add.
    """
    suspected, misfits = _suspected(c), c.found(*MISFITS)
    if misfits:
        suspected = [found for found in suspected if found.severity == "rejects"]
    if c.motion is not None:  # a log in motion that was meant to rest
        for found in c.found("stops-left-out", "stops-over-capacity"):
            yield f"{found.cure}: {found.text}"
    apart = (*c.found("campaign-unusable"), *misfits)
    yield from dict.fromkeys(found.cure or "" for found in apart)
    yield from _of_the_sensors(_many_rejected(c))
    yield from (found.cure or "" for found in suspected if found.code not in _NOISE)
    yield from _of_what_touched(c)
    yield from (found.cure or "" for found in suspected if found.code in _NOISE)
    yield from _of_the_misfit(c)
    yield from _of_the_precision(c)


def _suspected(c: Calibration) -> list[FindingResult]:
    """What the residuals say, one size for each suspect; those that reject first."""
    found = {(f.code, f.subject): f for f in reversed(c.found(*SUSPECTS, "channel-broken"))}
    return list(reversed(found.values()))


def _of_the_sensors(rejected: Iterable[RejectedPosture]) -> Iterator[str]:
    """Postures that the sensors themselves spoilt."""
    first: dict[str, str] = {}
    for r in sorted(rejected, key=lambda r: r.code == "posture-frozen"):
        if r.code in _SPOILT:
            first.setdefault(CATALOGUE[r.code].cure, r.reason)
    yield from (f"{cure}: {reason}" for cure, reason in first.items())


def _of_those_left_out(c: Calibration) -> Iterator[str]:
    """What to look at of the postures that an accepted campaign lost."""
    rejected = c.fit.rejected if c.fit is not None else ()
    if touched := [r for r in rejected if r.code not in _SPOILT]:
        which = f"posture{'s' * (len(touched) > 1)} {_numbers(touched)}"
        yield f"look what touched the terminal at {which}"
    yield from tuple(_of_the_sensors(rejected))[:1]


def _of_what_touched(c: Calibration) -> Iterator[str]:
    """Postures, or stretches of a motion, that something touched."""
    if c.motion is None:
        touched = [r for r in _many_rejected(c) if r.code not in _SPOILT]
        if touched:
            yield (
                f"find what touched the terminal at postures {_numbers(touched)} (cables, a hand, "
                "a stop), free it, and record again"
            )
        return
    if c.found("motion-left-out"):
        touching = any(stretch.code == "stretch-touched" for stretch in c.motion.rejected)
        yield (
            "find what touched the terminal in the stretches left out (cables, a hand, a stop), "
            "and free it; where nothing did, move more slowly, or hold eight or more postures "
            "for 3 s each"
            if touching
            else "squeeze less, or carry less: sensors reached their capacity or froze in the "
            "stretches left out"
        )
    yield from (found.cure or "" for found in c.found("halves-disagree"))


def _of_the_misfit(c: Calibration) -> Iterator[str]:
    """Residuals too large, and no suspect that stands out; of the tracker's survey too."""
    limit, survey = c.rig.acceptance.birge_max, c.tracker or {}
    if c.motion is None and c.fit is not None and c.fit.birge > limit and not _suspected(c):
        yield (
            "look at the postures one by one: a few bad ones are contact or a jolt; misfit that "
            "grows with time is drift; misfit everywhere is noise beyond "
            "`uncertainty.force_noise`, gain or crosstalk (`uncertainty.force_sensitivity`), NCPs "
            "that do not repeat, or a wrong mass, hinge or barycentre in rig.yaml"
        )
    yield from (found.cure or "" for found in c.found("methods-disagree"))
    birge = survey.get("birge")
    if c.method != "self" and isinstance(birge, float) and birge > limit:
        yield (
            "look at the tracker's residuals: a moved instrument, a loose target, or understated "
            "uncertainties"
        )


def _of_the_precision(c: Calibration) -> Iterator[str]:
    """Uncertainties above a limit of the rig file, of an angle or of the contact wrench."""
    std, limit = c.rpy_std[c.determined], c.rig.acceptance.angle_std
    worst = float(std.max())
    if worst > limit:
        i, j = np.unravel_index(int(std.argmax()), std.shape)
        weakest = f"{ANGLES[j]} of {c.mounted[i].name} is the weakest angle"
        if c.method == "tracker":
            yield f"measure more targets, farther apart, or from nearer: {weakest}"
        elif c.fit is not None and c.fit.postures:
            wanted = ceil(_SPARE * c.fit.postures * (worst / limit) ** 2)
            yield (
                f"squeeze the NCPs {_SPARE * worst / limit:.1f} times as hard, or record {wanted} "
                f"postures like the {c.fit.postures} of now (tdfscal plan chooses them): {weakest}"
            )
        else:
            yield f"squeeze the NCPs against each other, move longer, tilt farther: {weakest}"
    elif c.found("contact-uncertain"):
        yield _remedy(c, _largest_source(c)[0]) or _remedy(c, "noise")


def _remedy(c: Calibration, source: str) -> str:
    """What would lower a source's share of the uncertainty; empty where nothing would."""
    name, remedy = _source(source)
    if c.motion is not None:
        remedy = _IN_MOTION.get(source, remedy)
    return remedy and f"{remedy} would lower the uncertainty, which is mostly that of {name}"


def _many_rejected(c: Calibration) -> tuple[RejectedPosture, ...]:
    """Rejected postures, where they are more than may be."""
    if c.fit is None:
        return ()
    rejected = c.fit.rejected
    return rejected if len(rejected) > MOST_REJECTED * (c.fit.postures + len(rejected)) else ()


def _largest_source(c: Calibration) -> tuple[str, float]:
    """What contributes most to the angles' variance, and its mean share."""
    if c.budget is None or not c.budget.sources:
        return "noise", 0.0
    share = c.budget.shares.mean(axis=0)
    return c.budget.sources[int(share.argmax())], float(share.max())
