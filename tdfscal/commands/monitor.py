"""`monitor`: calibrations and campaigns of one rig over time."""

from __future__ import annotations

from collections.abc import Iterator, Sequence
from pathlib import Path
from typing import Annotated, Any

import numpy as np

from tdfscal.catalogue import sentence, told
from tdfscal.commands import options
from tdfscal.commands.campaign import LOG, campaign_folders, kind_of
from tdfscal.commands.earlier import Earlier, on_one_another, read_earlier
from tdfscal.commands.log_pass import Settings
from tdfscal.commands.options import Option, silent
from tdfscal.commands.recordings import Unusable, require_one_rig
from tdfscal.commands.result import (
    CalibrationSource,
    CommandResult,
    by_column,
    each_angle,
    sources_of,
)
from tdfscal.commands.several_campaigns import Judged, usable_campaigns, wanted
from tdfscal.comparison.history import Life, life_of
from tdfscal.comparison.pooling import pool
from tdfscal.errors import RejectedError, UsageError
from tdfscal.files.calibration.compared import below_accepted
from tdfscal.files.calibration.document import Calibration as CalibrationFile
from tdfscal.files.calibration.document import overdue, unsealed
from tdfscal.files.calibration.parts import MeasuredResult
from tdfscal.files.outputs import CALIBRATION
from tdfscal.findings import Finding
from tdfscal.frozen import record, replace
from tdfscal.logs import is_log
from tdfscal.records import Rig
from tdfscal.reporting.history import History, Source, day, finding
from tdfscal.reporting.layout import LISTED, Drawing
from tdfscal.reporting.traceability import Making, calibration_fact, day_measured, report_digest


@record(eq=False)
class MonitorResult(History, CommandResult):
    """A rig's history."""

    __repr__ = CommandResult.__repr__

    def table(self) -> dict[str, list[Any]]:
        """One row per check and angle: check, date, support, angle, value, std, path …, in rad."""
        life, known = self.life, self.life.known
        names = np.array(life.supports)[known].tolist()
        each = [of[:, known] for of in (life.rpy, life.rpy_std, life.path, life.path_std)]
        rows = (
            (check, day(life.month[k]), *row)
            for k, check in enumerate(life.names)
            for row in each_angle(names, *(of[k] for of in each))
        )
        return by_column("check date support angle value std path path_std", rows)

    def drawings(self) -> tuple[Drawing, ...]:
        """Return a control chart per sensor."""
        from tdfscal.reporting.figures.timeline import control_charts

        return control_charts(self.life, lambda alarm: sentence(finding(self.life, alarm)))


@options.command("monitor 2026-*.yaml --html history.html")
def monitor(
    *files: Annotated[
        options.Several,
        Option("calibration files and campaign folders of one rig", list[Path], "FILE…"),
    ],
    html: options.Page = None,
    progress: options.Telling = silent,
    command: str = "",
) -> MonitorResult:
    """Watch a rig over time: control chart, alarms (status 1), when to calibrate next.

    A campaign that `calibrate` rejects by itself takes no part and is named; status 1 where it is
    the latest, of which nothing is then known, and where one cannot be read or used as this rig's.
    """
    calibrations, folders, others = _sorted_out(sources_of(*files))
    known = on_one_another([read_earlier(source) for source in calibrations])
    papers = [
        found
        for earlier in known[1:]
        for found in require_one_rig((known[0].name, known[0].rig), (earlier.name, earlier.rig))
    ]
    groups = [[folder] for folder in folders]
    if len(known) + len(groups) < 2:
        what = "; ".join(("one check is no history", *others))
        raise UsageError(what, hint="name two or more calibrations or campaign folders")
    settings = Settings(progress)
    # Of an update its own; those before are its base's.
    before = [
        recording
        for earlier in known
        for recording in earlier.recordings()[-1 if earlier.file.history else 0 :]
    ]
    reads, unusable = usable_campaigns(groups, settings, None, known, before)
    if not known and not reads:
        raise next(iter(unusable.values()))
    reads, lost = _taking_part(known, reads, unusable)
    checks: list[Earlier | Judged] = [*known, *reads]
    if not checks:
        raise RejectedError("; ".join(map(told, lost)))
    progress(f"going through {len(checks)} checks")
    ordered: list[Earlier | Judged] = sorted([*reads, *known], key=lambda check: check.month)
    rig, pooled = _rig_of(checks), pool(checks)
    life, noisy = life_of(rig, pooled)
    making = Making(command, tuple(file for one in reads for file in one.read.log.inputs))
    found = [
        *lost,
        *papers,
        *noisy,
        *pooled.one_tare(),
        *_findings(life, checks),
        *overdue(rig, making.created[:10]),
    ]
    found += (finding(life, alarm) for alarm in life.alarms)
    return MonitorResult(rig, life, tuple(found), tuple(map(_source, ordered)), making)


def _rig_of(checks: Sequence[Earlier | Judged]) -> Rig:
    """The latest check's, which is not called as a check is: a draft bears its campaign's name."""
    rig = max(checks, key=lambda check: check.month).rig
    drafted = [Path(check.name).stem for check in checks]
    if len({check.rig.name for check in checks}) > 1 or rig.name in drafted:
        return replace(rig, name=f"Rig of {', '.join(rig.supports)}")
    return rig


def _taking_part(
    known: Sequence[Earlier], reads: Sequence[Judged], unusable: Unusable
) -> tuple[list[Judged], list[Finding]]:
    """Campaigns that no one rejects, and what is said of the others; the latest is wanted."""
    latest = max(check.month for check in (*known, *reads))
    sound = [read for read in reads if not read.rejected]
    few = len(known) + len(sound) < 2
    needed, others = list[Finding](), list[Finding]()
    for read in reads:
        if read.rejected:
            wants = few or read.month == latest
            (needed if wants else others).append(read.rejected)
    remarks = (read.remark for read in sound if read.remark)
    return sound, [*wanted(needed), *unusable.findings, *others, *remarks]


def _source(check: Earlier | Judged) -> Source:
    """When a check was measured, and the digest of its calibration or rig file."""
    when = MeasuredResult.of(check.measured)
    if isinstance(check, Earlier):
        fact, key = calibration_fact(check.name, check.file), "content_sha256"
        digest = report_digest(check.file)
    else:
        digest, key = check.read.log.campaign.rig.sha256, "rig_sha256"
        fact = "Campaign", f"{check.name}, of {day_measured(when)}, rig file SHA-256 {digest}"
    return fact, {"measured": when.model_dump(), key: digest}


def _sorted_out(
    sources: Sequence[CalibrationSource],
) -> tuple[list[CalibrationSource], list[Path], list[str]]:
    """Tell calibrations from campaign folders, and say what else is ours, which is left alone.

    A pattern such as FOLDER/* names pages, tables and the truth of a simulation too.
    """
    calibrations: list[CalibrationSource] = []
    folders, others = list[Path](), list[str]()
    for source in sources:
        if isinstance(source, CalibrationFile) or not (path := Path(source)).is_dir():
            kind = "" if isinstance(source, CalibrationFile) else kind_of(path)
            if kind not in ("", CALIBRATION, LOG):
                others.append(f"{source} is {kind}")
            else:
                calibrations.append(source)
            continue
        if is_log(path):
            raise UsageError("is a recording", where=str(path), hint="name its campaign folder")
        folders += [group[0] for group in campaign_folders([path])]
    return calibrations, folders, others


def _findings(life: Life, checks: Sequence[Earlier | Judged]) -> Iterator[Finding]:
    """What a reader of the history must know of its checks."""
    known = [check for check in checks if isinstance(check, Earlier)]
    for e in known:
        yield from (*below_accepted(e.name, e.file), *unsealed(e.name, e.file))
    if dated := [check.name for check in checks if check.measured.source == "file"]:
        more = len(dated) - LISTED
        yield Finding(
            "checks-undated", (*dated[:LISTED], *([f"and {more} more"] if more > 0 else []))
        )
    never = [name for name, told in zip(life.supports, life.known, strict=True) if not told]
    yield from (Finding("sensor-never-determined", (name,)) for name in never)
    for e in known:
        if silent := [name for name in e.file.undetermined if name not in never]:
            yield Finding("check-silent", (e.name,), values={"sensors": silent})
