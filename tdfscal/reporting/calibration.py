"""The report of one calibration."""

from __future__ import annotations

import math
from collections.abc import Iterable, Iterator, Sequence
from pathlib import PurePath

import numpy as np

from tdfscal.catalogue.numbers import bracketed, count, places, rounded, to_place, with_std
from tdfscal.files.calibration.document import Calibration
from tdfscal.files.calibration.evidence import ClockResult, MotionResult, ResidualWrench, has_delay
from tdfscal.files.calibration.parameters import calibrated
from tdfscal.model import parameters
from tdfscal.numerics import so3
from tdfscal.numerics.distributions import student_dof
from tdfscal.numerics.streams import covered
from tdfscal.records import ANGLES, BoolArray, FloatArray
from tdfscal.reporting import layout
from tdfscal.reporting.advice import advise
from tdfscal.reporting.figures import clock
from tdfscal.reporting.headline import (
    draft_lines,
    exact_table,
    half_widths,
    headline,
    largest_source,
    within,
)
from tdfscal.reporting.layout import Block, Drawing, Facts, Report, Row, Section, Table, chi_squared
from tdfscal.reporting.traceability import (
    campaign,
    campaign_facts,
    measured_on,
    provenance,
    report_digest,
    warnings,
)
from tdfscal.significance import COVERAGE_FACTOR, INTERVAL_COVERAGE

_CONVENTION = "rotation = Rz(yaw)·Ry(pitch)·Rx(roll)"


def calibration_report(c: Calibration, drawings: tuple[Drawing, ...] = ()) -> Report:
    """Lay out a calibration; drawings are those of a page."""
    files = [PurePath(entry.path) for entry in c.inputs]
    alike = len({file.name for file in files}) < len(files)  # of several campaigns
    names = ", ".join("/".join(file.parts[-2:]) if alike else file.name for file in files)
    rejected = layout.postures(c.fit.rejected, clock(c)) if c.fit is not None else ()
    left_out = layout.stretches(c.motion.rejected) if c.motion is not None else ()
    pieces = c.postures.left_out if c.postures is not None else ()
    blocks: dict[str, tuple[Block, ...]] = {
        "angles": (_angles(c),),
        "residuals" if c.motion is None else "residual-over-time": (
            *_residual_wrench(c),
            *layout.listed("Stretches left out", left_out),
        ),
        "timeline": (
            *layout.listed("Rejected postures", rejected),
            *layout.listed("Stretches of rest left out", layout.rests(pieces, clock(c))),
        ),
    }
    linear = ", linear method of the paper" if c.estimator == "linear" else ""
    notes = (finding.told for finding in c.findings if finding.severity == "notes")
    return Report(
        title=c.rig.name,
        subtitle=f"{layout.METHODS[c.method]}{linear} of {len(c.supports)} sensors from {names}"
        + measured_on(c),
        verdict=c.status.upper(),
        accepted=c.accepted,
        provisional=c.status == "provisional",
        claim=headline(c) if c.accepted else "",
        reasons=tuple(_reasons(c)),
        tiles=_tiles(c),
        summary=(_summary(c),),
        sections=(
            *layout.illustrated(drawings, blocks),
            Section("Zeros and load after the adjustment", _adjusted(c)),
            Section("Statistics", (Facts(statistics(c)), *layout.listed("Notes", notes))),
            Section("What is taken as exact", exact_table(c)),
            Section("Rotations, gains and budget", (*_matrices(c), *_budget(c)), page_only=True),
            Section("Lines to confirm", layout.listed("", draft_lines(c))),
            Section("As stated in the rig file", (Facts(_stated(c)),), page_only=True),
            campaign(campaign_facts(c), c.rig.record()),
            provenance(c),
        ),
        warnings=warnings(c),
        advice=advise(c),
        created=layout.utc(c.created),
        number=(report_digest(c) or "unsealed")[:8],
    )


def _reasons(c: Calibration) -> Iterator[str]:
    """Why the gate rejects, of all angles that are too uncertain the worst; what was left out."""
    uncertain = sorted(c.found("angle-uncertain"), key=lambda found: -(found.size or 0.0))
    if not c.accepted:
        yield from (found.text for found in c.found("postures-few"))
    for found in uncertain[:1]:
        more = f"; so have {count(len(uncertain) - 1, 'other angle')}" * (len(uncertain) > 1)
        yield f"{found.text}{more}"
    others = (found for found in c.reasons if found not in uncertain)
    yield from (found.text for found in (*others, *c.found("campaign-left-out")))


def _summary(c: Calibration) -> Table:
    """The angles with ±."""
    rows = [
        (m.name, *(with_std(1e3 * v, 1e3 * h) for v, h in zip(m.rpy, row, strict=True)))
        for m, row in zip(c.mounted, half_widths(c), strict=True)
    ]
    rows += [(name, "undetermined", "", "") for name in c.undetermined]
    caption = f"Installation angles, mrad, 95 %; {_CONVENTION}"
    return Table(caption, ("sensor", *ANGLES), tuple(rows))


def _angles(c: Calibration) -> Table:
    """Every angle in mrad."""
    rows: list[Row] = []
    for i, m in enumerate(c.mounted):
        each = zip(ANGLES, m.rpy, m.rpy_std, m.interval.low, m.interval.high, strict=True)
        for j, (angle, value, std, low, high) in enumerate(each):
            spread, interval, place = "–", "–", 3  # where roll and yaw are one turn
            if std is not None and low is not None and high is not None:
                place = places(1e3 * std)
                spread, *ends = (to_place(1e3 * v, place) for v in (std, low, high))
                interval = " to ".join(ends)
            source = _dominant(c, 3 * i + j)
            said = to_place(1e3 * value, place)
            rows.append((m.name, angle, said, spread, interval, source))
    rows += [(name, "undetermined", *[""] * 4) for name in c.undetermined]
    header = ("sensor", "angle", "value", "std. unc.", "95 % interval", "largest source")
    caption = f"Installation angles in the BCS, mrad; {_CONVENTION}"
    return Table(caption, header, tuple(rows), left=2)


def _dominant(c: Calibration, row: int) -> str:
    """The largest contribution to an angle's variance and its share."""
    source, share = largest_source(c, row)
    return f"{source} {share:.0%}" if 0 < share < 1 else ""


def _residual(c: Calibration) -> dict[str, ResidualWrench]:
    v = c.validation
    return {} if v is None else {"force": v.force, "moment": v.moment}


def _residual_wrench(c: Calibration) -> tuple[Table, ...]:
    where = "leave-one-out postures, about the LCS origin"
    if c.motion is not None:
        where = "stretches of the motion held out in turn, about the barycentre"
    return (layout.residual_table(_residual(c), where),) if c.validation is not None else ()


def _zero(value: float | None, std: float | None) -> str:
    if value is None:
        return "not measured"
    return with_std(value, std) if std is not None else f"{value:.2f} (open)"


def _adjusted(c: Calibration) -> tuple[Table, ...]:
    """Zeros, mass and barycentre as estimated; the tracker sees none of them."""
    if c.method == "tracker":
        return ()
    zeros = tuple((s.name, *map(_zero, s.zero, s.zero_std)) for s in c.supports)
    mass, bary = c.terminal.mass, c.terminal.barycenter
    found = [("mass, kg", mass.value, mass.std)]
    found += [
        (f"barycentre {axis}, mm", 1e3 * value, None if std is None else 1e3 * std)
        for axis, value, std in zip("xyz", bary.value, bary.std, strict=True)
    ]
    terminal = tuple(
        (name, f"{value:.3f}", "open")
        if std is None
        else (name, *(to_place(v, places(std)) for v in (value, std)))
        for name, value, std in found
    )
    return (
        Table("Zero offsets ± std. unc. (k = 1), N, sensor frames", ("sensor", *"xyz"), zeros),
        Table("Terminal, LCS", ("", "value", "std. unc."), terminal),
    )


def _matrices(c: Calibration) -> tuple[Table, ...]:
    """What a reading is multiplied by, as the convention says."""
    n = len(c.supports)
    turn_std = so3.entry_std(c.rotation, c.rotation_covariance)
    tables = [_by_row("Rotation, sensor to BCS", c, c.determined, c.rotation, turn_std)]
    gained = np.array([support.sensitivity is not None for support in c.supports])
    if gained.any():
        std = np.sqrt(np.diagonal(calibrated(c).covariance))[parameters.layout(n)["sensitivity"]]
        gain_std = parameters.symmetric(std.reshape(n, 6))
        tables.append(_by_row("Sensitivity, I + S", c, gained, c.sensitivity, gain_std))
    return tuple(tables)


def _by_row(
    caption: str, c: Calibration, which: BoolArray, value: FloatArray, std: FloatArray
) -> Table:
    """Matrices (n, 3, 3) of some sensors, each entry by the digits of its standard uncertainty."""
    rows = tuple(
        (c.support_names[i], axis, *map(with_std, value[i, j], std[i, j]))
        for i in np.flatnonzero(which)
        for j, axis in enumerate("xyz")
    )
    return Table(f"{caption}; ± std. unc. (k = 1)", ("sensor", "row", *"xyz"), rows, left=2)


def _budget(c: Calibration) -> tuple[Table, ...]:
    """Standard uncertainty of every angle by source, mrad; their squares add up."""
    if c.budget is None:
        return ()
    rows = tuple(
        (f"{a.angle} of {a.support}", *(_root(a.variance.get(name)) for name in c.budget.sources))
        for a in c.budget.angles
    )
    return (Table("Budget: standard uncertainty by source, mrad", ("", *c.budget.sources), rows),)


def _root(variance: float | None) -> str:
    return "–" if variance is None else f"{1e3 * math.sqrt(max(variance, 0.0)):.3f}"


def _stated(c: Calibration) -> tuple[tuple[str, str], ...]:
    """The quantities with the standard uncertainties that went into the result."""
    rig = c.rig
    load, u = rig.terminal, rig.uncertainty
    tares = [f"{s.name} {_each(s.zero.value)}, std {_each(s.zero.std)} N" for s in rig.supports]
    middle = [
        _each(1e3 * size for size in row) for row in (load.barycenter.value, load.barycenter.std)
    ]
    return (
        ("Mass", f"{load.mass.value:g} kg, std {load.mass.std:g} kg"),
        ("Barycentre", f"{' mm, std '.join(middle)} mm"),
        ("Tare", "; ".join(tares)),
        (
            "Gravity",
            f"{rig.gravity.magnitude:.9g} m/s², std of the level {rig.gravity.tilt_std:g} rad",
        ),
        (
            "NCPs, hinges, datums",
            f"std {1e6 * u.positioner:g}, {1e6 * u.hinge:g}, {1e6 * u.datum:g} µm",
        ),
        ("Force noise, gain", f"std {u.force_noise:g} N, {100 * u.force_sensitivity:g} %"),
        ("Hinge friction", f"std {u.hinge_moment:g} N·m"),
    )


def _each(values: Iterable[float]) -> str:
    return bracketed([f"{value:g}" for value in values])


def _tiles(c: Calibration) -> tuple[Row, ...]:
    limits = c.rig.acceptance
    tiles = [
        ("each angle, 95 %", within(c), f"limit ± {rounded(1e3 * c.limit_half_width)} mrad"),
        *layout.residual_tiles(_residual(c)),
    ]
    birge = c.tracker.birge if c.tracker is not None else None
    if c.motion is not None:
        tiles.append(("in motion", f"{c.motion.seconds:.0f} s", "of the log in the fit"))
    elif c.fit is not None:
        total = c.fit.postures + len(c.fit.rejected)
        tiles.append(("postures", f"{c.fit.postures} of {total}", "in the fit"))
    elif c.tracker is not None and isinstance(birge, float):
        tiles.append(("points", str(c.tracker.points), "of the survey"))
    if c.fit is not None:
        birge = c.fit.birge
    if isinstance(birge, float):
        tiles.append(
            ("residuals against stated", f"{birge:.2f}", f"limit {rounded(limits.birge_max)}")
        )
    return tuple(tiles)


def statistics(c: Calibration) -> tuple[tuple[str, str], ...]:
    """How well the fit agrees with what is stated."""
    facts = []
    if c.fit is not None:
        f = c.fit
        if c.motion is None or f.postures:
            facts.append(("Postures", f"{f.postures} used, {len(f.rejected)} rejected"))
        facts += [
            ("Recorder", f"{k.recorder}: {layout.told_clock(k, c.rig.log or ())}") for k in c.clocks
        ]
        facts += _motion(c.motion, c.clocks) if c.motion is not None else []
        facts += [
            (
                "Residuals",
                f"force {rounded(f.rms_force)} N, moment {rounded(f.rms_moment)} N·m (rms)",
            ),
            ("Fit", chi_squared(f.chi2, f.dof, None if c.motion else f.p_value) + _scaled(c)),
        ]
    if c.tracker is not None:
        t = c.tracker
        facts.append(("Survey", chi_squared(t.chi2, t.dof, t.p_value)))
    if c.observability is not None:
        alone = "by the log alone, " if c.method == "joint" else ""
        facts.append(("Observability", alone + c.observability.verdict))
    facts.append(("Coverage", _coverage(c)))
    done = "none was made: the intervals are those of the linear uncertainties"
    if (m := c.monte_carlo) is not None:
        done = f"{m.trials} trials {m.verdict} the linear 95 % intervals"
    facts.append(("Monte Carlo", done))
    return tuple(facts)


def _scaled(c: Calibration) -> str:
    """That the residuals widened every uncertainty; by one factor only in a campaign at rest."""
    of_stops = c.estimator != "linear" and c.motion is None and not c.campaigns
    if c.fit is None or c.fit.birge <= 1 or not of_stops:
        return ""
    scale = f"{c.fit.birge:.2f} (Birge ratio)"
    return f"; all noise was therefore scaled up by {scale}"


def _coverage(c: Calibration) -> str:
    """Coverage factors of the intervals, and the degrees of freedom that they stand for."""
    factors = [
        (high - low) / (2 * std)
        for m in c.mounted
        for low, high, std in zip(m.interval.low, m.interval.high, m.rpy_std, strict=True)
        if low is not None and high is not None and std > 0
    ]
    if not factors:
        return f"expanded uncertainties with k = {COVERAGE_FACTOR:g}"
    ends = (min(factors), max(factors))
    said = f"{100 * INTERVAL_COVERAGE:g} % intervals, k = {_span(ends, '.2f')}"
    if c.monte_carlo is not None and c.monte_carlo.decides:
        return f"{said}, by the trials"
    dof = sorted(float(n) for n in student_dof(INTERVAL_COVERAGE, ends) if math.isfinite(n))
    return f"{said} for {_span(dof, '.0f')} degrees of freedom" if dof else said


def _span(ends: tuple[float, ...] | list[float], form: str) -> str:
    return " to ".join(dict.fromkeys(format(end, form) for end in ends))


def _motion(m: MotionResult, clocks: Sequence[ClockResult]) -> list[tuple[str, str]]:
    """What the motion told besides the angles; clocks : of the other recorders."""
    lost = covered(m.rejected)
    rejected = f"; {len(m.rejected)} stretches left out, {lost:.1f} s" if m.rejected else ""
    moments = ", ".join(with_std(m.inertia.value[k][k], m.inertia.std[k][k]) for k in range(3))
    beyond = ", beyond the recorders' clocks" if clocks else ""
    delay = f"{with_std(1e3 * m.delay.value, 1e3 * m.delay.std)} ms, force after position{beyond}"
    rates = []
    if m.rate is not None:
        ppm = f"{with_std(1e6 * m.rate.value, 1e6 * m.rate.std)} ppm"
        rates = [("Clocks", f"run apart by {ppm}: the delay is that in the middle of the log")]
    return [
        ("Motion", f"{m.seconds:.1f} s used{rejected}"),
        ("Delay", "stands in the other recorder's clock" if has_delay(clocks) else delay),
        *rates,
        ("Friction", f"{with_std(m.friction.value, m.friction.std)} N·m at each hinge"),
        ("Inertia", f"xx, yy, zz = {moments} kg m² about the LCS origin"),
    ]
