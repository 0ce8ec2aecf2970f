"""What a calibration is good for: one number to type in, what it counts, what it rests on."""

from __future__ import annotations

import numpy as np

from tdfscal.files.calibration.consistency import UNCONFIRMED
from tdfscal.files.calibration.document import Calibration
from tdfscal.files.calibration.parts import ExactQuantityResult, Mounting
from tdfscal.records import ANGLES, FloatArray
from tdfscal.reporting.layout import Block, Table
from tdfscal.significance import COVERAGE_FACTOR

_SCALE = {"rad": (1e3, "mrad"), "m": (1e3, "mm"), "s": (1e3, "ms"), "relative": (100.0, "%"),
          "of it": (100.0, "%")}  # fmt: skip
#: Sources of the budget in words, where they are no words themselves.
_SOURCES = {
    "positioner": "the NCPs' repeatability",
    "hinge": "the hinges' places",
    "datum": "the servo datums",
    "sensitivity": "the sensors' gain",
    "gravity": "the base's level",
    "zero": "the zeros",
    "mass": "the mass",
    "barycentre": "the barycentre",
    "instrument angles": "the tracker's angles",
    "instrument range": "the tracker's range",
    "motion": "what the motion adds",
}
#: Quantities named in one sentence, and the share of the half width from which on they are.
_NAMED, _NOTABLE = 2, 0.1


def half_widths(c: Calibration) -> FloatArray:
    """Half (m, 3) of each mounted sensor's 95 % intervals, rad, by the farther end.

    Where roll and yaw are not separable: the expanded uncertainty of the turns.
    """
    return np.array([_half_width(mounting) for mounting in c.mounted])


def _half_width(mounting: Mounting) -> list[float]:
    turns = mounting.turn_std or mounting.rpy_std
    ends = zip(mounting.interval.low, mounting.rpy, mounting.interval.high, turns, strict=True)
    return [
        COVERAGE_FACTOR * std if low is None or high is None else max(value - low, high - value)
        for low, value, high, std in ends
    ]


def headline(c: Calibration) -> str:
    """One number for all angles, what it counts, what it does not, and what it rests on."""
    which = "each" if c.determined.all() else "each that is determined"
    said = f"{which} within ± {1e3 * half_widths(c).max():.2g} mrad (95 %)"
    if c.rig.uncertainty.force_sensitivity > 0 and c.method != "tracker":
        said += ", the gain's tolerance included"
    draft = [line for finding in c.found(UNCONFIRMED) for line in finding.subject]
    if draft:
        loaded = (
            f"Confirm these lines of the rig file's draft before you load the angles: "
            f"{', '.join(draft)}. If they are right, the angles are known, {said}."
        )
    else:
        loaded = f"You may load these angles: {said}."
    return " ".join(filter(None, (loaded, exact_sentence(c), _rests_on(c))))


def exact_sentence(c: Calibration) -> str:
    """What is taken as exact, the worst first, with what a typical error of each would do."""
    notable = _NOTABLE * float(half_widths(c).max())
    found = sorted(c.taken_as_exact, key=lambda q: -float(effects(q).max()))
    named = [q for q in found if effects(q).max() > notable][:_NAMED]
    if not named:
        return ""
    parts = [
        f"{q.name} ({typical_error(q)}{by} by {1e3 * effects(q).max():.2g} mrad)"
        for q, by in zip(named, (" would move an angle", "", ""), strict=False)
    ]
    last = f" and {parts[-1]}" if len(parts) > 1 else parts[-1]
    return f"Taken as exact: {', '.join(parts[:-1])}{last}."


def effects(quantity: ExactQuantityResult) -> FloatArray:
    """Effects (n, 3), rad, on roll, pitch, yaw; of the turns where these are not separable."""
    return np.array([s.turn if s.rpy is None else s.rpy for s in quantity.supports])


def typical_error(quantity: ExactQuantityResult) -> str:
    """The error of each component, in a unit that reads well."""
    scale, unit = _SCALE.get(quantity.unit, (1.0, quantity.unit))
    return f"{scale * quantity.error:g} {unit}"


def summary(c: Calibration) -> tuple[Block, ...]:
    """The angles with ±."""
    half = half_widths(c)
    rows = [
        (m.name, *(f"{1e3 * v:.3f} ± {1e3 * h:.3f}" for v, h in zip(m.rpy, row, strict=True)))
        for m, row in zip(c.mounted, half, strict=True)
    ]
    rows += [(name, "undetermined", "", "") for name in c.undetermined]
    caption = "Installation angles in the BCS, mrad, 95 %; Rz(yaw)·Ry(pitch)·Rx(roll)"
    return (Table(caption, ("sensor", *ANGLES), tuple(rows)),)


def _rests_on(c: Calibration) -> str:
    """How much went in, how it fits, and what limits the least known angle, in a sentence."""
    parts = []
    if c.motion is not None:
        parts.append(f"{c.motion.seconds:.0f} s of motion")
    if c.fit is not None and (c.motion is None or c.fit.postures):
        left_out = len(c.fit.rejected)
        besides = f" ({left_out} left out)" if left_out else ""
        parts.append(f"{c.fit.postures} postures{besides}")
    if c.tracker is not None:
        parts.append(f"{c.tracker.get('points')} points of the tracker")
    if c.fit is not None and c.fit.dof:
        parts.append(f"scatter against stated {c.fit.birge:.2f}")
    for clock in c.clocks:
        known = f"± {1e3 * clock.offset_std:.2g} ms, ± {1e6 * clock.rate_std:.2g} ppm"
        parts.append(f"the clock of {clock.recorder} to {known}")
    limit = limiting_source(c)
    return f"It rests on {', '.join(parts)}{'; limited by ' * bool(limit)}{limit}."


def limiting_source(c: Calibration) -> str:
    """What contributes most to the least known angle; empty where no budget says."""
    if c.budget is None or len(c.budget.sources) < 2:
        return ""
    worst = int(np.argmax(c.rpy_std[c.determined].ravel()))
    share, angle = c.budget.shares[worst], c.budget.angles[worst]
    source = c.budget.sources[int(share.argmax())]
    said = _SOURCES.get(source, source)
    return f"{said} ({share.max():.0%} of the variance of {angle.angle} of {angle.support})"
