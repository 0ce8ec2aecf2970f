"""What to do next, from the numbers of a calibration and from why it was rejected."""

from __future__ import annotations

import re
from collections.abc import Callable, Iterator
from math import ceil

import numpy as np

from tdfscal.catalogue.campaign import SUSPECTS
from tdfscal.catalogue.in_use import MISFITS
from tdfscal.files.calibration.document import Calibration
from tdfscal.files.calibration.evidence_model import MotionResult
from tdfscal.files.calibration.parts import FindingResult, RejectedPosture
from tdfscal.records import ANGLES
from tdfscal.reporting.headline import half_widths
from tdfscal.significance import MOST_REJECTED

#: Cures named at most; one fault makes others appear, so that the first few count.
_TRIED = 3
#: Noise that is more than stated: what touched is looked for first.
_NOISE = ("force-noise-suspected", "sensor-noise-suspected")
#: Postures named at most.
_NAMED = 8
#: Why a sensor spoilt a posture: it is at its end, or gives one reading.
_FULL, _FROZEN = ("posture-over-capacity", "posture-saturated"), ("posture-frozen",)
#: What is asked for beyond the bare limit.
_SPARE = 1.2
#: Uncertainty, as a share of that of now, at which a change of the campaign is worth a word.
_WORTH = 0.93
#: Changes of a campaign, by their forecast.
_CHANGES: dict[str, Callable[[float], str]] = {
    "postures": "with {:.0f} more such postures".format,
    "squeeze": lambda force: f"with squeezes of {float(f'{force:.2g}'):.0f} N",
    "tare": "with zeros known to {:g} N by a tare".format,
}
#: A source worth naming contributes at least this share of the angles' variance.
_NOTABLE = 0.25
_LESSEN = {
    "noise": "More postures, or a harder squeeze, would lower the uncertainty further: noise "
    "dominates.",
    "zero": "A tare just before the campaign would lower the uncertainty: the zeros dominate.",
    "positioner": "A harder squeeze would lower the uncertainty: NCP repeatability dominates.",
    "mass": "Weighing the terminal would lower the uncertainty: its mass dominates.",
    "barycentre": "More tilt, or a better barycentre, would lower the uncertainty: it dominates.",
    "hinge": "Measuring the hinge centres would lower the uncertainty: they dominate.",
    "datum": "Measuring the servo datums would lower the uncertainty: they dominate.",
    "gravity": "Levelling the BCS would lower the uncertainty: the direction of gravity dominates.",
    "sensitivity": "Calibrated gains would lower the uncertainty: the sensitivity dominates.",
    "instrument angles": "A tracker nearer to the rig would lower the uncertainty: its angles "
    "dominate.",
}
#: The same of samples in motion.
_LESSEN_IN_MOTION = {
    "noise": "A longer motion, a larger tilt, or a harder squeeze would lower the uncertainty "
    "further: noise dominates (`tdfscal plan RIG --motion` finds the best motion).",
    "noise spectrum": "A longer motion would lower the uncertainty: how noisy its slow part is "
    "dominates.",
    "positioner": "A harder squeeze, or a faster motion, would lower the uncertainty: the NCPs' "
    "position errors dominate.",
    "undeclared error": "Declaring or mending what the residuals suspect would lower the "
    "uncertainty: it dominates.",
    "motion": "A slower motion, or an inertia, a friction and a delay that are stated, would lower "
    "the uncertainty: what the motion adds dominates.",
}


def advise(c: Calibration) -> tuple[str, ...]:
    """Return sentences in the order in which to act: the first is the cure that counts most."""
    if c.status == "rejected":
        cures = _cures(c) or ("Record again: hold each posture for 3 s and touch nothing",)
        others = (f"{cure[0].lower()}{cure[1:]}" for cure in cures[1:_TRIED])
        return (
            f"{cures[0]}.",
            *(f"If that does not mend it: {cure}." for cure in others),
            "Do not load this result into a controller; calibrate again first.",
        )
    advice = [f"Mend what the residuals say: {found.cure}." for found in _suspected(c)[:1]]
    new = "new postures" if c.motion is None else "a motion without contact"
    advice.append(f"Prove it on {new}, monthly: tdfscal validate {_file(c)} LOG")
    better = tuple(_forecasts(c))
    if better:
        now = 1e3 * half_widths(c).max()
        return (*advice, f"The ± {now:.2g} mrad of now would be {', '.join(better)}.")
    source, share = _largest_source(c)
    lessen = _LESSEN if c.motion is None else _LESSEN | _LESSEN_IN_MOTION
    if share > _NOTABLE and source in lessen:
        advice.append(lessen[source])
    return tuple(advice)


def _forecasts(c: Calibration) -> Iterator[str]:
    """What changes of the campaign would make of the headline's number, the best first."""
    seen = c.observability
    if seen is None or c.method != "self" or c.motion is not None:
        return
    worst, half = float(c.rpy_std[c.determined].max()), 1e3 * half_widths(c).max()
    found = [(f.worst_std / worst, _CHANGES[f.change](f.amount)) for f in seen.forecasts]
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


def _cures(c: Calibration) -> tuple[str, ...]:
    """What each reason of the gate asks for, sentences without a full stop.

    Damage first, for it hides the rest; then a campaign that does not fit those before it, which no
    wider statement of what is doubtful beside it would mend; then sensors, which spoil postures;
    then what the residuals say, which makes postures misfit; then what touched, which looks like
    noise; precision last, for it is judged with the noise that all of these add.
    """
    suspected, misfits = _suspected(c), c.found(*MISFITS)
    if misfits:
        suspected = [found for found in suspected if found.severity == "rejects"]
    return (
        *_of_the_log(c),
        *dict.fromkeys(_begun(found.cure) for found in misfits),
        *_of_the_sensors(c),
        *(_begun(found.cure) for found in suspected if found.code not in _NOISE),
        *(_of_postures(c) if c.motion is None else _of_motion(c, c.motion)),
        *(_begun(found.cure) for found in suspected if found.code in _NOISE),
        *_of_the_misfit(c),
        *_of_the_precision(c),
    )


def _suspected(c: Calibration) -> list[FindingResult]:
    """What the residuals say, one size for each suspect; those that reject first."""
    found = {(f.code, f.subject): f for f in reversed(c.found(*SUSPECTS, "channel-broken"))}
    return list(reversed(found.values()))


def _begun(text: str | None) -> str:
    return f"{text[0].upper()}{text[1:]}" if text else ""


def _of_the_log(c: Calibration) -> Iterator[str]:
    """A log in motion that was meant to rest: what is said of its stops."""
    for found in c.found("stops-left-out", "stops-over-capacity"):
        if c.motion is not None:
            yield f"{_begun(found.cure)}: {found.text}"


def _of_the_sensors(c: Calibration) -> Iterator[str]:
    """Postures that the sensors themselves spoilt."""
    many = _many_rejected(c)
    full = [rejected.reason for rejected in many if rejected.code in _FULL]
    if full:
        yield (
            "Squeeze less, carry less, or widen the range of sensor and amplifier (or correct "
            f"`capacity` in rig.yaml): {full[0]}"
        )
    frozen = [rejected.reason for rejected in many if rejected.code in _FROZEN]
    if frozen:
        yield f"Look at the sensor's cable and amplifier: {frozen[0]}; then record again"


def _of_postures(c: Calibration) -> Iterator[str]:
    """Postures that something touched."""
    touched = [r.index + 1 for r in _many_rejected(c) if r.code not in (*_FULL, *_FROZEN)]
    if touched:
        names = ", ".join(map(str, touched[:_NAMED])) + (", …" if touched[_NAMED:] else "")
        yield (
            f"Find what touched the terminal at postures {names} (cables, a hand, a stop), free "
            "it, and record again"
        )


def _of_motion(c: Calibration, motion: MotionResult) -> Iterator[str]:
    """What may have caused the reasons that only a motion has."""
    if c.found("motion-left-out"):
        touched = any(stretch.code == "stretch-touched" for stretch in motion.rejected)
        yield (
            "Find what touched the terminal in the stretches left out (cables, a hand, a stop), "
            "and free it; where nothing did, move more slowly, or hold eight or more postures "
            "for 3 s each"
            if touched
            else "Squeeze less, or carry less: sensors reached their capacity or froze in the "
            "stretches left out"
        )
    yield from (_begun(found.cure) for found in c.found("halves-disagree"))


def _of_the_misfit(c: Calibration) -> Iterator[str]:
    """Residuals too large, and no suspect that stands out; of the tracker's survey too."""
    limit, survey = c.rig.acceptance.birge_max, c.tracker or {}
    if c.motion is None and c.fit is not None and c.fit.birge > limit and not _suspected(c):
        yield (
            "Look at the postures one by one: a few bad ones are contact or a jolt; misfit that "
            "grows with time is drift; misfit everywhere is noise beyond "
            "`uncertainty.force_noise`, gain or crosstalk (`uncertainty.force_sensitivity`), NCPs "
            "that do not repeat, or a wrong mass, hinge or barycentre in rig.yaml"
        )
    yield from (_begun(found.cure) for found in c.found("methods-disagree"))
    birge = survey.get("birge")
    if c.method != "self" and isinstance(birge, float) and birge > limit:
        yield (
            "Look at the tracker's residuals: a moved instrument, a loose target, or understated "
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
            yield f"Measure more targets, farther apart, or from nearer: {weakest}"
        elif c.fit is not None and c.fit.postures:
            wanted = ceil(_SPARE * c.fit.postures * (worst / limit) ** 2)
            yield (
                f"Squeeze the NCPs {_SPARE * worst / limit:.1f} times as hard, or record {wanted} "
                f"postures like the {c.fit.postures} of now (tdfscal plan chooses them): {weakest}"
            )
        else:
            yield f"Squeeze the NCPs against each other, move longer, tilt farther: {weakest}"
    elif c.found("contact-uncertain"):
        yield _LESSEN.get(_largest_source(c)[0], _LESSEN["noise"]).rstrip(".")


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
