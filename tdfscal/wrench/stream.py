"""The contact wrench over a whole log, piece by piece in bounded memory."""

from __future__ import annotations

from collections.abc import Iterable, Iterator

import numpy as np

from tdfscal.model.calibrated import Calibrated
from tdfscal.wrench.contact_wrench import Wrenches, pose, wrenches
from tdfscal.wrench.kinematics import motion
from tdfscal.wrench.resampling import Samples

#: Half the window in which a local cubic gives velocity and acceleration, s.
WINDOW = 0.1
_LEAST = 2
#: A step this many times the usual one ends a stretch of even sampling.
_UNEVEN = 3.0


def at_rest(given: Calibrated, samples: Iterable[Samples]) -> Iterator[Wrenches]:
    """Quasi-static contact wrenches: inertia plays no part."""
    for piece in samples:
        yield wrenches(given, piece.time, piece.position, piece.force)


def in_motion(given: Calibrated, samples: Iterable[Samples]) -> Iterator[Wrenches]:
    """Contact wrenches with the terminal's inertial terms.

    Velocities and accelerations come from the servo positions in a symmetric window, without
    delay; a piece is therefore held back by half a window. A stretch too short for one window is
    taken as at rest.
    """
    held: Samples | None = None
    done = 0
    for piece in samples:
        joined = piece if held is None else Samples.joined([held, piece])
        usual = np.median(np.diff(joined.time)) if joined.time.size > 1 else np.inf
        *closed, last = joined.stretches(_UNEVEN * float(usual))
        for stretch in closed:
            yield from _emit(given, stretch, done, stretch.time.size)
            done = 0
        half = _half(last)
        keep = last.time.size - 2 * half
        if keep > half:
            yield from _emit(given, last, done, last.time.size - half)
            held, done = last.rows(slice(keep, None)), half
        else:
            held = last
    if held is not None:
        yield from _emit(given, held, done, held.time.size)


def _half(stretch: Samples) -> int:
    """Instants on either side of the window."""
    return max(_LEAST, round(WINDOW / _step(stretch))) if stretch.time.size > 1 else _LEAST


def _step(stretch: Samples) -> float:
    return float((stretch.time[-1] - stretch.time[0]) / (stretch.time.size - 1))


def _emit(given: Calibrated, stretch: Samples, first: int, end: int) -> Iterator[Wrenches]:
    """Wrenches of the rows first … end − 1; the others are there for the window."""
    if end <= first:
        return
    at = pose(given, stretch.position)
    half = _half(stretch)
    moving = motion(at, _step(stretch), half) if stretch.time.size > 2 * half else None
    rows, part = slice(first, end), stretch.rows(slice(first, end))
    yield wrenches(
        given,
        part.time,
        part.position,
        part.force,
        rotation=at.rotation[rows],
        moving=None if moving is None else moving.rows(rows),
    )
