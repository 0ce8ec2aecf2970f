"""Speed of the solvers, as ratios within one run.

    python -m benchmarks.solver > benchmarks/solver.md

Monte Carlo: the batched solver against a loop over scipy.optimize.least_squares with the same
residual, the same analytic Jacobian, the same start and comparable accuracy. Postures: one fit
from 10 000 postures against one from 100, once their statistic is formed, and with its forming.
"""

from __future__ import annotations

import time
from collections.abc import Callable
from dataclasses import replace

import numpy as np
from scipy.optimize import least_squares

from tdfscal import simulation
from tdfscal.model.parameters import nominal, retract
from tdfscal.model.statics import balance, features, features_jacobian, postures
from tdfscal.numerics import so3
from tdfscal.numerics.rotation_descent import stacked
from tdfscal.records import FloatArray
from tdfscal.selfcal.covariance import information_root
from tdfscal.selfcal.estimator import Fit, Priors, fit, solve_statistic, statistic
from tdfscal.selfcal.linear_method import covariance_root
from tdfscal.selfcal.monte_carlo import CHUNK, Sampler
from tdfscal.selfcal.outliers import fit_robust
from tdfscal.simulation import Options

TRIALS, LOOPED = 100_000, 100


def seconds(call: Callable[[], object], repeats: int = 3) -> float:
    """Shortest of a few runs."""
    best = np.inf
    for _ in range(repeats):
        start = time.perf_counter()
        call()
        best = min(best, time.perf_counter() - start)
    return best


def by_scipy(result: Fit, reading: FloatArray, offset: FloatArray) -> FloatArray:
    """Solve one perturbed campaign by a general least-squares routine from the estimate."""
    rig, g = result.rig, result.rig.gravity
    seen = replace(result.postures, force=reading)
    at = balance(seen, result.state, rig.barycentre.value, g)
    L, priors = np.linalg.cholesky(result.at.cov), Priors(rig)
    design = np.linalg.solve(L, at.design).reshape(-1, at.design.shape[-1])
    active, size = np.flatnonzero(result.active), len(result.active)

    def state_at(x: FloatArray):  # type: ignore[no-untyped-def]
        full = np.zeros(size)
        full[active] = x
        return retract(result.state, full)

    def residual(x: FloatArray) -> FloatArray:
        state = state_at(x)
        return np.concatenate([design @ features(state, at, g), priors(state)[0] - offset])

    def jacobian(x: FloatArray) -> FloatArray:
        state = state_at(x)
        J = design @ features_jacobian(state, at, g)[:, active]
        return np.concatenate([J, priors(state)[1]])

    # "lm" is scipy's fastest. The chart moves by 1e-4 rad at most, and J is exact to that.
    found = least_squares(residual, np.zeros(len(active)), jac=jacobian, method="lm", xtol=1e-9)
    return np.asarray(found.x)


def one_trial(root: FloatArray, base: FloatArray) -> FloatArray:
    """Turns (9,) by which a general routine solves one drawn campaign."""

    def residual(x: FloatArray) -> FloatArray:
        return np.asarray(root @ stacked(so3.exp(x.reshape(-1, 3)) @ base))

    found = least_squares(residual, np.zeros(3 * len(base)), xtol=1e-12, ftol=1e-12, gtol=1e-12)
    return np.asarray(found.x)


def monte_carlo() -> None:
    """Time per trial, both ways, and the same trials solved both ways."""
    rig = simulation.reference_rig()
    options = Options(postures=30, squeeze=100.0)
    batch = simulation.simulate_dwells(rig, options, np.random.default_rng(0), 1)
    result = fit_robust(rig, postures(rig, batch.dwells(0))).fit
    sampler = Sampler(result, information_root(result), 1.0)
    rng = np.random.default_rng(1)

    def batched() -> None:
        for _ in range(TRIALS // CHUNK):
            sampler.solve(sampler.draw(rng, CHUNK))

    ours = seconds(batched, 1) / TRIALS
    shape = result.postures.force.shape
    noise = covariance_root(result.postures.force_cov) @ rng.standard_normal((*shape, LOOPED))
    offset = rng.standard_normal((len(result.prior_residual), LOOPED))
    start = time.perf_counter()
    for t in range(LOOPED):
        by_scipy(result, result.postures.force + noise[..., t], offset[:, t])
    theirs = (time.perf_counter() - start) / LOOPED
    roots, base = sampler.draw(rng, LOOPED), result.state.rotation
    turns = so3.log(sampler.solve(roots)[0] @ np.swapaxes(base, 1, 2)).reshape(LOOPED, -1)
    std = np.sqrt(np.diagonal(sampler.covariance))
    apart = [np.abs(one_trial(roots[t], base) - turns[t]) / std for t in range(LOOPED)]
    print("## Monte Carlo, 30 postures, three sensors\n")
    print("| | µs a trial |\n|---|---|")
    print(f"| loop over scipy.optimize.least_squares, {LOOPED} trials | {1e6 * theirs:.0f} |")
    print(f"| drawn and solved on the statistic, {TRIALS} trials | {1e6 * ours:.1f} |")
    print(f"\nRatio {theirs / ours:.0f}. The same trials solved both ways differ by at most "
          f"{np.max(apart):.1g} standard uncertainties.\n")  # fmt: skip


def many_postures() -> None:
    """One fit from few and from many postures."""
    rig = simulation.reference_rig()
    times = {}
    for K in (100, 10_000):
        options = Options(postures=K, squeeze=100.0)
        batch = simulation.simulate_dwells(rig, options, np.random.default_rng(0), 1)
        seen, start, priors = postures(rig, batch.dwells(0)), nominal(rig), Priors(rig)
        at = balance(seen, start, rig.barycentre.value, rig.gravity)
        compressed = statistic(at, np.ones(K))
        times[K] = (
            seconds(lambda: solve_statistic(rig, at, compressed, start, priors), 5),  # noqa: B023
            seconds(lambda: fit(rig, seen, start)),  # noqa: B023
        )
    solve, whole = (times[10_000][i] / times[100][i] for i in (0, 1))
    print("## 10 000 postures against 100\n")
    print("| | 10 000 / 100 |\n|---|---|")
    print(f"| iteration on the statistic | {solve:.2f} |")
    print(f"| whole fit, statistic formed anew in every pass | {whole:.1f} |")


def main() -> None:
    """Print the tables."""
    print("# Speed of the solvers\n\n`python -m benchmarks.solver`, one process.\n")
    monte_carlo()
    many_postures()


if __name__ == "__main__":
    main()
