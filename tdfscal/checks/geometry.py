"""Do the measured hinge positions fit the rigid terminal that the rig file states?

The distances between hinges are asked, without any force. n hinges have 3n coordinates and a rigid
terminal six freedoms, so that 3n − 6 equations per posture are left. Seen in the LCS, and there
across the rigid motions,

    R_kᵀ (p_ik − T_k) − r_i  =  δr_i + R_kᵀ (d_i + C F_ik + E_i (p_ik − p̄_i) + noise)

with hinges displaced by δr_i, datums d_i, supports that give by C, and E_i a positioner's frame
that is turned, scaled or not square. They enter by their sums, of one size for any number of
postures. Hinges, datums and what gives have the rig file's uncertainties, so that χ² of the whole
pattern is exact; a single cause is tested as if it had no prior (theory, section 14). One hinge
moves n − 1 distances; an offset of a positioner is, over small tilts, the same as a hinge turned
with it, and both are named. Not to be told: what moves all hinges as one body, or no distance
(with three hinges, along the normal of their plane).
"""

from __future__ import annotations

from typing import Final

import numpy as np

from tdfscal.findings import Finding, Value
from tdfscal.frozen import record
from tdfscal.model.postures import register
from tdfscal.model.statics import wrench
from tdfscal.numerics import so3
from tdfscal.numerics.distributions import chi2_quantile, chi2_sf
from tdfscal.numerics.information import Equations, Information
from tdfscal.numerics.least_squares import ask
from tdfscal.records import FloatArray, Rig
from tdfscal.significance import (
    CAUSE_EXPLAINS,
    CAUSES_APART,
    FRAME_MISFIT,
    GEOMETRY_MISFIT,
    MOST_REJECTED,
)

#: What every support gives, m/N, whatever is stated: at 2 N/µm nothing is harmed (theory, 11).
_GIVES: Final = 5e-7
_UNKNOWN: Final = 1.0  # m; a place with a larger standard uncertainty is not known
#: A frame that is scaled not about the middle of its travel, but from the zero of its coordinates.
FROM_ZERO: Final = "scaled from zero"
#: End of the same where the hinges were measured by these positions: they are off with it, and only
#: what turns with the terminal is seen of it.
_MEASURED: Final = ", and hinges"
#: Code of a finding by the cause's kind, and the unit of its size.
CODES: Final = {
    "hinge": ("hinge-misplaced", "m"),
    "datum": ("positions-offset", "m"),
    f"datum{_MEASURED}": ("positions-offset", "m"),
    "scale": ("scale-differs", ""),
    "compliance": ("supports-give", "m/N"),
    "turned": ("frame-turned", "rad"),
    "scaled": ("frame-scaled", ""),
    FROM_ZERO: ("frame-scaled", ""),
    f"{FROM_ZERO}{_MEASURED}": ("frame-scaled", ""),
    "not square": ("frame-not-square", "rad"),
}
#: Standard uncertainties by which a component is seen to be wrong.
_SURE: Final = 3.0
#: Share of what a cause explains that its second order, or another's, may leave.
_SECOND_ORDER: Final = 0.05
_FEWEST: Final = 3  # equations, beside all constant errors, by which a frame is judged
#: Positions are not known better than this, m: rounding, and a terminal that bends.
_FLOOR: Final = 2e-7
#: Ways in which a frame is wrong, with E of each of its components by one, (3, 3, 3).
_WAYS: Final[dict[str, FloatArray]] = {
    "turned": so3.hat(np.eye(3)),
    "scaled": np.eye(3)[:, :, None] * np.eye(3)[:, None],
    "not square": np.abs(so3.hat(np.eye(3))),
}
#: Share of a cause's best-known component that another must have to be known at all.
_SEEN: Final = 1e-6
#: Noise of positions in a frame's column, 1 per equation, is that of the residuals: with this many
#: times equations² of information it lends a test √(1 / this) standard deviations (theory, 13).
_NOISY: Final = 10.0
#: A posture this many times farther from the others' middle than their median is a jolt.
_JOLT: Final = 100.0
#: A cause: its kind, its support, and how its unknowns move the parameters, (P, g).
Suspect = tuple[str, int | None, FloatArray]
_CHUNK: Final = 1024  # postures summed at once


@record
class Cause:
    """One thing that may be wrong, and how well it alone explains the distances.

    kind : a key of `CODES`. support : whose; None: of all.
    statistic : fall of χ², by so many `unknowns`. amount, std : (g,), m (hinge in the LCS, datum
    in the BCS), relative (scale, frames), or m/N lateral and vertical; ∞ where nothing is seen.
    step : (P,), by how much the parameters of `equations` are off with it.
    """

    kind: str
    support: int | None
    statistic: float
    unknowns: int
    amount: FloatArray
    std: FloatArray
    step: FloatArray

    def p_value(self, variance: float = 1.0) -> float:
        """That chance alone, of this variance, asks as much for this cause."""
        return float(chi2_sf(self.statistic / variance, self.unknowns)) if self.unknowns else 1.0

    @property
    def weight(self) -> float:
        """Fall of χ² beyond its unknowns."""
        return self.statistic - self.unknowns

    @property
    def clear(self) -> FloatArray:
        """The amount (g,) of what is seen to be wrong, 0 elsewhere; all, where nothing is."""
        seen = np.abs(self.amount) > _SURE * self.std
        return np.where(seen | ~seen.any(), self.amount, 0.0)

    @property
    def scales(self) -> list[float]:
        """What coordinates x, y, z are to be multiplied by, no finer than it is known; or none."""
        if self.kind != "scale" and FROM_ZERO not in self.kind:
            return []
        digits = np.clip(1 - np.floor(np.log10(self.std * np.ones(3))), 2, 7)
        size = self.clear * np.ones(3)  # of the terminal, or of what is logged
        factors = 1.0 / (1.0 + size) if self.kind == "scale" else 1.0 - size
        return [round(float(each), int(n)) for each, n in zip(factors, digits, strict=True)]

    @property
    def errors(self) -> dict[str, FloatArray]:
        """Of hinges and datums (3n,), what gives (2,), frames about their middles (n, 3, 3); SI."""
        n = len(self.step) // 15
        hinge, datum, compliance, frame = np.split(self.step, [3 * n, 6 * n, 6 * n + 2])
        wrong = np.tensordot(frame.reshape(n, -1), np.concatenate(list(_WAYS.values())), 1)
        return {"hinge": hinge, "datum": datum, "compliance": compliance, "frame": wrong}


def _cause(
    sums: Equations, kind: str, support: int | None, columns: FloatArray, least: float = 0.0
) -> Cause:
    """Test a cause whose unknowns move the parameters by columns (P, g).

    least : information of an unknown below which it is none.
    """
    information = columns.T @ sums.seen.matrix @ columns
    own = np.trace(columns.T @ columns)  # a cause without any column is not seen
    floor = max(_SEEN * np.linalg.norm(information, 2), np.finfo(float).tiny * own)
    found = ask(information, columns.T @ sums.seen.score, max(floor, least))
    fall, unknowns = float(found.statistic), int(found.unknowns)
    step = columns @ found.amount
    return Cause(kind, support, fall, unknowns, found.amount, found.std, step)


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

    def findings(self, rig: Rig) -> tuple[Finding, ...]:
        """What may be wrong, and by how much, the likeliest first, each once."""
        told = [self._told(cause, rig) for cause in self.causes]
        return tuple({(one.code, one.subject): one for one in reversed(told)}.values())[::-1]

    def _told(self, cause: Cause, rig: Rig) -> Finding:
        (code, unit), supports = CODES[cause.kind], rig.supports
        values: dict[str, Value] = {
            "elsewhere": not self.explained,
            "or_more": not np.isfinite(cause.std).all(),
            "component": float(np.abs(cause.amount).max()),
        }
        subject = () if cause.support is None else (supports[cause.support],)
        if cause.scales:
            values |= {"turned": [*(subject or ("<each>",))], "signs": cause.scales}
        if code.startswith("frame"):
            values["amount"] = cause.clear.tolist()
            values["std"] = (cause.std * np.sqrt(self.scatter)).tolist()
            values["every"] = not subject
        if cause.kind.endswith(_MEASURED):
            hinge = rig.hinge + cause.errors["hinge"].reshape(-1, 3)
            own = slice(None) if cause.support is None else [cause.support]
            values |= {"measured": [*(subject or supports)], "hinges": hinge[own].ravel().tolist()}
        return Finding(code, subject, float(np.linalg.norm(cause.amount)), unit, values=values)


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
    keep = without_jolts(rig.hinge, position, variance)
    force = np.zeros_like(position) if force is None else force
    sums = equations(rig.hinge, position[keep], force[keep], variance[keep])
    varying, known = sums.apart_from(np.arange(15 * rig.n + 2) < 6 * rig.n + 2)
    dof = sums.rows - known
    scatter = max(1.0, varying.chi2 / dof) if dof > 0 else 1.0
    pattern = sums.scaled(scatter).given(stated_errors(rig, common))
    places, suspects = _suspects(rig.hinge, position[keep])
    tried = [_cause(pattern, *place) for place in places]
    best = max(tried, key=lambda cause: cause.weight)
    chi2 = max(0.0, pattern.chi2 - varying.chi2 / scatter)
    p_value = min(
        1.0,
        2 * float(chi2_sf(chi2, known)),
        2 * len(tried) * min(cause.p_value() for cause in tried),
    )
    if frames and dof > _FEWEST:
        wrong = [_cause(pattern, *suspect) for suspect in suspects]
        place = int(np.argmax([cause.weight for cause in wrong]))
        likely, alone = wrong[place], _cause(varying, *suspects[place], _NOISY * dof**2)
        # Held against the scatter without it, or it would excuse itself.
        rest = max(1.0, (varying.chi2 - alone.statistic) / max(dof - alone.unknowns, 1))
        varies = min(1.0, len(suspects) * alone.p_value(rest))
        # What another test has raised already is no further false alarm.
        raised, ahead = p_value <= GEOMETRY_MISFIT, likely.weight - best.weight
        level = GEOMETRY_MISFIT if raised else FRAME_MISFIT
        if (ahead > 0 and varies < level) or (raised and ahead > CAUSES_APART):
            p_value = varies if varies < FRAME_MISFIT else p_value
            whole = sums.scaled(rest).given(stated_errors(rig, common))
            explained = _explains(_cause(whole, *suspects[place]), whole.chi2, dof + known)
            return Geometry(p_value, _alike([*tried, *wrong], likely), explained, rest)
    if p_value > GEOMETRY_MISFIT:
        return Geometry(p_value, (), True, scatter)
    return Geometry(p_value, _alike(tried, best), _explains(best, chi2, known), scatter)


def _explains(cause: Cause, chi2: float, dof: int) -> bool:
    """Whether a cause leaves nothing remarkable of χ²."""
    left = max(0.0, chi2 - cause.statistic)
    chance = chi2_sf(left, max(dof - cause.unknowns, 1))
    return bool(left < _SECOND_ORDER * cause.statistic or chance > CAUSE_EXPLAINS)


def stated_errors(rig: Rig, common: float = 0.0) -> FloatArray:
    """Standard uncertainty (P,) of every column of `equations` by the rig file; as in `examine`."""
    n, stated = rig.n, rig.declared
    out = np.zeros(15 * n + 2)
    out[: 3 * n] = min(stated.hinge, _UNKNOWN)
    out[3 * n : 6 * n] = min(float(np.hypot(stated.datum, common)), _UNKNOWN)
    out[6 * n] = max(stated.compliance_lateral, _GIVES)
    out[6 * n + 1] = max(stated.compliance_vertical, _GIVES)
    return out


def _alike(tried: list[Cause], best: Cause) -> tuple[Cause, ...]:
    """The best cause, and others that explain about as much."""
    near = [c for c in tried if best.weight - c.weight < CAUSES_APART and c.unknowns]
    # From its zero or about its middle is one, where neither explains more.
    return tuple(sorted(near, key=lambda c: -c.weight - (FROM_ZERO in c.kind)))


def _suspects(hinge: FloatArray, position: FloatArray) -> tuple[list[Suspect], list[Suspect]]:
    """Hinges, datums, the pattern's size, what gives; and frames that are turned, scaled or not
    square, of a positioner or of all alike.
    """
    n, eye, middle = len(hinge), np.eye(15 * len(hinge) + 2), position.mean(axis=0)
    measured, upright = eye.copy(), so3.project(register(hinge, position)[0].mean(axis=0))
    measured[: 3 * n, 3 * n : 6 * n] = -np.kron(np.eye(n), upright.T)
    three = [eye[:, first : first + 3] for first in range(0, 6 * n, 3)]
    larger = eye[:, : 3 * n] @ (hinge - hinge.mean(axis=0)).reshape(-1, 1)
    places: list[Suspect] = [(("hinge", "datum")[i // n], i % n, three[i]) for i in range(2 * n)]
    places += [(f"datum{_MEASURED}", i, measured @ three[n + i]) for i in range(n)]
    places += [("scale", None, larger), ("compliance", None, eye[:, 6 * n : 6 * n + 2])]
    out: dict[tuple[str, int | None], FloatArray] = {}
    for i in range(n):
        for kind, first in zip(_WAYS, range(6 * n + 2 + 9 * i, 15 * n + 2, 3), strict=False):
            out[kind, i] = eye[:, first : first + 3]
        out[FROM_ZERO, i] = out["scaled", i] + three[n + i] * middle[i]
        out[FROM_ZERO + _MEASURED, i] = measured @ out[FROM_ZERO, i]
    for kind in ("scaled", FROM_ZERO, FROM_ZERO + _MEASURED):
        out[kind, None] = np.sum([out[kind, i] for i in range(n)], axis=0)
    return places, [(*key, columns) for key, columns in out.items()]


def _across(hinge: FloatArray) -> FloatArray:
    """Orthonormal directions (n, 3, 3n − 6) of the hinges' places that no rigid motion moves."""
    arm = hinge - hinge.mean(axis=0)
    spokes = np.swapaxes(wrench(arm[None])[0], -1, -2).reshape(3 * len(hinge), 6)
    return np.linalg.qr(spokes, mode="complete")[0][:, 6:].reshape(len(hinge), 3, -1)


def without_jolts(
    hinge: FloatArray, position: FloatArray, variance: FloatArray
) -> FloatArray | slice:
    """Postures (a mask) whose shape is that of the others; all, where too many differ."""
    R, T = register(hinge, position)
    shape = np.einsum("kba,knb->kna", R, position - T[:, None])
    across = np.tensordot(shape, _across(hinge), axes=2)
    away = np.sum((across - np.median(across, axis=0)) ** 2, axis=1) / (variance + _FLOOR**2)
    usual = max(float(np.median(away)), float(chi2_quantile(0.5, across.shape[1])))
    keep = away <= _JOLT * usual
    return keep if np.mean(~keep) <= MOST_REJECTED else slice(None)


def equations(
    hinge: FloatArray, position: FloatArray, force: FloatArray, variance: FloatArray
) -> Equations:
    """Sum the equations of K postures.

    Columns: δr (3n), d (3n), compliance lateral and vertical, E of each positioner (9n).
    """
    n, across, centre = len(hinge), _across(hinge), position.mean(axis=0)
    m, ways = across.shape[2], np.concatenate(list(_WAYS.values()))
    total = np.zeros((15 * n + 3, 15 * n + 3))
    for first in range(0, len(position), _CHUNK):
        p, F = position[first : first + _CHUNK], force[first : first + _CHUNK]
        K, (R, T) = len(p), register(hinge, p)
        turned = np.einsum("iam,kba->kmib", across, R)  # a displacement in the BCS, seen across
        fixed = np.broadcast_to(across.transpose(2, 0, 1), (K, m, n, 3))
        off = np.tensordot(np.einsum("kba,knb->kna", R, p - T[:, None]) - hinge, across, axes=2)
        columns = [
            fixed.reshape(K, m, -1),
            turned.reshape(K, m, -1),
            np.einsum("kmib,kib->km", turned[..., :2], F[..., :2])[..., None],
            np.einsum("kmi,ki->km", turned[..., 2], F[..., 2])[..., None],
            np.einsum("kmib,wbc,kic->kmiw", turned, ways, p - centre, optimize=True).reshape(
                K, m, -1
            ),
            off[..., None],
        ]
        rows = np.concatenate(columns, axis=2)
        rows /= np.sqrt(variance[first : first + _CHUNK] + _FLOOR**2)[:, None, None]
        rows = rows.reshape(K * m, -1)
        total += rows.T @ rows
    seen = Information(total[:-1, :-1], total[:-1, -1])
    return Equations(seen, float(total[-1, -1]), m * len(position))
