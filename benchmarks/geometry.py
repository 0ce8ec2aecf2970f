"""Hinges and positioners' offsets that the rig file does not know of, at rest and in motion.

Rigs of 3 to 6 supports with hinges spread by a tenth of the radius about a regular polygon. The
log shows the true distances between hinges: the rig file's hinges, the datums and the positions
scatter about the truth by what is declared (20 µm, 0, 10 µm per coordinate where nothing else is
said), in motion with positioners' errors that change over 20 mm. One hinge of the rig file, or one
positioner's coordinates, is off by the size of the row in a direction drawn evenly from all.

Right: the true cause is among those named. Visible: how many a test by χ² sees in the mean
(noncentral χ², with the stated uncertainties, and 0.5 µm/N that any support may give) when it knows
which support to ask, and when it searches all 2n + 2 causes at the same rate of false alarms. Of
campaigns that are not rejected, and of those in which nothing is said: how many have d² of all
angles beyond 99 % of χ², and the largest error of an angle over its standard uncertainty.

    python -m benchmarks.geometry [RUNS [SOUND RIGS AT REST [SOUND RIGS IN MOTION]]]
"""

from __future__ import annotations

import time
from collections import Counter
from collections.abc import Iterator
from dataclasses import dataclass, replace

import numpy as np
from scipy.stats import chi2, ncx2

from benchmarks.frame import errors, heads, numbers, show, tally
from tdfscal import simulation
from tdfscal.catalogue import sentence
from tdfscal.checks.geometry import CODES, equations, stated_errors
from tdfscal.errors import DataError, TdfscalError
from tdfscal.motioncal.pipeline import MotionCalibration, calibrate_moving
from tdfscal.motioncal.streams import slow_streams
from tdfscal.numerics.distributions import chi2_quantile
from tdfscal.records import DeclaredUncertainty, FloatArray, Rig, UncertainValue
from tdfscal.selfcal.pipeline import SelfCalibration, self_calibrate
from tdfscal.significance import GEOMETRY_MISFIT
from tdfscal.simulation import Options, Recorder
from tdfscal.simulation.moving_campaign import draw_field, simulate_moving
from tdfscal.simulation.options import MovingOptions

_DELAY = UncertainValue(np.array(0.0), np.array(0.02))
_SUPPORTS = DeclaredUncertainty(positioner=1e-5, hinge=2e-5, force_noise=0.1)
_NAMES = {"hinge": "the hinge of {} is not", "datum": "the servo coordinates of {} are offset"}


@dataclass(frozen=True, slots=True)
class Case:
    """What is off, by how much (m), on which rig; way : direction, none: drawn."""

    kind: str = ""
    size: float = 0.0
    radius: float = 0.6
    n: int = 3
    declared: DeclaredUncertainty = _SUPPORTS
    way: tuple[float, float, float] | None = None
    moving: bool = False


@dataclass(frozen=True, slots=True)
class Outcome:
    """verdict; what is said of the geometry; largest error over its std and whether d² is beyond
    99 % of χ², where there are angles.
    """

    verdict: str
    said: tuple[str, ...]
    right: bool
    error: float = 0.0
    beyond: bool = False
    visible: tuple[float, float] = (0.0, 0.0)


def run(case: Case, rng: np.random.Generator) -> Outcome:
    """One campaign."""
    declared, n = case.declared, case.n
    spread = 0.1 * case.radius * rng.standard_normal((n, 3))
    rig = simulation.make_rig(n, radius=case.radius, declared=declared)
    rig = replace(rig, hinge=rig.hinge + spread)
    exact = replace(declared, positioner=0.0, hinge=0.0, datum=0.0)
    which, off = int(rng.integers(n)), np.zeros((n, 3))
    way = rng.standard_normal(3) if case.way is None else np.array(case.way)
    off[which] = case.size * way / np.linalg.norm(way)
    hinge = rig.hinge + declared.hinge * rng.standard_normal((n, 3))
    stated = replace(rig, hinge=hinge + off if case.kind == "hinge" else hinge)
    datum = declared.datum * rng.standard_normal((n, 3)) + (off if case.kind == "datum" else 0.0)
    visible = _visible(case, stated, which, off) if case.kind else (0.0, 0.0)
    played = _in_motion if case.moving else _at_rest
    try:
        result, truth = played(replace(rig, declared=exact), stated, datum, rng)
    except DataError as error:
        right = _named(case, stated.supports[which], error.what)
        return Outcome("refused", (error.what,), right, visible=visible)
    except TdfscalError as error:
        return Outcome(f"no angles ({type(error).__name__})", (), False, visible=visible)
    found = [f for doubt in result.suspicions for f in doubt.findings(rejects=False)]
    placed = {code for code, _ in CODES.values()}
    text = "; ".join(map(sentence, found))
    verdict = "rejected" if result.reasons else "warned" if result.suspicions else "silent"
    largest, beyond = _errors(result, truth)
    said = tuple(sentence(f) for f in found if f.code in placed)
    right = _named(case, stated.supports[which], text)
    return Outcome(verdict, said, right, largest, beyond, visible)


def _visible(case: Case, stated: Rig, which: int, off: FloatArray) -> tuple[float, float]:
    """Probability that what is off, (n, 3), m, is seen by a test that knows where, and one not."""
    seed = np.random.default_rng(30)
    options = Options(squeeze=200.0, recorder=Recorder(mean_sd=0.1))
    seen = simulation.simulate_dwells(stated, options, seed, 1).dwells(0)
    variance = np.full(len(seen), case.declared.positioner**2)
    sums = equations(stated.hinge, seen.position, seen.force, variance)
    common = case.declared.positioner if case.moving else 0.0
    pattern = sums.given(stated_errors(stated, common))
    first = 3 * (which + (0 if case.kind == "hinge" else case.n))
    block = pattern.seen.matrix[first : first + 3, first : first + 3]
    values = np.linalg.eigvalsh(block)
    unknowns = int(np.sum(values > 1e-6 * values[-1]))
    away = max(float(off[which] @ block @ off[which]), 1e-12)
    limits = [chi2.isf(GEOMETRY_MISFIT / tests, unknowns) for tests in (1, 4 * case.n + 4)]
    return float(ncx2.sf(limits[0], unknowns, away)), float(ncx2.sf(limits[1], unknowns, away))


def _named(case: Case, support: str, text: str) -> bool:
    return bool(case.kind) and _NAMES[case.kind].format(support) in text


def _at_rest(
    true: Rig, stated: Rig, datum: FloatArray, rng: np.random.Generator
) -> tuple[SelfCalibration, FloatArray]:
    """24 postures squeezed by 200 N, 0.1 N of noise; and the true rotations."""
    options = Options(
        squeeze=200.0, stiffness=_stiffness(stated, rng), recorder=Recorder(mean_sd=0.1)
    )
    batch = simulation.simulate_dwells(true, options, rng, 1)
    dwells = batch.dwells(0)
    noise = stated.declared.positioner * rng.standard_normal(dwells.position.shape)
    dwells = replace(dwells, position=dwells.position + datum + noise)
    return self_calibrate(stated, dwells, rng=rng, max_trials=0), batch.truth.rotation[0]


def _in_motion(
    true: Rig, stated: Rig, datum: FloatArray, rng: np.random.Generator
) -> tuple[MotionCalibration, FloatArray]:
    """A minute of the simulator's multisine; and the true rotations."""
    stiffness = np.diagonal(_stiffness(stated, rng))
    options = MovingOptions(stiffness=(stiffness[0], stiffness[1], stiffness[2]))
    campaign = simulate_moving(true, options, rng)
    slow = slow_streams([campaign.log], true.capacity)
    field = draw_field(true.n, stated.declared.positioner, options.field_correlation, rng)
    slow = replace(slow, position=slow.position + datum + field(slow.position))
    return calibrate_moving(stated, slow, _DELAY), campaign.truth.rotation


def _stiffness(stated: Rig, rng: np.random.Generator) -> FloatArray:
    """Stiff supports, softer by what is declared; (3, 3), N/m."""
    give = stated.declared.compliance_lateral, stated.declared.compliance_vertical
    lateral, vertical = np.abs(np.array(give) * rng.standard_normal(2)) + np.array([5e-8, 7e-9])
    return np.diag([1 / lateral, 1 / lateral, 1 / vertical])


def _errors(result: SelfCalibration | MotionCalibration, truth: FloatArray) -> tuple[float, bool]:
    if isinstance(result, SelfCalibration):
        rotation, covariance = result.fit.state.rotation, result.uncertainty.covariance
    else:
        rotation = result.fit.state.still.rotation
        covariance = result.uncertainty.covariance
    d, std, distance = errors(truth, rotation, covariance)
    return float(np.max(np.abs(d) / std)), bool(len(d) * distance > chi2_quantile(0.99, len(d)))


def rows() -> Iterator[Case]:
    """What is off."""
    for moving in (False, True):
        for size, radius in ((1e-3, 2.0), (3e-3, 2.0), (15e-3, 10.0)):
            yield Case("hinge", size, radius, moving=moving)
        for size, radius in ((2e-4, 0.6), (1e-3, 0.6), (2e-4, 2.0), (1e-3, 2.0)):
            yield Case("datum", size, radius, moving=moving)
        yield Case("hinge", 1e-3, 2.0, n=4, moving=moving)
        yield Case("datum", 2e-4, 2.0, n=6, moving=moving)
        yield Case("hinge", 3e-3, 2.0, way=(0.0, 0.0, 1.0), moving=moving)
        yield Case("datum", 2e-4, 0.6, way=(0.0, 0.0, 1.0), moving=moving)


def sound(rng: np.random.Generator, *, moving: bool) -> Case:
    """A rig of which all is declared; no support is softer than 1 N/µm or so."""
    soft = float(rng.choice([0.0, 0.0, 2e-7, 1e-6]))
    declared = DeclaredUncertainty(
        positioner=float(rng.choice([5e-6, 1e-5, 3e-5])),
        hinge=float(rng.choice([1e-5, 2e-5, 1e-4, 1e-3])),
        datum=float(rng.choice([0.0, 0.0, 5e-5, 3e-4])),
        force_noise=0.1,
        compliance_lateral=soft,
        compliance_vertical=soft,
    )
    radius, n = float(rng.choice([0.6, 2.0, 10.0])), int(rng.integers(3, 7))
    return Case("", 0.0, radius, n, declared, moving=moving)


def line(case: Case, runs: int) -> None:
    """Print one row of the table of faults."""
    rng = np.random.default_rng([28, int(1e6 * case.size), int(10 * case.radius), case.n])
    started = time.process_time()
    found = [run(case, rng) for _ in range(runs)]
    verdicts = Counter(each.verdict for each in found)
    count = np.mean([len(each.said) for each in found if each.right] or [0])
    where = "along z" if case.way else "any way"
    size = f"{1e3 * case.size:g} mm at {case.radius:g} m, {case.n} supports, {where}"
    right, seconds = sum(each.right for each in found), (time.process_time() - started) / runs
    visible = " / ".join(f"{p:.1f}" for p in np.sum([o.visible for o in found], axis=0))
    harmed = _harmed(found, "warned", "silent"), _harmed(found, "silent")
    show("in motion" if case.moving else "at rest", f"{case.kind} {size}", tally(verdicts),
         f"{right} of {runs}", visible, f"{count:.1f}", *harmed, f"{seconds:.1f}")  # fmt: skip


def _harmed(found: list[Outcome], *verdicts: str) -> str:
    """How many of these verdicts have errors beyond χ², and the largest error over its std."""
    these = [each for each in found if each.verdict in verdicts]
    worst = max((each.error for each in these), default=0.0)
    return f"{sum(each.beyond for each in these)} of {len(these)}, {worst:.1f}" if these else "–"


def alarms(runs: int, *, moving: bool) -> None:
    """Print one row of the table of sound rigs."""
    rng = np.random.default_rng([29, int(moving)])
    found = [run(sound(rng, moving=moving), rng) for _ in range(runs)]
    verdicts = Counter(each.verdict for each in found)
    questioned = sum(bool(each.said) for each in found)
    show("in motion" if moving else "at rest", runs, questioned, tally(verdicts))


def main() -> None:
    """Print the tables."""
    runs, still, moving = numbers(20, 500, 100)
    last = "d² beyond 99 % where not rejected, worst error / σ"
    names = ("how", "off", "verdict", "right", "visible", "causes named", last, "where silent", "s")
    print(heads(*names))
    for case in rows():
        line(case, runs)
    print("\n" + heads("sound rigs", "campaigns", "geometry questioned", "verdicts"))
    alarms(still, moving=False)
    alarms(moving, moving=True)


if __name__ == "__main__":
    main()
