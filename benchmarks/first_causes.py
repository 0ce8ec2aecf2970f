"""Which cause of a gross misfit is named first, on rigs of three to six supports.

Every campaign draws its own rig (supports, radius, mass, height, squeeze, noise) and 12 to 30
postures. First: what stands first among the reasons, or the warnings where it is accepted. Biased:
accepted although d² of the angles is beyond 99.9 % of χ².

    python -m benchmarks.first_causes [RUNS [SEED [WORDS OF A ROW]]]
"""

from __future__ import annotations

import sys
from collections import Counter
from collections.abc import Callable, Iterator
from dataclasses import dataclass, replace

import numpy as np

from tdfscal import simulation
from tdfscal.catalogue.campaign import SUSPECTS
from tdfscal.errors import TdfscalError
from tdfscal.findings import Finding
from tdfscal.numerics import so3
from tdfscal.numerics.distributions import chi2_quantile
from tdfscal.records import Dwells, FloatArray, Rig, UncertainValue
from tdfscal.selfcal.pipeline import self_calibrate
from tdfscal.selfcal.result import SelfCalibration
from tdfscal.simulation import Faults, Gain, Options, Recorder, Slip

from .frame import heads, row

#: The rig as it really is, what happens, and what is done to the readings.
Injected = tuple[Rig, Faults, Callable[[Dwells], Dwells]]


@dataclass(frozen=True)
class Case:
    """name; codes that are right; whether of one sensor; what is put in: rig, sensor, rng, K."""

    name: str
    codes: tuple[str, ...]
    of_one: bool
    inject: Callable[[Rig, int, np.random.Generator, int], Injected]


def as_it_is(dwells: Dwells) -> Dwells:
    return dwells


def gain(size: float) -> Callable[[Rig, int, np.random.Generator, int], Injected]:
    def inject(rig: Rig, i: int, rng: np.random.Generator, K: int) -> Injected:
        sign = float(rng.choice([-1.0, 1.0]))
        return rig, Faults(gains=(Gain(i, (sign * size,) * 3),)), as_it_is

    return inject


def slip(rig: Rig, i: int, rng: np.random.Generator, K: int) -> Injected:
    way = rng.standard_normal(3)
    turn = 5e-3 * way / np.linalg.norm(way)
    step = Slip(i, int(rng.integers(K // 4, K - K // 4)), (turn[0], turn[1], turn[2]))
    return rig, Faults(slips=(step,)), as_it_is


def turned(rig: Rig, i: int, rng: np.random.Generator, K: int) -> Injected:
    rpy = rig.nominal_rpy.copy()
    rpy[i] = 30e-3 * rng.choice([-1.0, 1.0], 3)
    return replace(rig, nominal_rpy=rpy), Faults(), as_it_is


def load(rig: Rig, i: int, rng: np.random.Generator, K: int) -> Injected:
    mass = rig.mass.value * (1 + 0.01 * rng.choice([-1.0, 1.0]))
    return replace(rig, mass=UncertainValue(mass, rig.mass.std)), Faults(), as_it_is


def barycentre(rig: Rig, i: int, rng: np.random.Generator, K: int) -> Injected:
    off = rig.barycentre.value + 1e-2 * rng.choice([-1.0, 1.0], 3)
    return replace(rig, barycentre=UncertainValue(off, rig.barycentre.std)), Faults(), as_it_is


def at_a_channel(
    share: float, size: float
) -> Callable[[Rig, int, np.random.Generator, int], Injected]:
    """Forces of a size (N) at one channel of a sensor in a share of the postures."""

    def inject(rig: Rig, i: int, rng: np.random.Generator, K: int) -> Injected:
        some = rng.permutation(K)[: round(share * K)]
        added, axis = np.zeros((K, rig.n, 3)), int(rng.integers(3))
        if share < 1:
            added[some, i, axis] = (
                size * rng.choice([-1, 1], len(some)) * rng.uniform(0.8, 1.2, len(some))
            )
        else:
            added[some, i, axis] = size * rng.standard_normal(len(some))
        return rig, Faults(), lambda dwells: replace(dwells, force=dwells.force + added)

    return inject


def touched(rig: Rig, i: int, rng: np.random.Generator, K: int) -> Injected:
    """A body that bears on the sensor at 6 of 16 postures by 60 N, another way each time."""
    some, added = rng.permutation(K)[: round(6 * K / 16)], np.zeros((K, rig.n, 3))
    way = rng.standard_normal((len(some), 3))
    added[some, i] = 60.0 * way / np.linalg.norm(way, axis=1, keepdims=True)
    return rig, Faults(), lambda dwells: replace(dwells, force=dwells.force + added)


def sound(rig: Rig, i: int, rng: np.random.Generator, K: int) -> Injected:
    return rig, Faults(), as_it_is


NOISE = ("channel-broken", "channels-noisy", "sensor-noise-suspected")
GAIN = ("gain-suspected", "sensitivity-suspected")
CASES = (
    Case("gain 0.5 % off", GAIN, True, gain(0.005)),
    Case("gain 1 % off", GAIN, True, gain(0.01)),
    Case("gain 2 % off", GAIN, True, gain(0.02)),
    Case("gain 5 % off", GAIN, True, gain(0.05)),
    Case("sensor turned by 30 mrad, 2 mrad stated", ("mounting-suspected",), True, turned),
    Case("sensor slips by 5 mrad", ("sensor-slipped",), True, slip),
    Case("mass 1 % off", ("mass-suspected",), False, load),
    Case("barycentre 17 mm off", ("barycentre-suspected",), False, barycentre),
    Case("channel touched at 6 of 16, 60 N", NOISE, True, at_a_channel(0.375, 60.0)),
    Case("sensor touched at 6 of 16, 60 N any way", NOISE, True, touched),
    Case("channel of 5 N noise", NOISE, True, at_a_channel(1.0, 5.0)),
    Case("channel of 30 N noise", NOISE, True, at_a_channel(1.0, 30.0)),
    Case("sound", (), False, sound),
)


def campaign(case: Case, rng: np.random.Generator) -> tuple[Rig, int, Dwells, FloatArray]:
    """A rig as stated, the sensor that is wrong, dwells, and true rotations (n, 3, 3)."""
    n = int(rng.integers(3, 7))
    rig = simulation.make_rig(
        n,
        mass=float(rng.choice([120.0, 500.0, 1500.0])),
        radius=float(rng.choice([0.4, 0.6, 1.5])),
        height=float(rng.uniform(0.1, 0.5)),
    )
    i, K = int(rng.integers(n)), int(rng.integers(12, 31))
    if case.inject is turned:
        rig = replace(rig, rpy_std=np.full((n, 3), 2e-3))
    real, faults, change = case.inject(rig, i, rng, K)
    options = Options(
        postures=K,
        squeeze=float(rng.choice([100.0, 200.0, 400.0])),
        recorder=Recorder(mean_sd=float(rng.choice([0.05, 0.1, 0.3]))),
        faults=faults,
    )
    batch = simulation.simulate_dwells(real, options, rng, 1)
    return rig, i, change(batch.dwells(0)), batch.truth.rotation[0]


def said(result: SelfCalibration) -> tuple[Finding, ...]:
    """Causes in the order in which they are told."""
    of_cause = [f for f in result.findings if f.code in (*SUSPECTS, *NOISE)]
    return tuple(sorted(of_cause, key=lambda f: not f.rejects))


def line(case: Case, runs: int, seed: int) -> str:
    """One row."""
    count, others = Counter[str](), Counter[str]()
    for run in range(runs):
        rng = np.random.default_rng([seed, run])
        rig, i, dwells, truth = campaign(case, rng)
        own = {(code, (rig.supports[i],) if case.of_one else ()) for code in case.codes}
        try:
            result = self_calibrate(rig, dwells, rng=rng, max_trials=0)
        except TdfscalError as error:
            count["refused"] += 1
            others[f"refused: {error.what[:40]}"] += 1
            continue
        names = [(f.code, f.subject) for f in said(result)]
        count["first"] += bool(names) and names[0] in own
        count["named"] += any(name in own for name in names)
        if names and names[0] not in own:
            others[names[0][0]] += 1
        elif not names:
            others[", ".join(f.code for f in result.reasons) or "nothing"] += 1
        d = so3.log(truth @ np.swapaxes(result.fit.state.rotation, 1, 2)).ravel()
        distance = d @ np.linalg.solve(result.uncertainty.covariance, d)
        count["accepted"] += not result.reasons
        count["biased"] += int(not result.reasons and distance > chi2_quantile(0.999, d.size))
    wrong = ", ".join(f"{name} {times}" for name, times in others.most_common(4))
    keys = ("first", "named", "accepted", "biased")
    return row(case.name, runs, *(count[key] for key in keys), wrong)


def cases(words: str) -> Iterator[Case]:
    return (case for case in CASES if words in case.name)


def main() -> None:
    """Print the table."""
    runs = int(sys.argv[1]) if len(sys.argv) > 1 else 20
    seed = int(sys.argv[2]) if len(sys.argv) > 2 else 1
    print(heads("fault", "runs", "first", "named", "accepted", "of these biased", "else first"))
    for case in cases(sys.argv[3] if len(sys.argv) > 3 else ""):
        print(line(case, runs, seed), flush=True)


if __name__ == "__main__":
    main()
