"""Sensors that lack axes, zeros that move, supports that give, frames that are turned.

Campaigns of 24 postures where nothing else is said, 0.1 N per posture besides the 0.1 N that the
rig file declares, internal forces of 200 N, from the simulator. Per row: root mean square of the
errors over the determined angles in units of the stated one, of the Cramér–Rao bound of a rig that
stands still (from noise-free readings at the truth), that bound with what is declared free over
the one without, share inside the 95 % interval, how often the cause is named, and how often it is
where d² of the angles is beyond 99 % of χ² (with the number of such runs).

    python -m benchmarks.supports [RUNS [WORDS OF ONE ROW]]
"""

from __future__ import annotations

import sys
import time
from collections.abc import Iterator
from dataclasses import dataclass, replace

import numpy as np

from tdfscal import simulation
from tdfscal.catalogue import sentence
from tdfscal.estimation.fit import information
from tdfscal.estimation.score_tests import Suspicion
from tdfscal.model.parameters import nominal
from tdfscal.model.statics import postures
from tdfscal.numerics import so3
from tdfscal.numerics.distributions import chi2_quantile
from tdfscal.records import Drift, FloatArray, Rig
from tdfscal.selfcal.estimator import at_state, estimate, fit
from tdfscal.selfcal.mounting_search import best_start
from tdfscal.selfcal.preparation import misplaced_hinges
from tdfscal.selfcal.score_tests import suspicions
from tdfscal.significance import INTERVAL_COVERAGE
from tdfscal.simulation import Options, Recorder
from tdfscal.simulation.faults import Faults, Frame, Walk, Warming

_RECORDER = Recorder(mean_sd=0.1)


@dataclass(frozen=True, slots=True)
class Case:
    """name; rig as stated; what is simulated on which rig; what ought to be said of it."""

    name: str
    stated: Rig
    simulated: Rig
    options: Options
    cause: str = ""


def _says(doubt: Suspicion, cause: str) -> bool:
    return any(cause in sentence(finding) for finding in doubt.findings(rejects=False))


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
    slopes = replace(rig, drift=Drift(temperature=np.inf))
    yield Case("3 N of thermal drift, declared", slopes, rig, hot)
    yield Case("3 N of thermal drift, not declared", rig, rig, hot, "follow")
    yield Case("a walk of 1 N, declared", replace(rig, drift=Drift(walk=intensity)), rig, wander)
    still = replace(rig, drift=Drift(time=np.inf))
    yield Case("a walk of 1 N, not declared", rig, rig, wander, "wander")
    yield Case("slopes declared, nothing drifts", still, rig, plain)
    longer = replace(plain, postures=36)
    yield Case("slopes declared, nothing drifts, 36 postures", still, rig, longer)
    stated = replace(rig, drift=Drift(time=0.5 / 3600))
    yield Case("slopes of 0.5 N/h declared, nothing drifts", stated, rig, plain)
    soft = Options(squeeze=200.0, stiffness=1e6, recorder=_RECORDER)
    yield Case("supports of 1 N/µm, declared", _soft(1e-6), rig, soft)
    yield Case("supports of 1 N/µm, not declared", rig, rig, soft, "give between")
    # Less noise and more squeeze: what is soft does harm.
    for name, stiffness in (
        ("all ways", (1e6, 1e6, 1e6)),
        ("sideways", (1e6, 1e6, 2e7)),
        ("vertically", (2e7, 2e7, 1e6)),
    ):
        quiet = Options(
            squeeze=500.0, stiffness=np.array(stiffness), recorder=Recorder(mean_sd=0.03)
        )
        giving, firm = [
            replace(r, declared=replace(r.declared, force_noise=0.03)) for r in (_soft(1e-6), rig)
        ]
        title = f"1 N/µm {name}, 0.03 N, 500 N"
        yield Case(f"{title}, declared", giving, firm, quiet)
        yield Case(f"{title}, not declared", firm, firm, quiet, "give between")
    turned = replace(plain, faults=Faults(frames=(Frame(1, (6e-4, -5e-4, 6e-4)),)))
    yield Case("a frame turned by 1 mrad", rig, rig, turned, "the positioner of ncp2 is turned")


def run(case: Case, runs: int) -> str:
    """One row."""
    batch = simulation.simulate_dwells(case.simulated, case.options, np.random.default_rng(1), runs)
    error, std, bound, own, inside, named = [], [], [], [], [], []
    far, started = [], time.process_time()
    for trial in range(runs):
        dwells = batch.dwells(trial)
        seen = postures(case.stated, dwells)
        result = fit(case.stated, seen, best_start(case.stated, seen).state)
        known = estimate(result)
        found = known.uncertainty
        truth = batch.truth.rotation[trial]
        error.append(so3.log(truth @ np.swapaxes(result.state.rotation, 1, 2)).ravel())
        std.append(np.sqrt(np.diagonal(found.covariance)))
        bound.append(_bound(replace(case.stated, drift=Drift()), batch, trial))
        own.append(_bound(case.stated, batch, trial))
        far.append(error[-1] @ np.linalg.solve(found.covariance, error[-1]))
        half = np.repeat(found.coverage_factor.max(axis=1), 3) * std[-1]
        inside.append(np.abs(error[-1]) < half)
        held = (dwells.start + dwells.end) / 2
        doubts = (*suspicions(known, held, dwells.temperature), *misplaced_hinges(known))
        named.append(
            any(
                case.cause in sentence(f) for doubt in doubts for f in doubt.findings(rejects=False)
            )
        )
    e, s, b, o = np.array(error), np.array(std), np.array(bound), np.array(own)
    known = (np.median(s, axis=0) < 0.05).reshape(-1, 3).all(axis=1).repeat(3)
    rmse, sigma, crb, full = (np.sqrt(np.mean(x[:, known] ** 2)) for x in (e, s, b, o))
    covered = np.mean(np.array(inside)[:, known])
    harmed = np.array(far) > chi2_quantile(0.99, e.shape[1])
    there = f"{np.mean(np.array(named)[harmed]):.0%} of {harmed.sum()}" if harmed.any() else "–"
    without = [n for n, k in zip(case.stated.supports, known[::3], strict=True) if not k]
    return (
        f"| {case.name} | {1e3 * sigma:.3f} | {rmse / sigma:.2f} | {rmse / crb:.2f} | "
        f"{full / crb:.3f} | {covered:.1%} | {np.mean(named):.0%} | {there} | "
        f"{', '.join(without) or '–'} | "
        f"{(time.process_time() - started) / runs:.2f} |"
    )


def _bound(rig: Rig, batch: simulation.Batch, trial: int) -> FloatArray:
    """Standard deviations (3n,) of the Cramér–Rao bound of what the rig declares."""
    truth = batch.truth.trial(trial)
    S = truth.sensitivity
    state = replace(
        nominal(rig),
        rotation=truth.rotation,
        zero=truth.zero,
        sensitivity=S[:, [0, 1, 2, 1, 0, 0], [0, 1, 2, 2, 2, 1]],
        mass=np.asarray(truth.mass),
        barycentre=truth.barycentre,
    )
    sensing = (np.eye(3) + S) @ np.swapaxes(truth.rotation, 1, 2)
    exact = np.einsum("nab,knb->kna", sensing, batch.true_force[trial]) + truth.zero
    seen = replace(postures(rig, batch.dwells(trial)), force=exact)
    root = information(at_state(rig, seen, state, np.ones(len(seen)))).root
    return np.asarray(np.linalg.norm(root[: 3 * rig.n], axis=1))


def main() -> None:
    """Print the table."""
    runs = int(sys.argv[1]) if len(sys.argv) > 1 else 60
    print(f"`python -m benchmarks.supports {runs}`: {runs} campaigns per row, level "
          f"{INTERVAL_COVERAGE:.0%}\n")  # fmt: skip
    print("| campaign | stated σ, mrad | RMSE / σ | RMSE / bound | bound with / without | "
          "covered | named | named where harmed | undetermined | s per fit |")  # fmt: skip
    print("|---|---|---|---|---|---|---|---|---|---|")
    for case in cases():
        if len(sys.argv) < 3 or sys.argv[2] in case.name:
            print(run(case, runs), flush=True)


if __name__ == "__main__":
    main()
