"""The report of one calibration."""

from __future__ import annotations

import math
from collections.abc import Iterator, Sequence
from pathlib import PurePath

import numpy as np
from pydantic import BaseModel

from tdfscal.catalogue.numbers import (
    bracketed,
    count,
    coverage,
    estimated,
    measured,
    places,
    to_place,
    two_digits,
    with_std,
)
from tdfscal.files.calibration.document import Calibration
from tdfscal.files.calibration.evidence import (
    ClockResult,
    MotionResult,
    ResidualWrench,
    Scalar,
    has_delay,
)
from tdfscal.files.calibration.parameters import calibrated
from tdfscal.files.calibration.parts import RejectedPosture, Stretch
from tdfscal.files.rig.model import RigFile
from tdfscal.model import parameters
from tdfscal.numerics import so3
from tdfscal.numerics.distributions import INTERVAL_FACTOR, student_dof
from tdfscal.numerics.streams import covered
from tdfscal.records import ANGLES, BoolArray, FloatArray
from tdfscal.reporting import layout
from tdfscal.reporting.advice import advise
from tdfscal.reporting.figures import origin
from tdfscal.reporting.headline import (
    draft_lines,
    exact_blocks,
    headline,
    largest_source,
    parts,
    within,
)
from tdfscal.reporting.layout import Block, Drawing, Facts, Report, Row, Section, Table
from tdfscal.reporting.traceability import (
    campaign,
    campaign_facts,
    measured_on,
    provenance,
    report_digest,
    titled,
    warnings,
)
from tdfscal.significance import COVERAGE_FACTOR, INTERVAL_COVERAGE

_CONVENTION = "rotation = Rz(yaw)·Ry(pitch)·Rx(roll)"


def calibration_report(c: Calibration, drawings: tuple[Drawing, ...] = ()) -> Report:
    """Lay out a calibration; drawings are those of a page."""
    files = [PurePath(entry.path) for entry in c.inputs]
    alike = len({file.name for file in files}) < len(files)  # of several campaigns
    names = ", ".join("/".join(file.parts[-2:]) if alike else file.name for file in files)
    residuals = "residual-over-time" if c.motion else "residuals"
    blocks: dict[str, tuple[Block, ...]] = {
        "angles": (_angles(c),),
        residuals: (*_residual_wrench(c), *layout.listed("Left out", _left_out(c))),
    }
    linear = ", linear method of the paper" if c.estimator == "linear" else ""
    notes = (finding.told for finding in c.findings if finding.severity == "notes")
    return Report(
        title=titled(c),
        subtitle=f"{layout.METHODS[c.method]}{linear} of {len(c.supports)} sensors from {names}"
        + measured_on(c),
        verdict="; ".join((c.status.upper(), *(["UNSEALED"] if c.unsealed else []), *_alarms(c))),
        accepted=c.accepted,
        provisional=c.status == "provisional" or c.unsealed or bool(_alarms(c)),
        claim=headline(c) if c.accepted else "",
        reasons=tuple(_reasons(c)),
        tiles=tuple(_tiles(c)),
        summary=(_summary(c),),
        sections=(
            *layout.illustrated(drawings, blocks),
            Section("Zeros and load after the adjustment", _adjusted(c)),
            Section("Statistics", (Facts(tuple(_statistics(c))), *layout.listed("Notes", notes))),
            Section("What is taken as exact", exact_blocks(c)),
            Section("Rotations and gains", _matrices(c), page_only=True),
            Section("Lines to confirm", layout.listed("", draft_lines(c))),
            Section(
                "As stated in the rig file", (Facts(tuple(_as_stated(c.rig))),), page_only=True
            ),
            campaign(campaign_facts(c), c.rig.record()),
            provenance(c),
        ),
        warnings=warnings(c),
        advice=advise(c),
        created=layout.utc(c.created),
        number=(report_digest(c) or "unsealed")[:8],
    )


def _left_out(c: Calibration) -> Iterator[str]:
    """What of the log is not in the fit, and why; a date counts from the first dwell on."""
    rests, by_row = c.postures, any(one.rows == "postures" for one in c.rig.log or ())
    lost: list[tuple[str, RejectedPosture | Stretch]] = [
        *((f"posture {r.index + 1}", r) for r in (c.fit.rejected if c.fit else ())),
        *(("rest", s) for s in (rests.left_out if rests else ())),
    ]
    first = origin(min((*(rests.start if rests else ()), *(s.start for _, s in lost)), default=0.0))
    yield from layout.stretches(c.motion.rejected if c.motion else ())
    for name, s in lost:
        when = f"{s.start - first:.1f} to {s.end - first:.1f} s"
        yield f"{name} ({f'row {s.start:.0f}' if by_row else when}): {s.reason}"


def _alarms(c: Calibration) -> list[str]:
    """Sensors far from where the rig file has them, or perhaps others': said with the verdict."""
    turned, others = (c.found(code) for code in ("sensor-turned", "fields-crossed"))
    said = [f"{f.subject[0]} TURNED BY {np.degrees(f.size or 0.0):.0f}°" for f in turned]
    said += [f"PERHAPS {' AND '.join(f.subject)} EXCHANGED" for f in others]
    return said * c.accepted


def _reasons(c: Calibration) -> Iterator[str]:
    """Why the gate rejects, of all angles that are too uncertain the worst; what was left out."""
    uncertain = sorted(c.found("angle-uncertain"), key=lambda found: -(found.size or 0.0))
    if not c.accepted:
        yield from (found.text for found in c.found("postures-few", "range-exceeded"))
    for found in uncertain[:1]:
        more = f"; so have {count(len(uncertain) - 1, 'other angle')}" * (len(uncertain) > 1)
        yield f"{found.text}{more}"
    others = (found for found in c.reasons if found not in uncertain)
    yield from (found.text for found in (*others, *c.found("campaign-left-out")))


def _summary(c: Calibration) -> Table:
    """The angles with ±."""
    rows = [
        (m.name, *(with_std(1e3 * v, 1e3 * h) for v, h in zip(m.rpy, row, strict=True)))
        for m, row in zip(c.mounted, c.half_widths, strict=True)
    ]
    rows += [(name, "undetermined", "", "") for name in c.undetermined]
    caption = f"Installation angles, mrad, {coverage(c.accepted)}; {_CONVENTION}"
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
            source, share = largest_source(c, 3 * i + j)
            most = f"{source} {share:.0%}" if 0 < share < 1 else ""
            rows.append((m.name, angle, to_place(1e3 * value, place), spread, interval, most))
    rows += [(name, "undetermined", *[""] * 4) for name in c.undetermined]
    header = ("sensor", "angle", "value", "std. unc.", "95 % interval", "largest source")
    caption = f"Installation angles in the BCS, mrad; {_CONVENTION}"
    if not c.accepted:
        header = (*header[:4], "interval", header[5])
        caption += f"; intervals {coverage(c.accepted)}"
    return Table(caption, header, tuple(rows), left=2)


def _residual(c: Calibration) -> dict[str, ResidualWrench]:
    v = c.validation
    return {} if v is None else {"force": v.force, "moment": v.moment}


def _residual_wrench(c: Calibration) -> tuple[Table, ...]:
    last = f" of the last of the {parts(c)}" * (len(c.campaigns) > 1)
    where = f"leave-one-out postures{last}, about the LCS origin"
    if c.motion is not None:
        where = "stretches of the motion held out in turn, about the barycentre"
    return (layout.residual_table(_residual(c), where),) if c.validation is not None else ()


def _adjusted(c: Calibration) -> tuple[Table, ...]:
    """Zeros, mass and barycentre as estimated; the tracker sees none of them."""
    if c.method == "tracker":
        return ()
    zeros = tuple((s.name, *map(estimated, s.zero, s.zero_std)) for s in c.supports)
    mass, bary = c.terminal.mass, c.terminal.barycenter
    load = [("mass, kg", estimated(mass.value, mass.std))]
    load += [
        (f"barycentre {axis}, mm", estimated(1e3 * value, None if std is None else 1e3 * std))
        for axis, value, std in zip("xyz", bary.value, bary.std, strict=True)
    ]
    return (
        Table("Zero offsets ± std. unc. (k = 1), N, sensor frames", ("sensor", *"xyz"), zeros),
        Table("Terminal ± std. unc. (k = 1), LCS", ("", "value"), tuple(load)),
    )


def _matrices(c: Calibration) -> tuple[Table, ...]:
    """What a reading is multiplied by, as the convention says."""
    turn_std = so3.entry_std(c.rotation, c.rotation_covariance)
    tables = [_by_row("Rotation, sensor to BCS", c, c.determined, c.rotation, turn_std)]
    gained = np.array([support.sensitivity is not None for support in c.supports])
    if gained.any():
        tables.append(_by_row("Sensitivity, I + S", c, gained, c.sensitivity, gain_std(c)))
    return tuple(tables)


def gain_std(c: Calibration) -> FloatArray:
    """Standard uncertainties (n, 3, 3) of the sensors' sensitivities."""
    n = len(c.supports)
    std = np.sqrt(np.diagonal(calibrated(c).covariance))[parameters.layout(n)["sensitivity"]]
    return np.asarray(parameters.symmetric(std.reshape(n, 6)))


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


def _as_stated(rig: RigFile) -> Iterator[tuple[str, str]]:
    """All numbers but 0 that went into the result beside the log, by their keys."""
    for name in ("gravity", "terminal", "uncertainty", "drift"):
        yield from _stated(getattr(rig, name), name)
    for support in rig.supports:
        yield from _stated(support, support.name, "hinge", "nominal_rpy", "zero")


def _stated(block: BaseModel, place: str, *keys: str) -> Iterator[tuple[str, str]]:
    """Numbers of a block of the rig file, or of some keys of it, in the units that these name."""
    fields = type(block).model_fields
    for key in keys or fields:
        value, unit = getattr(block, key), (fields[key].description or "").partition(":")
        if isinstance(value, BaseModel) and not hasattr(value, "std"):
            yield from _stated(value, f"{place}.{key}")
        elif value:
            each = (value.value, value.std) if hasattr(value, "std") else (value,)
            said = (
                bracketed([f"{number:.9g}" for number in np.ravel(one)])
                if np.isfinite(one).all()
                else "unknown"
                for one in each
            )
            yield f"{place}.{key}", f"{', std '.join(said)} {unit[0] if unit[1] else ''}"


def _tiles(c: Calibration) -> Iterator[Row]:
    yield (
        f"each angle, {coverage(c.accepted)}",
        within(c),
        f"limit ± {measured(1e3 * c.limit_half_width)} mrad",
    )
    yield from layout.residual_tiles(_residual(c))
    if c.motion is not None:
        yield "in motion", f"{c.motion.seconds:.0f} s", "of the log in the fit"
    elif c.fit is not None:
        total = c.fit.postures + len(c.fit.rejected)
        yield "postures", f"{c.fit.postures} of {total}", "in the fit"
    elif c.tracker is not None:
        yield "points", f"{c.tracker.points}", "of the survey"
    judged, limit = c.fit or c.tracker, measured(c.rig.acceptance.birge_max)
    if judged is not None and isinstance(judged.birge, float):
        yield "residuals against stated", f"{judged.birge:.2f}", f"limit {limit}"


def _statistics(c: Calibration) -> Iterator[tuple[str, str]]:
    """How well the fit agrees with what is stated."""
    if (f := c.fit) is not None:
        if c.motion is None or f.postures:
            yield "Postures", f"{f.postures} used, {len(f.rejected)} rejected"
        for k in c.clocks:
            yield "Recorder", f"{k.recorder}: {layout.told_clock(k, c.rig.log or ())}"
        if c.motion is not None:
            yield from _motion(c.motion, c.clocks)
        sizes = f"force {measured(f.rms_force)} N, moment {measured(f.rms_moment)} N·m (rms)"
        yield "Residuals", sizes
        # The residuals widen every uncertainty by one factor only in a campaign at rest.
        at_rest = c.estimator != "linear" and c.motion is None and not c.campaigns
        scaled = f"; all noise was therefore scaled up by {f.birge:.2f} (Birge ratio)"
        tested = layout.chi_squared(f.chi2, f.dof, None if c.motion else f.p_value)
        yield "Fit", tested + scaled * (at_rest and f.birge > 1)
    if (t := c.tracker) is not None:
        yield "Survey", layout.chi_squared(t.chi2, t.dof, t.p_value)
    if c.observability is not None:
        alone = "by the log alone, " if c.method == "joint" else ""
        yield "Observability", alone + c.observability.verdict
    yield "Coverage", _coverage(c) if c.accepted else "none: the result is rejected"
    m, done = c.monte_carlo, "none was made: the intervals are those of the linear uncertainties"
    if m is not None:
        done = f"{m.trials} trials {m.verdict} the linear 95 % intervals"
    yield "Monte Carlo", done


def _coverage(c: Calibration) -> str:
    """Coverage factors of the intervals, and the degrees of freedom that they stand for."""
    factors = sorted(
        (high - low) / (2 * std)
        for m in c.mounted
        for low, high, std in zip(m.interval.low, m.interval.high, m.rpy_std, strict=True)
        if low is not None and high is not None and std > 0
    )
    if not factors:
        return f"expanded uncertainties with k = {COVERAGE_FACTOR:g}"
    said = f"{100 * INTERVAL_COVERAGE:g} % intervals, k = {_span(factors, '.2f')}"
    if c.monte_carlo is not None and c.monte_carlo.decides:
        return f"{said}, by the trials"
    dof = student_dof(INTERVAL_COVERAGE, (factors[0], factors[-1]))
    known = sorted(float(n) for n in dof if math.isfinite(n))
    return f"{said} for {_span(known, '.0f')} degrees of freedom" if known else said


def _span(values: Sequence[float], form: str) -> str:
    return " to ".join(dict.fromkeys(format(end, form) for end in (values[0], values[-1])))


def _motion(m: MotionResult, clocks: Sequence[ClockResult]) -> Iterator[tuple[str, str]]:
    """What the motion told besides the angles; clocks : of the other recorders."""
    lost = f"; {len(m.rejected)} stretches left out, {covered(m.rejected):.1f} s"
    yield "Motion", f"{m.seconds:.1f} s used{lost * bool(m.rejected)}"
    beyond = ", beyond the recorders' clocks" if clocks else ""
    delay = f"{_within(m.delay, 1e3)} ms (95 %), force after position{beyond}"
    yield "Delay", "stands in the other recorder's clock" if has_delay(clocks) else delay
    if m.rate is not None:
        ppm = f"{_within(m.rate, 1e6)} ppm (95 %)"
        yield "Clocks", f"run apart by {ppm}: the delay is that in the middle of the log"
    k, friction = INTERVAL_FACTOR, f"{_within(m.friction)} N·m (95 %)"
    if m.friction.value < 0:  # by chance: none drives a hinge
        friction = f"below {two_digits(k * m.friction.std)} N·m (k = {k:.2f})"
    yield "Friction", f"{friction} at each hinge"
    moments = (with_std(m.inertia.value[j][j], k * m.inertia.std[j][j]) for j in range(3))
    yield "Inertia", f"xx, yy, zz = {', '.join(moments)} kg m² (95 %) about the LCS origin"


def _within(known: Scalar, factor: float = 1.0) -> str:
    """A quantity with half its 95 % interval, times a factor of its unit."""
    return with_std(factor * known.value, factor * INTERVAL_FACTOR * known.std)
