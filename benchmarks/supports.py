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

from benchmarks.frame import declaring, errors, heads, lacking, numbers, rms, show
from benchmarks.selfcal_grid import bound
from tdfscal import simulation
from tdfscal.catalogue import sentence
from tdfscal.estimation.uncertainty import estimate
from tdfscal.model.statics import postures
from tdfscal.numerics.distributions import chi2_quantile
from tdfscal.records import Drift, Rig
from tdfscal.selfcal.estimator import fit
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


def _soft(value: float) -> Rig:
    return declaring(simulation.make_rig(3), compliance_lateral=value, compliance_vertical=value)


def cases() -> Iterator[Case]:
    """All rows of the table."""
    plain = Options(internal=200.0, recorder=_RECORDER)
    for name, rig in (
        ("all axes", lacking(3)),
        ("one lateral channel dead", lacking(3, (2, 1))),
        ("one vertical channel dead", lacking(3, (2, 2))),
        ("both lateral channels dead", lacking(3, (2, 0), (2, 1))),
        ("one whole sensor of four", lacking(4, (3, 0), (3, 1), (3, 2))),
        ("two of four are load cells", lacking(4, (2, 0), (2, 1), (3, 0), (3, 1))),
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
        giving, firm = [declaring(r, force_noise=0.03) for r in (_soft(1e-6), rig)]
        title = f"1 N/µm {name}, 0.03 N, 500 N"
        yield Case(f"{title}, declared", giving, firm, quiet)
        yield Case(f"{title}, not declared", firm, firm, quiet, "give between")
    turned = replace(plain, faults=Faults(frames=(Frame(1, (6e-4, -5e-4, 6e-4)),)))
    yield Case("a frame turned by 1 mrad", rig, rig, turned, "the positioner of ncp2 is turned")


def run(case: Case, runs: int) -> None:
    """Print one row."""
    batch = simulation.simulate_dwells(case.simulated, case.options, np.random.default_rng(1), runs)
    error, std, least, own, inside, named = [], [], [], [], [], []
    far, started = [], time.process_time()
    for trial in range(runs):
        dwells = batch.dwells(trial)
        seen = postures(case.stated, dwells)
        result = fit(case.stated, seen, best_start(case.stated, seen).state)
        known = estimate(result)
        found = known.uncertainty
        truth = batch.truth.rotation[trial]
        e, s, distance = errors(truth, result.state.rotation, found.covariance)
        error.append(e)
        std.append(s)
        far.append(len(e) * distance)
        least.append(bound(replace(case.stated, drift=Drift()), batch, trial, hinges=False))
        own.append(bound(case.stated, batch, trial, hinges=False))
        inside.append(np.abs(e) < np.repeat(found.coverage_factor.max(axis=1), 3) * s)
        held = (dwells.start + dwells.end) / 2
        doubts = (*suspicions(known, held, dwells.temperature), *misplaced_hinges(known))
        said = [sentence(f) for doubt in doubts for f in doubt.findings(rejects=False)]
        named.append(any(case.cause in one for one in said))
    sure = (np.median(std, axis=0) < 0.05).reshape(-1, 3).all(axis=1).repeat(3)
    rmse, sigma, crb, full = (rms(np.array(x)[:, sure]) for x in (error, std, least, own))
    covered = np.mean(np.array(inside)[:, sure])
    harmed = np.array(far) > chi2_quantile(0.99, len(sure))
    there = f"{np.mean(np.array(named)[harmed]):.0%} of {harmed.sum()}" if harmed.any() else "–"
    without = [n for n, k in zip(case.stated.supports, sure[::3], strict=True) if not k]
    show(case.name, f"{1e3 * sigma:.3f}", f"{rmse / sigma:.2f}", f"{rmse / crb:.2f}",
         f"{full / crb:.3f}", f"{covered:.1%}", f"{np.mean(named):.0%}", there,
         ", ".join(without) or "–", f"{(time.process_time() - started) / runs:.2f}")  # fmt: skip


def main() -> None:
    """Print the table."""
    (runs,) = numbers(60)
    print(f"`python -m benchmarks.supports {runs}`: {runs} campaigns per row, level "
          f"{INTERVAL_COVERAGE:.0%}\n")  # fmt: skip
    print(heads("campaign", "stated σ, mrad", "RMSE / σ", "RMSE / bound", "bound with / without",
                "covered", "named", "named where harmed", "undetermined", "s per fit"))  # fmt: skip
    for case in cases():
        if len(sys.argv) < 3 or sys.argv[2] in case.name:
            run(case, runs)


if __name__ == "__main__":
    main()
