"""What may be wrong with a campaign that its rig file does not declare."""

from __future__ import annotations

from dataclasses import dataclass, field, replace

import numpy as np

from tdfscal.estimation.uncertainty import Uncertainty
from tdfscal.findings import Finding, Value
from tdfscal.model.parameters import layout
from tdfscal.records import ANGLES, BoolArray, FloatArray, Rig
from tdfscal.significance import (
    CAUSES_APART,
    CERTAIN_SHIFT,
    CERTAINLY_UNDECLARED,
    HARMFUL_SHIFT,
)

#: Code of a finding by the group that the residuals ask for, the unit of its size, and whether it
#: is of one support.
CODES = {
    "zero": ("zero-suspected", "N", True),
    "sensitivity": ("sensitivity-suspected", "", True),
    "gain": ("gain-suspected", "", True),
    "mounting": ("mounting-suspected", "rad", True),
    "mass": ("mass-suspected", "kg", False),
    "barycentre": ("barycentre-suspected", "m", False),
    "hinge": ("hinge-suspected", "m", True),
    "datum": ("datum-suspected", "m", True),
    "tilt": ("tilt-suspected", "rad", False),
    "compliance": ("compliance-suspected", "m/N", False),
    "friction": ("hysteresis-suspected", "N·m", False),
    "hinge friction": ("hinge-friction-suspected", "N·m", False),
    "force noise": ("force-noise-suspected", "N", False),
    "sensor noise": ("sensor-noise-suspected", "N", True),
    "position noise": ("positioner-noise-suspected", "m", False),
    "drift": ("zero-drift", "N", True),
    "all drift": ("zeros-drift", "N", False),
    "temperature": ("zero-temperature", "N", True),
    "all temperature": ("zeros-temperature", "N", False),
    "parabola": ("zero-parabola", "N/√h", True),
    "all parabola": ("zeros-parabola", "N/√h", False),
    "walk": ("zero-walk", "N/√h", True),
    "all walk": ("zeros-walk", "N/√h", False),
}
#: Zeros that drift other than along a line, of one sensor or of all.
PARABOLAS = ("parabola", "all parabola")
#: What has no structure that a test could hold against its scatter.
SCATTERS = ("force noise", "sensor noise", "position noise", "walk", "all walk")


@dataclass(frozen=True, slots=True)
class Suspicion:
    """Something that the residuals, or the distances between hinges, ask for.

    causes : what it may be, the likeliest first, each with its size. p_value : that chance alone
    asks as much, for this suspect alone. shift : largest move of an angle in units of its standard
    uncertainty, harm : the same in rad; angle : which one. kind, support : what it is, and of which
    support. weight : twice the logarithm of its likelihood, less what its unknowns are worth.
    tied : another one is likelier, but not by much. zero_shift, zero : largest move of a zero,
    likewise, and which one. move : (p,), of the free parameters, whose covariance may have to hold
    it.
    """

    causes: tuple[Finding, ...]
    p_value: float
    shift: float
    harm: float
    angle: str
    kind: str = ""
    support: int | None = None
    weight: float = 0.0
    tied: bool = False
    zero_shift: float = 0.0
    zero: str = ""
    move: FloatArray | None = field(default=None, compare=False, repr=False)

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

    def findings(self, *, rejects: bool, **values: Value) -> tuple[Finding, ...]:
        """Each cause as a finding, the likeliest first."""
        facts: dict[str, Value] = {"angle": self.angle, "shift": self.shift, **values}
        if self.zero_shift > CERTAIN_SHIFT:
            facts |= {"zero": self.zero, "zero_shift": self.zero_shift}
        return tuple(
            replace(
                cause,
                p_value=self.p_value,
                harm=self.harm,
                values={**cause.values, **facts, "tied": self.tied or k > 0},
                rejects=rejects,
            )
            for k, cause in enumerate(self.causes)
        )


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
    """Weigh a suspect.

    kind, index : key of `CODES`, and the support where it is of one. size : that the residuals ask
    for, in the rig file's unit. move : (p,), of the free parameters with it, rotations first.
    """
    code, unit, of_one = CODES[kind]
    cause = Finding(code, (rig.supports[index],) if of_one else (), size, unit)
    support = index if of_one else None
    worst = worst_angle(rig, known, move)
    return Suspicion((cause,), p_value, *worst, kind=kind, support=support, weight=weight)


def worst_angle(rig: Rig, known: Uncertainty, move: FloatArray) -> tuple[float, float, str]:
    """Largest move of an angle in its standard uncertainties, in rad, and which.

    move : as in `suspicion`.
    """
    std = np.sqrt(np.diagonal(known.covariance))
    shift = np.abs(move[: len(std)]) / std
    worst = int(np.argmax(shift))
    angle = f"{ANGLES[worst % 3]} of {rig.supports[worst // 3]}"
    return float(shift[worst]), float(abs(move[worst])), angle


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
