"""What a calibration says last: what to do next."""

from __future__ import annotations

import re
import shlex
from collections.abc import Iterable, Iterator
from math import ceil

import numpy as np

from tdfscal.catalogue import CATALOGUE, cure
from tdfscal.catalogue.campaign import SUSPECTS
from tdfscal.catalogue.entry import begun
from tdfscal.catalogue.numbers import rounded, two_digits
from tdfscal.files.calibration.document import Calibration
from tdfscal.files.calibration.parts import FindingResult, RejectedPosture
from tdfscal.findings import Finding
from tdfscal.records import ANGLES
from tdfscal.reporting.headline import (
    SOURCES,
    SPOILT,
    STATED_BY,
    largest_source,
    not_whole,
    numbers,
    uncounted,
    within,
    without_effect,
)
from tdfscal.reporting.traceability import certificates, expired
from tdfscal.selfcal.estimator import HARDER
from tdfscal.significance import MOST_REJECTED

#: Cures named at most; one fault makes others appear, so that the first few count.
_TRIED = 3
#: Keys of the rig file that are named in a sentence at most.
_KEYS = 5
#: Noise that is more than stated: what touched is looked for first.
_NOISE = ("force-noise-suspected", "sensor-noise-suspected")
#: Times as many postures as there are: more are no advice.
_MANY = 20
#: What is asked for beyond the bare limit.
_SPARE = 1.2
#: Uncertainty, as a share of that of now, at which a change of the campaign is worth a word.
_WORTH = 0.93
#: A source worth naming contributes at least this share of the angles' variance.
_NOTABLE = 0.25
#: Changes of a campaign, by their forecast.
_CHANGES = {
    "postures": "with {:.0f} more such postures",
    "squeeze": "with squeezes of {:.0f} N{}",
    "tare": "with zeros known to {:g} N by a tare",
    "seconds": "with {:.0f} s of such motion",
}
#: Said of a squeeze where a sensor's capacity is not stated; that of hinges never is.
_BEARABLE = " (if sensors and hinges bear it)"
#: What would lower a source in motion, where it is something else.
_IN_MOTION = {
    "noise": "a longer motion, a larger tilt, or a harder squeeze (`tdfscal plan RIG --motion` "
    "finds the best)",
    "positioner": "a harder squeeze, or a faster motion,",
}


def advise(c: Calibration) -> tuple[str, ...]:
    """Return sentences in the order in which to act: the first is the cure that counts most."""
    if c.status == "rejected":
        each: dict[str, str] = {}  # one that is told apart by its numbers only is the same
        for said in filter(None, _cures(c)):
            each.setdefault(re.sub("`[^`]*`", "", said), said)
        first, *others = tuple(each.values())[:_TRIED] or (
            "record again: hold each posture for 3 s and touch nothing",
        )
        return (
            begun(first, "."),
            *(f"If that does not mend it: {other}." for other in others),
            "Do not load this result into a controller; calibrate again first.",
        )
    traced = (begun(found.cure or "", ".") for found in c.found("fields-crossed"))
    renewed = (*traced, *certificates(expired(c)))
    if c.status == "provisional":
        confirm = "Confirm or correct each line, take out its mark, and calibrate again."
        return (*renewed, confirm, *_to_mend(c))
    return (*renewed, *_to_measure(c), *_to_mend(c), _proof(c), *_to_improve(c))


def _to_measure(c: Calibration) -> Iterator[str]:
    """The keys of all that the headline counts as exact; of many only that there are."""
    names = [*(q.name for q in uncounted(c)), *without_effect(c)]
    keys = ", ".join(f"`{STATED_BY.get(name, name)}`" for name in names)
    if len(names) > _KEYS:
        keys = f"{len(names)} keys, which `tdfscal report` lists"
    if names:
        yield f"State in rig.yaml: {keys}."


def _to_mend(c: Calibration) -> Iterator[str]:
    """What an accepted campaign still has: a suspect, a log cut short, postures that were lost."""
    yield from (f"Mend what the residuals say: {found.cure}." for found in _suspected(c)[:1])
    if found := not_whole(c):
        names = tuple(name for each in found for name in each.subject)
        yield begun(cure(Finding(found[0].code, names)), ".")
    rejected = c.fit.rejected if c.fit is not None else ()
    if touched := [r for r in rejected if r.code not in SPOILT]:
        yield f"Look what touched the terminal at {numbers(touched)}."
    yield from (begun(said, ".") for said in tuple(_of_the_sensors(c, rejected))[:1])
    yield from (begun(found.cure or "", ".") for found in c.found("dwells-few", "postures-few"))


def _proof(c: Calibration) -> str:
    """How to check the result, with the name of its file."""
    new = "new postures" if c.motion is None else "a motion without contact"
    if c.source:
        how = f"tdfscal validate {shlex.quote(str(c.source))} LOG"
    elif c.command.startswith("tdfscal."):  # as Python names it
        how = "tdfscal.validate(calibration, log)"
    else:
        named = re.search(r"(?:-o|--output)[= ]('[^']+'|(?!- |-$)[^ ']+)", c.command)
        usual = "calibration.yaml" if c.command.startswith("tdfscal calibrate") else "CALIBRATION"
        file = named[1] if named else usual
        how = f"tdfscal validate {'./' * file.startswith('-')}{file} LOG"
    return f"Check {new} every month: `{how}`"


def _to_improve(c: Calibration) -> Iterator[str]:
    """What changes of the campaign would make of the headline's number; else the largest source."""
    if better := tuple(_forecasts(c)):
        yield f"The {within(c)} would become {', or '.join(better)}."
        return
    source, share = largest_source(c)
    if share > _NOTABLE and (remedy := _remedy(c, source)):
        yield begun(remedy, ".")


def _forecasts(c: Calibration) -> Iterator[str]:
    """Forecasts of the headline's number, the best first."""
    seen = c.observability
    if seen is None or c.method != "self":
        return
    worst, half = float(c.rpy_std[c.determined].max()), 1e3 * c.half_widths.max()
    found = []
    for f in seen.forecasts:
        amount = float(f"{rounded(f.amount)}") if f.change == "squeeze" else f.amount
        found.append((f.worst_std / worst, _CHANGES[f.change].format(amount, _bearable(c))))
    if seen.with_moves is not None and not c.campaigns and not c.found("moves-add-nothing"):
        share = seen.with_moves / float(np.sqrt(np.mean(c.rpy_std[c.determined] ** 2)))
        found.append((share, "with `--samples all`"))
    for share, change in sorted(found):
        if share < _WORTH:
            yield f"{two_digits(half * share)} {change}"


def _bearable(c: Calibration) -> str:
    """What bounds a squeeze, where the rig file does not."""
    return "" if all(support.capacity for support in c.rig.supports) else _BEARABLE


def _cures(c: Calibration) -> Iterator[str]:
    """What each reason of the gate asks for, sentences without their capital and full stop.

    Damage first, for it hides the rest; then a campaign that cannot be used, or does not fit those
    before it, which no wider statement of what is doubtful beside it would mend; then sensors,
    which spoil postures; then what the residuals say, which makes postures misfit; then what
    touched, which looks like noise; precision last, for it is judged with the noise that all of
    these add.
    """
    suspected, changed = _suspected(c), c.found("campaigns-changed")
    if changed:
        suspected = [found for found in suspected if found.severity == "rejects"]
    if c.motion is not None:  # a log in motion that was meant to rest
        for found in c.found("stops-left-out", "stops-over-capacity"):
            yield f"{found.cure}: {found.text}"
    apart = (*c.found("campaign-unusable"), *changed)
    yield from dict.fromkeys(found.cure or "" for found in apart)
    yield from _of_the_sensors(c, _many_rejected(c))
    yield from (found.cure or "" for found in c.found("sensor-turned"))
    yield from (found.cure or "" for found in suspected if found.code not in _NOISE)
    yield from _of_what_touched(c)
    yield from (found.cure or "" for found in suspected if found.code in _NOISE)
    yield from _of_the_misfit(c)
    yield from _of_the_precision(c)


def _suspected(c: Calibration) -> list[FindingResult]:
    """What the residuals say, one size for each suspect; those that reject first."""
    found = {(f.code, f.subject): f for f in reversed(c.found(*SUSPECTS))}
    return list(reversed(found.values()))


def _of_the_sensors(c: Calibration, rejected: Iterable[RejectedPosture]) -> Iterator[str]:
    """Postures that the sensors themselves spoilt."""
    yield from (found.cure or "" for found in c.found("range-exceeded")[:1])
    first: dict[str, str] = {}
    for r in sorted(rejected, key=lambda r: r.code == "posture-frozen"):
        if r.code in SPOILT and CATALOGUE[r.code].cure:
            first.setdefault(CATALOGUE[r.code].cure, r.reason)
    yield from (f"{told}: {reason}" for told, reason in first.items())


def _of_what_touched(c: Calibration) -> Iterator[str]:
    """Postures, or stretches of a motion, that something touched."""
    if c.motion is None:
        if touched := [r for r in _many_rejected(c) if r.code not in SPOILT]:
            yield f"{CATALOGUE['posture-misfits'].cure}: {numbers(touched)}"
    elif c.found("motion-left-out"):
        if any(stretch.code == "stretch-touched" for stretch in c.motion.rejected):
            yield CATALOGUE["stretch-touched"].cure
        spoilt = c.found("stretch-frozen", "stretch-standing", "stretch-over-capacity")
        yield from dict.fromkeys(found.cure or "" for found in spoilt)


def _of_the_misfit(c: Calibration) -> Iterator[str]:
    """Residuals too large, and no suspect that stands out; of the tracker's survey too."""
    limit = c.rig.acceptance.birge_max
    if c.motion is None and c.fit is not None and c.fit.birge > limit and not _suspected(c):
        yield (
            "look at the postures one by one: a few bad ones are contact or a jolt; misfit that "
            "grows with time is drift; misfit everywhere is noise beyond "
            "`uncertainty.force_noise`, gain or crosstalk (`uncertainty.force_sensitivity`), NCPs "
            "that do not repeat, or a wrong mass, hinge or barycentre in rig.yaml"
        )
    yield from (found.cure or "" for found in c.found("methods-disagree", "linear-apart"))
    if c.method != "self" and c.tracker is not None and c.tracker.birge > limit:
        yield (
            "look at the tracker's residuals: a moved instrument, a loose target, or understated "
            "uncertainties"
        )


def _of_the_precision(c: Calibration) -> Iterator[str]:
    """Uncertainties above a limit of the rig file, of an angle or of the contact wrench."""
    std, limit = c.rpy_std[c.determined], c.rig.acceptance.angle_std
    worst = float(std.max())
    if worst <= limit:
        if c.found("contact-uncertain"):
            yield _remedy(c, largest_source(c)[0]) or _remedy(c, "noise")
        return
    i, j = np.unravel_index(int(std.argmax()), std.shape)
    weakest = f"{ANGLES[j]} of {c.mounted[i].name} is the weakest angle"
    if few := c.found("postures-few"):
        yield f"{few[0].cure}: {weakest}"
    elif c.estimator == "linear":
        yield f"use the default estimator: {weakest}"
    elif c.method == "tracker":
        yield f"measure more targets, farther apart, or from nearer: {weakest}"
    elif c.fit is None or not c.fit.postures:
        still = "".join(f"{found.cure}, or " for found in c.found("dwells-few"))
        yield f"{still}squeeze the NCPs against each other, move longer, tilt farther: {weakest}"
    elif _SPARE * (worst / limit) ** 2 > _MANY:
        ask = "squeeze harder, quieten the sensors, or ask for less (`acceptance.angle_std`)"
        yield f"more of such postures do not reach the limit; {ask}: {weakest}"
    else:
        wanted = ceil(_SPARE * c.fit.postures * (worst / limit) ** 2)
        harder, seen = _SPARE * worst / limit, c.observability
        squeeze = f"squeeze the NCPs {harder:.1f} times as hard{_bearable(c)}, or "
        foreseen = {f.change for f in seen.forecasts} if seen is not None else set()
        if not _bearable(c) and (harder > HARDER or "squeeze" not in foreseen):
            squeeze = ""  # it would fill a sensor
        yield (
            f"{squeeze}record {wanted} postures like the {c.fit.postures} of now (tdfscal plan "
            f"chooses them): {weakest}"
        )


def _remedy(c: Calibration, source: str) -> str:
    """What would lower a source's share of the uncertainty; empty where nothing would."""
    name, remedy = SOURCES.get(source, (source, ""))
    if c.motion is not None:
        remedy = _IN_MOTION.get(source, remedy)
    return remedy and f"{remedy} would lower the uncertainty, which comes mostly from {name}"


def _many_rejected(c: Calibration) -> tuple[RejectedPosture, ...]:
    """Rejected postures, where they are more than may be."""
    if c.fit is None:
        return ()
    rejected = c.fit.rejected
    return rejected if len(rejected) > MOST_REJECTED * (c.fit.postures + len(rejected)) else ()
