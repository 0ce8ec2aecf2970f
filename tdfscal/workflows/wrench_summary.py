"""What `apply` says of a log's contact wrenches: totals, warnings, metadata."""

from __future__ import annotations

from collections.abc import Iterable, Iterator, Sequence
from dataclasses import dataclass, field
from pathlib import Path
from typing import Any

import numpy as np

from tdfscal.catalogue import documents
from tdfscal.findings import Finding
from tdfscal.model.zero_motion import ZeroAge
from tdfscal.records import FloatArray
from tdfscal.workflows.calibration_in_use import InUse
from tdfscal.wrench.contact_wrench import COMPONENTS, Wrenches
from tdfscal.wrench.filtering import Walk
from tdfscal.wrench.resampling import Tally
from tdfscal.wrench.sample_noise import ColouredNoise, SampleNoise
from tdfscal.wrench.zero_wander import ZeroVariance

#: What the roots of the mean squares are called.
_ROOTS = ("rms", "rms_uncalibrated", "std", "std_calibration")


@dataclass(slots=True)
class Totals:
    """What the summary says of the rows.

    squares : (4, 6), sums of squares of the wrench, of the uncalibrated one, of its standard
    uncertainty and of the calibration's part of that. largest : (2,), lengths. begin, end : s.
    """

    squares: FloatArray = field(default_factory=lambda: np.zeros((4, 6)))
    largest: FloatArray = field(default_factory=lambda: np.zeros(2))
    rows: int = 0
    begin: float = np.nan
    end: float = np.nan

    def passing(self, pieces: Iterable[Wrenches]) -> Iterator[Wrenches]:
        """Count the pieces of a log as they pass."""
        for piece in pieces:
            each = (piece.value, piece.raw, piece.std, piece.calibration_std)
            self.squares += [np.einsum("ka,ka->a", part, part) for part in each]
            lengths = np.sqrt(np.sum(piece.value.reshape(-1, 2, 3) ** 2, axis=2)).max(axis=0)
            self.largest = np.maximum(self.largest, lengths)
            if not self.rows:
                self.begin = float(piece.time[0])
            self.end = float(piece.time[-1])
            self.rows += len(piece.time)
            yield piece


def filter_effect(
    kind: str, walk: float, model: Walk, noise: ColouredNoise | None
) -> dict[str, Any]:
    """What the filter does, SI units; noise_left as a share, None where there is no noise."""
    smooth, noise = kind == "smooth", noise or ColouredNoise(np.array([model.r]))
    rest = float(np.sqrt(noise.remaining(np.array([model.gain]), smooth=smooth)[0]))
    return {
        "kind": kind,
        "walk": walk,
        "gain": model.gain,
        "noise": noise.std,
        "noise_left": rest / noise.std if noise.std > 0 else None,
        "delay": 0.0 if smooth else model.delay,
    }


def noise_effect(noise: SampleNoise, posture: float) -> dict[str, Any]:
    """What a sample adds by its noise, SI units, and what that was measured on.

    posture : N per axis, noise of a force at a posture.
    """
    return {
        "std": dict(zip(COMPONENTS, noise.std.tolist(), strict=True)),
        "dwells": noise.dwells,
        "windows": noise.windows,
        "posture": posture,
    }


def zero_effect(age: ZeroAge, moved: ZeroVariance | None, end: float) -> dict[str, Any]:
    """How old the zeros are at the log's end, s, and by how much they may have moved, N."""
    variance = 0.0 if moved is None else float(moved(np.array([end])).max())
    return {
        "age": age.seconds,
        "age_known": age.known,
        "moved": float(np.sqrt(variance)) if np.isfinite(variance) else None,
    }


def metadata(
    use: InUse, kind: str, walk: float | None, point: FloatArray, *, moving: bool
) -> dict[str, str]:
    """Metadata of a Parquet file."""
    place = f"the point ({', '.join(f'{x:g}' for x in point)}) m" if point.any() else "the origin"
    return {
        "quantity": f"contact wrench on the terminal: force, and moment about {place} of the LCS",
        "frame": "LCS",
        "units": "s, N, N·m",
        "u_": "standard uncertainty (k = 1) of the single sample, its noise included",
        "u_cal_": "the part of the calibration and the rig's constants, common to all samples",
        "raw_": "the same with the nominal mounting and the stated zeros, mass and barycentre",
        "filter": "none" if walk is None else f"{kind}, walk {walk:g} N in 1 s",
        "inertia": "included" if moving else "not included (quasi-static)",
        "calibration": f"{use.calibration.method}, {use.calibration.created}, "
        f"{use.calibration.status}",
        "rig": use.given.rig.name,
    }


def summary_of(
    use: InUse,
    output: Path | None,
    tally: Tally,
    totals: Totals,
    notes: Sequence[Finding],
    *,
    moving: bool,
) -> dict[str, Any]:
    """Return the document of the command, SI units; rms of each component over the rows."""
    roots = {
        what: {
            name: float(v) if np.isfinite(v) else None
            for name, v in zip(COMPONENTS, np.sqrt(squares / totals.rows), strict=True)
        }
        for what, squares in zip(_ROOTS, totals.squares, strict=True)
    }
    return {
        "output": None if output is None else str(output),
        "rows": totals.rows,
        "start": totals.begin,
        "end": totals.end,
        "quasi_static": not moving,
        "calibration_status": use.calibration.status,
        "left_out": {"uncovered": tally.uncovered, "unreadable": tally.unreadable},
        **roots,
        "largest": {"force": float(totals.largest[0]), "torque": float(totals.largest[1])},
        "findings": documents([*use.findings, *notes]),
    }
