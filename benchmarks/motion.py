"""Calibration in motion against the truth: error, honesty, stops, contacts, alarms, validation.

    python -m benchmarks.motion WHAT CASE [--lacking AXES] [--runs 100] [--first 1000]

Each run draws a rig, a motion, error fields and noise of its own; the estimator knows what a rig
file states. WHAT and its CASEs:

- errors: white, slow, approach (clean logs), contact, approach-contact. RMSE over all angles of all
  runs; d²/3n with the full stated covariance; share of errors within ±1.96 stated standard
  uncertainties, and of roll, pitch, yaw within the trials' 95 % intervals; the bound is the
  Cramér–Rao bound of the linearised model with the true spectrum of the force noise, positions
  without error and all nuisances free. With axes lacking, all of it is over the sensors whose
  angles are determined.
- stops: white, slow (0.3 N of noise slow as 2 s besides), stiff (carriages of 200 N/µm, white
  noise, where the positioners' errors weigh most). 15 postures in --seconds, rests of 6 s and moves
  of 4 s. Wider: runs in which an angle's uncertainty is above that of the rests alone.
- alarms: slow, white, approach, rests (ten rests and moves). Suspected: any suspicion; harmful: one
  that the gate rejects for. The level is `significance.UNDECLARED_ERROR` per log.
- validation: clean, turn (one sensor by 2 mrad in a random direction), zero (one sensor's zero by
  1 N), zero3 (by 3 N), load (2 kg and 2 mm), contact (15 N for 3 s; must hold). A minute of motion
  calibrates, and validates another motion of the same machine, with --drive approach an approach.
- speed: a rate in Hz. Parquet of 300 and of 1200 s: processor seconds of reading alone and of the
  whole calibration, medians of --runs, and the ratio of their slopes between the two lengths,
  which leaves out what stands in every calibration.
"""

from __future__ import annotations

import argparse
import time
from dataclasses import replace
from functools import partial

import numpy as np

import tdfscal
from benchmarks.frame import errors, inside, lacking, mean, over, rms, row, scratch
from tdfscal.dwells import find_dwells
from tdfscal.errors import TdfscalError
from tdfscal.files.rig.reading import load_rig
from tdfscal.files.writers.campaign import write_run
from tdfscal.logs import iter_log
from tdfscal.model.dynamics import Moving, voigt
from tdfscal.model.parameters import nominal
from tdfscal.motioncal.blocks import blocks
from tdfscal.motioncal.estimator import at_state
from tdfscal.motioncal.fit import MovingPriors, MovingState
from tdfscal.motioncal.pipeline import MotionCalibration, calibrate_moving
from tdfscal.motioncal.streams import Slow, slow_streams
from tdfscal.numerics import so3
from tdfscal.numerics.least_squares import spectrum
from tdfscal.records import FloatArray, Rig, UncertainValue
from tdfscal.selfcal.pipeline import self_calibrate
from tdfscal.simulation import reference_rig, run
from tdfscal.simulation.moving_campaign import MovingCampaign, simulate_moving
from tdfscal.simulation.options import MovingOptions, Touch
from tdfscal.simulation.truth import Truth
from tdfscal.validation.in_motion import validate_moving

DELAY = UncertainValue(np.array(0.0), np.array(0.02))
TOUCH = (9.0, -6.0, 10.39)  # 15 N
CASES = {
    "white": MovingOptions(),
    "slow": MovingOptions(slow_noise=0.3),
    "approach": MovingOptions.approach(),
    "contact": MovingOptions(slow_noise=0.3, touches=(Touch(28.5, 31.5, TOUCH),)),
    "approach-contact": replace(MovingOptions.approach(), touches=(Touch(15.0, 18.0, TOUCH),)),
}
STOPS = {
    "white": MovingOptions.stops(),
    "slow": replace(MovingOptions.stops(), slow_noise=0.3),
    "stiff": replace(MovingOptions.stops(), stiffness=(200e6, 200e6, 200e6)),
}
SOUND = {name: CASES[name] for name in ("slow", "white", "approach")} | {"rests": STOPS["slow"]}
#: Lengths of the logs that are timed, s.
LENGTHS = (300.0, 1200.0)
#: What `validate` should name first.
NAMED = {"turn": "sensor turned", "zero": "zero drifted", "zero3": "zero drifted"}
NAMED |= {"load": "load changed"}
#: Supports, and the axes (support, axis) that are not measured.
LACKING: dict[str, tuple[int, tuple[tuple[int, int], ...]]] = {
    "lateral": (3, ((2, 1),)),
    "vertical": (3, ((2, 2),)),
    "both laterals": (3, ((2, 0), (2, 1))),
    "sensor of four": (4, ((3, 0), (3, 1), (3, 2))),
    "two load cells of four": (4, ((2, 0), (2, 1), (3, 0), (3, 1))),
}


def bound(rig: Rig, campaign: MovingCampaign, slow: Slow) -> FloatArray:
    """Cramér–Rao covariance (3n, 3n), rad², at the truth; rig : as stated."""
    truth, options = campaign.truth, campaign.options
    still = replace(
        nominal(rig), rotation=truth.rotation, zero=truth.zero, mass=truth.mass,
        barycentre=truth.barycentre, hinge=truth.hinge, datum=-truth.datum,
    )  # fmt: skip
    state = MovingState(still, Moving(voigt(campaign.inertia), options.friction, options.delay))
    cut = blocks(slow, np.ones(len(slow.time), dtype=np.bool_))
    fit = at_state(MovingPriors(rig, slow, DELAY), cut, state, None)
    f = fit.data.bins.frequency
    density = options.noise**2 / options.rate + options.slow_noise**2 * 2 * options.slow_time / (
        1 + (2 * np.pi * f * options.slow_time) ** 2
    )
    # All of the log counts, also what lies under the taper's ramps.
    J = fit.data.weighted(fit.jacobian, cut[0].share * density)
    root = spectrum(np.concatenate([J, fit.prior_jacobian])).root
    return (root @ root.T)[: 3 * rig.n, : 3 * rig.n]


def played(
    case: str, without: str, seed: int
) -> tuple[Rig, MovingCampaign, Slow, MotionCalibration, float]:
    """One run: rig as stated, campaign, streams, result and the seconds that the result took."""
    n, dead = LACKING.get(without, (3, ()))
    rig = lacking(n, *dead) if dead else reference_rig()
    real = replace(rig, axes=np.ones_like(rig.axes))
    campaign = simulate_moving(real, CASES[case], np.random.default_rng(seed))
    slow = slow_streams([campaign.log], rig.capacity)
    slow = replace(slow, force=np.where(rig.axes, slow.force, 0.0))
    began = time.perf_counter()
    result = calibrate_moving(rig, slow, DELAY, rng=np.random.default_rng(seed))
    return rig, campaign, slow, result, time.perf_counter() - began


def one_error(case: str, without: str, seed: int) -> tuple[FloatArray, ...]:
    """Errors, stated std and the bound's (k,) of the angles that are determined; then d²/k, the
    share within the trials' intervals, whether these are refuted, whether a contact is named, s.
    """
    rig, campaign, slow, result, took = played(case, without, seed)
    known = np.repeat(result.observability.determined, 3)
    found, C = result.fit.state.still.rotation, result.uncertainty.covariance
    e, std, distance = errors(campaign.truth.rotation, found, C, known)
    trials = result.monte_carlo
    assert trials is not None
    rpy = so3.to_rpy(campaign.truth.rotation)
    share = np.mean(((trials.low < rpy) & (rpy < trials.high)).ravel()[known])
    flags = [distance, share, not trials.validated, bool(result.rejected), took]
    least = np.sqrt(np.diagonal(bound(rig, campaign, slow))[known])
    return e, std, least, np.array(flags, dtype=np.float64)


def error_row(case: str, without: str, seeds: range) -> str:
    """RMSE, stated, bound, their ratio, d²/k, shares inside, refuted, named, seconds."""
    found = zip(*over(partial(one_error, case, without), seeds), strict=True)
    e, std, least, flags = (np.array(part) for part in found)
    name = f"{case}, without {without}" if without else case
    return row(
        name, len(seeds), *(f"{1e3 * rms(x):.3f}" for x in (e, std, least)),
        f"{rms(e) / rms(least):.2f}", mean(flags[:, 0]), f"{inside(e, std):.1%}",
        mean(flags[:, 1], ".1%"), *flags[:, 2:4].sum(axis=0).astype(int),
        f"{np.median(flags[:, 4]):.1f}",
    )  # fmt: skip


def one_stop(case: str, seconds: float, seed: int) -> tuple[FloatArray, FloatArray, bool] | None:
    """Of the rests and of all samples: errors, stated std (9,) each and d²/9; whether wider."""
    rig, rng = reference_rig(), np.random.default_rng(seed)
    campaign = simulate_moving(rig, replace(STOPS[case], duration=seconds), rng)
    dwells = find_dwells([campaign.log])
    try:
        alone = self_calibrate(rig, dwells, rng=np.random.default_rng(seed), max_trials=0)
        slow = slow_streams([campaign.log], rig.capacity)
        both = calibrate_moving(rig, slow, DELAY, dwells=len(dwells))
    except TdfscalError:
        return None
    turns = both.uncertainty
    scores = []
    for rotation, C in (
        (alone.fit.state.rotation, alone.uncertainty.covariance),
        (both.fit.state.still.rotation, turns.covariance),
    ):
        e, std, distance = errors(campaign.truth.rotation, rotation, C)
        scores.append(np.array([*e, *std, distance]))
    return scores[0], scores[1], bool(np.any(turns.rpy_std > alone.uncertainty.rpy_std))


def stop_rows(case: str, seconds: float, seeds: range) -> str:
    """RMSE, stated, d²/9 and share inside, of the rests and of all samples."""
    found = over(partial(one_stop, case, seconds), seeds)
    good = [each for each in found if each is not None]
    rows = []
    for k, name in enumerate(("rests", "all")):
        part = np.array([each[k] for each in good])
        e, s, d = part[:, :9], part[:, 9:18], part[:, 18]
        sizes = (f"{1e3 * rms(x):.3f}" for x in (e, s))
        rows.append(row(f"{case}, {name}", len(part), *sizes, mean(d), f"{inside(e, s):.1%}"))
    wider = sum(each[2] for each in good)
    return "\n".join(rows) + f"\n\nwider {wider}, refused {len(found) - len(good)}"


def one_alarm(case: str, seed: int) -> tuple[str, bool]:
    """What is suspected of a sound log, and whether it would reject."""
    rig = reference_rig()
    campaign = simulate_moving(rig, SOUND[case], np.random.default_rng(seed))
    found = calibrate_moving(rig, slow_streams([campaign.log], rig.capacity), DELAY).suspicions
    said = f"{seed}: {found[0].kind}, p = {found[0].p_value:.2g}" if found else ""
    return said, any(doubt.harmful for doubt in found)


def alarm_row(case: str, seeds: range) -> str:
    """How many logs are suspected, how many harmfully, and of what."""
    found = over(partial(one_alarm, case), seeds)
    said = [text for text, _ in found if text]
    return row(case, len(seeds), len(said), sum(harmful for _, harmful in found), "; ".join(said))


def changed(case: str, truth: Truth, sensor: int, rng: np.random.Generator) -> Truth:
    """The machine after what the case does to it."""
    way = rng.standard_normal(3)
    way /= np.linalg.norm(way)
    if case == "turn":
        rotation = truth.rotation.copy()
        rotation[sensor] = so3.exp(2e-3 * way) @ rotation[sensor]
        return replace(truth, rotation=rotation)
    if case in ("zero", "zero3"):
        zero = truth.zero.copy()
        zero[sensor] += way * (3.0 if case == "zero3" else 1.0)
        return replace(truth, zero=zero)
    if case == "load":
        shift = np.array([2e-3, 0.0, 0.0])
        return replace(truth, mass=truth.mass + 2.0, barycentre=truth.barycentre + shift)
    return truth


def one_validation(case: str, drive: str, seed: int) -> tuple[list[bool], FloatArray]:
    """Held, p < 5 %, cause among the named, first, alone, contact left out; detectable turns."""
    rig, rng = reference_rig(), np.random.default_rng(seed)
    first, second = rng.spawn(2)
    base = MovingOptions(rate=100.0, noise=1.1, slow_noise=0.3)
    before = simulate_moving(rig, base, first)
    known = calibrate_moving(rig, slow_streams([before.log], rig.capacity), DELAY)
    sensor = int(rng.integers(rig.n))
    options = replace(
        MovingOptions.approach() if drive == "approach" else base, rate=100.0, noise=1.1,
        slow_noise=0.3, inertia=before.inertia,
        touches=(Touch(15.0, 18.0, TOUCH),) if case == "contact" else (),
    )  # fmt: skip
    after = simulate_moving(rig, options, second, changed(case, before.truth, sensor, rng))
    v = validate_moving(known.calibrated, slow_streams([after.log], rig.capacity), DELAY)
    wanted = (NAMED.get(case), None if case == "load" else sensor)
    named = [(cause.kind, cause.support) for cause in v.suspected]
    flags = [
        v.holds,
        v.judged.p_value < 0.05,
        wanted in named,
        named[:1] == [wanted],
        named == [wanted],
    ]
    return [*flags, bool(v.rejected)], v.detectable


def validation_row(case: str, drive: str, seeds: range) -> str:
    """The counts, and the turns that are detectable about a horizontal axis / the vertical."""
    flags, turns = zip(*over(partial(one_validation, case, drive), seeds), strict=True)
    size = 1e3 * np.median(turns, axis=0)
    sizes = f"{size[:, :2].mean():.2f} / {size[:, 2].mean():.2f}"
    return row(f"{drive}, {case}", len(seeds), *np.sum(flags, axis=0), sizes)


def speed_row(rate: float, runs: int) -> str:
    """Seconds at both lengths, read and calibrated, and the ratio of slopes."""
    used: dict[tuple[str, float], list[float]] = {}
    options = replace(CASES["white"], rate=rate, noise=1.75 * float(np.sqrt(rate / 250)))
    with scratch() as place:
        folders = {length: place / f"{length:.0f}" for length in LENGTHS}
        for length, folder in folders.items():
            rng = np.random.default_rng(0)
            played = run(reference_rig(), "motion", replace(options, duration=length), rng)
            write_run(played, folder, format="parquet")
        for _ in range(1 + runs):  # the first imports
            for length, folder in folders.items():
                began = time.process_time()
                loaded = load_rig(folder / "rig.yaml")
                for _ in iter_log((folder / "log.parquet",), loaded.log, loaded.rig.supports):
                    pass
                read = time.process_time()
                tdfscal.calibrate(folder, samples="moving")
                used.setdefault(("read", length), []).append(read - began)
                used.setdefault(("all", length), []).append(time.process_time() - read)
    at = {key: float(np.median(each[1:])) for key, each in used.items()}
    first, last = LENGTHS
    slope = {step: at[step, last] - at[step, first] for step in ("read", "all")}
    each = [f"{at[step, length]:.2f}" for step in slope for length in LENGTHS]
    return row(f"{rate:.0f}", runs, *each, f"{slope['all'] / slope['read']:.1f}")


def main() -> None:
    """Run one case and print its rows."""
    parser = argparse.ArgumentParser()
    parser.add_argument("what", choices=("errors", "stops", "alarms", "validation", "speed"))
    parser.add_argument("case")
    parser.add_argument("--lacking", choices=sorted(LACKING), default="")
    parser.add_argument("--runs", type=int, default=100)
    parser.add_argument("--first", type=int, default=1000)
    parser.add_argument("--seconds", type=float, default=144.0)
    parser.add_argument("--drive", choices=("minute", "approach"), default="minute")
    chosen = parser.parse_args()
    seeds = range(chosen.first, chosen.first + chosen.runs)
    rows = {
        "errors": lambda: error_row(chosen.case, chosen.lacking, seeds),
        "stops": lambda: stop_rows(chosen.case, chosen.seconds, seeds),
        "alarms": lambda: alarm_row(chosen.case, seeds),
        "validation": lambda: validation_row(chosen.case, chosen.drive, seeds),
        "speed": lambda: speed_row(float(chosen.case), chosen.runs),
    }
    print(rows[chosen.what]())


if __name__ == "__main__":
    main()
