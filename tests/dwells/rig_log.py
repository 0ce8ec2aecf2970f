"""Logs with known dwells: stops, moves, settling, noise; independent of the package."""

from collections.abc import Sequence
from dataclasses import dataclass, field

import numpy as np
import numpy.typing as npt
from scipy.signal import lfilter

from tdfscal.records import Log, Series

FloatArray = npt.NDArray[np.float64]


@dataclass(frozen=True)
class Recipe:
    """What to record. Lengths in s, m, N, Hz."""

    rate: float = 200.0
    position_rate: float | None = None
    supports: int = 3
    stops: Sequence[float] = (4.0,) * 8
    move: float = 2.0
    travel: float = 0.05
    """Amplitude of a move; tiny ones are squeezes."""
    stiffness: float | None = None
    """N/m: forces follow the positions; None: new forces at each stop, smooth on the way."""
    force_noise: float = 1.0
    force_tau: float = 0.0
    """Correlation time of the force noise; 0 is white."""
    position_noise: float = 0.3e-6
    quantum: float = 0.0
    force_quantum: float = 0.0
    settle: tuple[float, float, float] = (0.0, 0.3, 0.0)
    """Amplitude N, time constant s, frequency Hz (0: no oscillation)."""
    also: tuple[float, float, float] = (0.0, 0.3, 0.0)
    """A second mode of settling."""
    vibration: tuple[float, float, float] = (0.0, 0.0, 0.0)
    """Force amplitude N, position amplitude m, frequency Hz."""
    drift: float = 0.0
    """N/s on every axis."""
    jitter: float = 0.0
    """Of the sample times, as a fraction of the interval."""
    seed: int = 0


@dataclass(frozen=True)
class Recorded:
    """A log and its truth: stops (K, 2) in s; per stop the settled force (K, n, 3) and position;
    clean(t): noise-free force at times t, (T, n, 3)."""

    log: Log
    recipe: Recipe
    stops: FloatArray
    force: FloatArray
    position: FloatArray
    _decay: FloatArray = field(repr=False)

    def clean_offset(self, k: int, start: float, end: float) -> FloatArray:
        """Mean (n, 3) over [start, end] of what settling adds in stop k."""
        t = np.linspace(start, end, 4001) - self.stops[k, 0]
        modes = (self.recipe.settle, self.recipe.also)
        shapes = [np.exp(-t / tau) * np.cos(2 * np.pi * hertz * t) for _, tau, hertz in modes]
        return np.asarray(
            sum(decay[k] * shape.mean() for decay, shape in zip(self._decay, shapes, strict=True))
        )


def _ease(u: FloatArray) -> FloatArray:
    """Minimum-jerk step from 0 to 1."""
    u = np.clip(u, 0.0, 1.0)
    return np.asarray(u**3 * (10 - 15 * u + 6 * u**2))


def _noise(rng: np.random.Generator, shape: tuple[int, ...], rate: float, tau: float) -> FloatArray:
    """Unit variance; AR(1) with correlation time tau along axis 0."""
    white = rng.standard_normal(shape)
    if tau == 0.0:
        return white
    phi = np.exp(-1.0 / (rate * tau))
    drive = white * np.sqrt(1 - phi**2)
    drive[0] = white[0]
    return np.asarray(lfilter([1.0], [1.0, -phi], drive, axis=0))


def record(recipe: Recipe, origin: float = 0.0) -> Recorded:
    """Stops, with moves between them; the log begins and ends at rest."""
    rng = np.random.default_rng(recipe.seed)
    n, count = recipe.supports, len(recipe.stops)
    begin = np.zeros(count)
    for k in range(1, count):
        begin[k] = begin[k - 1] + recipe.stops[k - 1] + recipe.move
    end = begin + np.asarray(recipe.stops)
    base = rng.uniform(0.3, 1.3, (n, 3))
    position = base + recipe.travel * _signed(rng, (count, n, 3))
    if recipe.stiffness is None:
        force = np.array([0.0, 0.0, 1600.0]) + 200.0 * rng.standard_normal((count, n, 3))
    else:
        force = np.array([0.0, 0.0, 1600.0]) + recipe.stiffness * (position - base)
    modes = (recipe.settle, recipe.also)
    decays = np.zeros((2, count, n, 3))
    decays[0] = recipe.settle[0] * _signed(rng, (count, n, 3))
    if recipe.also[0]:
        decays[1] = recipe.also[0] * _signed(rng, (count, n, 3))

    def blend(t: FloatArray, level: FloatArray) -> FloatArray:
        value = np.broadcast_to(level[0], (len(t), n, 3)).copy()
        for k in range(1, count):
            u = _ease((t - end[k - 1]) / recipe.move)[:, None, None]
            value += u * (level[k] - level[k - 1])
        return value

    def times(rate: float) -> FloatArray:
        t = np.arange(0.0, end[-1], 1.0 / rate)
        return np.asarray(t + recipe.jitter / rate * rng.uniform(-0.5, 0.5, len(t)))

    tf = times(recipe.rate)
    tp = tf if recipe.position_rate is None else times(recipe.position_rate)
    f, p = blend(tf, force), blend(tp, position)
    for k in range(count):
        stop = (tf >= begin[k]) & (tf < end[k] + (recipe.move if k < count - 1 else 0.0))
        t = tf[stop] - begin[k]
        for decay, (_, tau, hertz) in zip(decays, modes, strict=True):
            shape = np.exp(-t / tau) * np.cos(2 * np.pi * hertz * t)
            f[stop] += decay[k] * shape[:, None, None]
    shake_f, shake_p, shake_hz = recipe.vibration
    phase = rng.uniform(0, 2 * np.pi, (2, n, 3))
    f += shake_f * np.sin(2 * np.pi * shake_hz * tf[:, None, None] + phase[0])
    p += shake_p * np.sin(2 * np.pi * shake_hz * tp[:, None, None] + phase[1])
    f += recipe.force_noise * _noise(rng, f.shape, recipe.rate, recipe.force_tau)
    p += recipe.position_noise * rng.standard_normal(p.shape)
    f += recipe.drift * tf[:, None, None]
    if recipe.quantum:
        p = np.round(p / recipe.quantum) * recipe.quantum
    if recipe.force_quantum:
        f = np.round(f / recipe.force_quantum) * recipe.force_quantum
    log = Log(
        supports=tuple(f"ncp{i + 1}" for i in range(n)),
        position=tuple(Series(tp + origin, p[:, i].copy()) for i in range(n)),
        force=tuple(Series(tf + origin, f[:, i].copy()) for i in range(n)),
    )
    return Recorded(log, recipe, np.column_stack([begin, end]) + origin, force, position, decays)


def _signed(rng: np.random.Generator, shape: tuple[int, ...]) -> FloatArray:
    """Magnitudes 0.5 to 1 of either sign."""
    return np.asarray(rng.uniform(0.5, 1.0, shape) * rng.choice([-1.0, 1.0], shape))
