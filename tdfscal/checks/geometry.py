"""Do the measured hinge positions fit the rigid terminal that the rig file states?

Hinges, datums and what gives have the rig file's uncertainties in the equations of
`hinge_distances`, so that χ² of the whole pattern is exact; a single cause is tested as if it had
no prior (theory, section 14). One hinge moves n − 1 distances; an offset of a positioner is, over
small tilts, the same as a hinge turned with it, and both are named.

Not to be told: what moves all hinges as one body, and what moves no distance (with three hinges,
along the normal of their plane).
"""

from __future__ import annotations

from dataclasses import dataclass
from typing import Final

import numpy as np

from tdfscal.checks.hinge_distances import (
    FRAMES,
    Cause,
    Equations,
    Suspect,
    equations,
    without_jolts,
)
from tdfscal.numerics.distributions import chi2_sf
from tdfscal.records import FloatArray, Rig
from tdfscal.significance import CAUSE_EXPLAINS, CAUSES_APART, FRAME_MISFIT, GEOMETRY_MISFIT

#: What every support gives, m/N, whatever is stated: at 2 N/µm nothing is harmed (theory, 11).
_GIVES: Final = 5e-7
#: A standard uncertainty of a place above this is none, m.
_UNKNOWN: Final = 1.0
#: What is wrong with {0}, and its cure; {1} is the size in the rig file's unit, upwards.
WORDS: Final = {
    "hinge": (
        "the hinge of {0} is not where it is stated",
        "measure the hinges again, or write `uncertainty.hinge: {1}` in rig.yaml",
    ),
    "datum": (
        "the servo coordinates of {0} are offset",
        "measure the servo datums, or write `uncertainty.datum: {1}` in rig.yaml",
    ),
    "scale": (
        "positions and hinges differ in scale",
        "check the scale of the positioners and of the hinges' survey",
    ),
    "compliance": (
        "the NCPs give between encoder and hinge",
        "see what is loose, or write `uncertainty.compliance: {{lateral: {1}, vertical: {1}}}` in "
        "rig.yaml",
    ),
}
#: Components of a frame's errors, and its cure.
_COMPONENTS: Final = {
    "turned": ("about x", "about y", "about z"),
    "scaled": ("along x", "along y", "along z"),
    "not square": ("y to z", "x to z", "x to y"),
}
_ALIGN: Final = (
    "align it, or calibrate the positioner; hinge distances show no error that all positioners "
    "share"
)
#: Share of what a cause explains that its second order, or another's, may leave.
_SECOND_ORDER: Final = 0.05
#: Equations that are left when all constant errors are known, for a frame to be judged.
_FEWEST: Final = 3


@dataclass(frozen=True, slots=True)
class Geometry:
    """What the distances between hinges say.

    p_value : that the stated uncertainties alone make such a pattern; by the likeliest of all
    tests. causes : the one that explains most and those that explain about as much; empty where
    nothing is wrong. explained : they leave nothing. scatter : by which the distances vary more
    from posture to posture than stated, at least 1.
    """

    p_value: float
    causes: tuple[Cause, ...]
    explained: bool
    scatter: float

    def told(self, supports: tuple[str, ...]) -> tuple[str, str]:
        """What is wrong, by how much, and the cures, in words."""
        what = ", or ".join(_told(cause, supports, self.scatter) for cause in self.causes)
        if not self.explained:
            what += ", and other distances disagree too"
        return what, "; or ".join(dict.fromkeys(_cure(cause) for cause in self.causes))


def _cure(cause: Cause) -> str:
    """What to do about it, in words."""
    if cause.kind not in WORDS:
        return _ALIGN
    return WORDS[cause.kind][1].format("", upwards(float(np.abs(cause.amount).max())))


def _told(cause: Cause, supports: tuple[str, ...], scatter: float) -> str:
    """What is wrong and by how much, in words; scatter : variance over the stated one."""
    name = "" if cause.support is None else supports[cause.support]
    size = float(np.linalg.norm(cause.amount))
    if cause.kind in ("hinge", "datum"):
        more = "" if np.isfinite(cause.std).all() else " or more"
        return f"{WORDS[cause.kind][0].format(name)}, by {1e3 * size:.3g} mm{more}"
    if cause.kind == "scale":
        return f"{WORDS[cause.kind][0]}, by {size:.2%}"
    if cause.kind in WORDS:
        return f"{WORDS[cause.kind][0]}, by {size:.2g} m/N"
    parts = [
        f"{words} by {1e3 * value:.2g} ± {1e3 * std * np.sqrt(scatter):.1g} mrad"
        for words, value, std in zip(_COMPONENTS[cause.kind], cause.amount, cause.std, strict=True)
        if np.isfinite(std)
    ]
    said = f"the frame of the positioner of {name} is {cause.kind}"
    return f"{said} ({', '.join(parts)})" if parts else said


def upwards(size: float) -> str:
    """A size with one significant digit, rounded up."""
    step = 10.0 ** np.floor(np.log10(max(size, np.finfo(float).tiny)))
    return f"{float(f'{np.ceil(size / step) * step:.1g}'):g}"


def examine(
    rig: Rig,
    position: FloatArray,
    variance: FloatArray,
    force: FloatArray | None = None,
    *,
    common: float = 0.0,
    frames: bool = False,
) -> Geometry:
    """Hold the distances between hinges against the rig file.

    Parameters
    ----------
    position : (K, n, 3), m, BCS, of NCPs. variance : (K,), m², of a coordinate, repeatability
        included; errors of different postures are independent.
    force : (K, n, 3), N, BCS, on the terminal; None where supports give nothing.
    common : m, standard uncertainty of a coordinate that all postures share, beside the datum's.
    frames : whether a positioner's frame may be blamed, where distances agree on average.
    """
    n, stated = rig.n, rig.declared
    keep = without_jolts(rig.hinge, position, variance)
    force = np.zeros_like(position) if force is None else force
    sums = equations(rig.hinge, position[keep], force[keep], variance[keep])
    nuisances = slice(0, 6 * n + 2)
    varying, known = sums.apart_from(nuisances)
    dof = sums.rows - known
    scatter = max(1.0, varying.chi2 / dof) if dof > 0 else 1.0
    prior = np.zeros(len(sums.score))
    prior[: 3 * n] = min(stated.hinge, _UNKNOWN)
    prior[3 * n : 6 * n] = min(float(np.hypot(stated.datum, common)), _UNKNOWN)
    prior[6 * n] = max(stated.compliance_lateral, _GIVES)
    prior[6 * n + 1] = max(stated.compliance_vertical, _GIVES)
    pattern = sums.scaled(scatter).given(prior)
    tried = [pattern.ask(*suspect) for suspect in _suspects(rig.hinge, len(prior))]
    best = max(tried, key=lambda cause: cause.weight)
    if frames and dof > _FEWEST:
        wrong = [pattern.ask(*suspect) for suspect in _frames(n, len(prior))]
        likely = max(wrong, key=lambda cause: cause.weight)
        p_value, rest = _varies(varying, dof, _frames(n, len(prior)), likely)
        if likely.weight > best.weight and p_value < FRAME_MISFIT:
            return Geometry(p_value, _alike([*tried, *wrong], likely), True, rest)
    chi2 = max(0.0, pattern.chi2 - varying.chi2 / scatter)
    p_value = min(
        1.0,
        2 * float(chi2_sf(chi2, known)),
        2 * len(tried) * min(cause.p_value for cause in tried),
    )
    if p_value > GEOMETRY_MISFIT:
        return Geometry(p_value, (), True, scatter)
    left = max(0.0, chi2 - best.statistic)
    explained = left < _SECOND_ORDER * best.statistic or bool(
        chi2_sf(left, max(known - best.unknowns, 1)) > CAUSE_EXPLAINS
    )
    return Geometry(p_value, _alike(tried, best), explained, scatter)


def _varies(
    varying: Equations, dof: int, frames: list[Suspect], likely: Cause
) -> tuple[float, float]:
    """That chance makes the distances vary with the place as a frame does, and what then remains.

    varying : what no constant error explains. The frame is held against the scatter without it, or
    it would excuse itself; second result : that scatter, variance over the stated one, at least 1.
    """
    (own,) = (f for f in frames if f[:2] == (likely.kind, likely.support))
    asked = varying.ask(*own)
    rest = max(1.0, (varying.chi2 - asked.statistic) / max(dof - asked.unknowns, 1))
    p_value = float(chi2_sf(asked.statistic / rest, asked.unknowns)) if asked.unknowns else 1.0
    return min(1.0, len(frames) * p_value), rest


def _alike(tried: list[Cause], best: Cause) -> tuple[Cause, ...]:
    """The best cause, and others that explain about as much."""
    near = [c for c in tried if best.weight - c.weight < CAUSES_APART and c.unknowns]
    return tuple(sorted(near, key=lambda cause: -cause.weight))


def _suspects(hinge: FloatArray, size: int) -> list[Suspect]:
    """Hinges, datums, the pattern's size, what gives; size : number of parameters P."""
    n, eye = len(hinge), np.eye(size)
    out: list[Suspect] = []
    for kind, first in (("hinge", 0), ("datum", 3 * n)):
        out += [(kind, i, eye[:, first + 3 * i : first + 3 * i + 3]) for i in range(n)]
    larger = np.zeros((size, 1))
    larger[: 3 * n, 0] = (hinge - hinge.mean(axis=0)).ravel()
    return [*out, ("scale", None, larger), ("compliance", None, eye[:, 6 * n : 6 * n + 2])]


def _frames(n: int, size: int) -> list[Suspect]:
    """Frames of positioners that are turned, scaled or not square."""
    starts = range(6 * n + 2, size, 3)
    return [
        (way, k // 3, np.eye(size)[:, start : start + 3])
        for k, (start, way) in enumerate(zip(starts, n * list(FRAMES), strict=True))
    ]
