"""`tdfscal apply`."""

from __future__ import annotations

import sys
from collections.abc import Iterator
from dataclasses import dataclass, field
from pathlib import Path
from typing import Any

import numpy as np

from tdfscal.checks.log_against_calibration import Inspection
from tdfscal.cli.app import emit
from tdfscal.errors import DataError
from tdfscal.files.output_places import check_calibration
from tdfscal.files.writers.wrenches import check_wrench_path, write_wrenches
from tdfscal.logs import iter_log
from tdfscal.records import FloatArray, Log
from tdfscal.workflows.calibration_in_use import InUse, take
from tdfscal.wrench.contact_wrench import COMPONENTS
from tdfscal.wrench.filtering import Kind, Walk, checked_walk, filtered
from tdfscal.wrench.resampling import Tally, aligned
from tdfscal.wrench.stream import WrenchPiece, at_rest, in_motion


@dataclass(slots=True)
class _Totals:
    """What the summary says of the rows: sums over components (6,), and largest lengths (2,)."""

    squares: FloatArray = field(default_factory=lambda: np.zeros(6))
    raw_squares: FloatArray = field(default_factory=lambda: np.zeros(6))
    variance: FloatArray = field(default_factory=lambda: np.zeros(6))
    largest: FloatArray = field(default_factory=lambda: np.zeros(2))
    span: list[float] = field(default_factory=list)

    def add(self, piece: WrenchPiece) -> None:
        w = piece.wrench
        self.squares += np.einsum("ka,ka->a", w.value, w.value)
        self.raw_squares += np.einsum("ka,ka->a", w.raw, w.raw)
        self.variance += np.einsum("ka,ka->a", w.std, w.std)
        lengths = np.sqrt(np.sum(w.value.reshape(-1, 2, 3) ** 2, axis=2)).max(axis=0)
        self.largest = np.maximum(self.largest, lengths)
        self.span = [*self.span[:1], float(piece.time[0]), float(piece.time[-1])]
        self.span = [self.span[0], self.span[-1]]


def run(
    calibration: Path,
    paths: list[Path],
    *,
    output: Path,
    rig: Path | None,
    quasi_static: bool,
    filter: Kind,
    walk: float | None,
    json: bool,
    quiet: bool,
) -> None:
    """Write the contact wrench of every sample and print a summary."""
    check_wrench_path(output)
    walk = checked_walk(filter, walk)
    check_calibration(calibration)
    use = take(calibration, paths, rig)
    check_wrench_path(output, [calibration, *use.campaign.logs])
    for warning in use.warnings:
        print(f"tdfscal: WARNING: {warning}", file=sys.stderr)
    moving = use.given.rig.inertia is not None and not quasi_static
    tally, totals, notes = Tally(), _Totals(), list[str]()
    loaded = use.campaign.rig

    def heard(piece: Log) -> Log:
        notes.extend(piece.warnings)
        if not quiet and sys.stderr.isatty():
            print(f"\r{tally.used} samples …", end="", file=sys.stderr, flush=True)
        return piece

    pieces = map(heard, iter_log(use.campaign.logs, loaded.log, loaded.rig.supports))
    inspection = Inspection(use.given)
    samples = inspection.watch(aligned(pieces, tally))
    told: list[Walk] = []
    if walk is not None:
        samples = filtered(samples, filter, walk, told.append)
    wrenches = in_motion(use.given, samples) if moving else at_rest(use.given, samples)
    about = _about(use, filter, walk, moving=moving)
    judged = _judged(wrenches, paths, inspection, notes)
    # Numbers out of all proportion are refused by name, not warned of by numpy.
    with np.errstate(all="ignore"):
        rows = write_wrenches(output, judged, about, totals.add)
    notes += _notes(tally, use)
    result = _summary(use, output, rows, tally, totals, notes, moving=moving)
    result["filter"] = _filter(filter, walk, told[0]) if walk is not None else None
    for note in notes:
        print(f"tdfscal: warning: {note}", file=sys.stderr)
    if json:
        emit(result)
    else:
        _print(result)


def _filter(kind: Kind, walk: float, model: Walk) -> dict[str, Any]:
    """What the filter does, SI units."""
    return {
        "kind": kind,
        "walk": walk,
        "noise": float(np.sqrt(model.r)),
        "noise_left": model.left if kind == "kalman" else model.left_smooth,
        "delay": model.delay if kind == "kalman" else 0.0,
    }


def _judged(
    pieces: Iterator[WrenchPiece], paths: list[Path], inspection: Inspection, notes: list[str]
) -> Iterator[WrenchPiece]:
    """Pass the pieces on; at their end add to the notes what the inspection warns of.

    Raises DataError where there is no piece, or the log contradicts the rig: while the result is
    not in its place yet.
    """
    found = False
    for piece in pieces:
        found = True
        yield piece
    if not found:
        raise DataError(
            "there is no instant at which every NCP's position and force are known",
            where=", ".join(map(str, paths)),
            hint="check that all streams were recorded at the same time",
        )
    notes += inspection.finish()


def _about(use: InUse, kind: Kind, walk: float | None, *, moving: bool) -> dict[str, str]:
    """Metadata of a Parquet file."""
    return {
        "quantity": "contact wrench on the terminal: force, and moment about the LCS origin",
        "frame": "LCS",
        "units": "s, N, N·m",
        "u_": "standard uncertainty (k = 1) from the calibration and the rig's constants; "
        "noise of the single sample not included",
        "raw_": "the same with the nominal mounting and the stated zeros, mass and barycentre",
        "filter": "none" if walk is None else f"{kind}, walk {walk:g} N in 1 s",
        "inertia": "included" if moving else "not included (quasi-static)",
        "calibration": f"{use.calibration.method}, {use.calibration.created}, "
        f"{use.calibration.status}",
        "rig": use.given.rig.name,
    }


def _notes(tally: Tally, use: InUse) -> list[str]:
    notes = []
    if tally.uncovered:
        notes.append(
            f"{tally.uncovered} force samples lie where another stream has a gap, has not begun "
            "or has ended; they are left out"
        )
    if tally.unreadable:
        notes.append(f"{tally.unreadable} samples hold no number and are left out")
    if use.given.open.any():
        notes.append(
            "the calibration leaves zeros, mass or barycentre open: the uncertainty of the "
            "components that they touch is unknown (empty)"
        )
    return notes


def _summary(
    use: InUse,
    output: Path,
    rows: int,
    tally: Tally,
    totals: _Totals,
    notes: list[str],
    *,
    moving: bool,
) -> dict[str, Any]:
    def rms(squares: FloatArray) -> dict[str, float | None]:
        root = np.sqrt(squares / rows)
        return {
            name: float(v) if np.isfinite(v) else None
            for name, v in zip(COMPONENTS, root, strict=True)
        }

    return {
        "output": str(output),
        "rows": rows,
        "start": totals.span[0],
        "end": totals.span[1],
        "quasi_static": not moving,
        "calibration_status": use.calibration.status,
        "left_out": {"uncovered": tally.uncovered, "unreadable": tally.unreadable},
        "rms": rms(totals.squares),
        "rms_uncalibrated": rms(totals.raw_squares),
        "std": rms(totals.variance),
        "largest": {"force": float(totals.largest[0]), "torque": float(totals.largest[1])},
        "warnings": [*use.warnings, *notes],
    }


def _number(value: float | None, form: str) -> str:
    return "unknown" if value is None else format(value, form)


def _print(result: dict[str, Any]) -> None:
    from tdfscal.reporting.text import table

    way = "quasi-static" if result["quasi_static"] else "with inertia"
    print(
        f"Contact wrench of {result['rows']} samples, {result['start']:.6g} to "
        f"{result['end']:.6g} s, {way}; LCS, moments about its origin"
    )
    if (f := result["filter"]) is not None:
        late = f"{1e3 * f['delay']:.3g} ms late" if f["delay"] else "without delay"
        print(
            f"filter {f['kind']}: {late}; leaves {100 * f['noise_left']:.0f} % of the sensors' "
            f"noise of {f['noise']:.3g} N"
        )
    rows = [
        [
            name,
            "N" if name.startswith("f") else "N·m",
            _number(result["rms"][name], ".3g"),
            _number(result["rms_uncalibrated"][name], ".3g"),
            _number(result["std"][name], ".2g"),
        ]
        for name in COMPONENTS
    ]
    print("\n".join(table(["", "", "rms", "rms uncalibrated", "std. unc."], rows, left=2)))
    print(
        f"largest: force {result['largest']['force']:.3g} N, "
        f"torque {result['largest']['torque']:.3g} N·m"
    )
    print(f"\nwrote {result['output']}")
