"""Do the measured hinge positions fit the rigid terminal that the rig file states?

Hinges, datums and what gives have the rig file's uncertainties in the equations of
`hinge_distances`, so that χ² of the whole pattern is exact; a single cause is tested as if it had
no prior (theory, section 14). One hinge moves n − 1 distances; an offset of a positioner is, over
small tilts, the same as a hinge turned with it, and both are named.

Not to be told: what moves all hinges as one body, and what moves no distance (with three hinges,
along the normal of their plane).
"""

from __future__ import annotations

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
from tdfscal.findings import Finding, Value
from tdfscal.frozen import record
from tdfscal.model.postures import register
from tdfscal.numerics.distributions import chi2_sf
from tdfscal.records import FloatArray, Rig
from tdfscal.significance import CAUSE_EXPLAINS, CAUSES_APART, FRAME_MISFIT, GEOMETRY_MISFIT

#: What every support gives, m/N, whatever is stated: at 2 N/µm nothing is harmed (theory, 11).
_GIVES: Final = 5e-7
#: Share of the size beyond which positions are of another machine, or misnamed.
_SHAPE: Final = 2e-3
#: A standard uncertainty of a place above this is none, m.
_UNKNOWN: Final = 1.0
#: Code of a finding by the cause's kind, and the unit of its size.
CODES: Final = {
    "hinge": ("hinge-misplaced", "m"),
    "datum": ("positions-offset", "m"),
    "scale": ("scale-differs", ""),
    "compliance": ("supports-give", "m/N"),
    "turned": ("frame-turned", "rad"),
    "scaled": ("frame-scaled", ""),
    "not square": ("frame-not-square", "rad"),
}
#: Share of what a cause explains that its second order, or another's, may leave.
_SECOND_ORDER: Final = 0.05
#: Equations that are left when all constant errors are known, for a frame to be judged.
_FEWEST: Final = 3


def gross_limit(rig: Rig, force: FloatArray | None = None) -> float:
    """Rms distance from the rig file's pattern, m, above which no fit can be trusted.

    force : (K, n, 3), N, readings, under which declared supports give; None where none do.
    """
    stated, give = rig.declared, 0.0
    radius = float(np.linalg.norm(rig.hinge - rig.hinge.mean(axis=0), axis=1).mean())
    if force is not None:
        load = float(np.median(np.linalg.norm(force, axis=2), axis=0).max())
        # What is not measured carries a part of the weight at most.
        load = max(load, float(rig.mass.value) * rig.gravity)
        give = load * max(stated.compliance_lateral, stated.compliance_vertical)
    own = np.sqrt(stated.hinge**2 + stated.datum**2 + stated.positioner**2)
    return _SHAPE * radius + 6 * (float(own) + give)


def misfit(hinge: FloatArray, position: FloatArray) -> tuple[float, float]:
    """Medians over the postures: rms distance after registration in m, and height of LCS z."""
    R, T = register(hinge, position)
    off = position - (np.einsum("kab,nb->kna", R, hinge) + T[:, None])
    rms = np.sqrt(np.mean(np.sum(off**2, axis=2), axis=1))
    return float(np.median(rms)), float(np.median(R[:, 2, 2]))


@record
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

    def findings(self, supports: tuple[str, ...]) -> tuple[Finding, ...]:
        """What may be wrong, and by how much, the likeliest first."""
        return tuple(_finding(cause, supports, self) for cause in self.causes)


def _finding(cause: Cause, supports: tuple[str, ...], found: Geometry) -> Finding:
    subject = () if cause.support is None else (supports[cause.support],)
    code, unit = CODES[cause.kind]
    values: dict[str, Value] = {"elsewhere": not found.explained}
    values["or_more"] = not np.isfinite(cause.std).all()
    values["component"] = float(np.abs(cause.amount).max())
    if cause.kind in FRAMES:
        values["amount"] = cause.amount.tolist()
        values["std"] = (cause.std * np.sqrt(found.scatter)).tolist()
    size = float(np.linalg.norm(cause.amount))
    return Finding(code, subject, size, unit, values=values)


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
    n, size = rig.n, 15 * rig.n + 2
    keep = without_jolts(rig.hinge, position, variance)
    force = np.zeros_like(position) if force is None else force
    sums = equations(rig.hinge, position[keep], force[keep], variance[keep])
    nuisances = slice(0, 6 * n + 2)
    varying, known = sums.apart_from(nuisances)
    dof = sums.rows - known
    scatter = max(1.0, varying.chi2 / dof) if dof > 0 else 1.0
    pattern = sums.scaled(scatter).given(stated_errors(rig, common))
    tried = [pattern.ask(*suspect) for suspect in _suspects(rig.hinge, size)]
    best = max(tried, key=lambda cause: cause.weight)
    chi2 = max(0.0, pattern.chi2 - varying.chi2 / scatter)
    p_value = min(
        1.0,
        2 * float(chi2_sf(chi2, known)),
        2 * len(tried) * min(cause.p_value for cause in tried),
    )
    if frames and dof > _FEWEST:
        wrong = [pattern.ask(*suspect) for suspect in _frames(n, size)]
        likely = max(wrong, key=lambda cause: cause.weight)
        varies, rest = _varies(varying, dof, _frames(n, size), likely)
        # What another test has raised already is no further false alarm.
        level = FRAME_MISFIT if p_value > GEOMETRY_MISFIT else GEOMETRY_MISFIT
        if likely.weight > best.weight and varies < level:
            p_value = varies if varies < FRAME_MISFIT else p_value
            return Geometry(p_value, _alike([*tried, *wrong], likely), True, rest)
    if p_value > GEOMETRY_MISFIT:
        return Geometry(p_value, (), True, scatter)
    left = max(0.0, chi2 - best.statistic)
    explained = left < _SECOND_ORDER * best.statistic or bool(
        chi2_sf(left, max(known - best.unknowns, 1)) > CAUSE_EXPLAINS
    )
    return Geometry(p_value, _alike(tried, best), explained, scatter)


def stated_errors(rig: Rig, common: float = 0.0) -> FloatArray:
    """Standard uncertainty (P,) of every column of `equations` by the rig file; as in `examine`."""
    n, stated = rig.n, rig.declared
    out = np.zeros(15 * n + 2)
    out[: 3 * n] = min(stated.hinge, _UNKNOWN)
    out[3 * n : 6 * n] = min(float(np.hypot(stated.datum, common)), _UNKNOWN)
    out[6 * n] = max(stated.compliance_lateral, _GIVES)
    out[6 * n + 1] = max(stated.compliance_vertical, _GIVES)
    return out


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
