"""`capability`: thresholds for a machine, and the smallest contact that it notices with them."""

from __future__ import annotations

import shlex
from collections.abc import Iterator
from dataclasses import field
from itertools import compress
from pathlib import Path
from typing import Annotated, Any

import numpy as np

from tdfscal.commands import options
from tdfscal.commands.calibration_in_use import LogInUse, take
from tdfscal.commands.campaign import Campaign, listed
from tdfscal.commands.log_pass import Settings
from tdfscal.commands.options import Option, silent, triple
from tdfscal.commands.result import Calibration, CalibrationSource, CommandResult, read_source
from tdfscal.detection.capability import (
    UNTIMED,
    Capability,
    Request,
    assess,
    beyond_contact_free,
    more_false_stops,
)
from tdfscal.detection.noise import LowPass, MeasuredNoise, measured_noise, serving
from tdfscal.detection.path import (
    ByZeros,
    Errors,
    Largest,
    PathPoints,
    ZeroChange,
    errors,
    explained_by_zeros,
    planned_readings,
    unexplained,
)
from tdfscal.detection.path import Path as Places
from tdfscal.errors import DataError, UsageError
from tdfscal.files.calibration.parameters import calibrated
from tdfscal.files.writers.plan import read_plan
from tdfscal.findings import Finding, Value, unfit
from tdfscal.frozen import record, replace
from tdfscal.model.postures import ZeroAge
from tdfscal.records import BoolArray, FloatArray
from tdfscal.reporting.headline import exact_names
from tdfscal.reporting.layout import Drawing, Report, document, each_named, utc
from tdfscal.reporting.summaries import UNITS, capability_report
from tdfscal.reporting.traceability import Making, calibration_fact
from tdfscal.wrench.contact_wrench import COMPONENTS
from tdfscal.wrench.wrench_noise import by_sensor

#: Age of zeros, s, from which on a rig file is expected to say how they drift.
_OLD = 86400.0
#: Share of the variance from which on zeros have aged too far.
_AGED = 0.5


@record(eq=False)
class CapabilityResult(CommandResult):
    """Thresholds and smallest contacts along a path, with what was asked and what was found.

    about : (3,), m, LCS, point of the moments. name : of the calibration. making : with its inputs.
    """

    calibration: Calibration
    capability: Capability
    request: Request
    findings: tuple[Finding, ...]
    about: tuple[float, float, float]
    timed: bool
    name: str
    making: Making

    def to_report(self, drawings: tuple[Drawing, ...] = ()) -> Report:
        """Lay out thresholds, what they come from, and what would help."""
        c, asked = self.calibration, (self.request, self.findings, self.about)
        found = capability_report(self.capability, *asked, timed=self.timed)
        facts = calibration_fact(self.name, c), ("Taken as exact", exact_names(c))
        sections = (*found.sections, self.making.section(*facts))
        title, created = f"{c.rig.name}: {found.title}", utc(self.making.created)
        return replace(found, title=title, sections=sections, created=created)

    def document(self) -> dict[str, Any]:
        """Return thresholds, contacts, shares and findings as plain JSON values."""
        noise = [each.std for each in self.capability.noise]
        shares = self.capability.shares
        of_each = [{source: of[k] for source, of in shares.items()} for k in range(len(noise))]
        return document(
            self,
            "calibration_status=calibration.status calibration_created=calibration.created "
            "false_stops=request.false_stops detect=request.detect filter=request.cutoff "
            "about timed duration=capability.duration",
            for_machine=not unfit(self.findings),
            axes=each_named(COMPONENTS, "axis", **self._sizes(), noise=noise, shares=of_each),
        )

    def table(self) -> dict[str, Any]:
        """One row per axis: threshold and smallest contact, N or N·m, shares of the variance."""
        shares = {f"share_{source}": of for source, of in self.capability.shares.items()}
        return {"axis": COMPONENTS, **self._sizes(), **shares}

    def _sizes(self) -> dict[str, Any]:
        names = ("threshold", "smallest_contact")
        return {"unit": UNITS, **{name: getattr(self.capability, name) for name in names}}


@options.command("capability calibration.yaml assembly/free.csv --filter 10")
def capability(
    calibration: options.OneCalibration,
    paths: options.Paths,
    *,
    rig: options.RigFile = None,
    false_stops: Annotated[
        float,
        Option("false stops an hour that are borne on each axis", metavar="PER_HOUR", least=1e-12),
    ] = 0.1,
    detect: Annotated[
        float,
        Option("probability that the smallest contact is seen", metavar="P", least=0.5, below=1.0),
    ] = 0.95,
    filter: Annotated[
        float | None,
        Option("cut-off of the controller's Butterworth, 2nd order", metavar="HZ", least=1e-9),
    ] = None,
    at: options.LcsPoint = (0.0, 0.0, 0.0),
    html: options.Page = None,
    progress: options.Telling = silent,
    command: str = "",
) -> CapabilityResult:
    """Find thresholds for a machine, and the smallest contact it notices, along a free path."""
    request, point = Request(false_stops, detect, filter), triple("--at", at)
    path = _planned(calibration, listed(paths), np.array(point))
    if path is None:
        log = take(calibration, paths, rig, Settings(progress), point)
        path = _recorded(log, request.cutoff)
    own, given = path.log.calibration, path.log.given
    if not own.rotation_covariance.any():
        raise DataError(
            "the calibration states no covariance: nothing tells what it leaves open",
            where=path.log.name,
            hint="calibrate anew; --estimator linear needs its Monte Carlo trials",
        )
    progress("looking for thresholds")
    found = assess(given, path.errors, path.noise, path.duration, request)
    named = shlex.join([path.log.name, *map(str, listed(paths))])
    judged = _findings(path, found, request.cutoff, f"tdfscal update {named} -o FILE")
    findings = _contact_first(path, [*path.findings, *judged])
    making = Making(command, tuple(path.log.inputs))
    timed = not path.places.averaged
    return CapabilityResult(own, found, request, findings, point, timed, path.log.name, making)


@record(kw_only=True)
class FreePath:
    """A path without contact, with all that stands on the wrench along it.

    noise : of the wrench behind the filter. duration : s. sampled : at known times. age : of the
    zeros. largest : of the filtered wrench; of a log of stops, at rest, and moved : between them.
    by_zeros : what zeros that have moved explain. in_motion : the log has no stops. touched : of a
    log without stops that serve, what is contact in it; None where that was not asked.
    """

    log: LogInUse
    places: Places
    errors: Errors
    noise: MeasuredNoise
    duration: float
    sampled: bool = False
    age: ZeroAge = ZeroAge(known=False)
    largest: Largest = field(default_factory=Largest)
    moved: Largest = field(default_factory=Largest)
    by_zeros: ByZeros | None = None
    in_motion: bool = False
    findings: tuple[Finding, ...] = ()
    touched: tuple[Finding, ...] | None = None


def _recorded(log: LogInUse, cutoff: float | None) -> FreePath:
    """Read a log under a calibration, in bounded memory.

    Raises DataError where it holds no instant, UsageError for a filter beyond its sampling rate.
    """
    points, (head, samples) = PathPoints(log.campaign.rig.averaged), log.passing()
    averaged, start = log.campaign.rig.averaged, head.samples.time
    interval = None if averaged or len(start) < 2 else float(np.median(np.diff(start)))
    if cutoff is not None and (interval is None or cutoff * interval >= 0.5):
        rate = "its rows are averaged postures" if interval is None else f"{1 / interval:.6g} Hz"
        raise UsageError(
            f"a filter of {cutoff:g} Hz does not suit this log ({rate})",
            where="--filter",
            hint="give a cut-off below half the sampling rate",
        )
    low = LowPass(cutoff, interval or 1.0)
    begun, free, moved = list[tuple[FloatArray, FloatArray]](), Largest(), Largest()
    with np.errstate(all="ignore"):
        for piece in log.wrenches(points.passing(samples)):
            if piece.time[0] <= start[-1]:
                begun.append((piece.time, piece.value))
            size = np.abs(low(piece.time, piece.value))
            # In a log of stops: between them it is driven, not watched.
            rests = points.resting(piece.time) if len(head.start) else np.True_
            still = np.broadcast_to(rests, piece.time.shape)
            free.add(piece.time[still], size[still])
            moved.add(piece.time[~still], size[~still])
    places = points.path()
    age, flicker = log.zeros(head)
    zeros = ZeroChange(log.rig.drift, age, log.temperatures(places.time), flicker)
    stand = errors(log.given, places, zeros, _scatter(log))
    time, value = (np.concatenate(parts) for parts in zip(*begun, strict=True))
    rest = [] if head.averaged else list(head.dwells(time))
    moving = not head.averaged and len(time) > 1 and not serving(rest, interval or 1.0, cutoff)
    if moving:
        value = unexplained(stand, places, time, value)
    if head.averaged:
        time, value = time[:0], value[:0]
    return FreePath(
        log=log,
        places=places,
        errors=stand,
        noise=measured_noise(time, value, rest, cutoff),
        duration=UNTIMED if interval is None else points.used * interval,
        sampled=interval is not None,
        age=age,
        largest=free,
        moved=moved,
        by_zeros=explained_by_zeros(log.given, places, points.resting(places.time), stand),
        in_motion=not averaged and not len(head.start),
        findings=tuple(log.findings()),
        touched=tuple(log.touched()) if moving else None,
    )


def _contact_first(path: FreePath, found: list[Finding]) -> tuple[Finding, ...]:
    """Blame a contact where there is one, before the motion: in it a wrench of either is large."""
    beyond = [f for f in found if f.code == "moves-beyond"]
    touched = path.touched
    if touched is None:
        touched = tuple(path.log.touched()) if beyond else ()
    spans = np.array([(f.values["begin"], f.values["end"]) for f in touched], float).reshape(-1, 2)
    when = np.array([f.values["time"] for f in beyond], float)
    inside = np.any((spans[:, :1] <= when) & (when <= spans[:, 1:]), axis=0)
    told = list(compress(beyond, inside))
    each = (replace(f, values={**f.values, "free": True}, rejects=True) for f in touched)
    return (*each, *(f for f in found if f not in told))


def _planned(source: CalibrationSource, paths: list[Path], point: FloatArray) -> FreePath | None:
    """Take the postures or the motion of a plan for the path; None where no plan is named.

    Nothing was recorded: its zeros hold, and its samples have no noise.

    Raises UsageError, DataError.
    """
    if len(paths) != 1 or (driven := read_plan(paths[0])) is None:
        return None
    name, loaded = read_source(source)
    rig, given = loaded.rig.loaded(name), calibrated(loaded)
    if driven.position.shape[1] != given.rig.n or driven.supports != given.rig.supports:
        hint = f"plan with the rig of {name}"
        raise DataError("the plan is of another rig", where=str(paths[0]), hint=hint)
    log = LogInUse(
        Campaign(rig, ()), Settings(), name=name, calibration=loaded, given=given, point=point
    )
    readings = planned_readings(log.given, driven.position, driven.squeeze)
    places = Places(driven.time, driven.position, readings, driven.averaged)
    return FreePath(
        log=log,
        places=places,
        errors=errors(log.given, places, None, _scatter(log)),
        noise=measured_noise(np.zeros(0), np.zeros((0, 6)), [], None),
        duration=UNTIMED if places.averaged else float(np.ptp(places.time)),
    )


def _scatter(log: LogInUse) -> FloatArray:
    """Variance (6,) of the wrench at a posture beyond what the rig file declares."""
    return np.asarray(max(log.excess_variance, 0.0) * by_sensor(log.given).sum(axis=0))


def _findings(
    path: FreePath, found: Capability, cutoff: float | None, line: str
) -> Iterator[Finding]:
    """What is to be judged by; cutoff : of the filter, Hz; line : that takes new zeros in."""
    log, stated = path.log, path.log.rig
    unsound = list(_rejecting(path, found, line))
    yield from unsound
    if not log.given.joint and log.calibration.method != "tracker":
        yield Finding("covariance-in-part", (log.name,))
    aged = np.mean(np.sum(path.errors.zeros**2, axis=2), axis=0)
    whole = np.mean(np.sum(path.errors.factor**2, axis=2), axis=0)
    whole += [one.std**2 for one in found.noise]
    share = float(np.max(np.divide(aged, whole, out=np.zeros(6), where=whole > 0)))
    days = abs(path.age.seconds) / _OLD
    if share > _AGED:
        yield Finding("zeros-aged", size=share, values={"days": days})
    drifts = stated.drift.time > 0 or stated.drift.walk > 0 or stated.drift.temperature > 0
    if not drifts and path.age.known and days > 1.0:
        yield Finding("drift-undeclared", size=days)
    if not path.noise.spans:
        planned = not log.campaign.logs
        filtered = f"{cutoff:g}" if cutoff is not None and not planned else ""
        yield Finding("path-without-noise", values={"planned": planned, "filtered": filtered})
    if path.log.given.rig.inertia is None and path.sampled and not unsound:
        yield Finding("path-inertia-unknown")
    for name, unit, rows, limit in stated.acceptance.contact_limits:
        worst = float(np.max(found.smallest_contact[rows]))
        if limit is not None and worst > limit:
            values: dict[str, Value] = {"limit": limit}
            yield Finding("contact-unseen", (name,), worst, unit, values=values, rejects=True)


def _rejecting(path: FreePath, found: Capability, line: str) -> Iterator[Finding]:
    """What shows that the path was in contact, or driven beyond; and thresholds without end."""
    # Without its inertia a terminal that moves shows a wrench, and no contact.
    quasi_static, by_zeros = path.log.given.rig.inertia is None, path.by_zeros
    free = "moves-beyond" if quasi_static and path.in_motion else "path-in-contact"
    moved = by_zeros is not None and bool(by_zeros.steady.any())
    said = False
    for code, largest in ((free, path.largest), ("moves-beyond", path.moved)):
        contact, limit = beyond_contact_free(path.errors, found, largest.size)
        if contact.any():
            zeros = by_zeros is not None and by_zeros.suffice(largest.size, limit)
            if code == "moves-beyond" and zeros and moved:
                continue
            worst = int(np.argmax(np.where(contact, largest.size / limit, 0.0)))
            values: dict[str, Value] = {"limit": float(limit[worst]), "axis": COMPONENTS[worst]}
            values["time"] = float(largest.when[worst] - path.places.time[0])
            values |= {"unstated": quasi_static, "line": line}
            if code == "path-in-contact" and by_zeros is not None:
                values["zeros"] = by_zeros.change if zeros else 0.0
            axes, size = _axes(contact), float(largest.size[worst])
            said = said or code == "path-in-contact"
            yield Finding(code, axes, size, UNITS[worst], values=values, rejects=True)
    if moved and not said and by_zeros is not None:
        worse = more_false_stops(path.errors, found, by_zeros.steady)
        if worse.any():
            most = int(np.argmax(np.where(worse, by_zeros.steady / found.threshold, 0.0)))
            size, values = float(by_zeros.steady[most]), {"axis": COMPONENTS[most], "line": line}
            yield Finding("path-zeros-moved", _axes(worse), size, UNITS[most], values=values,
                          rejects=True)  # fmt: skip
    if path.errors.open.any():
        yield Finding("threshold-unbounded", _axes(path.errors.open), rejects=True)


def _axes(which: BoolArray) -> tuple[str, ...]:
    return tuple(axis for axis, there in zip(COMPONENTS, which, strict=True) if there)
