"""The report of a calibration without angles: what is weak, what was left out, what next."""

from __future__ import annotations

from collections.abc import Iterator
from pathlib import PurePath

from tdfscal.catalogue import cure, sentence
from tdfscal.catalogue.entry import begun
from tdfscal.catalogue.numbers import measured, rounded
from tdfscal.catalogue.numbers import when as at
from tdfscal.errors import NotConvergedError, TdfscalError
from tdfscal.estimation.judged import Undetermined
from tdfscal.files.calibration.parts import MeasuredResult
from tdfscal.files.rig.reading import LoadedRig
from tdfscal.frozen import record
from tdfscal.records import InputFile
from tdfscal.reporting import layout
from tdfscal.reporting.layout import Block, Facts, Report, Section, Table
from tdfscal.reporting.traceability import Making, campaign, day_measured, stated_facts


@record
class Attempt:
    """A calibration that ended without angles.

    rig : the last campaign's. inputs : files that were read. messages : of the log. paths : as
    they were given. measured : when; None of several campaigns.
    """

    error: TdfscalError
    rig: LoadedRig
    inputs: tuple[InputFile, ...]
    messages: tuple[str, ...]
    paths: tuple[str, ...]
    command: str
    measured: MeasuredResult | None = None

    @property
    def seen(self) -> Undetermined | None:
        """What there is to be looked at."""
        found = self.error.evidence
        return found if isinstance(found, Undetermined) else None


def undetermined_report(attempt: Attempt) -> Report:
    """Lay out what is weak, the log and its residuals, and what to do next; no angle is given."""
    error, seen, rig, when = attempt.error, attempt.seen, attempt.rig, attempt.measured
    names = ", ".join(PurePath(entry.path).name for entry in attempt.inputs)
    limit = 1e3 * rig.rig.acceptance.identifiable
    making = Making(attempt.command, attempt.inputs)
    origin = making.section(
        ("Rig file", f"{rig.path}, SHA-256 {rig.sha256}"),
        ("Decision rule", "an angle is determined where the standard uncertainty of its turn is "
         f"below {rounded(limit, 3)} mrad (acceptance.identifiable) and at most half of what was "
         "stated before"),
    )  # fmt: skip
    return Report(
        title=rig.rig.name,
        subtitle=f"calibration of {len(rig.rig.supports)} sensors from "
        f"{names or ', '.join(attempt.paths)}{f' of {day_measured(when)}' if when else ''}",
        verdict="NOT CONVERGED" if isinstance(error, NotConvergedError) else "NOT IDENTIFIABLE",
        accepted=False,
        claim="No angle is given, and no calibration file was written.",
        reasons=(f"{error.where}: {error.what}" if error.where else error.what,),
        sections=(
            *([_turns(seen, error.finding.code), *_evidence(seen)] if seen else ()),
            *([campaign(stated_facts(rig.rig, when), rig.rig)] if when else []),
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


def _turns(seen: Undetermined, code: str) -> Section:
    """Every turn with its standard uncertainty; what each weak one lacks; code : of the error."""
    within = "Within either of the two mountings" * (code == "mountings-alike")
    rows = tuple(
        (turn.support, turn.angle, _known(turn.std), "yes" if turn.identified else "NO")
        for turn in seen.observability.angles
    )
    header = ("sensor", "turn", "std. uncertainty", "determined")
    causes: dict[str, list[str]] = {}
    for weakness in seen.observability.weak:
        causes.setdefault(sentence(weakness.finding), []).append(weakness.angle.name)
    lacking = (f"{', '.join(names)}: {cause}" for cause, names in causes.items())
    blocks: tuple[Block, ...] = Table(within, header, rows, left=2), *layout.listed("", lacking)
    return Section("What the data determine", blocks)


def _known(std: float) -> str:
    return f"{measured(1e3 * std)} mrad" if std < 1.0 else "over 1 rad"


def _evidence(seen: Undetermined) -> Iterator[Section]:
    """What was used and left out, and how well it fits."""
    q, moving = seen.quality, isinstance(seen.of, float)
    if isinstance(seen.of, float):
        used = ("Motion", f"{seen.of:.0f} s of the log used")
        left_out = layout.stretches(seen.rejected)
    else:
        total = len(seen.of)
        used = ("Postures", f"{total - len(seen.rejected)} of {total} in the fit")
        rests = (f"from {at(s.start)}: {sentence(s.reason)}" for s in seen.of.left_out)
        left_out = (*layout.rejected(seen.rejected), *rests)
    fit = "no residual is left to judge it by"
    if q.dof > 0:
        fit = layout.chi_squared(q.chi2, q.dof, None if moving else q.p_value)
    yield Section("Statistics", (Facts((used, ("Fit", fit))),))
    yield Section("Left out", layout.listed("", left_out))
