"""Results that a table and some sentences tell: capability, plan, registration."""

from __future__ import annotations

from collections.abc import Iterator, Mapping, Sequence
from pathlib import Path
from typing import TYPE_CHECKING, Any

import numpy as np

from tdfscal.catalogue import sentence, told
from tdfscal.catalogue.numbers import measured, places, quantity, rounded, to_place, with_std
from tdfscal.findings import Finding, unfit
from tdfscal.numerics.distributions import INTERVAL_FACTOR, coverage_factor
from tdfscal.records import ANGLES, Rig
from tdfscal.reporting import layout
from tdfscal.reporting.layout import Block, Facts, Report, Section, Table
from tdfscal.reporting.traceability import certificates
from tdfscal.significance import COVERAGE_FACTOR, INTERVAL_COVERAGE
from tdfscal.wrench.contact_wrench import COMPONENTS

if TYPE_CHECKING:  # each command loads its own
    from tdfscal.detection.capability import Capability, Request
    from tdfscal.planning.motion import MovingPlan
    from tdfscal.planning.plan import Plan
    from tdfscal.planning.predicted_information import Forecast
    from tdfscal.trackercal.best_fit import PointRegistration

#: Units of the components.
UNITS = ("N", "N", "N", "N·m", "N·m", "N·m")
#: Share of the variance from which on noise is explained.
_MOSTLY = 0.5
#: What lowers the smallest contact, by what most of it comes from.
_LOWERS = {
    "zeros": "Tare each sensor before the run, or set the wrench to zero there.",
    "load": "Weigh the terminal, and find its barycentre.",
    "gain": "Have the sensors' gains calibrated.",
    "calibration": "Calibrate with more postures and a harder squeeze.",
    "moves": "State `terminal.inertia`: without it what the motion adds counts as noise.",
    "slow": "Let the sensors warm up: noise as slow as this passes any filter.",
    "noise": "Filter (--filter HZ).",
    "filtered": "Filter lower (--filter HZ).",
    "low": "Quieten the sensors (cables, amplifiers): a still lower filter would be late.",
}
#: Hz; a filter as low as this delays a machine's stop by a tenth of a second.
_LOW = 3.0


def by_component(columns: Mapping[str, Sequence[str]]) -> Table:
    """Rows fx … mz with their units, and a column of text each."""
    rows = zip(COMPONENTS, UNITS, *columns.values(), strict=True)
    return Table("", ("", "", *columns), tuple(rows), left=2)


def place_of(point: Sequence[float]) -> str:
    """Return a point of the LCS that moments are about."""
    return f"({', '.join(f'{x:g}' for x in point)}) m" if any(point) else "its origin"


def number(value: float | None, form: str = "", unknown: str = "unknown") -> str:
    """Return a number, or what stands for one that is not known."""
    if value is None or not np.isfinite(value):
        return unknown
    return format(value, form) if form else measured(value, 3)


def capability_report(
    found: Capability, request: Request, findings: Sequence[Finding],
    about: tuple[float, float, float], *, timed: bool,
) -> Report:  # fmt: skip
    """Lay out thresholds, smallest contacts, what they come from, and what would help."""
    bad = unfit(findings)
    # What is too coarse for the rig file's limit is a threshold all the same.
    none = [f for f in bad if f.code != "contact-unseen"]
    band = "no filter" if request.cutoff is None else f"filter {request.cutoff:g} Hz"
    length = f"{rounded(found.duration, 4)} s" if timed else "postures, as if an hour long"
    sizes = {"threshold": found.threshold, "smallest contact": found.smallest_contact}
    columns = {name: [number(v) for v in of] for name, of in sizes.items()}
    for name, share in found.shares.items():
        columns[name] = ["< 1 %" if 0.0 < v < 0.01 else number(v, ".0%", "–") for v in share]
    blocks: tuple[Block, ...] = (by_component(columns), *_noise(found, request))
    unstated = any(f.code == "path-inertia-unknown" for f in findings)
    most = (_most(found, request, c, unstated) for c in found.worst)
    return Report(
        "contact that is seen",
        f"path of {length}; {band}; LCS, moments about {place_of(about)}",
        verdict="NO THRESHOLDS FOR A MACHINE" if none else "UNSEEN" if bad else "",
        accepted=not bad,
        claim="" if none else f"A machine that stops at these thresholds stops falsely at most "
        f"{request.false_stops:g} times an hour and axis, and sees the smallest contact below with "
        f"{rounded(100 * request.detect, 4)} % probability; the shares say what that comes from.",
        reasons=tuple(map(told, bad)),
        warnings=tuple(told(f) for f in findings if f not in bad),
        sections=() if any(f.rejects for f in none) else (Section("", blocks),),
        advice=(
            *certificates(findings),
            *dict.fromkeys(_LOWERS[source] for source in most if not none),
        ),
    )  # fmt: skip


def _most(found: Capability, request: Request, c: int, unstated: bool) -> str:
    """What most of a component's smallest contact comes from; unstated : the inertia."""
    source = max(found.shares, key=lambda source: found.shares[source][c])
    if source == "noise" and found.noise[c].slow > found.noise[c].fast:
        return "moves" if unstated and not found.resting else "slow"
    if source == "noise" and request.cutoff is not None:
        return "filtered" if request.cutoff > _LOW else "low"
    return source


def _noise(found: Capability, request: Request) -> Iterator[str]:
    """What noise is, where it counts most."""
    worst = [c for c in found.worst if found.shares["noise"][c] > _MOSTLY]
    if worst and not any(found.noise[c].std for c in worst):
        yield "The noise is what the rig file declares of a posture (uncertainty.force_noise)."
    elif worst:
        sizes = (f"{measured(found.noise[c].std, 3)} {UNITS[c]} in {COMPONENTS[c]}" for c in worst)
        of = "of single samples" if request.cutoff is None else "behind the filter"
        where = "at the stops of the path" if found.resting else "along the path, motion included"
        less = "" if found.resting else ". Less at rest, or where the inertia is stated"
        yield f"Noise is the scatter {of} {where}: {', '.join(sizes)}{less}."


def plan_report(plan: Plan | MovingPlan, findings: Sequence[Finding]) -> Report:
    """Lay out what to drive, and what to expect of it."""
    from tdfscal.planning.motion import MovingPlan

    rows = tuple(
        (name, *(number(1e3 * INTERVAL_FACTOR * v, ".3f", "–") for v in row))
        for name, row in zip(plan.rig.supports, plan.expected.rpy_std, strict=True)
    )
    caption = "Half of the 95 % interval to expect of the installation angles, mrad"
    table = Table(caption, ("sensor", *ANGLES), rows)
    title, drive, contact, used = _motion(plan) if isinstance(plan, MovingPlan) else _postures(plan)
    mean = f"On average ± {measured(1e3 * INTERVAL_FACTOR * plan.expected.mean, 3)} mrad."
    expected = Section("What to expect", (table, *contact, f"{mean} {used}"))
    return Report(title, drive, sections=(expected,), warnings=tuple(map(told, findings)))


def _postures(plan: Plan) -> tuple[str, str, Sequence[Block], str]:
    limits, request = plan.request.limits, plan.request
    reach = np.abs(plan.position - plan.position.mean(axis=0)).max(axis=(0, 1)).round(6)
    return (
        f"Plan for {plan.rig.name}: {len(plan)} postures",
        f"tilt up to {np.rad2deg(limits.tilt):g}°, {_squeezed(plan)}; "
        f"{rounded(request.noise, 3)} N noise per axis and posture beside the rig file's; "
        f"home ({', '.join(f'{v:.3f}' for v in limits.home)}) m"
        f"{', the mean of what was recorded' if limits.recorded else ''}",
        tuple(_contact(plan)),
        f"Travel: {', '.join(f'±{rounded(v)}' for v in reach)} m along x, y, z.",
    )


def _squeezed(plan: Plan | MovingPlan) -> str:
    """How hard the plan squeezes, and by what; what the positioners add unasked informs too."""
    limits = plan.request.limits
    said = f"squeeze up to {limits.squeeze:g} N"
    if limits.stiffness is None:
        return f"{said} by servoed forces"
    said += f" by displacements against {quantity(limits.stiffness, 'N/m')}"
    unasked = limits.repeatability_force(plan.rig)
    told = f"; the positioners' own scatter adds {measured(unasked, 3)} N at random, which "
    told += "informs as well"
    return said + (told if unasked else "")


def _contact(plan: Plan) -> Iterator[Block]:
    """What the plan makes of the contact wrench, where the rig file limits it."""
    from tdfscal.planning.predicted_information import contact_excess, contact_expanded

    sizes = contact_expanded(plan.expected)
    limits = plan.rig.acceptance.contact_limits
    if sizes is None or all(limit is None for *_, limit in limits):
        return
    parts = [
        f"{name} {measured(size, 3)} {unit} of {limit:g}"
        for (name, unit, _, limit), size in zip(limits, sizes, strict=True)
        if limit is not None
    ]
    end = "enough"
    if contact_excess(plan.rig, plan.expected) > 1.0:
        end = "not enough: squeeze harder, or tare and weigh better"
    known = f"expanded uncertainty (k = {COVERAGE_FACTOR:g})"
    yield f"Contact wrench, {known} against its limit: {', '.join(parts)}: {end}."


def _motion(plan: MovingPlan) -> tuple[str, str, Sequence[Block], str]:
    request, limits, used = plan.request, plan.request.limits, plan.used
    return (
        f"Motion for {plan.rig.name}: {request.duration:g} s without a stop",
        f"tilt up to {np.rad2deg(limits.tilt):g}°, speed up to {1e3 * request.speed:g} mm/s, "
        f"{_squeezed(plan)}; {request.noise:g} N noise in the mean force of a second",
        (),
        f"Used: tilt {np.rad2deg(used['tilt']):.2f}°, speed {1e3 * used['speed']:.1f} mm/s, travel "
        f"{', '.join(f'±{rounded(v)}' for v in used['travel'])} m along x, y, z, internal force "
        f"{used['squeeze']:.0f} N, force in all {used['force']:.0f} N.",
    )


def plan_document(plan: Plan | MovingPlan, path: Path | None) -> dict[str, Any]:
    """Return a plan as plain JSON values, SI units; path : the file."""
    from tdfscal.planning.motion import MovingPlan

    limits = layout.document(plan.request.limits, "tilt squeeze force stiffness")
    more: dict[str, Any]
    if isinstance(plan, MovingPlan):
        limits["speed"] = plan.request.speed
        own = "used duration=request.duration"
        more = {"frequency": plan.motion.line / plan.request.duration}
    else:
        own = "position approach squeeze=postures.squeeze"
        more = {"postures": len(plan)}
    return layout.document(
        plan,
        f"rig=rig.name noise=request.noise {own}",
        format="tdfscal-plan/1",
        output=path,
        limits=limits,
        expected=_forecast(plan.rig, plan.expected),
        **more,
    )


def _forecast(rig: Rig, of: Forecast) -> dict[str, Any]:
    contact = "force_std=contact_force torque_std=contact_torque"
    known = of.contact_force is not None and of.contact_torque is not None
    return {
        "mean_std": of.mean,
        "supports": layout.each_named(rig.supports, rpy_std=of.rpy_std),
        **({"contact": layout.document(of, contact)} if known else {}),
    }


def registration_report(r: PointRegistration, of_files: Sequence[Finding]) -> Report:
    """Lay out the transform with its standard uncertainties, and the residual of each point.

    of_files : what was found of the point files.
    """
    names = *(f"{angle}, mrad" for angle in ANGLES), *(f"translation {axis}, mm" for axis in "xyz")
    stds = (*r.rpy_std, *r.translation_std)
    k = float(coverage_factor(INTERVAL_COVERAGE, r.noise_dof))
    values = tuple(
        (name, *(to_place(1e3 * v, places(1e3 * std)) for v in (value, std, k * std)))
        for name, value, std in zip(names, (*r.rpy, *r.translation), stds, strict=True)
    )
    residuals = tuple(
        (name, *(to_place(1e3 * v, 4) for v in (*d, np.linalg.norm(d))))
        for name, d in zip(r.names, r.residual, strict=True)
    )
    known = places(float(r.rpy_std.min()))
    rotation = tuple(tuple(to_place(v, known, "+") for v in row) for row in r.rotation)
    scale = f"1 + ({with_std(1e6 * (r.scale - 1), 1e6 * r.scale_std)}) ppm (not applied)"
    if r.chi2 is None or r.p_value is None:
        noise = f"{rounded(1e3 * r.sigma, 3)} mm per coordinate" if r.sigma is not None else "none"
        fit = ("Noise", f"{noise}, from the residuals ({r.dof} degrees of freedom)")
    else:
        fit = ("Fit", layout.chi_squared(r.chi2, r.dof, r.p_value))
    blocks = (
        Table(f"{_CONVENTION}; rotation = Rz(yaw)·Ry(pitch)·Rx(roll)",
              ("", "value", "std. unc.", f"± (95 %, k = {k:.2f})"), values),
        Table("Rotation, by rows", ("x", "y", "z"), rotation, left=0),
        Table("Residuals, mm", ("point", "x", "y", "z", "length"), residuals),
        Facts((fit, ("Scale", scale))),
    )  # fmt: skip
    return Report(
        title=f"{len(r.names)} points fit within {quantity(max(r.rms, 1e-9), 'm')} (rms)",
        reasons=tuple(map(told, r.findings)),
        sections=(Section("Transform", blocks),),
        warnings=tuple(map(told, of_files)),
    )


_CONVENTION = "measured = rotation · reference + translation"


def registration_document(r: PointRegistration) -> dict[str, Any]:
    """Return plain JSON values; m and rad."""
    return layout.document(
        r,
        "rotation rpy rpy_std translation translation_std noise_dof rms chi2 dof p_value sigma "
        "scale scale_std coplanar missing extra",
        convention=_CONVENTION,
        covariance={
            "definition": "of (d, t) with R_true = exp([d]x) · rotation, d in the measured frame; "
            "rad, m",
            "matrix": r.covariance,
        },
        points=layout.each_named(r.names, residual=r.residual),
        rejected=[{"name": p.name, "reason": sentence(p.finding)} for p in r.rejected],
    )
