"""How the zeros of the sensors move over a campaign (theory, section 11).

The zero of a channel at posture k is z + Σ_g a_g φ_g(k): z holds at the first posture, and every
φ_g vanishes there, as a tare just before the campaign has it; zeros of an earlier campaign held at
its first posture, and φ_g counts from there. The functions are a slope in time, a slope in
temperature, a parabola in time where a test asked for it, and the modes of a random walk
(Karhunen–Loève). The amplitudes a_g are parameters with a prior, per channel.
"""

from __future__ import annotations

from typing import Literal

import numpy as np

from tdfscal.frozen import record, replace
from tdfscal.records import BoolArray, Drift, FloatArray, IntArray

Kind = Literal["time", "temperature", "parabola", "walk", "step"]

#: Modes of a random walk at most; what they leave counts as noise of each posture.
WALK_MODES = 40


@record
class ZeroMotion:
    """Functions by which zeros move, over K postures.

    kind : (G,). value : (K, n, G); time in s, temperature in K, a walk's modes in N.
    std : (G,), standard deviation of the amplitudes' prior: N/s, N/K, N/s², 1, N.
    remainder : N² per posture and channel, of a walk's modes that are left out.
    """

    kind: tuple[Kind, ...]
    value: FloatArray
    std: FloatArray
    remainder: float = 0.0

    def subset(self, keep: BoolArray | IntArray | slice) -> ZeroMotion:
        """Return the motion at the postures that keep selects."""
        return replace(self, value=self.value[keep])


@record
class ZeroAge:
    """How long before a log's first time its zeros held, and what has changed since.

    seconds : negative where the log begins before. warming : K, of the sensors' mean.
    known : by the clocks of both; else the least that is possible.
    """

    seconds: float = 0.0
    warming: float = 0.0
    known: bool = True


def zero_motion(
    drift: Drift,
    time: FloatArray,
    temperature: FloatArray | None,
    n: int,
    age: ZeroAge | None = None,
) -> ZeroMotion | None:
    """Build the functions for what a rig file declares; None where its zeros stay.

    time : (K,), s, of the postures. temperature : (K, n), °C, at each sensor. age : of the zeros
    at the first posture; default none, they hold there.
    """
    age = age or ZeroAge()
    elapsed = np.repeat((time - time[0] + age.seconds)[:, None], n, axis=1)
    parts: list[tuple[Kind, FloatArray, float]] = []
    if drift.time > 0:
        parts.append(("time", elapsed, drift.time))
    if drift.temperature > 0 and temperature is not None:
        warming = temperature - temperature[0] + age.warming
        parts.append(("temperature", warming, drift.temperature))
    if drift.parabola > 0:
        parts.append(("parabola", elapsed**2, drift.parabola))
    remainder = 0.0
    if drift.walk > 0:
        modes, remainder = walk_modes(drift.walk, time)
        before = np.full((len(time), 1), drift.walk * np.sqrt(abs(age.seconds)))
        modes = np.hstack([before, modes]) if age.seconds else modes
        parts += [("walk", np.repeat(mode[:, None], n, axis=1), 1.0) for mode in modes.T]
    if not parts:
        return None
    kinds, values, std = zip(*parts, strict=True)
    return ZeroMotion(kinds, np.stack(values, axis=2), np.array(std), remainder)


def walk_modes(intensity: float, time: FloatArray) -> tuple[FloatArray, float]:
    """Modes (K, m), N, of a random walk from time[0] on, and the variance that they leave, N².

    intensity : N/√s. The covariance of a walk is q² min(t_k, t_l). A few postures get all of its
    eigenvectors; many get the sines of the continuous walk, and their remainder, which changes
    over K/m postures together, counts as K/m times its variance in every one of them.
    """
    elapsed, K = time - time.min(), len(time)
    span = float(elapsed.max(initial=0.0))
    if not span > 0:
        return np.zeros((K, 0)), 0.0
    if K <= WALK_MODES + 1:
        values, vectors = np.linalg.eigh(np.minimum(elapsed[:, None], elapsed[None]))
        kept = values > values[-1] * K * np.finfo(float).eps
        return intensity * vectors[:, kept] * np.sqrt(values[kept]), 0.0
    rate = (np.arange(WALK_MODES) + 0.5) * np.pi / span
    modes = np.sin(elapsed[:, None] * rate) * np.sqrt(2.0 / span) / rate
    left = span / 2.0 - 0.5 * float(np.sum(2.0 / span / rate**2))
    return intensity * modes, intensity**2 * left * K / WALK_MODES
