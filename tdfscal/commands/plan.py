"""`plan`: which postures and squeezes to drive, and what to expect of them."""

from __future__ import annotations

from collections.abc import Iterator, Sequence
from pathlib import Path
from typing import TYPE_CHECKING, Annotated, Any

import numpy as np

from tdfscal.catalogue import told
from tdfscal.commands import options
from tdfscal.commands.campaign import PathLike, PathLikes, listed, no_log, one, resolve, rig_named
from tdfscal.commands.log_pass import LogPass, Settings
from tdfscal.commands.options import Numbers, Option, Progress, numbers, silent, triple
from tdfscal.commands.result import CommandResult
from tdfscal.commands.samples import delay_of
from tdfscal.dwells import find_dwells
from tdfscal.errors import TdfscalError, UsageError
from tdfscal.files.rig.reading import LoadedRig
from tdfscal.files.writers.plan import plan_csv, time_table_csv
from tdfscal.findings import Finding
from tdfscal.frozen import record
from tdfscal.model.postures import postures as at_rest
from tdfscal.model.postures import register
from tdfscal.planning.candidates import Limits, Objective, Request, travel_limits
from tdfscal.planning.motion import MovingPlan, MovingRequest, plan_motion
from tdfscal.planning.plan import Plan, make_plan, plan_for_contact, plan_for_target
from tdfscal.planning.predicted_information import recorded, scatter_of
from tdfscal.records import Dwells, FloatArray, Log
from tdfscal.reporting.layout import Drawing, Report
from tdfscal.reporting.summaries import plan_document, plan_report

if TYPE_CHECKING:
    import pandas as pd

DEFAULT_POSTURES = 24
DEFAULT_NOISE = 1.0
"""N per axis and posture, where nothing is recorded yet and the rig file states no force noise."""
DEFAULT_DENSITY = 0.1
"""N, of a force's mean over a second in motion."""
#: Ways from home as `--travel` writes them.
Travel = float | str | Sequence[str | float]


@record(eq=False)
class PlanResult(CommandResult):
    """Postures or a motion to drive, and what to expect of it.

    output : the file.
    """

    plan: Plan | MovingPlan
    output: Path | None
    findings: tuple[Finding, ...] = ()

    @property
    def notes(self) -> tuple[str, ...]:
        """What keeps the home from being known."""
        return tuple(map(told, self.findings))

    def to_report(self, drawings: tuple[Drawing, ...] = ()) -> Report:
        """Return what to drive, and what to expect of it."""
        return plan_report(self.plan)

    @property
    def content(self) -> str:
        """The file that a machine drives, CSV."""
        if isinstance(self.plan, MovingPlan):
            return time_table_csv(self.plan, self.command)
        return plan_csv(self.plan, self.command)

    def document(self) -> dict[str, Any]:
        """Return the plan as plain JSON values, SI units."""
        return plan_document(self.plan, None if self.output is None else str(self.output))

    def to_frame(self) -> pd.DataFrame:
        """One row per posture, or instant in s: hinge centres in m, squeezes in N, BCS."""
        import io

        import pandas as pd

        return pd.read_csv(io.StringIO(self.content), comment="#")

    def drawings(self) -> tuple[Drawing, ...]:
        """Return the figure of the uncertainties to expect."""
        from tdfscal.reporting.figures.angles import planned

        return (planned(self.plan),)


@options.command("plan rig.yaml -o plan.csv --postures 24", output="content")
def plan(
    rig: Annotated[PathLike, Option("a rig.yaml, or its folder", Path, "RIG")],
    *,
    output: Annotated[
        PathLike | None,
        options.written("postures, or the time table, to drive", ".csv", metavar="FILE.csv"),
    ] = None,
    postures: Annotated[
        int | None,
        Option(
            "postures to drive; default 24, or more for acceptance.contact",
            least=1,
        ),
    ] = None,
    target: Annotated[
        float | None,
        Option("as many postures as bring every angle within this, mrad", metavar="MRAD"),
    ] = None,
    tilt: Annotated[float, Option("largest tilt, degrees", metavar="DEG")] = 5.0,
    squeeze: Annotated[float, Option("largest internal force at any NCP, N", metavar="N")] = 200.0,
    force_limit: Annotated[
        float | None, Option("largest force at any NCP in all, N", metavar="N")
    ] = None,
    travel: Annotated[
        Travel,
        Option(
            "way from home, either side, m: of all NCPs, or of one",
            list[str],
            "[NCP=]M[,M,M]",
            shell="repeatable",
        ),
    ] = (),
    home: Annotated[
        Numbers | None,
        Option(
            "LCS origin in the BCS at home, m; default: mean of the recorded log",
            str | None,
            "X,Y,Z",
        ),
    ] = None,
    stiffness: Annotated[
        float | None,
        Option("of an NCP, N/m: squeeze by displacements; else by servoed forces", metavar="N/M"),
    ] = None,
    noise: Annotated[
        float | None,
        Option(
            "noise of a posture's mean force per axis, N; default: the log's, or 0 beside a "
            "stated force_noise, or 1; of a motion, of a mean over a second, default 0.1",
            metavar="N",
        ),
    ] = None,
    objective: Annotated[
        Objective, Option("what to know best: the angles, or the wrench at acceptance.contact.rpy")
    ] = "angles",
    given: Annotated[
        PathLikes,
        Option(
            "campaign or log recorded already; plan what is next", list[Path], "PATH", reads=True
        ),
    ] = (),
    motion: Annotated[bool, Option("plan a motion without a stop, not postures")] = False,
    duration: Annotated[float, Option("of the motion, s", metavar="S")] = 60.0,
    speed: Annotated[
        float, Option("largest speed of a hinge in motion, m/s", metavar="M/S")
    ] = 0.02,
    progress: options.Telling = silent,
) -> PlanResult:
    """Choose the postures and squeezes, or the motion, to drive, and say what to expect of them.

    Raises
    ------
    UsageError, RigError, DataError, NotIdentifiableError
    """
    postures_only = (postures, target) != (None, None) or bool(listed(given))
    if motion and (postures_only or objective != "angles"):
        raise UsageError(
            "--postures, --target, --objective and --given are of postures",
            where="--motion",
            hint="leave them out, or plan postures",
        )
    if postures is not None and target is not None:
        raise UsageError(
            "--postures and --target ask for two different things", hint="give one of them"
        )
    known = rig_named(rig)
    seen, level, at = None, np.eye(3), np.zeros(3)
    findings: tuple[Finding, ...] = ()
    if given or home is None:
        try:
            seen, centres = _recorded(known, listed(given), progress)
            (level,), (at,) = register(known.rig.hinge, centres[None])
        except TdfscalError as error:
            if given:
                raise
            findings = (Finding("home-unknown", values={"why": error.what}),)
    limits = Limits(
        tilt=float(np.deg2rad(tilt)),
        squeeze=squeeze,
        force=np.inf if force_limit is None else force_limit,
        travel=travel_limits(known.rig, _travels(travel)),
        home=at if home is None else np.array(triple("--home", home)),
        stiffness=stiffness,
        level=level,
        recorded=seen is not None and home is None,
    )
    rng = np.random.default_rng(0)
    found: Plan | MovingPlan
    if motion:
        progress("looking for the best motion")
        density = DEFAULT_DENSITY if noise is None else noise
        moving = MovingRequest(limits, duration, speed, density, delay_of(known))
        found = plan_motion(known.rig, moving, rng)
    else:
        before, usual = None, 0.0 if known.rig.declared.force_noise else DEFAULT_NOISE
        if seen is not None and given:
            before = recorded(known.rig, seen, noise or DEFAULT_NOISE)
        if seen is not None and len(seen):
            usual = scatter_of(at_rest(known.rig, seen), known.rig) or usual
        request = Request(
            limits=limits,
            noise=usual if noise is None else noise,
            objective=objective,
        )
        if postures is None and target is None and known.rig.acceptance.states_contact:
            found = plan_for_contact(known.rig, request, DEFAULT_POSTURES, rng, given=before)
        elif target is None:
            count = postures or DEFAULT_POSTURES
            found = make_plan(known.rig, request, count, rng, given=before)
        else:
            aim, telling = 1e-3 * target, progress
            found = plan_for_target(known.rig, request, aim, rng, given=before, progress=telling)
    return PlanResult(found, one(output), findings)


def _recorded(rig: LoadedRig, given: list[Path], progress: Progress) -> tuple[Dwells, FloatArray]:
    """Dwells of what is given, or else lies beside the rig file, and hinge centres (n, 3), m, BCS.

    These are means over the dwells, or over all samples where nothing rests.
    """
    campaign = resolve(given or [rig.path.parent], rig.path)
    if not campaign.logs:
        raise no_log(given, "there is no log to build on")
    log, means = LogPass(campaign, Settings(progress)), list[list[FloatArray]]()

    def watched() -> Iterator[Log]:
        for piece in log.pieces():
            seen = [series.value for series in piece.position]
            means.append([x.mean(axis=0) if len(x) else np.full(3, np.nan) for x in seen])
            yield piece

    progress("reading the log and finding the dwells")
    dwells = log.noted(find_dwells(watched()))
    return dwells, np.nanmean(dwells.position if len(dwells) else means, axis=0)


def _travels(travel: Travel) -> dict[str | None, tuple[float, ...]]:
    found = {}
    for text in [travel] if isinstance(travel, str | float | int) else travel:
        name, equals, value = str(text).rpartition("=")
        found[name if equals else None] = numbers("--travel", value)
    return found
