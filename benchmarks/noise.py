"""Noise that is not as it is stated: unequal channels, heavy tails, 1/f between postures.

    python -m benchmarks.noise [RUNS] > benchmarks/noise.md

Reference rig, squeeze 100 N; every dwell's mean is stated to 0.3 N per axis. Heavy tails and 1/f
have that standard deviation; unequal channels exceed it. RMSE and stated σ over all angles.
"""

from __future__ import annotations

import sys
from dataclasses import replace

import numpy as np

from tdfscal import simulation
from tdfscal.errors import TdfscalError
from tdfscal.numerics import so3
from tdfscal.records import Dwells, FloatArray
from tdfscal.selfcal.pipeline import self_calibrate
from tdfscal.simulation import Options, Recorder

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


def flicker(rng: np.random.Generator, postures: int, n: int) -> FloatArray:
    """1/f noise (K, n, 3) of unit standard deviation within the campaign, on average."""
    frequency = np.fft.rfftfreq(4 * postures)[1:, None, None]
    shape = (len(frequency), n, 3)
    wave = (rng.standard_normal(shape) + 1j * rng.standard_normal(shape)) / np.sqrt(frequency)
    noise = np.fft.irfft(np.concatenate([np.zeros((1, n, 3)), wave]), axis=0)[:postures]
    return np.asarray(noise / noise.std(axis=0).mean())


def noisy(dwells: Dwells, noise: FloatArray) -> Dwells:
    """Dwells with noise of their mean forces added and its stated covariance."""
    stated = np.broadcast_to(STD**2 * np.eye(3), dwells.force_cov.shape).copy()
    return replace(dwells, force=dwells.force + STD * noise, force_cov=stated)


def main() -> None:
    """Print the table."""
    runs = int(sys.argv[1]) if len(sys.argv) > 1 else 60
    rig = simulation.reference_rig()
    rig = replace(rig, declared=replace(rig.declared, force_noise=0.0))
    print(f"# Noise that is not as stated\n\n`python -m benchmarks.noise {runs}`: {runs} a row.\n")
    print("| noise | K | accepted | postures left out | RMSE, mrad | stated σ | d²/9 | error |")
    print("|---|---|---|---|---|---|---|---|")
    for seed, (kind, K) in enumerate((kind, K) for kind in KINDS for K in (24, 60)):
        options = Options(squeeze=100.0, postures=K, recorder=Recorder(mean_sd=1e-6))
        batch = simulation.simulate_dwells(rig, options, np.random.default_rng(seed), runs)
        rng = np.random.default_rng(1000 + seed)
        accepted = left_out = 0
        squares, variances, distance = [], [], []
        for i in range(runs):
            dwells = noisy(batch.dwells(i), drawn(kind, rng, K, rig.n))
            try:
                result = self_calibrate(rig, dwells, rng=rng, max_trials=0)
            except TdfscalError:
                continue
            accepted += not result.reasons
            left_out += len(result.rejected)
            d = so3.log(
                batch.truth.rotation[i] @ np.swapaxes(result.fit.state.rotation, 1, 2)
            ).ravel()
            C = result.uncertainty.covariance
            squares.append(d**2)
            variances.append(np.diagonal(C))
            distance.append(d @ np.linalg.solve(C, d) / 9)
        rmse, std = (1e3 * np.sqrt(np.mean(v)) for v in (squares, variances))
        print(
            f"| {kind} | {K} | {accepted / runs:.0%} | {left_out / runs / K:.1%} | {rmse:.3f} "
            f"| {std:.3f} | {np.mean(distance):.2f} | {np.std(distance) / np.sqrt(runs):.2f} |",
            flush=True,
        )


if __name__ == "__main__":
    main()
