"""The linear method's covariance with every kind of declared input in turn.

    python -m benchmarks.linear_inputs [RUNS] [TRIALS] > benchmarks/linear_inputs.md

One input dominates what else is declared; d²/9 compares the errors with the covariance that the
method states by Monte Carlo of all declared inputs (its scatter over the trials corrected).
"""

from __future__ import annotations

import sys
from dataclasses import replace

import numpy as np

from tdfscal import simulation
from tdfscal.model.statics import postures
from tdfscal.numerics import so3
from tdfscal.records import DeclaredUncertainty, Rig, UncertainValue
from tdfscal.selfcal.linear_method import evaluate_linear, fit_linear
from tdfscal.simulation import Options, Recorder

OPTIONS = Options(postures=40, tilt=np.radians(8.0), squeeze=300.0, recorder=Recorder(mean_sd=0.05))
BASE = simulation.make_rig(
    3,
    mass_std=1e-6,
    barycentre_std=1e-9,
    zero_std=1e-6,
    declared=DeclaredUncertainty(positioner=1e-7, force_noise=0.02),
)


def declared(**changes: float) -> Rig:
    """The rig with more declared."""
    return replace(BASE, declared=replace(BASE.declared, **changes))


def known(std: float, of: UncertainValue) -> UncertainValue:
    return UncertainValue(of.value, np.full_like(of.value, std))


CASES = {
    "force noise, 0.3 N": declared(force_noise=0.3),
    "positioner, 50 µm": declared(positioner=5e-5),
    "zero, 2 N": replace(BASE, zero=known(2.0, BASE.zero)),
    "mass, 2 kg": replace(BASE, mass=known(2.0, BASE.mass)),
    "barycentre, 2 mm": replace(BASE, barycentre=known(2e-3, BASE.barycentre)),
    "hinge, 0.2 mm": declared(hinge=2e-4),
    "datum, 0.2 mm": declared(datum=2e-4),
    "sensitivity, 0.2 %": declared(force_sensitivity=2e-3),
    "hinge friction, 0.3 N·m": declared(hinge_moment=0.3),
    "gravity, 1 mrad": replace(BASE, gravity_tilt_std=1e-3),
    "compliance, 0.1 µm/N": declared(compliance_lateral=1e-7, compliance_vertical=1e-7),
}


def distances(rig: Rig, runs: int, trials: int, seed: int) -> tuple[list[float], float]:
    """d²/9 of each run, and the stated standard uncertainty, rad, rms over the angles."""
    batch = simulation.simulate_dwells(rig, OPTIONS, np.random.default_rng(seed), runs)
    found, variance = [], []
    for i in range(runs):
        fit = fit_linear(rig, postures(rig, batch.dwells(i)))
        C = evaluate_linear(fit, np.random.default_rng(i), trials).covariance
        d = so3.log(batch.truth.rotation[i] @ np.swapaxes(fit.state.rotation, 1, 2)).ravel()
        # E[S⁻¹] = C⁻¹ (N − 1)/(N − p − 2) of a sample covariance S.
        found.append(float(d @ np.linalg.solve(C, d)) / 9 * (trials - 11) / (trials - 1))
        variance.append(np.diagonal(C).mean())
    return found, float(np.sqrt(np.mean(variance)))


def main() -> None:
    """Print the table."""
    runs = int(sys.argv[1]) if len(sys.argv) > 1 else 60
    trials = int(sys.argv[2]) if len(sys.argv) > 2 else 150
    print("# The linear method's covariance\n")
    print(f"`python -m benchmarks.linear_inputs {runs} {trials}`: {runs} campaigns a row.\n")
    print("| declared | stated σ, mrad | d²/9 | its standard error |\n|---|---|---|---|")
    for seed, (name, rig) in enumerate(CASES.items()):
        found, std = distances(rig, runs, trials, seed)
        error = np.std(found) / np.sqrt(runs)
        print(f"| {name} | {1e3 * std:.2f} | {np.mean(found):.2f} | {error:.2f} |", flush=True)


if __name__ == "__main__":
    main()
