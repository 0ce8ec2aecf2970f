"""What benchmarks share: arguments, folders, runs on two cores, errors, and lines of a table."""

from __future__ import annotations

import multiprocessing
import sys
import tempfile
from collections import Counter
from collections.abc import Callable, Iterable, Iterator
from concurrent.futures import ProcessPoolExecutor
from contextlib import contextmanager
from dataclasses import replace
from pathlib import Path
from typing import TypeVar

import numpy as np

from tdfscal.numerics import so3
from tdfscal.records import BoolArray, FloatArray, Rig
from tdfscal.simulation import make_rig

Seed = TypeVar("Seed")
Result = TypeVar("Result")
CORES = 2


def numbers(*usual: int) -> list[int]:
    """The leading arguments of the command line, all of them numbers, or what is usual."""
    given = [int(word) for word in sys.argv[1 : len(usual) + 1]]
    return [*given, *usual[len(given) :]]


def introduce(title: str, command: str, doc: str | None) -> None:
    """Print the head of a page: title, command, and the last paragraph of a module's docstring."""
    last = (doc or "").split("\n\n")[-1]
    print(f"# {title}\n\n`python -m benchmarks.{command}`.\n{last}")


def publish(module: str, text: str) -> None:
    """Print a page, and write it beside the module of that file name."""
    Path(module).with_suffix(".md").write_text(text, encoding="utf-8")
    print(text)


@contextmanager
def scratch() -> Iterator[Path]:
    """A folder that is gone afterwards."""
    with tempfile.TemporaryDirectory(prefix="benchmarks-") as name:
        yield Path(name)


def stream(work: Callable[[Seed], Result], seeds: Iterable[Seed]) -> Iterator[Result]:
    """The results of a function of this module's caller, as they come, in the order of seeds."""
    with ProcessPoolExecutor(CORES, multiprocessing.get_context("spawn")) as pool:
        yield from pool.map(work, seeds)


def over(work: Callable[[Seed], Result], seeds: Iterable[Seed]) -> list[Result]:
    """All results of `stream`."""
    return list(stream(work, seeds))


def row(*cells: object) -> str:
    """A line of a table."""
    return f"| {' | '.join(map(str, cells))} |"


def show(*cells: object) -> None:
    """Print a line of a table at once."""
    print(row(*cells), flush=True)


def heads(*names: str) -> str:
    """The first two lines of a table."""
    return f"{row(*names)}\n|{'---|' * len(names)}"


def tally(counts: Counter[str], most: int | None = None) -> str:
    """What was counted, the most frequent first."""
    return ", ".join(f"{name} {count}" for name, count in counts.most_common(most))


def mean(values: Iterable[float], form: str = ".2f") -> str:
    """A mean and its standard error."""
    found = np.asarray(list(values), dtype=np.float64)
    return f"{found.mean():{form}} ± {found.std() / np.sqrt(len(found)):{form}}"


def rms(values: object) -> float:
    """Root of the mean square over all axes."""
    return float(np.sqrt(np.mean(np.square(np.asarray(values, dtype=np.float64)))))


def flicker(rng: np.random.Generator, count: int, longer: int = 1) -> FloatArray:
    """1/f noise (count, 3, 3) of std 1, from so many times that length to half the rate."""
    f = np.fft.rfftfreq(longer << (count - 1).bit_length())[1:]
    out = np.empty((count, 9))
    for channel in out.T:
        wave = rng.standard_normal(len(f)) + 1j * rng.standard_normal(len(f))
        channel[:] = np.fft.irfft(np.append(0.0, wave / np.sqrt(f)))[:count]
    return np.asarray(out / out.std(axis=0).mean()).reshape(count, 3, 3)


def errors(
    true: FloatArray, found: FloatArray, cov: FloatArray, of: BoolArray | None = None
) -> tuple[FloatArray, FloatArray, float]:
    """Turns (k,), rad, from rotations (n, 3, 3) found to true ones, their std, and d²/k.

    of : which of all 3n; None: all.
    """
    e = so3.log(true @ np.swapaxes(found, 1, 2)).ravel()
    if of is not None:
        e, cov = e[of], cov[np.ix_(of, of)]
    return e, np.sqrt(np.diagonal(cov)), float(e @ np.linalg.solve(cov, e)) / len(e)


def inside(e: FloatArray, std: FloatArray) -> float:
    """Share of errors in their 95 % intervals."""
    return float(np.mean(np.abs(e) < 1.96 * std))


def declaring(rig: Rig, **changes: float) -> Rig:
    """The rig with other declared uncertainties."""
    return replace(rig, declared=replace(rig.declared, **changes))


def lacking(n: int, *dead: tuple[int, int]) -> Rig:
    """A rig of n supports of which some do not measure some axes, (support, axis)."""
    axes = np.ones((n, 3), dtype=np.bool_)
    axes[tuple(np.array(dead, dtype=int).reshape(-1, 2).T)] = False
    return replace(make_rig(n), axes=axes)
