"""`init`: a rig file from nothing but logs."""

from __future__ import annotations

from pathlib import Path
from typing import Annotated, Any

from tdfscal.catalogue import told
from tdfscal.checks.log_against_rig import bent
from tdfscal.commands import options
from tdfscal.commands.campaign import PathLike, find_logs
from tdfscal.commands.options import silent
from tdfscal.commands.result import CommandResult
from tdfscal.dwells.find import no_dwell
from tdfscal.errors import DataError
from tdfscal.files.rig.draft import RigSketch, draft, sketch_rig
from tdfscal.files.rig.reading import parse_rig
from tdfscal.frozen import record
from tdfscal.logs.describe import LogInfo, describe_logs
from tdfscal.records import FloatArray
from tdfscal.reporting.layout import document

_GRAVITY = 9.80665


@record(eq=False)
class InitResult(CommandResult):
    """A drafted rig file. yaml : its text. description : of the logs. confirm : what to confirm.
    doubts : what keeps the positions from being a rigid terminal's.
    """

    yaml: str
    description: LogInfo
    sketch: RigSketch
    confirm: tuple[str, ...]
    doubts: tuple[str, ...] = ()

    @property
    def text(self) -> str:
        """What was drafted, in words."""
        n, postures = len(self._supports), len(self.description.dwells or ())
        return (
            f"a rig of {n} supports ({', '.join(self._supports)}), {postures} static postures, "
            f"about {self.sketch.mass:.4g} kg\n{len(self.confirm)} lines are marked to be "
            "confirmed;\n`tdfscal calibrate` runs with them and says which its result rests on\n"
        )

    @property
    def notes(self) -> tuple[str, ...]:
        """What keeps the logs from being used, or wants a look."""
        return (*self.doubts, *self.description.problems)

    def document(self) -> dict[str, Any]:
        """Return the text, what to confirm, and the numbers behind it."""
        names = "yaml confirm supports=_supports hinge=sketch.hinge mass=sketch.mass"
        names += " nominal_rpy=sketch.nominal_rpy"
        return document(self, names, notes=[*self.description.guess.notes, *self.notes])

    def table(self) -> dict[str, Any]:
        """One row per support: hinge in m, nominal mounting in rad."""
        columns = (self._supports, *self.sketch.hinge.T, *self.sketch.nominal_rpy.T)
        return dict(zip(["support", "x", "y", "z", "roll", "pitch", "yaw"], columns, strict=True))

    @property
    def _supports(self) -> tuple[str, ...]:
        return self.description.guess.supports


@options.command("init campaign/log.csv -o campaign/rig.yaml")
def init(
    paths: options.Paths,
    *,
    output: Annotated[
        PathLike | None,
        options.written(
            "file to write",
            ".yaml",
            ".yml",
            default=Path("-"),
            shell="default: stdout",
            holds="yaml",
        ),
    ] = None,
    progress: options.Telling = silent,
) -> InitResult:
    """Write a complete, commented rig.yaml from a log; what to confirm is marked in it."""
    logs = find_logs(paths)
    progress("reading the log")
    info = describe_logs(logs)
    first = info.contents[0]
    if not info.recorders:
        raise _no_draft(info, info.guess.cure)
    position, force = _postures(info)
    wrong, mended = bent(info.guess.supports, position)
    position = position if mended is None else mended.signals(position)
    sketch = sketch_rig(position, force, _GRAVITY)
    text = draft(
        first.path.absolute().parent.name or "Rig",
        sketch,
        len(position),
        info.recorders,
        info.guess.notes,
    )
    drafted = parse_rig(text.encode(), str(output or "rig.yaml"))
    doubts = tuple(told(drafted.written(one)) for one in wrong)
    return InitResult(text, info, sketch, drafted.unconfirmed, doubts)


def _no_draft(info: LogInfo, hint: str | None = None) -> DataError:
    """The error for logs that do not show enough, with all that is known of why."""
    said = info.problems or info.guess.notes or ("no mapping is guessed",)
    what, path = "; ".join(text.rstrip(".") for text in said), str(info.contents[0].path)
    return DataError(what, where=None if path in what else path, hint=hint)


def _postures(info: LogInfo) -> tuple[FloatArray, FloatArray]:
    """Positions and forces (K, n, 3): of the dwells, or of samples where there is none."""
    if info.dwells is not None and len(info.dwells):
        return info.dwells.position, info.dwells.force
    there = info.samples
    if there is None:
        raise no_dwell(info.dwells) if info.dwells is not None else _no_draft(info)
    return there
