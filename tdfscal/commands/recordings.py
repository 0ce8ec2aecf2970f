"""The same recording in two campaigns: told by its files, its hours, its dwells or its samples."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass
from itertools import combinations

import numpy as np

from tdfscal.checks.repeated_samples import RepeatedSamples
from tdfscal.errors import UsageError
from tdfscal.records import Dwells, InputFile, Measured, Rig

#: Mean forces of two recordings differ by more than this share of their standard uncertainty in
#: one of nine channels or more; chance alone would bring them as near once in 10¹⁵ dwells.
_SAME = 0.02


@dataclass(frozen=True, slots=True)
class Recording:
    """What tells one recording from another. dwells, samples : None where not at hand."""

    name: str
    inputs: Sequence[InputFile]
    measured: Measured | None
    rig: Rig | None = None
    dwells: Dwells | None = None
    samples: RepeatedSamples | None = None


def refuse_repeated(recordings: Sequence[Recording]) -> None:
    """Raise UsageError where two campaigns hold the same recording."""
    for first, second in combinations(recordings, 2):
        common = {e.sha256 for e in first.inputs} & {e.sha256 for e in second.inputs}
        what = next((e.path for e in second.inputs if e.sha256 in common), None)
        if what is None and _at_one_time(first.measured, second.measured):
            what = "their clocks say so, for no rig is recorded twice at a time"
        if what is None and _alike(first, second):
            what = "the mean forces of their dwells agree far below their uncertainty"
        if what is None and _copied(first, second):
            what = "the readings of every sensor are the same, noise included"
        if what is not None:
            raise UsageError(
                f"holds the same recording as {first.name}: {what}",
                where=second.name,
                hint="name each recording once; twice the same data are no more data",
            )


def _at_one_time(a: Measured | None, b: Measured | None) -> bool:
    """Whether two wall clocks ran at the same time, for longer than they may be set apart."""
    if a is None or b is None or not a.source == b.source == "log":
        return False
    together = min(a.end, b.end) - max(a.begin, b.begin)
    return together > 0.5 * min(a.end - a.begin, b.end - b.begin)


def _alike(a: Recording, b: Recording) -> bool:
    """Whether half of the dwells of the shorter one, or more, are also the other's."""
    if a.dwells is None or b.dwells is None or a.rig is None:
        return False
    few, many = sorted((a.dwells, b.dwells), key=len)
    if not len(few) or few.force.shape[1:] != many.force.shape[1:]:
        return False
    variance = np.diagonal(few.force_cov, axis1=-2, axis2=-1) + a.rig.declared.force_noise**2
    within = _SAME * np.sqrt(variance)
    same = sum(
        bool((np.abs(many.force - force) <= limit).all(axis=(1, 2)).any())
        for force, limit in zip(few.force, within, strict=True)
    )
    return 2 * same >= len(few)


def _copied(a: Recording, b: Recording) -> bool:
    """Whether samples of every sensor that measures are in both."""
    if a.samples is None or b.samples is None or a.rig is None or b.rig is None:
        return False
    if a.rig.supports != b.rig.supports:
        return False
    copied = {repeat.sensor for repeat in a.samples.shared(b.samples)}
    return copied >= set(np.flatnonzero(a.rig.axes.any(axis=1)).tolist())
