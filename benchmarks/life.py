"""The life of a rig: pooled campaigns, alarms and their rate, time of a hundred campaigns.

    python -m benchmarks.life [histories [pooled] [moving] [steps] [calm] [creep] [hundred]]

Pooled campaigns are simulated and fitted; the many histories for alarms are drawn from the
information of such campaigns, linear and Gaussian, since the rates asked for are small.
"""

from __future__ import annotations

import sys
import time
from collections.abc import Iterator
from dataclasses import replace

import numpy as np
from scipy.special import logsumexp, ndtr, ndtri

from benchmarks.frame import declaring, errors, heads, inside, numbers, rms, row, scratch
from tdfscal.commands.log_pass import Settings
from tdfscal.commands.recordings import read_campaigns
from tdfscal.commands.several_campaigns import judged
from tdfscal.comparison.control_chart import Check, Watching
from tdfscal.comparison.history import life_of
from tdfscal.comparison.members import Recorded
from tdfscal.comparison.pooling import Pool, pool
from tdfscal.estimation.fit import Priors
from tdfscal.estimation.observation import eliminate, stated
from tdfscal.files.writers.campaign import simulate_to_folder
from tdfscal.model.parameters import nominal
from tdfscal.motioncal.pipeline import calibrate_moving
from tdfscal.motioncal.streams import slow_streams
from tdfscal.numerics import so3
from tdfscal.numerics.information import Information, contrast
from tdfscal.records import Drift, FloatArray, Rig, UncertainValue
from tdfscal.selfcal.estimator import fit
from tdfscal.selfcal.preparation import usable_postures
from tdfscal.significance import ALARMS_PER_YEAR
from tdfscal.simulation import Options, Recorder, reference_rig, simulate_dwells
from tdfscal.simulation.moving_campaign import simulate_moving
from tdfscal.simulation.options import MovingOptions
from tdfscal.simulation.truth import make_rig
from tests.comparison.histories import history

RIG = reference_rig()
History = list[Check]
DELAY = UncertainValue(np.array(0.0), np.array(0.02))


def last_errors(result: Pool, at: int, truth: FloatArray) -> tuple[FloatArray, FloatArray, float]:
    """Of a pool's state at its campaign `at`: errors (9,), their std, and d²/9."""
    state = result.posterior(at)
    X = so3.exp(state.mean[:9].reshape(3, 3)) @ result.reference.rotation
    return errors(truth, X, state.covariance[:9, :9])


def pooled(walk: float, histories: int) -> str:
    """Twelve campaigns of five postures: the last state against the truth."""
    rig = replace(RIG, drift=Drift(angle=walk))
    rng = np.random.default_rng(11)
    found, alarms = [], 0
    for _ in range(histories):
        campaigns, truth = history(rig, rng, months=12, walk=walk)
        result = pool(campaigns)
        alarms += bool(life_of(rig, result)[0].alarms)
        found.append(last_errors(result, 11, truth[-1]))
    e, std, d2 = (np.array(part) for part in zip(*found, strict=True))
    return row(f"{1e3 * walk:.2f}", histories, f"{1e3 * rms(e):.4f}", f"{rms(e) / rms(std):.3f}",
               f"{np.mean(d2):.2f}", f"{inside(e, std):.1%}", alarms)  # fmt: skip


def moving(histories: int, first: int = 5000) -> Iterator[str]:
    """Two logs of 30 s in motion, and a check of five postures, of one rig with known hinges."""
    rig = declaring(RIG, hinge=0.0)
    found: dict[str, list[tuple[float, float]]] = {}
    for seed in range(first, first + histories):
        rng = np.random.default_rng(seed)
        lean = rng.normal(size=(3, 3)) * [0.02, 0.02, 0.05]
        rpy = rig.nominal_rpy + lean
        logs = []
        for k in range(2):
            log = simulate_moving(rig, MovingOptions(rpy=rpy, duration=30.0), rng).log
            own = calibrate_moving(rig, slow_streams([log], rig.capacity), DELAY)
            logs.append(Recorded(f"moving {k}", float(k), rig, estimate=own.calibrated))
        batch = simulate_dwells(rig, Options(rpy=rpy, postures=5, squeeze=200.0), rng, 1)
        still = Recorded("still", 2.0, rig, usable_postures(rig, batch.dwells(0)).postures)
        for name, campaigns in (
            ("one in motion", logs[:1]), ("two in motion", logs),
            ("and one at rest", [*logs, still]),
        ):  # fmt: skip
            truth = batch.truth.rotation[0]
            e, std, d2 = last_errors(pool(campaigns), len(campaigns) - 1, truth)
            found.setdefault(name, []).append((d2, inside(e, std)))
    spread = np.sqrt(2 / 9 / histories)
    for name, pairs in found.items():
        d2, share = np.mean(pairs, axis=0)
        yield row(name, histories, f"{d2:.2f} ± {spread:.2f}", f"{share:.1%}")


class Drawn:
    """Histories drawn from the information of simulated campaigns."""

    def __init__(self, rng: np.random.Generator, zero: float, rig: Rig = RIG, postures: int = 5,
                 finer: float = 1.0) -> None:  # fmt: skip
        """finer : by so much all readings and positions of a check are better than the rig's."""
        self.rng, self.turns = rng, 3 * rig.n
        std = np.where(np.isinf(rig.zero.std), np.inf, zero)
        rig = replace(rig, zero=replace(rig.zero, std=std))
        reference = nominal(rig)
        self.roots = []
        for _ in range(40):
            (campaign,), _ = history(rig, rng, months=1, zero=zero, postures_each=postures)
            assert campaign.postures is not None
            found = fit(rig, campaign.postures, reference)
            known = eliminate(found, found.state).information
            values, vectors = np.linalg.eigh(known.matrix)
            self.roots.append(finer * vectors * np.sqrt(values.clip(0.0)))
        prior = stated(Priors(rig), reference)
        self.prior = Information(prior.matrix, np.zeros_like(prior.score))
        self.std = 1 / np.sqrt(np.diagonal(prior.matrix))
        t = self.turns
        covariances = [np.linalg.inv(prior.matrix + root @ root.T)[:t, :t] for root in self.roots]
        self.single = float(np.sqrt(np.mean([np.trace(c) / t for c in covariances])))

    def checks(self, turns: FloatArray, months: FloatArray, at: int = 0, which: int = 0) -> History:
        """Checks of a rig whose sensors are turned by turns (K, 3n); check `at` is campaign which.

        So that each campaign is as often the stepped one, for the chart and for the best test.
        """
        size = len(self.std)
        x = self.std * self.rng.standard_normal(size)
        drawn = self.rng.integers(len(self.roots), size=len(turns))
        drawn[at] = which % len(self.roots)
        checks = []
        for k, turn in enumerate(turns):
            x[: self.turns], root = turn, self.roots[drawn[k]]
            score = root @ (root.T @ x + self.rng.standard_normal(size))
            checks.append(Check(str(k), float(months[k]), Information(root @ root.T, score)))
        return checks

    def watch(self, checks: History, rate: float = ALARMS_PER_YEAR) -> Watching:
        """Go through a history without a declared walk."""
        still = [np.zeros(len(self.std))] * len(checks)
        return Watching(checks, self.prior, still, self.turns // 3, rate).run()

    def moved(self, size: float, shape: FloatArray) -> tuple[int, FloatArray]:
        """Turns (K, 3n) of one sensor about a random axis by size times shape (K,)."""
        sensor = int(self.rng.integers(self.turns // 3))
        axis = self.rng.standard_normal(3)
        turns = np.zeros((len(shape), self.turns))
        turns[:, 3 * sensor : 3 * sensor + 3] = np.outer(shape, size * axis / np.linalg.norm(axis))
        return sensor, turns

    def stepped(self, size: float, at: int, checks: int, which: int) -> tuple[bool, ...]:
        """A step: sensor named within so many checks; dated right; a year later; within a check."""
        months = np.arange(at + 12.0)
        sensor, turns = self.moved(size, (months >= at).astype(np.float64))
        history = self.checks(turns, months, at, which)

        def own(last: int) -> tuple[bool, list[int]]:
            found = self.watch(history[:last]).alarms
            own = [a for a in found if a.sensor == sensor and a.raised >= at]
            return bool(own), [a.onset for a in own if a.kind == "step"]

        (named, now), (_, later) = own(at + checks), own(len(history))
        return named, at in now, at in later, any(abs(onset - at) <= 1 for onset in later)


def bound(drawn: Drawn, size: float, at: int, checks: int) -> tuple[float, float]:
    """Share of steps that any test can raise by their checks-th check, at the chart's rate.

    Neyman and Pearson's: the likelihood ratio of the very alternative (its size, date and checks
    known; any sensor and axis, all alike) has the best mean power of all tests with as many false
    alarms. Then the same with sensor and axis known too. The rate of these checks is spent on this
    one test.
    """
    rng, level, n = drawn.rng, checks * ALARMS_PER_YEAR / 12, 3
    axes = rng.standard_normal((200, 3))
    turns = np.zeros((n * len(axes), 3 * n))
    for i in range(n):
        rows = slice(i * len(axes), (i + 1) * len(axes))
        turns[rows, 3 * i : 3 * i + 3] = size * axes / np.linalg.norm(axes, axis=1)[:, None]
    still, stepped, oracle = [], [], []
    for first in drawn.roots:
        rest = rng.integers(len(drawn.roots), size=at + checks - 1)
        roots = [first, *(drawn.roots[i] for i in rest)]
        own, before = (
            Information(sum(r @ r.T for r in part), np.zeros(len(drawn.std)))
            for part in (roots[:checks], roots[checks:])
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


def steps(zero: float, histories: int, finer: float = 1.0) -> Iterator[str]:
    """Steps of all sizes after 6, 12 and 24 checks, beside the bounds."""
    drawn = Drawn(np.random.default_rng(12), zero, finer=finer)
    for size, checks in ((2e-3, 1), (1e-3, 3), (0.5e-3, 12), (5e-3, 1), (20e-3, 1)):
        for at in (6, 12, 24):
            found = np.mean(
                [drawn.stepped(size, at, checks, which) for which in range(histories)], axis=0
            )
            shares = (f"{share:.1%}" for share in (*found, *bound(drawn, size, at, checks)))
            step = f"{1e3 * size:g} mrad after {at}"
            yield row(f"{zero:g}", f"{1e3 * drawn.single:.2f}", step, histories, checks, *shares)


def creeping(pace: float, histories: int) -> str:
    """A creep that begins after six checks, by pace a month."""
    drawn = Drawn(np.random.default_rng(12), 0.5)
    months, seen, named = np.arange(24.0), [], 0
    for _ in range(histories):
        sensor, turns = drawn.moved(pace, (months - 5).clip(0))
        found = drawn.watch(drawn.checks(turns, months))
        seen += np.flatnonzero(found.smallest[:, sensor] <= found.level)[:1].tolist()
        named += any(a.kind == "creep" and a.sensor == sensor for a in found.alarms)
    after = np.median(seen) - 5
    return row(f"{1e3 * pace:g}", histories, f"{len(seen) / histories:.0%}", f"{after:.0f}",
               f"{named / histories:.0%}")  # fmt: skip


#: What an unchanged rig is checked like: postures, sensors, zeros, months of the checks, rate.
CALM = {
    "24 months": (5, 3, 0.5, np.arange(24.0), ALARMS_PER_YEAR),
    "24 months, zeros 0.25 N": (5, 3, 0.25, np.arange(24.0), ALARMS_PER_YEAR),
    "24 months, 60 postures": (60, 3, 0.5, np.arange(24.0), ALARMS_PER_YEAR),
    "24 months, 0.1 a year": (5, 3, 0.5, np.arange(24.0), 0.1),
    "24 months, six sensors, 0.1 a year": (5, 6, 0.5, np.arange(24.0), 0.1),
    "2 checks, 0.3 a year": (5, 3, 0.5, np.arange(2.0), 0.3),
    "6 checks, 0.1 a year": (5, 3, 0.5, np.arange(6.0), 0.1),
    "200 daily checks, 0.2 a year": (5, 3, 0.5, np.arange(200.0) / 30.4375, 0.2),
    "200 monthly checks, 0.01 a year": (5, 3, 0.5, np.arange(200.0), 0.01),
    "30 checks 1 day to 6 months apart, 0.03 a year": (
        5, 3, 0.5, np.cumsum(np.geomspace(1 / 30, 6, 30)[np.argsort(np.sin(np.arange(30)))]), 0.03,
    ),
}  # fmt: skip


def calm(name: str, histories: int, seed: int = 13) -> str:
    """Histories of an unchanged rig that raise an alarm."""
    postures, sensors, zero, months, rate = CALM[name]
    rig = RIG if sensors == RIG.n else make_rig(sensors)
    drawn = Drawn(np.random.default_rng(seed), zero, rig, postures)
    still = np.zeros((len(months), drawn.turns))
    wrong = sum(
        bool(drawn.watch(drawn.checks(still, months), rate).alarms) for _ in range(histories)
    )
    years = histories * (months[-1] - months[0]) / 12
    stated = 1 - np.exp(-rate * years / histories)
    share = wrong / histories / stated
    ratio = f"{share:.2f} ± {share / np.sqrt(max(wrong, 1)):.2f}"
    return row(name, histories, f"{years:.0f}", wrong, f"{wrong / histories:.2%}", f"{stated:.2%}",
               ratio)  # fmt: skip


def hundred() -> str:
    """A hundred campaigns of twelve dwells: reading, and all the rest."""
    with scratch() as folder:
        months = folder / "months"
        simulate_to_folder(
            months, scenario="months", postures=12, months=100, format="parquet",
            recorder=Recorder(),
        )  # fmt: skip
        start = time.perf_counter()
        groups = [[path] for path in sorted(months.iterdir()) if path.is_dir()]
        reads, _ = read_campaigns(groups, Settings())
        read = time.perf_counter() - start
        start = time.perf_counter()
        pool([judged(item) for item in reads])
        rest = time.perf_counter() - start
    figures = f"{read:.1f}", f"{rest:.1f}", f"{(read + rest) / read:.2f}"
    return row("100 × 12 dwells, 100 Hz, Parquet", *figures)


HEADS = {
    "pooled": ("walk, mrad/√month", "histories", "RMSE, mrad", "/ bound", "d²/9", "in 95 %",
               "alarms"),
    "moving": ("campaigns of one rig", "histories", "d²/9", "in 95 %"),
    "steps": ("zeros, N", "one check, mrad", "step", "histories", "within checks", "sensor named",
              "and dated", "dated a year later", "within one check", "best test",
              "sensor and axis known"),
    "calm": ("checks of an unchanged rig", "histories", "rig-years", "that alarm", "share",
             "stated", "share / stated"),
    "creep": ("mrad a month", "histories", "raised", "after checks, median", "named creep"),
    "hundred": ("campaigns", "reading, s", "pooling, s", "all / reading"),
}  # fmt: skip


def rows(part: str, histories: int) -> Iterator[str]:
    """Lines of one table."""
    if part == "pooled":
        yield from (pooled(walk, histories) for walk in (0.0, 5e-5))
    elif part == "moving":
        yield from moving(histories)
    elif part == "steps":
        for zero, finer in ((0.5, 1.0), (0.25, 1.0), (0.5, 1.45)):
            yield from steps(zero, 2 * histories, finer)
    elif part == "calm":
        yield from (calm(name, 5 * histories) for name in CALM)
    elif part == "creep":
        yield from (creeping(pace, histories) for pace in (0.1e-3, 0.15e-3, 0.5e-3))
    else:
        yield hundred()


def main() -> None:
    """Print the tables."""
    (histories,) = numbers(200)
    for part in sys.argv[2:] or list(HEADS):
        print("\n" + heads(*HEADS[part]))
        for line in rows(part, histories):
            print(line, flush=True)


if __name__ == "__main__":
    main()
