"""`register`: the rigid transform between two point files."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from pathlib import Path
from typing import Annotated, Any

import numpy as np

from tdfscal.commands import options
from tdfscal.commands.campaign import PathLike
from tdfscal.commands.options import Option, silent
from tdfscal.commands.result import CommandResult
from tdfscal.errors import UsageError
from tdfscal.files.field_types import LengthUnit
from tdfscal.files.points.reading import read_point_file
from tdfscal.files.yaml import as_path
from tdfscal.findings import Finding
from tdfscal.frozen import record
from tdfscal.records import Instrument
from tdfscal.reporting.layout import Drawing, Report
from tdfscal.reporting.summaries import registration_document, registration_report
from tdfscal.trackercal import best_fit
from tdfscal.trackercal.best_fit import PointRegistration
from tdfscal.trackercal.point_matching import Match


@record(eq=False)
class RegisterResult(CommandResult):
    """Best-fit transform reference → measured. of_files : what was found of its point files."""

    registration: PointRegistration
    of_files: tuple[Finding, ...]

    @property
    def findings(self) -> tuple[Finding, ...]:
        """What was found of the files and of the fit."""
        return (*self.of_files, *self.registration.findings)

    def to_report(self, drawings: tuple[Drawing, ...] = ()) -> Report:
        """Return transform, uncertainty, residuals."""
        return registration_report(self.registration, self.of_files)

    def document(self) -> dict[str, Any]:
        """Return plain JSON values; m and rad."""
        return registration_document(self.registration)

    def table(self) -> dict[str, Any]:
        """One row per point: its residual x, y, z and their length, in m."""
        r = self.registration
        columns = (r.names, *r.residual.T, np.linalg.norm(r.residual, axis=1))
        return dict(zip(("point", "x", "y", "z", "length"), columns, strict=True))


@options.command("register measured.csv drawing.csv --unit mm")
def register(
    measured: Annotated[PathLike, Option("point file, as measured", Path, "MEASURED")],
    reference: Annotated[PathLike, Option("point file, fitted onto it", Path, "REFERENCE")],
    *,
    unit: Annotated[LengthUnit | None, Option("of files that name none")] = None,
    match: Annotated[
        Match, Option("pair points by group and name, by name in whatever group, or row by row")
    ] = "name",
    groups: Annotated[
        Mapping[str, str] | Sequence[str],
        Option("measured group A is reference group B", list[str], "A=B", shell="repeatable"),
    ] = (),
    range: Annotated[
        float | None,
        Option("instrument: standard uncertainty of its range, m", metavar="M", least=0.0),
    ] = None,
    range_ppm: Annotated[
        float | None,
        Option("instrument: what adds to it, ppm of the distance", metavar="P", least=0.0),
    ] = None,
    angle_arcsec: Annotated[
        float | None,
        Option("instrument: standard uncertainty of its angles, arcsec", metavar="A", least=0.0),
    ] = None,
    progress: options.Telling = silent,
) -> RegisterResult:
    """Fit the rigid transform from reference points to measured ones, with its uncertainty."""
    instrument = _instrument(range, range_ppm, angle_arcsec)
    pairs = _pairs(groups)
    first = read_point_file(as_path(measured), length_unit=unit)
    second = read_point_file(as_path(reference), length_unit=unit)
    fit = best_fit.register(
        first.points, second.points, instrument=instrument, match=match, groups=pairs
    )
    return RegisterResult(fit, (*first.findings, *second.findings))


def _instrument(*given: float | None) -> Instrument | None:
    """Return the instrument of range, range_ppm, angle_arcsec; None where none is stated."""
    if all(value is None for value in given):
        return None
    values = [0.0 if value is None else float(value) for value in given]
    if not (values[0] or values[1]) or not values[2]:
        raise UsageError(
            "an instrument has an uncertainty of its range and one of its angles",
            where="--range, --range-ppm, --angle-arcsec",
            hint="state both, as in --range 1e-5 --range-ppm 5 --angle-arcsec 2",
        )
    return Instrument(*values)


def _pairs(groups: Mapping[str, str] | Sequence[str]) -> dict[str, str]:
    """Return measured → reference group, of a mapping or of texts `A=B`, `A=B,C=D`."""
    if isinstance(groups, Mapping):
        return dict(groups)
    pairs: dict[str, str] = {}
    texts = [groups] if isinstance(groups, str) else groups
    for text in (part for whole in texts for part in whole.split(",")):
        ours, equals, theirs = (part.strip() for part in text.partition("="))
        if not (ours and equals and theirs) or ours in pairs:
            raise UsageError(
                f"{text!r} does not pair two groups",
                where="--groups",
                hint="write MEASURED=REFERENCE, as in --groups targets_1=ncp1",
            )
        pairs[ours] = theirs
    return pairs
