"""The report of a calibration that ended without angles: what is weak, what was seen, what next."""

from __future__ import annotations

from collections.abc import Iterator
from pathlib import PurePath

import numpy as np

from tdfscal.catalogue import cure, sentence
from tdfscal.catalogue.entry import begun
from tdfscal.catalogue.numbers import rounded
from tdfscal.errors import NotConvergedError, TdfscalError
from tdfscal.files.calibration import statistics
from tdfscal.files.calibration.evidence import DwellTable, PostureTable
from tdfscal.files.calibration.parts import RejectedPosture
from tdfscal.files.rig.reading import EmbeddedRig, LoadedRig
from tdfscal.frozen import record, replace
from tdfscal.motioncal.pipeline import UndeterminedMotion
from tdfscal.records import InputFile
from tdfscal.reporting import layout
from tdfscal.reporting.figures import angles, residuals, timeline
from tdfscal.reporting.figures.style import Drawing
from tdfscal.reporting.figures.timeline import DwellLog
from tdfscal.reporting.layout import Facts, Items, Report, Section, Table
from tdfscal.reporting.traceability import Making
from tdfscal.selfcal.result import Undetermined

Seen = Undetermined | UndeterminedMotion


@record
class Attempt:
    """A calibration that ended without angles.

    rig : the last campaign's. inputs : files that were read. messages : of the log. paths : as
    they were given.
    """

    error: TdfscalError
    rig: LoadedRig
    inputs: tuple[InputFile, ...]
    messages: tuple[str, ...]
    paths: tuple[str, ...]
    command: str

    @property
    def seen(self) -> Seen | None:
        """What there is to be looked at."""
        found = self.error.evidence
        return found if isinstance(found, Undetermined | UndeterminedMotion) else None

    def log(self, seen: Undetermined) -> DwellLog:
        """The dwells of the log."""
        held, left_out = statistics.dwells(seen), statistics.rejected(seen.dwells, seen.rejected)
        return DwellLog(
            EmbeddedRig.model_validate({**self.rig.document, "sha256": self.rig.sha256}),
            PostureTable.model_validate(statistics.postures(seen)),
            tuple(map(RejectedPosture.model_validate, left_out)),
            None if held is None else DwellTable.model_validate(held),
        )


def undetermined_drawings(attempt: Attempt) -> tuple[Drawing, ...]:
    """Return every figure for which there is evidence."""
    seen = attempt.seen
    if seen is None:
        return ()
    turns = angles.determined(seen.observability, seen.rig.acceptance.identifiable)
    if attempt.error.finding.code == "mountings-alike":
        which = "Which of two mountings it is, the log leaves undetermined. Within either"
        turns = replace(turns, reading=f"{which}, {turns.reading}")
    if isinstance(seen, UndeterminedMotion):
        return turns, timeline.moving(seen.slow, seen.rejected)
    log = attempt.log(seen)
    found: list[Drawing | None] = [timeline.of(log)]
    if seen.quality.dof > 0:
        said = (
            "What the fit leaves of forces and moments, each posture predicted from the others: it "
            "says how well log and rig file agree, and nothing of turns that are not determined."
        )
        left = residuals.at_postures(log.postures)
        found.append(left and replace(left, reading=said))
    return turns, *(drawing for drawing in found if drawing is not None)


def undetermined_report(attempt: Attempt, drawings: tuple[Drawing, ...] = ()) -> Report:
    """Lay out what is weak, the log and its residuals, and what to do next; no angle is given."""
    error, seen, rig = attempt.error, attempt.seen, attempt.rig
    moving = isinstance(seen, UndeterminedMotion)
    names = ", ".join(PurePath(entry.path).name for entry in attempt.inputs)
    limit = 1e3 * rig.rig.acceptance.identifiable
    making = Making(attempt.command, attempt.inputs)
    blocks = {
        "determined": _turns(seen) if seen is not None else (),
        "forces" if moving else "timeline": layout.listed("Left out", _left_out(attempt)),
    }
    origin = making.section(
        ("Rig file", f"{rig.path}, SHA-256 {rig.sha256}"),
        ("Decision rule", "an angle is determined where the standard uncertainty of its turn is "
         f"below {rounded(limit, 3)} mrad (acceptance.identifiable) and at most half of what was "
         "stated before"),
    )  # fmt: skip
    return Report(
        title=rig.rig.name,
        subtitle=f"calibration of {len(rig.rig.supports)} sensors from "
        f"{names or ', '.join(attempt.paths)}",
        verdict="NOT CONVERGED" if isinstance(error, NotConvergedError) else "NOT IDENTIFIABLE",
        accepted=False,
        claim="No angle is given, and no calibration file was written.",
        reasons=(f"{error.where}: {error.what}" if error.where else error.what,),
        sections=(
            *layout.illustrated(drawings, blocks),
            Section("Statistics", (Facts(_statistics(seen)),) if seen is not None else ()),
            origin,
        ),
        warnings=attempt.messages,
        advice=tuple(_advice(attempt)),
        created=layout.utc(making.created),
    )


def _advice(attempt: Attempt) -> Iterator[str]:
    """The error's own first, then what other weak turns ask for, of each code the first."""
    seen, own = attempt.seen, attempt.error.hint or ""
    weak = [] if seen is None else [weakness.finding for weakness in seen.observability.weak]
    cures = {finding.code: cure(finding) for finding in reversed(weak)}
    others = (text for text in reversed(cures.values()) if not own.startswith(text))
    yield from (begun(text, ".") for text in (own, *others) if text)


def _turns(seen: Seen) -> tuple[Table | Items, ...]:
    """What each weak turn lacks, and how far the loads on each sensor point apart."""
    causes: dict[str, list[str]] = {}
    for weakness in seen.observability.weak:
        causes.setdefault(sentence(weakness.finding), []).append(weakness.angle.name)
    said = (f"{', '.join(names)}: {cause}" for cause, names in causes.items())
    spread = np.degrees(seen.observability.spread)
    rows = tuple(
        (name, f"{rounded(angle)}") for name, angle in zip(seen.rig.supports, spread, strict=True)
    )
    table = Table("", ("sensor", "directions of its loads within, degrees"), rows)
    return (*layout.listed("Not determined", said), table)


def _left_out(attempt: Attempt) -> tuple[str, ...]:
    seen = attempt.seen
    if seen is None:
        return ()
    if isinstance(seen, UndeterminedMotion):
        return layout.stretches(seen.rejected)
    log = attempt.log(seen)
    rests = layout.rests(log.postures.left_out, log.clock)
    return (*layout.postures(log.rejected, log.clock), *rests)


def _statistics(seen: Seen) -> tuple[tuple[str, str], ...]:
    q = seen.quality
    if isinstance(seen, Undetermined):
        total = len(seen.dwells)
        used = ("Postures", f"{total - len(seen.rejected)} of {total} in the fit")
    else:
        used = ("Motion", f"{seen.keep.sum() * seen.slow.step:.0f} s of the log used")
    fit = layout.chi_squared(q.chi2, q.dof, q.p_value if isinstance(seen, Undetermined) else None)
    return used, ("Fit", fit if q.dof > 0 else "no residual is left to judge it by")
