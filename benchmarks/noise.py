"""Noise that is not as it is stated: unequal channels, heavy tails, 1/f between and within dwells.

    python -m benchmarks.noise [RUNS] > benchmarks/noise.md

Reference rig, squeeze 100 N; every dwell's mean is stated to 0.3 N per axis. Heavy tails and 1/f
have that standard deviation; unequal channels exceed it. Within dwells: samples of 1/f noise, 2 N
at 100 Hz, nothing stated but what the log shows. RMSE and stated σ over all angles. Validate:
share of calibrations that five more postures with the same noise reject, or more noise in them is
named (a verdict on the noise, not on the calibration).
"""

from __future__ import annotations

import sys
from collections.abc import Iterator
from dataclasses import replace

import numpy as np

from tdfscal import simulation
from tdfscal.dwells import find_dwells
from tdfscal.errors import TdfscalError
from tdfscal.numerics import so3
from tdfscal.records import Dwells, FloatArray, Rig, Series
from tdfscal.selfcal.covariance import joint_posterior
from tdfscal.selfcal.pipeline import self_calibrate
from tdfscal.selfcal.result import SelfCalibration
from tdfscal.simulation import Options, Recorder
from tdfscal.validation.causes import NOISE
from tdfscal.validation.known_noise import KnownNoise
from tdfscal.validation.residual_wrench import validate

STD = 0.3
KINDS = (
    "as stated",
    "t with 3 degrees of freedom",
    "t with 4 degrees of freedom",
    "one sensor 4 times",
    "one sensor 10 times",
    "Fz of all sensors 4 times",
    "1/f between postures",
)
WITHIN = "1/f within dwells"
HELD = 5


def drawn(kind: str, rng: np.random.Generator, postures: int, n: int) -> FloatArray:
    """Noise (K, n, 3) of the means, in units of the stated one."""
    white = rng.standard_normal((postures, n, 3))
    match kind.split():
        case ["t", "with", dof, *_]:
            nu = float(dof)
            return np.asarray(rng.standard_t(nu, white.shape) / np.sqrt(nu / (nu - 2)))
        case ["one", "sensor", times, _]:
            white[:, 0] *= float(times)
        case ["Fz", *_, times, _]:
            white[..., 2] *= float(times)
        case ["1/f", *_]:
            return flicker(rng, postures, n)
    return white


def flicker(rng: np.random.Generator, postures: int, n: int, longer: int = 4) -> FloatArray:
    """1/f noise (K, n, 3) of unit standard deviation within the campaign, on average.

    longer : so many times as long as the campaign the slowest part lasts.
    """
    frequency = np.fft.rfftfreq(longer * postures)[1:, None, None]
    shape = (len(frequency), n, 3)
    wave = (rng.standard_normal(shape) + 1j * rng.standard_normal(shape)) / np.sqrt(frequency)
    noise = np.fft.irfft(np.concatenate([np.zeros((1, n, 3)), wave]), axis=0)[:postures]
    return np.asarray(noise / noise.std(axis=0).mean())


def noisy(dwells: Dwells, noise: FloatArray) -> Dwells:
    """Dwells with noise of their mean forces added and its stated covariance."""
    stated = np.broadcast_to(STD**2 * np.eye(3), dwells.force_cov.shape).copy()
    return replace(dwells, force=dwells.force + STD * noise, force_cov=stated)


def campaigns(
    kind: str, rig: Rig, postures: int, runs: int, seed: int
) -> Iterator[tuple[Dwells, Dwells, FloatArray]]:
    """Dwells to calibrate with, dwells to validate with, and the true rotations (n, 3, 3)."""
    rng = np.random.default_rng(1000 + seed)
    if kind == WITHIN:
        recorder = Recorder(dwell=(4.0, 5.0), force_sd=(0.0, 0.0))
        options = Options(squeeze=100.0, postures=postures + HELD, recorder=recorder)
        for run in range(runs):
            c = simulation.simulate_campaign(rig, options, np.random.default_rng([seed, run]))
            noise = 2.0 * flicker(rng, len(c.log.force[0].time), rig.n, 2)
            force = tuple(Series(s.time, s.value + noise[:, i]) for i, s in enumerate(c.log.force))
            whole = find_dwells(replace(c.log, force=force))
            yield *split(whole, len(whole) - HELD), c.truth.rotation
        return
    options = Options(squeeze=100.0, postures=postures + HELD, recorder=Recorder(mean_sd=1e-6))
    batch = simulation.simulate_dwells(rig, options, np.random.default_rng(seed), runs)
    for run in range(runs):
        whole = noisy(batch.dwells(run), drawn(kind, rng, postures + HELD, rig.n))
        yield *split(whole, postures), batch.truth.rotation[run]


def split(dwells: Dwells, first: int) -> tuple[Dwells, Dwells]:
    """The first dwells, and the others."""
    names = ("start", "end", "position", "position_cov", "force", "force_cov", "force_min",
             "force_max", "count", "effective")  # fmt: skip
    before, after = (
        replace(dwells, **{name: getattr(dwells, name)[rows] for name in names})
        for rows in (slice(first), slice(first, None))
    )
    return before, after


def known_noise(result: SelfCalibration) -> KnownNoise:
    """What `validate` reads of it in the calibration file."""
    quality = result.quality
    return KnownNoise(
        result.channels, result.validation.kurtosis, len(result.validation.index),
        max(1.0, quality.birge), quality.dof,
    )  # fmt: skip


def main() -> None:
    """Print the table."""
    runs = int(sys.argv[1]) if len(sys.argv) > 1 else 60
    rig = simulation.reference_rig()
    rig = replace(rig, declared=replace(rig.declared, force_noise=0.0))
    print(f"# Noise that is not as stated\n\n`python -m benchmarks.noise {runs}`: {runs} a row.\n")
    print(
        "| noise | K | accepted | postures left out | RMSE, mrad | stated σ | d²/9 | error "
        "| validate rejects | of these names noise |"
    )
    print("|---|---|---|---|---|---|---|---|---|---|")
    for seed, (kind, K) in enumerate((kind, K) for kind in (*KINDS, WITHIN) for K in (24, 60)):
        accepted = left_out = rejects = named = 0
        squares, variances, distance = [], [], []
        for used, held, rotation in campaigns(kind, rig, K, runs, seed):
            try:
                result = self_calibrate(rig, used, rng=np.random.default_rng(0), max_trials=0)
                C = result.uncertainty.covariance
                known = known_noise(result)
                verdict = validate(joint_posterior(result.fit, C), held, rig=rig, known=known)
            except TdfscalError:
                continue
            accepted += not result.reasons
            left_out += len(result.rejected)
            rejects += not verdict.holds
            named += bool(verdict.suspected) and verdict.suspected[0].kind in NOISE
            d = so3.log(rotation @ np.swapaxes(result.fit.state.rotation, 1, 2)).ravel()
            squares.append(d**2)
            variances.append(np.diagonal(C))
            distance.append(d @ np.linalg.solve(C, d) / 9)
        rmse, std = (1e3 * np.sqrt(np.mean(v)) for v in (squares, variances))
        print(
            f"| {kind} | {K} | {accepted / runs:.0%} | {left_out / runs / K:.1%} | {rmse:.3f} "
            f"| {std:.3f} | {np.mean(distance):.2f} | {np.std(distance) / np.sqrt(runs):.2f} "
            f"| {rejects / runs:.1%} | {named} of {rejects} |",
            flush=True,
        )


if __name__ == "__main__":
    main()
