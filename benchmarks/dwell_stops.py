"""Logs with known stops over the ranges that dwells are to be found in, and what is found there."""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import dataclass, replace

import numpy as np
from scipy.signal import lfilter

from benchmarks.frame import flicker, rms, row
from tdfscal.dwells import find_dwells
from tdfscal.records import Dwells, FloatArray, Series
from tests.dwells.rig_log import Recipe, Recorded, record

Random = np.random.Generator
HEADS = ("what", "stops", "found", "in parts", "reach into a move", "bias / se, worst", "rms",
         "(mean − truth) / se, rms")  # fmt: skip


def _log(rng: Random, low: float, high: float) -> float:
    return float(np.exp(rng.uniform(np.log(low), np.log(high))))


def _stops(rng: Random, low: float, high: float, count: int) -> tuple[float, ...]:
    return tuple(_log(rng, low, high) for _ in range(count))


def _usual(rng: Random, **changes: object) -> Recipe:
    """A log of no special kind; `changes` make it one."""
    recipe: dict[str, object] = {
        "rate": _log(rng, 50, 1000),
        "stops": _stops(rng, 1.0, 6.0, 16),
        "move": _log(rng, 0.4, 2.0),
        "force_noise": _log(rng, 0.2, 3.0),
        "position_noise": _log(rng, 1e-7, 3e-6),
        "seed": int(rng.integers(1 << 30)),
    }
    return Recipe(**(recipe | changes))  # type: ignore[arg-type]


def _settling(rng: Random, hertz: float, tau: float, count: int = 12) -> Recipe:
    """Of 1 to 30 N; every stop leaves 1.5 to 8 s after what is left has fallen below 1 % of 1 N."""
    amplitude = _log(rng, 1.0, 30.0)
    calm = tau * np.log(100.0 * amplitude)
    stops = tuple(calm + s for s in _stops(rng, 1.5, 8.0, count))
    return _usual(rng, settle=(amplitude, tau, hertz), stops=stops, force_noise=1.0, rate=200.0)


KINDS: dict[str, Callable[[Random], Recipe]] = {
    "50 Hz to 1 kHz": _usual,
    "5 kHz": lambda rng: _usual(rng, rate=5000.0, stops=_stops(rng, 1.0, 3.0, 6)),
    "stops of 0.5 s": lambda rng: _usual(rng, stops=(0.5,) * 30, rate=_log(rng, 100, 1000)),
    "stops of 0.5 s to 2 min": lambda rng: _usual(
        rng, stops=_stops(rng, 0.5, 120.0, 10), rate=_log(rng, 50, 200)),
    "vibration, 0.5 to 60 Hz": lambda rng: _usual(
        rng, vibration=(_log(rng, 0.5, 5.0), 2e-7, _log(rng, 0.5, 60.0)), force_noise=1.0,
        stops=_stops(rng, 3.0, 8.0, 14), rate=500.0),
    "noise correlated over 0.02 to 0.3 s": lambda rng: _usual(
        rng, force_tau=_log(rng, 0.02, 0.3), stops=_stops(rng, 4.0, 12.0, 14), rate=200.0),
    "drift, 0.01 to 0.5 N/s": lambda rng: _usual(
        rng, drift=_log(rng, 0.01, 0.5), force_noise=1.0, rate=200.0),
    "squeezes of 2 to 5 µm": lambda rng: _usual(
        rng, travel=_log(rng, 2e-6, 5e-6), move=_log(rng, 0.2, 0.6), stiffness=2e7,
        position_noise=_log(rng, 1e-7, 6e-7), stops=_stops(rng, 1.0, 3.0, 20)),
    "encoders rounded to 0.5 to 5 µm": lambda rng: _usual(
        rng, quantum=_log(rng, 5e-7, 5e-6), position_noise=_log(rng, 1e-7, 1e-6)),
    "forces rounded to 0.2 to 1 N": lambda rng: _usual(
        rng, force_quantum=_log(rng, 0.2, 1.0), force_noise=_log(rng, 0.2, 1.0)),
    "settling, 0.1 to 3 s": lambda rng: _settling(rng, 0.0, _log(rng, 0.1, 3.0)),
    "ringing, 0.3 to 1 Hz": lambda rng: _settling(
        rng, _log(rng, 0.3, 1.0), _log(rng, 0.5, 3.0)),
    "ringing, 1 to 10 Hz": lambda rng: _settling(rng, _log(rng, 1.0, 10.0), _log(rng, 0.1, 1.0)),
    "settling and ringing": lambda rng: _also(_settling(rng, 0.0, _log(rng, 0.2, 1.0)), rng),
    "positions written to 1 µm": lambda rng: _usual(
        rng, quantum=1e-6, position_noise=_log(rng, 1e-7, 1e-6), rate=_log(rng, 50, 250)),
}  # fmt: skip


def _also(recipe: Recipe, rng: Random) -> Recipe:
    amplitude, tau, _ = recipe.settle
    return replace(recipe, also=(amplitude, tau * rng.uniform(0.5, 1.0), _log(rng, 0.5, 5.0)))


def _slow(rng: Random, kind: str) -> Recorded:
    """2 N of noise that is alike over much of a stop; 8 N settle in 0.1 s."""
    stops = tuple(rng.uniform(4.0, 5.0, 16))
    recorded = record(
        _usual(rng, rate=100.0, stops=stops, force_noise=1e-6, settle=(8.0, 0.1, 0.0))
    )

    log = recorded.log
    count = len(log.force[0].time)
    if kind == "1/f":
        noise = flicker(rng, count, 8)
    else:
        phi, white = float(kind), rng.standard_normal((8 * count, 3, 3))
        noise = lfilter([np.sqrt(1.0 - phi**2)], [1.0, -phi], white, axis=0)[-count:]
    force = tuple(Series(s.time, s.value + 2.0 * noise[:, i]) for i, s in enumerate(log.force))
    return replace(recorded, log=replace(log, force=force))


#: Noise that is slower than white, and settling as friction makes it.
SLOW: dict[str, Callable[[Random], Recorded]] = {
    "AR(0.95) at 100 Hz": lambda rng: _slow(rng, "0.95"),
    "AR(0.99) at 100 Hz": lambda rng: _slow(rng, "0.99"),
    "1/f over eight logs": lambda rng: _slow(rng, "1/f"),
    "settling of 1 to 10 N in 0.1 to 0.8 s": lambda rng: record(
        _usual(rng, rate=100.0, stops=tuple(rng.uniform(4.0, 5.0, 16)), force_noise=1.0,
               settle=(_log(rng, 1.0, 10.0), _log(rng, 0.1, 0.8), 0.0))
    ),
}  # fmt: skip


@dataclass(frozen=True)
class Score:
    """parts : stops found as more than one dwell. astray : dwells that reach into a move.
    bias : of each mean force without noise, over its standard error. z : with noise.
    """

    stops: int
    found: int
    parts: int
    astray: int
    bias: FloatArray
    z: FloatArray

    def row(self, what: str) -> str:
        """A line of the table."""
        sizes = (np.nan,) * 3
        if len(self.bias):
            sizes = (self.bias.max(), rms(self.bias), rms(self.z))
        cells = (f"{size:.2f}" for size in sizes)
        return row(what, self.stops, self.found, self.parts, self.astray, *cells)


def score(recorded: Recorded, dwells: Dwells) -> Score:
    """What was found of one log."""
    recipe = recorded.recipe
    hits = np.zeros(len(recorded.stops), dtype=np.int64)
    astray = 0
    bias, z = [], []
    for k in range(len(dwells)):
        begin, end = dwells.start[k], dwells.end[k]
        inside = np.minimum(recorded.stops[:, 1], end) - np.maximum(recorded.stops[:, 0], begin)
        stop = int(np.argmax(inside))
        first, last = recorded.stops[stop]
        hits[stop] += 1
        # A smooth move begins like t³: what is less than a sixth of it moves by 0.05 of the travel
        # at most where that is tiny, and by less than the noise where it is not.
        astray += max(first - begin, end - last, 0.0) > recipe.move / 6.0 + 2.0 / recipe.rate
        se = np.sqrt(np.diagonal(dwells.force_cov[k], axis1=1, axis2=2))
        middle = 0.5 * (max(begin, first) + min(end, last))
        bias.append(np.abs(recorded.clean_offset(stop, begin, end)) / se)
        z.append((dwells.force[k] - recorded.force[stop] - recipe.drift * middle) / se)
    return Score(
        len(hits), int((hits > 0).sum()), int((hits > 1).sum()), int(astray), np.array(bias),
        np.array(z),
    )  # fmt: skip


def scored(what: str, seeds: range) -> Score:
    """What is found of several logs of a kind."""
    scores = []
    for seed in seeds:
        rng = np.random.default_rng(seed)
        recorded = SLOW[what](rng) if what in SLOW else record(KINDS[what](rng))
        scores.append(score(recorded, find_dwells(recorded.log)))
    return together(scores)


def together(scores: list[Score]) -> Score:
    """The sum of scores."""
    shown = [s for s in scores if len(s.bias)]
    empty = np.empty((0, 3, 3))
    return Score(
        sum(s.stops for s in scores), sum(s.found for s in scores), sum(s.parts for s in scores),
        sum(s.astray for s in scores),
        np.concatenate([s.bias for s in shown]) if shown else empty,
        np.concatenate([s.z for s in shown]) if shown else empty,
    )  # fmt: skip
