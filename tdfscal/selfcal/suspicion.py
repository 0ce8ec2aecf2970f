"""What may be wrong with a campaign that its rig file does not declare, in words, with its cure."""

from __future__ import annotations

from dataclasses import dataclass, field, replace

import numpy as np

from tdfscal.checks import geometry
from tdfscal.model.parameters import layout
from tdfscal.numerics.distributions import p_text
from tdfscal.records import ANGLES, BoolArray, FloatArray, Rig
from tdfscal.selfcal.covariance import Uncertainty
from tdfscal.significance import (
    CAUSES_APART,
    CERTAIN_SHIFT,
    CERTAINLY_UNDECLARED,
    HARMFUL_SHIFT,
)

#: What is wrong with {0}, and its cure; {1} is the size that the residuals ask for.
WORDS = {
    "zero": (
        "the zero of {0} is not what is stated",
        "tare again, or write `zero.std: {1}` for {0} in rig.yaml",
    ),
    "sensitivity": (
        "gain or crosstalk of {0} is not what is stated",
        "have the sensor of {0} checked, or write `uncertainty.force_sensitivity: {1}` in rig.yaml",
    ),
    "gain": (
        "the gain of {0} is not what is stated",
        "have the sensor of {0} checked, or write `uncertainty.force_sensitivity: {1}` in rig.yaml",
    ),
    "mass": (
        "the mass is not what is stated",
        "weigh again, or write `terminal.mass.std: {1}` in rig.yaml",
    ),
    "barycentre": (
        "the barycentre is not where it is stated",
        "correct it, or write `terminal.barycenter.std: {1}` in rig.yaml",
    ),
    **geometry.WORDS,
    "tilt": (
        "gravity is not along -Z of the BCS",
        "level the BCS, or write `gravity.tilt_std: {1}` in rig.yaml",
    ),
    "friction": (
        "the hinges hold back against the turn by which a posture is reached",
        "see whether the hinges move freely, or write `uncertainty.hinge_moment: {1}` in rig.yaml",
    ),
    "hinge friction": (
        "the moments scatter as friction of {1} N·m in the hinges would make them",
        "see whether the hinges move freely and the NCPs repeat as stated, or write "
        "`uncertainty.hinge_moment: {1}` in rig.yaml",
    ),
    "force noise": (
        "the forces scatter by {1} N per axis and posture beyond what is stated",
        "see what shakes or hums, or write `uncertainty.force_noise: {1}` in rig.yaml",
    ),
    "sensor noise": (
        "the forces of {0} scatter by {1} N per axis and posture beyond what is stated",
        "look at the sensor of {0}, its cable and amplifier, or write "
        "`uncertainty.force_noise: {1}` in rig.yaml",
    ),
    "position noise": (
        "the NCPs repeat {1} m per axis worse than stated",
        "see what is loose, or write `uncertainty.positioner: {1}` in rig.yaml",
    ),
    "drift": (
        "the zero of {0} drifts over the campaign",
        "warm up and tare again, or write `drift.time: .inf` in rig.yaml",
    ),
    "temperature": (
        "the zero of {0} follows the temperature",
        "write `drift.temperature: .inf` in rig.yaml",
    ),
    "walk": (
        "the zero of {0} wanders at random",
        "let it warm up, tare more often, or write `drift.walk: {1}` in rig.yaml",
    ),
    "parabola": (
        "the zero of {0} drifts other than along a line",
        "record faster, or write `drift.walk: {1}` in rig.yaml",
    ),
}
for _group in ("drift", "temperature", "parabola", "walk"):
    _what, _advice = WORDS[_group]
    _what = _what.replace("zero of {0} drifts", "zeros of all sensors drift")
    _what = _what.replace("zero of {0} wanders", "zeros of all sensors wander")
    WORDS[f"all {_group}"] = (
        _what.replace("zero of {0} follows", "zeros of all follow"),
        _advice.replace("let it warm", "let them warm"),
    )


@dataclass(frozen=True, slots=True)
class Suspicion:
    """Something that the residuals, or the distances between hinges, ask for.

    what, advice : what is wrong, and its cure. p_value : that chance alone asks as much, for this
    suspect alone. shift : largest move of an angle in units of its standard uncertainty.
    angle : which one. kind, support : what it is, and of which support. weight : twice the
    logarithm of its likelihood, less what its unknowns are worth. tied : another one is likelier,
    but not by much. zero_shift, zero : largest move of a zero, likewise, and which one.
    move : (p,), of the active parameters of a fit in motion, whose covariance may have to hold it.
    evidence : what says so.
    """

    what: str
    advice: str
    p_value: float
    shift: float
    angle: str
    kind: str = ""
    support: int | None = None
    weight: float = 0.0
    tied: bool = False
    zero_shift: float = 0.0
    zero: str = ""
    move: FloatArray | None = field(default=None, compare=False, repr=False)
    evidence: str = "the residuals"

    @property
    def certain(self) -> bool:
        """Chance alone does not ask as much."""
        return self.p_value < CERTAINLY_UNDECLARED

    @property
    def harmful(self) -> bool:
        """It would move an angle by more than its uncertainty bears; less, where it is certain.

        Then zeros count too, since a controller loads them. Before, chance alone moves them as far:
        mass, barycentre and zeros are nearly exchangeable.
        """
        if self.certain:
            return max(self.shift, self.zero_shift) > CERTAIN_SHIFT
        return self.shift > HARMFUL_SHIFT

    @property
    def spoils_motion(self) -> bool:
        """Harmful to samples in motion, where only what is certain counts.

        A path driven twice repeats the positioners' errors, as no noise does: what is left of them
        looks like a gain or an offset, and stands in the uncertainty.
        """
        return self.certain and self.harmful

    @property
    def finding(self) -> str:
        """What is wrong, how surely, and what it does."""
        said = f"{self.evidence} say {'about as well ' if self.tied else ''}that"
        zero = f" and the zero {self.zero} by {self.zero_shift:.1f}"
        return (
            f"{said} {self.what} ({p_text(self.p_value)}), which would move "
            f"{self.angle} by {self.shift:.1f} of its standard uncertainties"
            f"{zero if self.zero_shift > CERTAIN_SHIFT else ''}"
        )

    @property
    def text(self) -> str:
        """The finding with its cure."""
        return f"{self.finding}: {self.advice}"


def suspicion(
    rig: Rig,
    known: Uncertainty,
    kind: str,
    index: int,
    size: float,
    move: FloatArray,
    p_value: float,
    weight: float,
) -> Suspicion:
    """Put a suspect into words.

    kind, index : key of `WORDS`, and the support where it is of one. size : that the residuals ask
    for, in the rig file's unit. move : (p,), of the free parameters with it, rotations first.
    """
    up = geometry.upwards(size)
    what, advice = (words.format(rig.supports[index], up) for words in WORDS[kind])
    support = index if "{0}" in WORDS[kind][0] else None
    shift = worst_angle(rig, known, move)
    return Suspicion(what, advice, p_value, *shift, kind=kind, support=support, weight=weight)


def worst_angle(rig: Rig, known: Uncertainty, move: FloatArray) -> tuple[float, str]:
    """Largest move of an angle in its standard uncertainties, and which; move as in `suspicion`."""
    std = np.sqrt(np.diagonal(known.covariance))
    shift = np.abs(move[: len(std)]) / std
    worst = int(np.argmax(shift))
    return float(shift[worst]), f"{ANGLES[worst % 3]} of {rig.supports[worst // 3]}"


def worst_zero(
    rig: Rig, known: Uncertainty, active: BoolArray, move: FloatArray
) -> tuple[float, str]:
    """Largest move of a zero in its standard uncertainties, and which; active : (P,)."""
    place, full = layout(rig.n)["zero"], np.zeros(len(active))
    full[active] = move
    std = known.parameter_std[place]
    free = np.isfinite(std) & (std > 0)
    size = np.where(free, np.abs(full[place]) / np.where(free, std, 1.0), 0.0)
    worst = int(np.argmax(size))
    return float(size[worst]), f"{'xyz'[worst % 3]} of {rig.supports[worst // 3]}"


def likeliest(found: list[Suspicion]) -> tuple[Suspicion, ...]:
    """The likeliest suspicion, and those that are about as likely."""
    ranked = sorted(found, key=lambda doubt: -doubt.weight)
    near = [doubt for doubt in ranked if ranked[0].weight - doubt.weight < CAUSES_APART]
    return tuple(replace(doubt, tied=k > 0) for k, doubt in enumerate(near))
