"""`capability`: thresholds for a machine, and the smallest contact that it notices with them."""

from __future__ import annotations

from typing import Annotated, Any

import numpy as np

from tdfscal.catalogue import told
from tdfscal.commands import options
from tdfscal.commands.calibration_in_use import WrenchPass, take
from tdfscal.commands.campaign import listed
from tdfscal.commands.free_path import FreePath, planned_path, read_path
from tdfscal.commands.log_pass import Settings
from tdfscal.commands.options import Option, silent, triple
from tdfscal.commands.result import Calibration, CommandResult, by_column
from tdfscal.detection.capability import (
    Capability,
    Request,
    assess,
    beyond_contact_free,
)
from tdfscal.errors import DataError
from tdfscal.findings import Finding, Value, unfit
from tdfscal.frozen import record
from tdfscal.records import BoolArray
from tdfscal.reporting.layout import Drawing, Report, document, plain
from tdfscal.reporting.summaries import UNITS, capability_report
from tdfscal.wrench.contact_wrench import COMPONENTS

#: Age of zeros, s, from which on a rig file is expected to say how they drift.
_OLD = 86400.0
#: Share of the variance from which on zeros have aged too far.
_AGED = 0.5


@record(eq=False)
class CapabilityResult(CommandResult):
    """Thresholds and smallest contacts along a path, with what was asked and what was found.

    about : (3,), m, LCS, point of the moments.
    """

    calibration: Calibration
    capability: Capability
    request: Request
    findings: tuple[Finding, ...]
    about: tuple[float, float, float]
    timed: bool

    @property
    def exit_status(self) -> int:
        """1 where a finding rejects the path, or the calibration for it."""
        return int(any(finding.rejects for finding in self.findings))

    @property
    def notes(self) -> tuple[str, ...]:
        """What was found of calibration and path, beside what rejects them."""
        return tuple(told(finding) for finding in self.findings if not finding.rejects)

    def to_report(self, drawings: tuple[Drawing, ...] = ()) -> Report:
        """Lay out thresholds, what they come from, and what would help."""
        return capability_report(
            self.capability, self.request, self.findings, self.about, drawings, timed=self.timed
        )

    def document(self) -> dict[str, Any]:
        """Return thresholds, contacts, shares and findings as plain JSON values."""
        c, asked = self.capability, document(self.request, "false_stops detect filter=cutoff")
        return {
            "calibration_status": self.calibration.status,
            "calibration_created": self.calibration.created,
            **asked,
            **document(self, "about"),
            "duration": c.duration,
            "timed": self.timed,
            "for_machine": not unfit(self.findings),
            "axes": [
                plain(
                    {
                        "axis": axis,
                        "unit": unit,
                        "threshold": c.threshold[k],
                        "smallest_contact": c.smallest_contact[k],
                        "shares": {name: share[k] for name, share in c.shares.items()},
                        "noise": c.noise[k].std,
                    }
                )
                for k, (axis, unit) in enumerate(zip(COMPONENTS, UNITS, strict=True))
            ],
        }

    def table(self) -> dict[str, list[Any]]:
        """One row per axis: threshold and smallest contact, N or N·m, shares of the variance."""
        c = self.capability
        names = " ".join(f"share_{source}" for source in c.shares)
        rows = (
            (axis, unit, c.threshold[k], c.smallest_contact[k], *(s[k] for s in c.shares.values()))
            for k, (axis, unit) in enumerate(zip(COMPONENTS, UNITS, strict=True))
        )
        return by_column(f"axis unit threshold smallest_contact {names}", rows)

    def drawings(self) -> tuple[Drawing, ...]:
        """Return the figure of thresholds and contacts over the path."""
        from tdfscal.reporting.figures.timeline import detection

        return (detection(self.capability, timed=self.timed),)


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
        Option(
            "probability with which the smallest contact is seen", metavar="P", least=0.5, below=1.0
        ),
    ] = 0.95,
    filter: Annotated[
        float | None,
        Option(
            "cut-off of the controller's low-pass (Butterworth, 2nd order)",
            metavar="HZ",
            least=1e-9,
        ),
    ] = None,
    at: options.LcsPoint = (0.0, 0.0, 0.0),
    html: options.Page = None,
    progress: options.Telling = silent,
) -> CapabilityResult:
    """Find thresholds for a machine, and the smallest contact it then notices, along a free path.

    Raises
    ------
    UsageError, RigError, DataError
    """
    request, point = Request(false_stops, detect, filter), triple("--at", at)
    path = planned_path(calibration, listed(paths), np.array(point))
    if path is None:
        use = take(calibration, paths, rig)
        path = read_path(WrenchPass.of(use, Settings(progress), point), request.cutoff)
    if not path.use.calibration.rotation_covariance.any():
        raise DataError(
            "the calibration states no covariance: nothing tells what it leaves open",
            where=path.use.name,
            hint="calibrate anew; --estimator linear needs its Monte Carlo trials",
        )
    progress("looking for thresholds")
    return _judged(path, request, point)


def _judged(
    path: FreePath, request: Request, about: tuple[float, float, float]
) -> CapabilityResult:
    noise = path.noise(request.cutoff)
    found = assess(path.given, path.errors, noise, path.places.time, path.duration, request)
    findings = (*path.use.findings, *path.findings, *_findings(path, found, noise.spans > 0))
    timed = not path.places.averaged
    return CapabilityResult(path.use.calibration, found, request, findings, about, timed)


def _findings(path: FreePath, found: Capability, noisy: bool) -> list[Finding]:
    """What the path and the calibration's use are to be judged by."""
    out = []
    # Without its inertia a terminal that moves shows a wrench, and no contact.
    unmodelled = path.given.rig.inertia is None and path.in_motion
    free = "moves-beyond" if unmodelled else "path-in-contact"
    for code, largest in ((free, path.largest), ("moves-beyond", path.moved)):
        contact, limit = beyond_contact_free(path.errors, found, largest.size)
        if contact.any():
            worst = int(np.argmax(np.where(contact, largest.size / limit, 0.0)))
            values: dict[str, Value] = {
                "limit": float(limit[worst]),
                "time": float(largest.when[worst] - path.places.time[0]),
            }
            if path.given.rig.inertia is None:
                values["unstated"] = True
            axes, size = _axes(contact), float(largest.size[worst])
            out.append(Finding(code, axes, size, UNITS[worst], values=values, rejects=True))
    if path.errors.open.any():
        out.append(Finding("threshold-unbounded", _axes(path.errors.open), rejects=True))
    use, drift = path.use, path.use.campaign.rig.rig.drift
    if not path.given.joint and use.calibration.method != "tracker":
        out.append(Finding("covariance-in-part", (use.name,)))
    aged = np.mean(np.sum(path.errors.zeros**2, axis=2), axis=0)
    whole = np.mean(np.sum(path.errors.factor**2, axis=2), axis=0)
    whole += [one.std**2 for one in found.noise]
    share = float(np.max(np.divide(aged, whole, out=np.zeros(6), where=whole > 0)))
    days = abs(path.age.seconds) / _OLD
    if share > _AGED:
        out.append(Finding("zeros-aged", size=share, values={"days": days}))
    declared = drift.time > 0 or drift.walk > 0 or drift.temperature > 0
    if not declared and path.age.known and days > 1.0:
        out.append(Finding("drift-undeclared", size=days))
    if not noisy:
        planned = not path.use.campaign.logs
        out.append(Finding("path-without-noise", values={"planned": planned}))
    if path.given.rig.inertia is None and path.interval and not any(f.rejects for f in out):
        out.append(Finding("path-inertia-unknown"))
    return [*out, *_stated_contact(path, found)]


def _axes(which: BoolArray) -> tuple[str, ...]:
    return tuple(axis for axis, there in zip(COMPONENTS, which, strict=True) if there)


def _stated_contact(path: FreePath, found: Capability) -> list[Finding]:
    """Whether the contact that the rig file states would be seen."""
    limits = path.use.campaign.rig.rig.acceptance
    out = []
    for name, unit, rows, limit in limits.contact_limits:
        worst = float(np.max(found.smallest_contact[rows]))
        if limit is not None and worst > limit:
            values: dict[str, Value] = {"limit": limit}
            out.append(Finding("contact-unseen", (name,), worst, unit, values=values, rejects=True))
    return out
