"""Results that a table and some sentences tell: a contact wrench over a log, the smallest contact
that is seen, a plan, a registration.
"""

from __future__ import annotations

from collections.abc import Iterator, Sequence
from typing import TYPE_CHECKING, Any

import numpy as np

from tdfscal.catalogue import documents, sentence, told
from tdfscal.findings import Finding, rejecting
from tdfscal.records import ANGLES, Rig
from tdfscal.reporting import layout
from tdfscal.reporting.layout import Block, Drawing, Facts, Report, Section, Table
from tdfscal.significance import COVERAGE_FACTOR
from tdfscal.wrench.contact_wrench import COMPONENTS

if TYPE_CHECKING:  # each command loads its own
    from tdfscal.detection.capability import Capability, Remedy, Request
    from tdfscal.planning.moving_plan import MovingPlan
    from tdfscal.planning.plan import Plan
    from tdfscal.planning.predicted_information import Forecast
    from tdfscal.trackercal import PointRegistration

#: Units of the components.
UNITS = ("N", "N", "N", "N·m", "N·m", "N·m")
#: Units of time, s, from where they are used.
_TIMES = ((86400.0, "days"), (3600.0, "h"), (60.0, "min"))
#: Share of the noise from which on a filter is said to do nothing.
_IDLE = 0.95
#: Remedies that are told.
_TOLD = 3
_DO = {
    "tare": "tare each sensor before the run",
    "set-to-zero": "set the wrench to zero before the run, hanging free for 3 s",
    "weigh": "weigh the terminal, and find its barycentre, exactly",
    "calibrate": "calibrate twice as well: four times the postures, or a harder squeeze",
    "filter": "filter at {:.3g} Hz",
}
_POINTS = "measured = rotation · reference + translation"


def _by_component(columns: dict[str, Sequence[str]]) -> Table:
    """Rows fx … mz with their units, and a column of text each."""
    rows = tuple(
        (axis, unit, *cells)
        for axis, unit, *cells in zip(COMPONENTS, UNITS, *columns.values(), strict=True)
    )
    return Table("", ("", "", *columns), rows, left=2)


def _place(point: Sequence[float]) -> str:
    return f"({', '.join(f'{x:g}' for x in point)}) m" if any(point) else "its origin"


def _number(value: float | None, form: str = ".3g", unknown: str = "unknown") -> str:
    return unknown if value is None or not np.isfinite(value) else format(value, form)


def wrench_report(summary: dict[str, Any]) -> Report:
    """Lay out the size of the wrench over all samples, with and without the calibration."""
    stops, largest = summary["stops"], summary["largest"]
    columns = {"rms": summary["rms"], "at stops": stops and stops["rms"],
               "uncalibrated": summary["rms_uncalibrated"], "std. unc.": summary["std"],
               "of it calibration": summary["std_calibration"]}  # fmt: skip
    table = _by_component(
        {
            name: [_number(of[component]) for component in COMPONENTS]
            for name, of in columns.items()
            if of is not None
        }
    )
    sentences = (
        _at_stops(summary),
        _noise(summary["noise"]),
        _zeros(summary["zeros"]),
        f"largest: force {largest['force']:.3g} N, torque {largest['torque']:.3g} N·m",
    )
    way = "quasi-static" if summary["quasi_static"] else "with inertia"
    return Report(
        f"Contact wrench of {summary['rows']} samples",
        f"{summary['start']:.6g} to {summary['end']:.6g} s, {way}; LCS, moments about "
        f"{_place(summary['about'])}",
        claim=_filter(summary["filter"]),
        sections=(Section("", (table, *filter(None, sentences))),),
    )


def _at_stops(summary: dict[str, Any]) -> str:
    """What part of a free wrench is motion."""
    if summary["stops"] is None:
        return ""
    return (
        f"{summary['stops']['rows'] / summary['rows']:.0%} of the samples lie at stops (hinges "
        "below 0.2 mm/s). Where nothing touches, what the wrench has more between them is the "
        "motion's."
    )


def _filter(f: dict[str, Any] | None) -> str:
    if f is None:
        return ""
    left = f["noise_left"]
    if left is None:
        return f"filter {f['kind']}: the sensors show no noise, and nothing is taken off"
    late = f"{1e3 * f['delay']:.3g} ms late" if f["delay"] else "without delay"
    said = f"filter {f['kind']}: {late}; leaves {100 * left:.0f} % of the sensors' noise of "
    said += f"{f['noise']:.3g} N"
    if left < _IDLE:
        return said
    return f"{said}: noise as slow as a force that walks by {f['walk']:g} N in 1 s stays"


def _noise(noise: dict[str, Any] | None) -> str:
    if noise is None or not (noise["dwells"] or noise["windows"]):
        return "noise of a sample: as declared; the log shows none"
    if noise["dwells"]:
        return f"noise of a sample: measured in {noise['dwells']} static dwells of the log"
    return (
        f"noise of a sample: measured in {noise['windows']} short windows, for the beginning of "
        "the log holds no static dwell; slower noise is not in it"
    )


def _zeros(zeros: dict[str, Any]) -> str:
    moved, age = zeros["moved"], zeros["age"]
    if moved == 0.0:
        return ""
    size = "by an unknown amount" if moved is None else f"by {moved:.2g} N (std)"
    since = "are of unknown age, here as if the log followed the calibration's,"
    if zeros["age_known"]:
        one, unit = next((each for each in _TIMES if abs(age) >= each[0]), (1.0, "s"))
        since = (
            f"held {abs(age) / one:.2g} {unit} {'before' if age >= 0 else 'after'} the log began,"
        )
    return f"the calibration's zeros {since} and may have moved {size} by its end"


def capability_report(
    found: Capability, request: Request, remedies: Sequence[Remedy], findings: Sequence[Finding],
    about: tuple[float, float, float], drawings: tuple[Drawing, ...], *, timed: bool,
) -> Report:  # fmt: skip
    """Lay out thresholds, smallest contacts, what they come from, and what would help."""
    bad = rejecting(findings)
    band = "no filter" if request.cutoff is None else f"filter {request.cutoff:g} Hz"
    length = f"{found.duration:.4g} s" if timed else "postures, as if an hour long"
    shares = {name: [_number(v, ".0%", "–") for v in of] for name, of in found.shares.items()}
    table = _by_component(
        {
            "threshold": [_number(v) for v in found.threshold],
            "smallest contact": [_number(v) for v in found.smallest_contact],
            **shares,
        }
    )
    better = (_remedy(one, found) for one in remedies[:_TOLD])
    lowers = layout.listed("What lowers the smallest contact", better)
    return Report(
        "Contact that this rig sees",
        f"path of {length}; {band}; LCS, moments about {_place(about)}",
        verdict="NOT AS IT IS" if bad else "",
        accepted=not bad,
        claim=f"At most {request.false_stops:g} false stops an hour and axis; the smallest contact "
        f"exceeds its threshold with {request.detect:.4g} probability.",
        reasons=tuple(told(one) for one in bad),
        warnings=() if not drawings else tuple(told(f) for f in findings if not f.rejects),
        sections=(Section("", (table, *lowers)), *layout.illustrated(drawings, {})),
    )


def _remedy(remedy: Remedy, found: Capability) -> str:
    """What to do, and what the worst force and torque come down to."""
    now, then = found.smallest_contact, remedy.smallest_contact
    said = []
    for first in (0, 3):
        rows = now[first : first + 3]
        if np.isfinite(rows).any():
            k = first + int(np.nanargmax(rows))
            said.append(f"{COMPONENTS[k]} {now[k]:.3g} → {then[k]:.3g} {UNITS[k]}")
    return f"{_DO[remedy.kind].format(remedy.value)}: {', '.join(said)}"


def plan_report(plan: Plan | MovingPlan) -> Report:
    """Lay out what to drive, and what to expect of it."""
    from tdfscal.planning.moving_plan import MovingPlan

    head, blocks = _motion(plan) if isinstance(plan, MovingPlan) else _postures(plan)
    rows = tuple(
        (name, *(_number(1e3 * v, ".3f", "–") for v in row))
        for name, row in zip(plan.rig.supports, plan.expected.rpy_std, strict=True)
    )
    caption = "Standard uncertainty to expect of the installation angles, mrad"
    angles = Table(caption, ("sensor", *ANGLES), rows)
    return Report(*head, sections=(Section("What to expect", (angles, *blocks)),))


def _postures(plan: Plan) -> tuple[tuple[str, str], Iterator[Block]]:
    limits, request = plan.request.limits, plan.request
    more = f", on top of {plan.given} postures recorded before" if plan.given else ""
    again = {0: "never", 1: "once"}.get(len(plan.returns), f"{len(plan.returns)} times")
    head = (
        f"Plan for {plan.rig.name}: {len(plan)} postures{more}",
        f"{again} the first again, tilt up to {np.rad2deg(limits.tilt):g}°, squeeze up to "
        f"{limits.squeeze:g} N, {request.noise:g} N noise per axis and posture",
    )
    return head, _of_postures(plan)


def _of_postures(plan: Plan) -> Iterator[Block]:
    expected, request = plan.expected, plan.request
    if expected.contact_force is not None and expected.contact_torque is not None:
        at = ", ".join(f"{v:g}" for v in request.at or plan.rig.acceptance.contact_rpy)
        stds = {"force, N": expected.contact_force, "torque, N·m": expected.contact_torque}
        rows = tuple((name, *(f"{v:.3f}" for v in std)) for name, std in stds.items())
        caption = f"… and of the contact wrench at roll, pitch, yaw {at} rad"
        yield Table(caption, ("", "x", "y", "z"), rows)
        if plan.rig.acceptance.states_contact:
            yield _contact(plan)
    before = "" if plan.before is None else f"; before the plan {1e3 * plan.before.mean:.3g} mrad"
    what = "contact wrench" if request.objective == "wrench" else "angles"
    reach = np.max(np.abs(plan.position - plan.position.mean(axis=0)), axis=(0, 1))
    yield (
        f"Mean {1e3 * expected.mean:.3g} mrad; {len(plan)} random postures within the same limits "
        f"{1e3 * plan.random.mean:.3g} mrad{before}; for the {what} the plan is "
        f"{plan.improvement:.2f} times better. Travel used about the middle: "
        f"{', '.join(f'±{v:.3f}' for v in reach)} m along x, y, z; way of the slowest axis "
        f"{plan.tour:.2f} m."
    )


def _contact(plan: Plan) -> str:
    """What the plan makes of the limits of the contact wrench."""
    from tdfscal.planning.plan import contact_conforms, contact_expanded

    stated = plan.rig.acceptance
    limits = (("force", "N", stated.contact_force), ("torque", "N·m", stated.contact_torque))
    sizes = contact_expanded(plan.expected) or ()
    parts = [
        f"{name} {size:.3g} {unit} of {limit:g}"
        for (name, unit, limit), size in zip(limits, sizes, strict=True)
        if limit is not None
    ]
    enough = contact_conforms(plan.rig, plan.expected)
    end = "enough" if enough else "not enough: squeeze harder, or tare and weigh better"
    expanded = f"expanded uncertainty (k = {COVERAGE_FACTOR:g})"
    return f"Contact wrench, {expanded} against its limit: {', '.join(parts)}: {end}."


def _motion(plan: MovingPlan) -> tuple[tuple[str, str], tuple[Block, ...]]:
    request, limits, used = plan.request, plan.request.limits, extremes(plan)
    mean, random = (1e3 * f.mean for f in (plan.expected, plan.random))
    way = ", ".join(f"±{v:.3f}" for v in used["travel"])
    head = (
        f"Motion for {plan.rig.name}: {request.duration:g} s without a stop",
        f"tilt up to {np.rad2deg(limits.tilt):g}°, speed up to {1e3 * request.speed:g} mm/s, "
        f"squeeze up to {limits.squeeze:g} N, noise of {request.noise:g} N in a force's mean over "
        "a second",
    )
    return head, (
        f"Mean {mean:.3g} mrad; random ones within the same limits {random:.3g} mrad: the plan "
        f"is {plan.improvement:.2f} times better.",
        f"Used of the limits: lean {np.rad2deg(used['tilt']):.2f}°, speed of a hinge "
        f"{1e3 * used['speed']:.1f} mm/s, way of a hinge {way} m along x, y, z, internal force "
        f"{used['squeeze']:.0f} N, force in all {used['force']:.0f} N.",
    )


def extremes(plan: MovingPlan) -> dict[str, Any]:
    """What the motion uses of its limits: rad, m/s, m per axis, N."""
    time = plan.time
    course = plan.trajectory.at(time)
    home = plan.request.limits.home + plan.rig.hinge
    speed = np.linalg.norm(np.diff(course.place, axis=0), axis=2).max() / (time[1] - time[0])
    return {
        "tilt": np.arccos(np.clip(course.rotation[:, 2, 2], -1, 1)).max(),
        "speed": speed,
        "travel": np.abs(course.place - home).max(axis=(0, 1)),
        "squeeze": np.linalg.norm(course.squeeze, axis=2).max(),
        "force": np.linalg.norm(course.force, axis=2).max(),
    }


def plan_document(
    plan: Plan | MovingPlan, path: str | None, waypoints: str | None
) -> dict[str, Any]:
    """Return a plan as plain JSON values, SI units; path, waypoints : the files."""
    from tdfscal.planning.moving_plan import MovingPlan

    limits = layout.document(plan.request.limits, "tilt squeeze force stiffness")
    more: dict[str, Any]
    if isinstance(plan, MovingPlan):
        course = plan.trajectory.at(plan.waypoints)
        limits["speed"] = plan.request.speed
        more = {
            "waypoints_output": waypoints,
            "duration": plan.request.duration,
            "used": extremes(plan),
            "frequency": plan.trajectory.lines.line / plan.request.duration,
            "waypoints": {
                "time": plan.waypoints,
                "position": course.position(plan.request.limits),
                "squeeze": course.squeeze,
            },
        }
    else:
        more = {
            "postures": len(plan),
            "returns": plan.returns + 1,
            "given": plan.given,
            "objective": plan.request.objective,
            "before": None if plan.before is None else _forecast(plan.rig, plan.before),
            "tour": plan.tour,
            "position": plan.position,
            "squeeze": plan.postures.squeeze,
            "approach": plan.approach,
        }
    return layout.document(
        plan,
        "improvement",
        format="tdfscal-plan/1",
        rig=plan.rig.name,
        output=path,
        noise=plan.request.noise,
        limits=limits,
        expected=_forecast(plan.rig, plan.expected),
        random=_forecast(plan.rig, plan.random),
        **more,
    )


def _forecast(rig: Rig, of: Forecast) -> dict[str, Any]:
    supports = layout.each_named(rig.supports, rpy_std=of.rpy_std)
    document: dict[str, Any] = {"mean_std": of.mean, "supports": supports}
    if of.contact_force is not None and of.contact_torque is not None:
        document["contact"] = {"force_std": of.contact_force, "torque_std": of.contact_torque}
    return document


def registration_report(r: PointRegistration) -> Report:
    """Lay out the transform with its standard uncertainties, and the residual of each point."""
    names = [*((name, "mrad") for name in ANGLES), *((f"translation {x}", "mm") for x in "xyz")]
    values = tuple(
        (name, f"{1e3 * value:.6f}", f"{1e3 * std:.6f}", unit)
        for (name, unit), value, std in zip(
            names, (*r.rpy, *r.translation), (*r.rpy_std, *r.translation_std), strict=True
        )
    )
    residuals = tuple(
        (name, *(f"{1e3 * v:.4f}" for v in (*d, np.linalg.norm(d))))
        for name, d in zip(r.names, r.residual, strict=True)
    )
    rotation = tuple(tuple(f"{v:+.12f}" for v in row) for row in r.rotation)
    scale = f"1 {1e6 * (r.scale - 1):+.1f} ppm, std. unc. {1e6 * r.scale_std:.1f} ppm"
    scale += "" if r.scaled else " (not applied)"
    if r.chi2 is None or r.p_value is None:
        noise = f"{1e3 * r.sigma:.3g} mm per coordinate" if r.sigma is not None else "none"
        fit = ("Noise", f"{noise}, from the residuals ({r.dof} degrees of freedom)")
    else:
        fit = ("Fit", layout.chi_squared(r.chi2, r.dof, r.p_value))
    blocks = (
        Table(f"{_convention(r)}; rotation = Rz(yaw)·Ry(pitch)·Rx(roll)",
              ("", "value", "std. unc.", "unit"), values),
        Table("Rotation, by rows", ("", "", ""), rotation, left=0),
        Table("Residuals, mm", ("point", "x", "y", "z", "length"), residuals),
        Facts((fit, ("Scale", scale))),
    )  # fmt: skip
    return Report(
        title=f"{len(r.names)} points fit within {1e3 * r.rms:.3g} mm (rms)",
        reasons=tuple(map(told, r.findings)),
        sections=(Section("Transform", blocks),),
    )


def _convention(r: PointRegistration) -> str:
    return _POINTS.replace("rotation", "scale · rotation") if r.scaled else _POINTS


def registration_document(r: PointRegistration, found: Sequence[Finding] = ()) -> dict[str, Any]:
    """Return plain JSON values; m and rad."""
    return layout.document(
        r,
        "rotation rpy rpy_std translation translation_std rms chi2 dof p_value sigma scale "
        "scale_std scale_estimated=scaled coplanar missing extra",
        convention=_convention(r),
        covariance={
            "definition": "of (d, t) with R_true = exp([d]x) · rotation, d in the measured frame; "
            "rad, m",
            "matrix": r.covariance,
        },
        points=layout.each_named(r.names, residual=r.residual),
        rejected=[{"name": p.name, "reason": sentence(p.finding)} for p in r.rejected],
        findings=documents([*found, *r.findings]),
    )
