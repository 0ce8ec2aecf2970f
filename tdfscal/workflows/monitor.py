"""`monitor`: calibrations and campaigns of one rig over time."""

from __future__ import annotations

from collections.abc import Iterable, Sequence
from dataclasses import dataclass, replace
from datetime import UTC, datetime
from os import PathLike
from pathlib import Path
from typing import Any

import numpy as np

from tdfscal.comparison.control_chart import Alarm
from tdfscal.comparison.history import Life
from tdfscal.errors import UsageError
from tdfscal.files.calibration.document import Calibration as CalibrationFile
from tdfscal.files.output_places import PAGE_SUFFIXES, check_outputs
from tdfscal.files.outputs import together
from tdfscal.logs import is_log
from tdfscal.records import ANGLES, Measured, Rig
from tdfscal.reporting.layout import LISTED, Drawing, Report
from tdfscal.significance import ALARMS_PER_YEAR
from tdfscal.workflows.arguments import Instant, one, window
from tdfscal.workflows.calibration import CalibrationSource, paths_of, sources_of
from tdfscal.workflows.campaign import campaign_folders, inputs_read
from tdfscal.workflows.earlier import Earlier, read_earlier
from tdfscal.workflows.log_pass import Settings
from tdfscal.workflows.progress import SILENT, Progress
from tdfscal.workflows.recordings import Recording, refuse_repeated, stated
from tdfscal.workflows.result import Result, by_column
from tdfscal.workflows.rig_life import life_of
from tdfscal.workflows.several_campaigns import Read, read_campaign, require_one_rig


@dataclass(frozen=True, slots=True, repr=False)
class MonitorResult(Result):
    """A rig's history. alarms : those that count, of all in `life`."""

    rig: Rig
    life: Life
    alarms: tuple[Alarm, ...]
    warnings: tuple[str, ...]

    @property
    def exit_status(self) -> int:
        """1 on an alarm."""
        return 1 if self.alarms else 0

    def _page(self, drawings: tuple[Drawing, ...]) -> Report:
        """Lay out verdict, alarms, state, angles."""
        from tdfscal.reporting.history import history_report

        report = history_report(self.life, self.alarms, drawings)
        papers = _papers(self.rig)
        return replace(
            report,
            title=f"{self.rig.name}: {report.title[0].lower()}{report.title[1:]}",
            warnings=(*self.warnings, *papers),
        )

    def to_dict(self) -> dict[str, Any]:
        """Return checks, alarms, walk and the next calibration as plain JSON values."""
        from tdfscal.reporting.history import document

        content = document(self.life, self.alarms)
        return {"rig": self.rig.name, **content, "warnings": [*self.warnings, *_papers(self.rig)]}

    def table(self) -> dict[str, list[Any]]:
        """One row per check and angle: check, date, support, angle, value, std, path …, in rad."""
        from tdfscal.reporting.history import day

        life = self.life
        rows = (
            (
                check, day(life.month[k]), name, angle,
                life.rpy[k, i, j], life.rpy_std[k, i, j],
                life.path[k, i, j], life.path_std[k, i, j],
            )
            for k, check in enumerate(life.names)
            for i, name in enumerate(life.supports)
            if life.known[i]
            for j, angle in enumerate(ANGLES)
        )  # fmt: skip
        return by_column("check date support angle value std path path_std", rows)

    def drawings(self) -> tuple[Drawing, ...]:
        """Return a control chart per sensor."""
        from tdfscal.reporting.figures.history import draw

        return draw(self.life)


@together()
def monitor(
    *files: CalibrationSource | Iterable[CalibrationSource],
    rate: float = ALARMS_PER_YEAR,
    from_: Instant | None = None,
    to: Instant | None = None,
    since: str | None = None,
    html: str | PathLike[str] | None = None,
    figures: str | PathLike[str] | None = None,
    progress: Progress = SILENT,
) -> MonitorResult:
    """Watch a rig over time: control chart by date of measurement, alarms, next calibration.

    Parameters
    ----------
    files : calibrations, and campaign folders with a rig.yaml each, of one rig; two or more.
    rate : false alarms per year that an unchanged rig may raise.
    from_, to : part of the log to use: s of its clock, "2h"; "+90" after its begin; or a date.
    since : a date; alarms raised before it are shown, and count no more.
    html : page to write. figures : folder for the figures, PNG, SVG and PDF.
    progress : called as the work goes on.

    Raises
    ------
    UsageError
        There are fewer than two, they are of different rigs, or one recording is in two of them.
    DataError, RigError
        One cannot be read.
    """
    sources, page, first = sources_of(*files), one(html), _date(since)
    if not 0 < rate <= 1:
        raise UsageError(
            f"{rate:g} false alarms per year", where="--rate", hint="give 1 or less, above 0"
        )
    check_outputs({"--html": (page, PAGE_SUFFIXES)}, inputs_read(paths_of(sources)))
    calibrations, folders = _sorted_out(sources)
    known = [read_earlier(source) for source in calibrations]
    settings = Settings(progress, window(from_, to))
    reads = [read_campaign([folder], settings) for folder in folders]
    rig = _one_rig(known, reads)
    calibrated = [Recording(e.name, e.inputs, None) for e in known]
    refuse_repeated([*calibrated, *reads])
    if len(known) + len(reads) < 2:
        raise UsageError(
            "one check is no history", hint="name two or more calibrations or campaign folders"
        )
    progress.stage(f"going through {len(known) + len(reads)} checks")
    life = life_of(rig, known, reads, rate)
    result = MonitorResult(
        rig,
        life,
        tuple(a for a in life.alarms if life.month[a.raised] >= first),
        _warnings(life, known, reads),
    )
    result.save_figures(figures, progress, page)
    return result


def _date(text: str | None) -> float:
    """Months since 1970 of a date; −∞ without one. Raises UsageError."""
    if text is None:
        return -np.inf
    try:
        begin = stated(text).begin
    except ValueError as error:
        raise UsageError(
            f"{text!r} is no date", where="--since", hint="write it as 2026-03-01"
        ) from error
    return Measured(begin, begin, "rig").month


def _sorted_out(sources: Sequence[CalibrationSource]) -> tuple[list[CalibrationSource], list[Path]]:
    """Tell calibrations from campaign folders."""
    calibrations: list[CalibrationSource] = []
    folders: list[Path] = []
    for source in sources:
        if isinstance(source, CalibrationFile) or not Path(source).is_dir():
            calibrations.append(source)
            continue
        path = Path(source)
        if is_log(path):
            raise UsageError("is a recording", where=str(path), hint="name its campaign folder")
        folders += [group[0] for group in campaign_folders([path])]
    return calibrations, folders


def _one_rig(known: Sequence[Earlier], reads: Sequence[Read]) -> Rig:
    """Return the latest rig; all must state the same constants."""
    checks: list[Earlier | Read] = [*known, *reads]
    if not checks:
        raise UsageError("nothing is named", hint="name calibrations or campaign folders")
    latest = max(checks, key=lambda check: check.measured.month)
    for check in checks:
        require_one_rig(latest.rig, check.rig, check.name, latest.name)
    return latest.rig


def _papers(rig: Rig) -> tuple[str, ...]:
    """Sensors whose own calibration is due."""
    today = f"{datetime.now(UTC):%Y-%m-%d}"
    return tuple(
        f"the sensor of {name} was due for calibration on {papers.due}"
        for name, papers in zip(rig.supports, rig.sensors, strict=False)
        if papers.due is not None and papers.due < today
    )


def _warnings(life: Life, known: Sequence[Earlier], reads: Sequence[Read]) -> tuple[str, ...]:
    rejected = [e.name for e in known if not e.file.accepted]
    checks: list[Earlier | Read] = [*known, *reads]
    dated = [check.name for check in checks if check.measured.source == "file"]
    found = []
    if rejected:
        found.append(f"rejected by the quality gate: {_some(rejected)}")
    if dated:
        found.append(
            f"nothing says when it was recorded, and the file's date stands for it: {_some(dated)}"
        )
    never = [name for name, told in zip(life.supports, life.known, strict=True) if not told]
    found += [
        f"{name}: no check determines the mounting of its sensor, which lacks an axis; it has no "
        "angles, and its turn raises no alarm"
        for name in never
    ]
    for e in known:
        if silent := [name for name in e.file.undetermined if name not in never]:
            found.append(f"{e.name} leaves {', '.join(silent)} undetermined and says nothing of it")
    return tuple(found)


def _some(names: Sequence[str]) -> str:
    """Names, the first ones of many."""
    more = len(names) - LISTED
    return ", ".join(names[:LISTED]) + (f" and {more} more" if more > 0 else "")
