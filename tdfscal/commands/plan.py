"""`plan`: which postures and squeezes to drive, and what to expect of them."""

from __future__ import annotations

from collections.abc import Sequence
from pathlib import Path
from typing import TYPE_CHECKING, Annotated, Any

import numpy as np

from tdfscal.commands import options
from tdfscal.commands.campaign import PathLike, no_log, one, resolve, rig_file
from tdfscal.commands.log_pass import LogPass, Settings, delay_of
from tdfscal.commands.options import Numbers, Option, Progress, numbers, silent, triple
from tdfscal.commands.result import CommandResult
from tdfscal.errors import TdfscalError, UsageError
from tdfscal.files.rig.reading import LoadedRig
from tdfscal.files.writers.plan import plan_csv, time_table_csv
from tdfscal.findings import Finding
from tdfscal.frozen import record, replace
from tdfscal.model.postures import postures as at_rest
from tdfscal.model.postures import register
from tdfscal.planning.candidates import Limits, Request
from tdfscal.planning.motion import MovingPlan, MovingRequest, plan_motion
from tdfscal.planning.plan import Plan, make_plan
from tdfscal.planning.predicted_information import scatter_of
from tdfscal.records import Dwells, FloatArray, Rig
from tdfscal.reporting.layout import Drawing, Report
from tdfscal.reporting.summaries import plan_document, plan_report

if TYPE_CHECKING:
    import pandas as pd

DEFAULT_NOISE = 1.0
"""N per axis and posture, where nothing is recorded yet and the rig file states no force noise."""
DEFAULT_DENSITY = 0.1
"""N, of a force's mean over a second in motion."""
DEFAULT_DURATION, DEFAULT_SPEED = 60.0, 0.02


@record(eq=False)
class PlanResult(CommandResult):
    """Postures or a motion to drive, and what to expect of it. output : the file."""

    plan: Plan | MovingPlan
    output: Path | None
    findings: tuple[Finding, ...] = ()

    def to_report(self, drawings: tuple[Drawing, ...] = ()) -> Report:
        """Return what to drive, and what to expect of it."""
        return plan_report(self.plan, self.findings)

    @property
    def content(self) -> str:
        """The file that a machine drives, CSV."""
        if isinstance(self.plan, MovingPlan):
            return time_table_csv(self.plan, self.command)
        return plan_csv(self.plan, self.command)

    def document(self) -> dict[str, Any]:
        """Return the plan as plain JSON values, SI units."""
        return plan_document(self.plan, self.output)

    def to_frame(self) -> pd.DataFrame:
        """One row per posture, or instant in s: hinge centres in m, squeezes in N, BCS."""
        import io

        import pandas as pd

        return pd.read_csv(io.StringIO(self.content), comment="#")


Driven = Annotated[
    PathLike | None,
    options.written("postures, or the time table, to drive", ".csv", metavar="FILE.csv"),
]
Count = Annotated[
    int | None,
    Option("postures to drive; default 24, or more for acceptance.contact", least=1, below=10_001),
]
Target = Annotated[
    float | None,
    Option(
        "as many postures as bring every angle within ± this (95 %), mrad",
        metavar="MRAD",
        least=1e-6,
    ),
]
Tilt = Annotated[float, Option("largest tilt, degrees", metavar="DEG", least=0, below=46)]
Squeeze = Annotated[float, Option("largest internal force at any NCP, N", metavar="N", least=0)]
ForceLimit = Annotated[
    float | None, Option("largest force at any NCP in all, N", metavar="N", least=0)
]
Ways = Annotated[
    float | str | Sequence[str | float],
    Option(
        "way from home, either side, m: of all NCPs, or of one",
        list[str],
        "[NCP=]M[,M,M]",
        shell="repeatable",
    ),
]
Home = Annotated[
    Numbers | None,
    Option(
        "LCS origin in the BCS at home, m; default: mean of the recorded log", str | None, "X,Y,Z"
    ),
]
Stiffness = Annotated[
    float | None,
    Option(
        "of an NCP, N/m: squeeze by displacements; else by servoed forces",
        metavar="N/M",
        least=1.0,
        below=1e12,
    ),
]
Noise = Annotated[
    float | None,
    Option(
        "noise of a posture's mean force per axis, N; default: the log's, or 0 beside a "
        "stated force_noise, or 1; of a motion, of a mean over a second, default 0.1",
        metavar="N",
        least=0,
    ),
]
Duration = Annotated[float, Option("of the motion, s", metavar="S", least=20, below=3601)]
Speed = Annotated[
    float, Option("largest speed of a hinge in motion, m/s", metavar="M/S", least=1e-6)
]


@options.command("plan rig.yaml -o plan.csv --postures 24")
def plan(
    rig: Annotated[PathLike, Option("a rig.yaml, or its folder", Path, "RIG")],
    *,
    output: Driven = None,
    postures: Count = None,
    target: Target = None,
    tilt: Tilt = 5.0,
    squeeze: Squeeze = 200.0,
    force_limit: ForceLimit = None,
    travel: Ways = (),
    home: Home = None,
    stiffness: Stiffness = None,
    noise: Noise = None,
    motion: Annotated[bool, Option("plan a motion without a stop, not postures")] = False,
    duration: Duration = DEFAULT_DURATION,
    speed: Speed = DEFAULT_SPEED,
    progress: options.Telling = silent,
) -> PlanResult:
    """Choose the postures and squeezes, or the motion, to drive, and say what to expect of them."""
    if motion and (postures, target) != (None, None):
        what = "--postures and --target are of postures"
        raise UsageError(what, where="--motion", hint="leave them out, or plan postures")
    if postures is not None and target is not None:
        what = "--postures and --target ask for two different things"
        raise UsageError(what, hint="give one of them")
    if not motion and (duration, speed) != (DEFAULT_DURATION, DEFAULT_SPEED):
        what = "--duration and --speed are of a motion"
        raise UsageError(what, hint="leave them out, or plan one by --motion")
    known, force = rig_file(rig), np.inf if force_limit is None else force_limit
    way = travel_limits(known.rig, travel)
    limits = Limits(float(np.deg2rad(tilt)), squeeze, way, np.zeros(3), force, stiffness)
    limits, seen, findings = _at_home(limits, known, home, progress)
    found: Plan | MovingPlan
    if motion:
        progress("looking for the best motion")
        density = DEFAULT_DENSITY if noise is None else noise
        moving = MovingRequest(limits, duration, speed, density, delay_of(known))
        found = plan_motion(known.rig, moving, np.random.default_rng(0))
    else:
        own = _noise(known.rig, seen) if noise is None else noise
        request = Request(limits, own)
        found = make_plan(
            known.rig,
            request,
            postures,
            np.random.default_rng(0),
            target=None if target is None else 1e-3 * target,
            progress=progress,
        )
    return PlanResult(found, one(output), findings)


def travel_limits(rig: Rig, travel: float | str | Sequence[str | float]) -> FloatArray:
    """Half ranges (n, 3), m, by entries [NCP=]M[,M,M]; without an NCP they are of all.

    Raises UsageError for an unknown support or an impossible range.
    """
    each = [travel] if isinstance(travel, str | float | int) else travel
    pairs = [str(text).rpartition("=")[::2] for text in each]
    entries = dict(pairs)
    if len(entries) < len(pairs):
        what, hint = "two ranges are of the same NCPs", "give x, y and z as one text, M,M,M"
        raise UsageError(what, where="--travel", hint=hint)
    found = np.full((rig.n, 3), np.inf)
    for name, text in sorted(entries.items()):  # of all first
        value = numbers("--travel", text)
        if name and name not in rig.supports:
            hint = f"the rig has {', '.join(rig.supports)}"
            raise UsageError(f"there is no support {name!r}", where="--travel", hint=hint)
        if len(value) not in (1, 3):
            raise UsageError(
                f"{len(value)} ranges are given", where="--travel", hint="give one, or x, y and z"
            )
        if not min(value) >= 0.0:
            raise UsageError("a range is negative", where="--travel", hint="give metres")
        found[rig.supports.index(name) if name else slice(None)] = value
    return found


def _at_home(
    limits: Limits, rig: LoadedRig, home: Numbers | None, progress: Progress
) -> tuple[Limits, Dwells | None, tuple[Finding, ...]]:
    """Put the limits about the home, unless it is named: the mean of what lies beside the rig file.

    Of its dwells, or along the motion where nothing rests.
    """
    if home is not None:
        return replace(limits, home=np.array(triple("--home", home))), None, ()
    try:
        campaign = resolve([rig.path.parent], rig.path)
        if not campaign.logs:
            raise no_log(rig.path.parent)
        log = LogPass(campaign, Settings(progress))
        seen, _ = log.samples("static")
        centres = (seen if len(seen) else log.moving()).position.mean(axis=0)
        (level,), (middle,) = register(rig.rig.hinge, centres[None])
    except TdfscalError as error:
        return limits, None, (Finding("home-unknown", values={"why": error.what}),)
    return replace(limits, home=middle, level=level, recorded=True), seen, ()


def _noise(rig: Rig, seen: Dwells | None) -> float:
    """Noise of a posture, N per axis, as what is recorded shows it; else what is usual."""
    usual = 0.0 if rig.declared.force_noise else DEFAULT_NOISE
    return (scatter_of(at_rest(rig, seen), rig) or usual) if seen else usual
