"""A calibration as plain rows: what every rendering shows, worked out once."""

from __future__ import annotations

import math
from dataclasses import dataclass
from pathlib import PurePath

from tdfscal.files.calibration.document import Calibration
from tdfscal.reporting.advice import advise
from tdfscal.reporting.figures.log_time import clock

METHODS = {
    "self": "self-calibration",
    "tracker": "laser-tracker calibration",
    "joint": "joint calibration, self and tracker",
}
ESTIMATORS = {"ml": "", "linear": ", linear method of the paper"}


@dataclass(frozen=True, slots=True)
class AngleRow:
    """One angle in mrad.

    turn : from the nominal mounting; None where that is zero, and the turn the value itself.
    source : the largest contribution and its share of the variance.
    """

    support: str
    angle: str
    value: float
    std: float
    low: float
    high: float
    source: str
    turn: float | None = None


@dataclass(frozen=True, slots=True)
class Summary:
    """Everything a reader needs in the order of reading: verdict, angles, proof, what next."""

    title: str
    subtitle: str
    accepted: bool
    reasons: tuple[str, ...]
    angles: tuple[AngleRow, ...]
    zeros: tuple[tuple[str, str, str, str], ...]
    facts: tuple[tuple[str, str], ...]
    proof: tuple[tuple[str, str, str, str, str], ...]
    rejected: tuple[str, ...]
    warnings: tuple[str, ...]
    advice: tuple[str, ...]

    @property
    def verdict(self) -> str:
        """One word."""
        return "ACCEPTED" if self.accepted else "REJECTED"

    @property
    def turned(self) -> bool:
        """Whether a nominal mounting makes an angle and the turn of its sensor two things."""
        return any(row.turn is not None for row in self.angles)

    @property
    def angle_title(self) -> str:
        """What the table of the angles holds."""
        turn = ", and their turn from the nominal mounting" if self.turned else ""
        return f"Installation angles in the BCS{turn}, mrad"

    def angle_table(self) -> tuple[tuple[str, ...], list[tuple[str, ...]]]:
        """Header and rows of the angles for a terminal."""
        turned = self.turned
        header = ("sensor", "angle", "value", *(["turn"] if turned else []))
        header += ("std. unc.", "95 % interval", "mostly from")
        rows = [
            (
                row.support if row.angle == "roll" else "",
                row.angle,
                f"{row.value:.3f}",
                *([_turn(row)] if turned else []),
                f"{row.std:.3f}",
                f"{row.low:.3f} to {row.high:.3f}",
                row.source,
            )
            for row in self.angles
        ]
        return header, rows


def _turn(row: AngleRow) -> str:
    return f"{row.value if row.turn is None else row.turn:+.3f}"


def summarise(calibration: Calibration) -> Summary:
    """Work out the rows."""
    c = calibration
    method = METHODS[c.method] + (ESTIMATORS[c.estimator] if c.estimator else "")
    names = ", ".join(PurePath(entry.path).name for entry in c.inputs)
    return Summary(
        title=c.rig.name,
        subtitle=f"{method} of {len(c.supports)} sensors from {names}",
        accepted=c.status == "accepted",
        reasons=c.quality.reasons,
        angles=_angles(c),
        zeros=_zeros(c),
        facts=_facts(c),
        proof=_proof(c),
        rejected=_rejected(c),
        warnings=(*c.cautions, *c.warnings),
        advice=advise(c),
    )


def _angles(c: Calibration) -> tuple[AngleRow, ...]:
    rows = []
    for i, (support, stated) in enumerate(zip(c.supports, c.rig.supports, strict=True)):
        for j, angle in enumerate(("roll", "pitch", "yaw")):
            rows.append(
                AngleRow(
                    support.name,
                    angle,
                    1e3 * support.rpy[j],
                    1e3 * support.rpy_std[j],
                    1e3 * support.rpy_interval.low[j],
                    1e3 * support.rpy_interval.high[j],
                    _largest_source(c, 3 * i + j),
                    _from_nominal(support.rpy[j], stated.nominal_rpy[j]),
                )
            )
    return tuple(rows)


def _from_nominal(angle: float, nominal: float) -> float | None:
    """Difference in mrad, the short way round; None where the nominal angle is zero."""
    return 1e3 * math.remainder(angle - nominal, math.tau) if nominal else None


def _largest_source(c: Calibration, row: int) -> str:
    if c.budget is None or len(c.budget.sources) < 2:
        return ""
    variance = c.budget.angles[row].variance
    name = max(variance, key=lambda source: variance[source])
    total = sum(variance.values())
    return f"{name} {variance[name] / total:.0%}" if total > 0 else ""


def _zeros(c: Calibration) -> tuple[tuple[str, str, str, str], ...]:
    """Zero offsets with their standard uncertainties in N, where the method estimates them."""
    if c.method == "tracker":
        return ()
    rows = []
    for support in c.supports:
        x, y, z = (
            f"{value:.2f} ± {std:.2f}" if std is not None else f"{value:.2f} (open)"
            for value, std in zip(support.zero, support.zero_std, strict=True)
        )
        rows.append((support.name, x, y, z))
    return tuple(rows)


def _facts(c: Calibration) -> tuple[tuple[str, str], ...]:
    facts = []
    if c.fit is not None:
        f = c.fit
        facts += [
            ("Postures", f"{f.postures} used, {len(f.rejected)} rejected"),
            ("Residuals", f"force {f.rms_force:.2g} N, moment {f.rms_moment:.2g} N·m (rms)"),
            ("Fit", f"χ² = {f.chi2:.4g} for {f.dof} degrees of freedom, p = {_p(f.p_value)}"),
        ]
    if c.tracker is not None:
        t = c.tracker
        facts.append(
            (
                "Survey",
                f"χ² = {t['chi2']:.4g} for {t['dof']} degrees of freedom, "
                f"p = {_p(float(str(t['p_value'])))}",
            )
        )
    if c.observability is not None:
        alone = "by the log alone, " if c.method == "joint" else ""
        facts.append(("Observability", alone + c.observability.verdict))
    if c.monte_carlo is not None:
        m = c.monte_carlo
        said = "confirm" if m.linear_interval_validated else "do not confirm"
        facts.append(("Monte Carlo", f"{m.trials} trials {said} the linear 95 % intervals"))
    return tuple(facts)


def _p(value: float) -> str:
    return f"{value:.2f}" if value >= 0.01 else f"{value:.1g}"


def _proof(c: Calibration) -> tuple[tuple[str, str, str, str, str], ...]:
    """Held-out contact wrench: quantity, rms without, rms with, largest without, largest with."""
    if c.validation is None:
        return ()
    v = c.validation
    return tuple(
        (
            name,
            f"{w.rms_before:.3g} {unit}",
            f"{w.rms_after:.3g} {unit}",
            f"{w.max_before:.3g} {unit}",
            f"{w.max_after:.3g} {unit}",
        )
        for name, unit, w in (("force", "N", v.force), ("moment", "N·m", v.moment))
    )


def _rejected(c: Calibration) -> tuple[str, ...]:
    if c.fit is None:
        return ()
    time = clock(c)
    return tuple(
        f"posture {r.index + 1}"
        + (
            f" ({time.stretch(r.start, r.end)})"
            if r.start is not None and r.end is not None
            else ""
        )
        + f": {r.reason}"
        for r in c.fit.rejected
    )
