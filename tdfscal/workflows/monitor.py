"""`monitor`: calibrations and campaigns of one rig over time."""

from __future__ import annotations

from collections.abc import Iterable, Iterator, Sequence
from dataclasses import dataclass, replace
from datetime import UTC, datetime
from pathlib import Path
from typing import Annotated, Any

import numpy as np

from tdfscal.catalogue import documents, told
from tdfscal.comparison.common import common, with_load
from tdfscal.comparison.control_chart import Alarm, Check
from tdfscal.comparison.eliminated import stated
from tdfscal.comparison.history import Life, live
from tdfscal.comparison.misfit import scatter_of, within
from tdfscal.comparison.pooling import Pool, pool
from tdfscal.errors import UsageError
from tdfscal.files.calibration.document import Calibration as CalibrationFile
from tdfscal.files.outputs import PAGE_SUFFIXES, check_outputs
from tdfscal.findings import Finding
from tdfscal.logs import is_log
from tdfscal.model.earlier import free_constants, of_load, same_load
from tdfscal.model.parameters import State, deviation, nominal
from tdfscal.numerics.information import Information, without
from tdfscal.records import ANGLES, BoolArray, Measured, Rig
from tdfscal.reporting.layout import LISTED, Drawing, Report
from tdfscal.selfcal.estimator import Priors
from tdfscal.significance import ALARMS_PER_YEAR
from tdfscal.workflows.arguments import one, window
from tdfscal.workflows.calibration import CalibrationSource, paths_of, sources_of
from tdfscal.workflows.campaign import campaign_folders, inputs_read, is_other_result
from tdfscal.workflows.earlier import Earlier, read_earlier
from tdfscal.workflows.log_pass import Settings
from tdfscal.workflows.options import Begin, End, Option, Page, Telling, command
from tdfscal.workflows.progress import SILENT
from tdfscal.workflows.recordings import Recording, refuse_repeated, stated_date
from tdfscal.workflows.result import Result, by_column
from tdfscal.workflows.several_campaigns import (
    Read,
    left_out,
    read_campaign,
    recorded,
    require_one_rig,
    unsound,
)


@dataclass(frozen=True, slots=True, repr=False)
class MonitorResult(Result):
    """A rig's history. alarms : those that count, of all in `life`."""

    rig: Rig
    life: Life
    alarms: tuple[Alarm, ...]
    findings: tuple[Finding, ...]

    @property
    def exit_status(self) -> int:
        """1 on an alarm."""
        return 1 if self.alarms else 0

    def _page(self, drawings: tuple[Drawing, ...]) -> Report:
        """Lay out verdict, alarms, state, angles."""
        from tdfscal.reporting.history import history_report

        report = history_report(self.life, self.alarms, drawings)
        return replace(
            report,
            title=f"{self.rig.name}: {report.title[0].lower()}{report.title[1:]}",
            warnings=tuple(map(told, (*self.findings, *_papers(self.rig)))),
        )

    def to_dict(self) -> dict[str, Any]:
        """Return checks, alarms, walk and the next calibration as plain JSON values."""
        from tdfscal.reporting.history import document

        content = document(self.life, self.alarms)
        found = documents((*self.findings, *_papers(self.rig)))
        return {"rig": self.rig.name, **content, "findings": found}

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


@command("monitor 2026-*.yaml --html history.html")
def monitor(
    *files: Annotated[
        CalibrationSource | Iterable[CalibrationSource],
        Option("calibration files and campaign folders of one rig", list[Path], "FILE…"),
    ],
    from_: Begin = None,
    to: End = None,
    since: Annotated[
        str | None, Option("alarms raised before count no more", metavar="DATE")
    ] = None,
    html: Page = None,
    progress: Telling = SILENT,
) -> MonitorResult:
    """Watch a rig over time: control chart, alarms (status 1), when to calibrate next.

    Raises
    ------
    UsageError
        There are fewer than two, they are of different rigs, or one recording is in two of them.
    DataError, RigError
        One cannot be read.
    """
    sources, page, first = sources_of(*files), one(html), _date(since)
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
    rejected = unsound(reads)
    if len(known) + len(reads) - len(rejected) < 2:
        rejected = {}
    reads = [read for read in reads if read.name not in rejected]
    progress.stage(f"going through {len(known) + len(reads)} checks")
    life, noisy = life_of(rig, known, reads)
    result = MonitorResult(
        rig,
        life,
        tuple(a for a in life.alarms if life.month[a.raised] >= first),
        (*left_out(rejected), *noisy, *_findings(life, known, reads)),
    )
    result.save_page(page, progress)
    return result


def _date(text: str | None) -> float:
    """Months since 1970 of a date; −∞ without one. Raises UsageError."""
    if text is None:
        return -np.inf
    try:
        begin = stated_date(text).begin
    except ValueError as error:
        raise UsageError(
            f"{text!r} is no date", where="--since", hint="write it as 2026-03-01"
        ) from error
    return Measured(begin, begin, "rig").month


def _sorted_out(sources: Sequence[CalibrationSource]) -> tuple[list[CalibrationSource], list[Path]]:
    """Tell calibrations from campaign folders; what else is ours is left alone.

    A pattern such as FOLDER/* names pages, tables and the truth of a simulation too.
    """
    calibrations: list[CalibrationSource] = []
    folders: list[Path] = []
    for source in sources:
        if not isinstance(source, CalibrationFile) and is_other_result(Path(source)):
            continue
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


def _papers(rig: Rig) -> tuple[Finding, ...]:
    """Sensors whose own calibration is due."""
    today = f"{datetime.now(UTC):%Y-%m-%d}"
    return tuple(
        Finding("sensor-overdue", (name,), values={"due": papers.due})
        for name, papers in zip(rig.supports, rig.sensors, strict=False)
        if papers.due is not None and papers.due < today
    )


def _findings(life: Life, known: Sequence[Earlier], reads: Sequence[Read]) -> Iterator[Finding]:
    rejected = tuple(e.name for e in known if not e.file.accepted)
    checks: list[Earlier | Read] = [*known, *reads]
    dated = tuple(check.name for check in checks if check.measured.source == "file")
    if rejected:
        yield Finding("checks-rejected", _some(rejected))
    if dated:
        yield Finding("checks-undated", _some(dated))
    never = [name for name, told in zip(life.supports, life.known, strict=True) if not told]
    yield from (Finding("sensor-never-determined", (name,)) for name in never)
    for e in known:
        if silent := [name for name in e.file.undetermined if name not in never]:
            yield Finding("check-silent", (e.name,), values={"sensors": silent})


def _some(names: Sequence[str]) -> tuple[str, ...]:
    """Names, the first ones of many."""
    more = len(names) - LISTED
    return (*names[:LISTED], *([f"and {more} more"] if more > 0 else []))


def life_of(
    rig: Rig, known: Sequence[Earlier], reads: Sequence[Read]
) -> tuple[Life, list[Finding]]:
    """Go through calibrations and campaigns of a rig; and say which count with their own scatter.

    Raises UsageError where a calibration stands on another that is not among them.
    """
    pooled = pool([recorded(read) for read in reads]) if reads else None
    rigs = pooled.common.rigs if pooled else ()
    shared = common([*rigs, *(e.rig for e in known)])
    first, told = known[0].state if known else nominal(rig), np.zeros(rig.n, dtype=np.bool_)
    if pooled:
        first, told = pooled.reference, _determined(rig, pooled, reads)
    first = _common(first, told, known)
    loads = [*(pooled.references if pooled else ()), *(e.state for e in known)]
    references = [with_load(first, loads[k]) for k in shared.terminal]
    prior, checks, fits = shared.stated(references), list[Check](), list[tuple[float, int]]()
    for k, m in enumerate(pooled.members if pooled else ()):
        own = m.own.padded(shared.size)
        if not told.all():
            own = _said(rig, own + prior, prior, told)
        checks.append(Check(m.name, m.month, own, shared.load(k)))
        fits.append(within(replace(m.reduced, information=own), prior))
    for k, e in enumerate(known, len(rigs)):
        own = _own(rig, e, known, references[k])
        checks.append(Check(e.name, e.measured.month, shared.embedded(k, own), shared.load(k)))
        fits.append((0.0, 0) if e.file.campaigns else (e.chi2, e.dof))
    birge = scatter_of(fits)
    checks = [
        replace(check, own=check.own.scaled(ratio / birge.min()))
        for check, ratio in zip(checks, birge, strict=True)
    ]
    noisy = [
        Finding("campaign-noisy", (check.name,), float(ratio))
        for check, ratio in zip(checks, birge, strict=True)
        if ratio > birge.min()
    ]
    checks.sort(key=lambda check: check.month)
    ratio = float(birge.min())
    return live(rig, references[-1], prior, checks, rate=ALARMS_PER_YEAR, birge=ratio), noisy


def _determined(rig: Rig, pooled: Pool, reads: Sequence[Read]) -> BoolArray:
    """Sensors (n,) that campaigns together determine, or that lack no axis in any of them."""
    whole = np.all([read.rig.axes.all(axis=1) for read in reads], axis=0)
    last = pooled.posterior(len(pooled.members) - 1)
    std = np.sqrt(np.diagonal(last.covariance)[: 3 * rig.n]).reshape(-1, 3)
    return np.asarray(whole | (std.max(axis=1) < rig.acceptance.identifiable))


def _common(first: State, told: BoolArray, known: Sequence[Earlier]) -> State:
    """Constants from which all checks count: each sensor's turns where something determines it.

    told : (n,), those that the first state has from something.
    """
    rotation = first.rotation.copy()
    for e in known:
        new = e.file.determined & ~told
        rotation[new], told = e.state.rotation[new], told | new
    return replace(first, rotation=rotation)


def _own(rig: Rig, e: Earlier, known: Sequence[Earlier], reference: State) -> Information:
    """What a calibration's own data say (c,), without what was known before them."""
    told, before = e.file.determined, stated(Priors(e.rig), reference)
    if e.file.history:
        last = e.file.history[-1]
        base = next((o for o in known if o.sha256 == last.sha256), None)
        if base is not None:
            step = base.walk(rig, e.measured.month)
            told, stood = told & base.file.determined, _about(base, reference).walked(step)
            if same_load(base.rig, e.rig):
                before = stood
            else:  # of the terminal its own rig file spoke
                spoken, kept = ~of_load(e.rig), ~of_load(base.rig)
                rest = stood.without(~kept)
                before.matrix[np.ix_(spoken, spoken)] = rest.matrix[np.ix_(kept, kept)]
                before.score[spoken] = rest.score[kept]
        elif min(o.measured.month for o in known) < e.measured.month:
            raise UsageError(
                f"stands on a calibration of {last.created[:10]} that is not named",
                where=e.name,
                hint="name every calibration since the first, or campaigns instead",
            )
    return _said(e.rig, _about(e, reference), before, told)


def _said(rig: Rig, now: Information, before: Information, told: BoolArray) -> Information:
    """What was added to what was known before, but for turns of sensors (n,) that are not told."""
    lost = np.zeros(len(now.score), dtype=np.bool_)
    lost[: 3 * rig.n] = np.repeat(~told, 3)
    return without(now.without(lost), before.without(lost))


def _about(e: Earlier, reference: State) -> Information:
    """Information (c,) of a calibration on its own constants, counted from a reference."""
    free = free_constants(e.rig)
    away = deviation(e.state, reference)[: len(free)][free]
    return Information(e.information.matrix, e.information.matrix @ away)
