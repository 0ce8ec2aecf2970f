"""Self-calibration over a grid of simulated rigs: error against the Cramér–Rao bound.

    python -m benchmarks.selfcal_grid [TRIALS] > benchmarks/selfcal_grid.md

Every cell draws its own machines within what its rig file states. The bound is that of the true
loads and the true state, priors included; RMSE, stated standard uncertainty and coverage are over
all angles of all campaigns, and coverage also over the joint 95 % region of the 3n angles.
"""

from __future__ import annotations

from dataclasses import dataclass, replace
from itertools import product

import numpy as np

from benchmarks.frame import errors, heads, numbers, rms, show, stream
from tdfscal import simulation
from tdfscal.estimation.fit import information
from tdfscal.model.parameters import nominal
from tdfscal.model.statics import postures
from tdfscal.numerics.distributions import chi2_quantile
from tdfscal.records import FloatArray, Rig, UncertainValue
from tdfscal.selfcal.estimator import at_state
from tdfscal.selfcal.pipeline import self_calibrate
from tdfscal.simulation import Options

SUPPORTS = (3, 4, 6)
TILTS = (1.0, 5.0, 10.0)
LOADS = (("natural", 20.0), ("natural", 100.0), ("natural", 500.0), ("squeeze", 100.0))
TARES = (0.1, 0.5, 5.0)


@dataclass(frozen=True)
class Cell:
    """One rig and campaign of the grid."""

    supports: int
    tilt: float
    kind: str
    load: float
    tare: float

    def rig(self) -> Rig:
        rig = simulation.make_rig(self.supports)
        zero = np.full((self.supports, 3), self.tare)
        return replace(rig, zero=UncertainValue(np.zeros_like(zero), zero))

    def options(self) -> Options:
        tilt = float(np.deg2rad(self.tilt))
        if self.kind == "natural":
            return Options(tilt=tilt, internal=self.load)
        return Options(tilt=tilt, internal=20.0, squeeze=self.load)


@dataclass(frozen=True)
class Row:
    """Figures of a cell."""

    cell: Cell
    rmse: float
    bound: float
    stated: float
    mahalanobis: float
    single: float
    joint: float


def bound(rig: Rig, batch: simulation.Batch, trial: int, *, hinges: bool = True) -> FloatArray:
    """Std (3n,) of the Cramér–Rao bound at the truth, with noise-free readings.

    hinges : these and the datums are the true ones, too.
    """
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
    if hinges:
        state = replace(state, hinge=truth.hinge, datum=truth.datum)
    seen = postures(rig, batch.dwells(trial))
    sensing = (np.eye(3) + S) @ np.swapaxes(truth.rotation, 1, 2)
    exact = np.einsum("nab,knb->kna", sensing, batch.true_force[trial]) + truth.zero
    root = information(at_state(rig, replace(seen, force=exact), state, np.ones(len(seen)))).root
    return np.asarray(np.linalg.norm(root[: 3 * rig.n], axis=1))


def row(job: tuple[int, Cell, int]) -> Row:
    """Run the campaigns of one cell."""
    seed, cell, trials = job
    rig = cell.rig()
    batch = simulation.simulate_dwells(rig, cell.options(), np.random.default_rng(seed), trials)
    found, bounds = [], []
    for i in range(trials):
        result = self_calibrate(rig, batch.dwells(i), rng=np.random.default_rng(0), max_trials=0)
        R, C = result.fit.state.rotation, result.uncertainty.covariance
        found.append(errors(batch.truth.rotation[i], R, C))
        bounds.append(bound(rig, batch, i))
    e, std, distance = (np.array(part) for part in zip(*found, strict=True))
    return Row(
        cell, rms(e), rms(bounds), rms(std), float(np.mean(distance)),
        float(np.mean(e**2 < chi2_quantile(0.95, 1) * std**2)),
        float(np.mean(3 * rig.n * distance < chi2_quantile(0.95, 3 * rig.n))),
    )  # fmt: skip


def cells() -> list[Cell]:
    """Return the grid."""
    return [
        Cell(n, tilt, kind, load, tare)
        for n, tilt, (kind, load), tare in product(SUPPORTS, TILTS, LOADS, TARES)
    ]


def main() -> None:
    """Print the table."""
    (trials,) = numbers(100)
    jobs = [(seed, cell, trials) for seed, cell in enumerate(cells())]
    print("# Self-calibration against the Cramér–Rao bound\n")
    print(
        f"`python -m benchmarks.selfcal_grid {trials}`: {trials} campaigns of 24 postures a row.\n"
    )
    print(heads("n", "tilt, °", "internal forces, N", "tare, N", "bound, mrad", "RMSE / bound",
                "stated / RMSE", "d²/3n", "angles in 95 %", "region in 95 %"))  # fmt: skip
    rows = []
    for r in stream(row, jobs):
        rows.append(r)
        c = r.cell
        figures = (1e3 * r.bound, r.rmse / r.bound, r.stated / r.rmse, r.mahalanobis, r.single)
        show(c.supports, f"{c.tilt:g}", f"{c.kind} {c.load:g}", f"{c.tare:g}",
             *(f"{figure:.3f}" for figure in (*figures, r.joint)))  # fmt: skip
    total = rms([r.rmse / r.bound for r in rows])
    stated = rms([r.stated / r.rmse for r in rows])
    print(
        f"\nAll rows together: RMSE / bound {total:.3f}, stated / RMSE {stated:.3f}, "
        f"d²/3n {np.mean([r.mahalanobis for r in rows]):.3f}, "
        f"angles in their 95 % interval {np.mean([r.single for r in rows]):.4f}, "
        f"joint region {np.mean([r.joint for r in rows]):.4f}."
    )


if __name__ == "__main__":
    main()
