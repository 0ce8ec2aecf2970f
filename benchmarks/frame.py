"""What benchmarks share: runs over seeds on two cores, and the lines of a table."""

from __future__ import annotations

import multiprocessing
from collections.abc import Callable, Iterable
from concurrent.futures import ProcessPoolExecutor
from typing import TypeVar

import numpy as np

from tdfscal.numerics import so3
from tdfscal.records import FloatArray

Seed = TypeVar("Seed")
Result = TypeVar("Result")
CORES = 2


def over(work: Callable[[Seed], Result], seeds: Iterable[Seed]) -> list[Result]:
    """The results of a function of this module's caller, in the order of the seeds."""
    with ProcessPoolExecutor(CORES, multiprocessing.get_context("spawn")) as pool:
        return list(pool.map(work, seeds))


def row(*cells: object) -> str:
    """A line of a table."""
    return f"| {' | '.join(map(str, cells))} |"


def heads(*names: str) -> str:
    """The first two lines of a table."""
    return f"{row(*names)}\n|{'---|' * len(names)}"


def mean(values: Iterable[float], form: str = ".2f") -> str:
    """A mean and its standard error."""
    found = np.asarray(list(values), dtype=np.float64)
    return f"{found.mean():{form}} ± {found.std() / np.sqrt(len(found)):{form}}"


def rms(values: object) -> float:
    """Root of the mean square over all axes."""
    return float(np.sqrt(np.mean(np.square(np.asarray(values, dtype=np.float64)))))


def errors(true: FloatArray, found: FloatArray, cov: FloatArray) -> tuple[FloatArray, float]:
    """Turns (3n,), rad, from rotations (n, 3, 3) found to true ones, and d²/3n."""
    e = so3.log(true @ np.swapaxes(found, 1, 2)).ravel()
    return e, float(e @ np.linalg.solve(cov, e)) / len(e)
