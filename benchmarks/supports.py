"""Sensors that lack axes, zeros that move, supports that give, frames that are turned.

Campaigns of 24 postures, 0.1 N per posture, internal forces of 200 N, from the simulator. Per row:
root mean square of the errors over the determined angles in units of the stated one, of the
Cramér–Rao bound (from noise-free readings at the truth), share inside the 95 % interval, and how
often the result is questioned.

    python -m benchmarks.supports [RUNS]
"""

from __future__ import annotations

import sys
import time
from collections.abc import Iterator
from dataclasses import dataclass, replace

import numpy as np

from tdfscal import simulation
from tdfscal.model.parameters import nominal, with_motions
from tdfscal.model.statics import postures
from tdfscal.numerics import so3
from tdfscal.records import Drift, FloatArray, Rig
from tdfscal.selfcal.closure import frame_errors
from tdfscal.selfcal.covariance import evaluate, information_root, quality
from tdfscal.selfcal.estimator import at_state, fit
from tdfscal.selfcal.mounting_search import best_start
from tdfscal.selfcal.score_tests import suspicions
from tdfscal.significance import INTERVAL_COVERAGE
from tdfscal.simulation import Options, Recorder
from tdfscal.simulation.faults import Faults, Frame, Walk, Warming

_RECORDER = Recorder(mean_sd=0.1)


@dataclass(frozen=True, slots=True)
class Case:
    """name; rig as stated; what is simulated on which rig."""

    name: str
    stated: Rig
    simulated: Rig
    options: Options


def _lacking(n: int, *dead: tuple[int, int]) -> Rig:
    axes = np.ones((n, 3), dtype=np.bool_)
    for sensor, axis in dead:
        axes[sensor, axis] = False
    return replace(simulation.make_rig(n), axes=axes)


def _soft(value: float) -> Rig:
    rig = simulation.make_rig(3)
    declared = replace(rig.declared, compliance_lateral=value, compliance_vertical=value)
    return replace(rig, declared=declared)


def cases() -> Iterator[Case]:
    """All rows of the table."""
    plain = Options(internal=200.0, recorder=_RECORDER)
    for name, rig in (
        ("all axes", _lacking(3)),
        ("one lateral channel dead", _lacking(3, (2, 1))),
        ("one vertical channel dead", _lacking(3, (2, 2))),
        ("both lateral channels dead", _lacking(3, (2, 0), (2, 1))),
        ("one whole sensor of four", _lacking(4, (3, 0), (3, 1), (3, 2))),
        ("two of four are load cells", _lacking(4, (2, 0), (2, 1), (3, 0), (3, 1))),
    ):
        yield Case(name, rig, rig, plain)
    rig = simulation.make_rig(3)
    warming = Warming(10.0, ((0.3, -0.2, 0.3), (-0.3, 0.1, 0.2), (0.1, 0.3, -0.3)))
    walks = tuple(Walk(i, 1.0) for i in range(3))
    hot = replace(plain, faults=Faults(warming=warming))
    wander = replace(plain, faults=Faults(walks=walks))
    # A campaign takes about 24 · 7 s.
    intensity = 1.0 / np.sqrt(24 * 7.0)
    yield Case(
        "3 N of thermal drift, declared", replace(rig, drift=Drift(temperature=np.inf)), rig, hot
    )
    yield Case("3 N of thermal drift, not declared", rig, rig, hot)
    yield Case("a walk of 1 N, declared", replace(rig, drift=Drift(walk=intensity)), rig, wander)
    yield Case(
        "slopes declared, nothing drifts", replace(rig, drift=Drift(time=np.inf)), rig, plain
    )
    soft = Options(squeeze=200.0, stiffness=1e6, recorder=_RECORDER)
    yield Case("supports of 1 N/µm, declared", _soft(1e-6), rig, soft)
    yield Case("supports of 1 N/µm, not declared", rig, rig, soft)
    turned = replace(plain, faults=Faults(frames=(Frame(1, (6e-4, -5e-4, 6e-4)),)))
    yield Case("a frame turned by 1 mrad", rig, rig, turned)


def run(case: Case, runs: int) -> str:
    """One row."""
    batch = simulation.simulate_dwells(case.simulated, case.options, np.random.default_rng(1), runs)
    error, std, bound, inside, asked, started = [], [], [], [], [], time.process_time()
    for trial in range(runs):
        dwells = batch.dwells(trial)
        seen = postures(case.stated, dwells)
        result = fit(case.stated, seen, best_start(case.stated, seen).state)
        parts = information_root(result)
        stats = quality(result, parts)
        found = evaluate(result, parts, stats.birge)
        truth = batch.truth.rotation[trial]
        error.append(so3.log(truth @ np.swapaxes(result.state.rotation, 1, 2)).ravel())
        std.append(np.sqrt(np.diagonal(found.covariance)))
        bound.append(_bound(case, batch, trial))
        half = np.repeat(found.coverage_factor.max(axis=1), 3) * std[-1]
        inside.append(np.abs(error[-1]) < half)
        held = (dwells.start + dwells.end) / 2
        doubts = suspicions(result, parts, found, held, stats, dwells.temperature)
        asked.append(bool((*doubts, *frame_errors(result, parts, found))))
    e, s, b = np.array(error), np.array(std), np.array(bound)
    known = (np.median(s, axis=0) < 0.05).reshape(-1, 3).all(axis=1).repeat(3)
    rmse, sigma, crb = (np.sqrt(np.mean(x[:, known] ** 2)) for x in (e, s, b))
    covered = np.mean(np.array(inside)[:, known])
    without = [n for n, k in zip(case.stated.supports, known[::3], strict=True) if not k]
    return (
        f"| {case.name} | {1e3 * sigma:.3f} | {rmse / sigma:.2f} | {rmse / crb:.2f} | "
        f"{covered:.1%} | {np.mean(asked):.0%} | {', '.join(without) or '–'} | "
        f"{(time.process_time() - started) / runs:.2f} |"
    )


def _bound(case: Case, batch: simulation.Batch, trial: int) -> FloatArray:
    """Standard deviations (3n,) of the Cramér–Rao bound without drift, compliance or walk."""
    plain = replace(case.stated, drift=Drift())
    truth = batch.truth.trial(trial)
    S = truth.sensitivity
    state = replace(
        with_motions(nominal(plain), 0),
        rotation=truth.rotation,
        zero=truth.zero,
        sensitivity=S[:, [0, 1, 2, 1, 0, 0], [0, 1, 2, 2, 2, 1]],
        mass=np.asarray(truth.mass),
        barycentre=truth.barycentre,
    )
    sensing = (np.eye(3) + S) @ np.swapaxes(truth.rotation, 1, 2)
    exact = np.einsum("nab,knb->kna", sensing, batch.true_force[trial]) + truth.zero
    seen = replace(postures(plain, batch.dwells(trial)), force=exact)
    root = information_root(at_state(plain, seen, state, np.ones(len(seen)))).root
    return np.asarray(np.linalg.norm(root[: 3 * plain.n], axis=1))


def main() -> None:
    """Print the table."""
    runs = int(sys.argv[1]) if len(sys.argv) > 1 else 60
    print(f"`python -m benchmarks.supports {runs}`: {runs} campaigns per row, level "
          f"{INTERVAL_COVERAGE:.0%}\n")  # fmt: skip
    print("| campaign | stated σ, mrad | RMSE / σ | RMSE / bound | covered | questioned | "
          "undetermined | s per fit |")  # fmt: skip
    print("|---|---|---|---|---|---|---|---|")
    for case in cases():
        print(run(case, runs), flush=True)


if __name__ == "__main__":
    main()
