"""The life of a rig: pooled campaigns, alarms and their rate, time of a hundred campaigns.

    python -m benchmarks.life [histories [pooled] [alarms] [hundred]]

Pooled campaigns are simulated and fitted; the many histories for alarms are drawn from the
information of such campaigns, linear and Gaussian, since the rates asked for are small.
"""

from __future__ import annotations

import sys
import tempfile
import time
from collections.abc import Iterator
from dataclasses import replace
from pathlib import Path

import numpy as np
from scipy.special import logsumexp, ndtr, ndtri

from tdfscal.comparison.control_chart import Check, Watch, Watching
from tdfscal.comparison.eliminated import eliminate, stated
from tdfscal.comparison.pooling import pool
from tdfscal.files.writers.campaign import simulate_to_folder
from tdfscal.model.parameters import nominal
from tdfscal.numerics import so3
from tdfscal.numerics.information import Information, contrast
from tdfscal.records import Drift, FloatArray
from tdfscal.selfcal.estimator import Priors, fit
from tdfscal.significance import ALARMS_PER_YEAR
from tdfscal.simulation import Recorder, reference_rig
from tdfscal.workflows.progress import SILENT
from tdfscal.workflows.several_campaigns import read_campaign, recorded
from tests.comparison.histories import history

RIG = reference_rig()


def pooled(walk: float, histories: int) -> str:
    """Twelve campaigns of five postures: the last state against the truth."""
    rig = replace(RIG, drift=Drift(angle=walk))
    rng = np.random.default_rng(11)
    errors, variances, misfits = [], [], 0
    for _ in range(histories):
        campaigns, truth = history(rig, rng, months=12, walk=walk)
        result = pool(campaigns)
        misfits += bool(result.misfits)
        state = result.posterior(rig, 11)
        covariance = state.covariance[:9, :9]
        X = so3.exp(state.mean[:9].reshape(3, 3)) @ result.reference.rotation
        errors.append(so3.log(truth[-1] @ np.swapaxes(X, 1, 2)).ravel())
        variances.append(covariance)
    e, C = np.array(errors), np.array(variances)
    var = np.diagonal(C, axis1=1, axis2=2)
    d2 = np.einsum("ka,kab,kb->k", e, np.linalg.inv(C), e)
    inside = np.mean(np.abs(e) < 1.96 * np.sqrt(var))
    return (
        f"| {1e3 * walk:.2f} | {histories} | {1e3 * np.sqrt(np.mean(e**2)):.4f} | "
        f"{np.sqrt(np.mean(e**2) / np.mean(var)):.3f} | {np.mean(d2) / 9:.2f} | {inside:.1%} | "
        f"{misfits} |"
    )


class Drawn:
    """Histories drawn from the information of simulated campaigns of five postures."""

    def __init__(self, rng: np.random.Generator, zero: float) -> None:
        self.rng = rng
        std = np.where(np.isinf(RIG.zero.std), np.inf, zero)
        rig = replace(RIG, zero=replace(RIG.zero, std=std))
        reference = nominal(rig)
        self.roots = []
        for _ in range(40):
            (campaign,), _ = history(rig, rng, months=1, zero=zero)
            assert campaign.postures is not None
            found = fit(rig, campaign.postures, reference)
            values, vectors = np.linalg.eigh(eliminate(found, found.state).information.matrix)
            self.roots.append(vectors * np.sqrt(values.clip(0.0)))
        prior = stated(Priors(rig), reference)
        self.prior = Information(prior.matrix, np.zeros_like(prior.score))
        self.std = 1 / np.sqrt(np.diagonal(prior.matrix))
        covariances = [np.linalg.inv(prior.matrix + root @ root.T)[:9, :9] for root in self.roots]
        self.single = float(np.sqrt(np.mean([np.trace(c) / 9 for c in covariances])))

    def watch(self, turns: FloatArray, rate: float = 0.01) -> Watch:
        """Go through a history whose sensors are turned by turns (months, 9)."""
        size = len(self.std)
        constants = self.std * self.rng.standard_normal(size)
        checks = []
        for month, turn in enumerate(turns):
            x = constants.copy()
            x[:9] = turn
            root = self.roots[self.rng.integers(len(self.roots))]
            score = root @ (root.T @ x + self.rng.standard_normal(size))
            checks.append(Check(str(month), float(month), Information(root @ root.T, score)))
        return Watching(checks, self.prior, [np.zeros(size)] * len(checks), 3, rate).run()

    def stepped(self, size: float, at: int) -> tuple[bool, bool, bool]:
        """A step about a random axis: named in its month, within three checks, right month."""
        sensor = int(self.rng.integers(3))
        axis = self.rng.standard_normal(3)
        turns = np.zeros((at + 3, 9))
        turns[at:, 3 * sensor : 3 * sensor + 3] = size * axis / np.linalg.norm(axis)
        own = [a for a in self.watch(turns).alarms if a.sensor == sensor and a.raised >= at]
        return (
            any(a.raised == at and a.onset == at for a in own),
            bool(own),
            any(a.onset == at for a in own),
        )


def bound(drawn: Drawn, size: float, at: int, checks: int, runs: int = 40) -> tuple[float, float]:
    """Share of steps that any test can raise by their checks-th check, at the chart's rate.

    Neyman and Pearson's: the likelihood ratio of the very alternative (its size, date and checks
    known; any sensor and axis, all alike) has the best mean power of all tests with as many false
    alarms. Then the same with sensor and axis known too. The rate of these checks is spent on this
    one test.
    """
    rng, level, n = drawn.rng, checks * ALARMS_PER_YEAR / 12, 3
    axes = rng.standard_normal((400, 3))
    turns = np.zeros((n * len(axes), 3 * n))
    for i in range(n):
        rows = slice(i * len(axes), (i + 1) * len(axes))
        turns[rows, 3 * i : 3 * i + 3] = size * axes / np.linalg.norm(axes, axis=1)[:, None]
    still, stepped, oracle = [], [], []
    for _ in range(runs):
        roots = [drawn.roots[rng.integers(len(drawn.roots))] for _ in range(at + checks)]
        before, own = (
            Information(sum(r @ r.T for r in part), np.zeros(len(drawn.std)))
            for part in (roots[:at], roots[at:])
        )
        M = contrast(drawn.prior + before, own).matrix[: 3 * n, : 3 * n]
        root = np.linalg.cholesky(M)
        noise = rng.standard_normal((4000, 3 * n)) @ root.T
        shift = turns @ M
        half = 0.5 * np.sum(turns * shift, axis=1)
        still.append(logsumexp(noise @ turns.T - half, axis=1))
        score = shift + rng.standard_normal(shift.shape) @ root.T
        stepped.append(logsumexp(score @ turns.T - half, axis=1))
        oracle.append(ndtr(np.sqrt(2 * half) + ndtri(level)))
    limit = np.quantile(np.concatenate(still), 1 - level)
    return float(np.mean(np.concatenate(stepped) > limit)), float(np.mean(oracle))


def alarms(zero: float, histories: int) -> Iterator[str]:
    """False alarms, and steps of 2 and 1 mrad after 6, 12 and 24 checks, beside the bounds."""
    drawn = Drawn(np.random.default_rng(12), zero)
    still = np.zeros((24, 9))
    years = 23 / 12
    for rate in (ALARMS_PER_YEAR, 0.1):
        wrong = sum(bool(drawn.watch(still, rate).alarms) for _ in range(5 * histories))
        yield (
            f"| {zero:g} | {1e3 * drawn.single:.2f} | nothing, 24 months, {rate:g} a year | "
            f"{5 * histories} | {wrong} alarms | {wrong / 5 / histories / years:.4f} a year | | |"
        )
    for size, checks in ((2e-3, 1), (1e-3, 3)):
        for at in (6, 12, 24):
            found = np.array([drawn.stepped(size, at) for _ in range(histories)])
            best, known = bound(drawn, size, at, checks)
            raised = found[:, 0 if checks == 1 else 1].mean()
            yield (
                f"| {zero:g} | {1e3 * drawn.single:.2f} | {1e3 * size:g} mrad after {at} checks | "
                f"{histories} | {raised:.1%} within {checks} | {found[:, 2].mean():.1%} "
                f"| {best:.1%} | {known:.1%} |"
            )


def hundred() -> str:
    """A hundred campaigns of twelve dwells: reading, and all the rest."""
    with tempfile.TemporaryDirectory() as folder:
        months = Path(folder) / "months"
        simulate_to_folder(
            months, scenario="months", postures=12, months=100, format="parquet",
            recorder=Recorder(),
        )  # fmt: skip
        start = time.perf_counter()
        reads = [
            read_campaign([path], SILENT) for path in sorted(months.iterdir()) if path.is_dir()
        ]
        read = time.perf_counter() - start
        start = time.perf_counter()
        pool([recorded(item) for item in reads])
        rest = time.perf_counter() - start
    ratio = (read + rest) / read
    return f"| 100 × 12 dwells, 100 Hz, Parquet | {read:.1f} | {rest:.1f} | {ratio:.2f} |"


def main() -> None:
    """Print the tables."""
    histories = int(sys.argv[1]) if len(sys.argv) > 1 else 200
    parts = sys.argv[2:] or ["pooled", "alarms", "hundred"]
    if "pooled" in parts:
        _print_pooled(histories)
    if "alarms" in parts:
        _print_alarms(histories)
    if "hundred" in parts:
        print("\n| campaigns | reading, s | pooling, s | all / reading |")
        print("|---|---|---|---|")
        print(hundred(), flush=True)


def _print_pooled(histories: int) -> None:
    print("Twelve campaigns of five postures, zeros drawn anew (0.5 N):\n")
    print(
        "| walk, mrad/√month | histories | RMSE, mrad | RMSE / bound | d²/9 | in 95 % | misfits |"
    )
    print("|---|---|---|---|---|---|---|")
    for walk in (0.0, 5e-5):
        print(pooled(walk, histories), flush=True)


def _print_alarms(histories: int) -> None:
    print("\nMonthly checks of five postures, default rate (0.01 a year):\n")
    print(
        "| zeros, N | one check, mrad | what happens | histories | raised | right date | "
        "best test | sensor and axis known |"
    )
    print("|---|---|---|---|---|---|---|---|")
    for zero in (0.5, 0.25):
        for row in alarms(zero, 2 * histories):
            print(row, flush=True)


if __name__ == "__main__":
    main()
