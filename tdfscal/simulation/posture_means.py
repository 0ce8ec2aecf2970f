"""Many campaigns at once, reduced to the means of their dwells: no time series in between."""

from __future__ import annotations

from dataclasses import dataclass, fields, replace

import numpy as np

from tdfscal.records import Dwells, FloatArray, Log, Rig, Series
from tdfscal.simulation import faults
from tdfscal.simulation.equilibrium import settle
from tdfscal.simulation.faults import Place
from tdfscal.simulation.options import Options
from tdfscal.simulation.postures import Stage, reading, set_stage, stand
from tdfscal.simulation.time_course import streams
from tdfscal.simulation.truth import Truth


@dataclass(frozen=True, slots=True)
class Batch:
    """Independent campaigns, axis B, each of K dwells.

    truth : (B,). true_force : (B, K, n, 3), N, BCS, of each NCP on the terminal. means : the dwells
    of all, a leading axis B before every other, with their exact covariances. mean_sd : (B, K, n),
    N, of a mean force, without `force_noise`, which no averaging removes.
    """

    truth: Truth
    true_force: FloatArray
    means: Dwells
    mean_sd: FloatArray

    def __len__(self) -> int:
        return len(self.true_force)

    def dwells(self, trial: int) -> Dwells:
        """One campaign as the dwell finder would hand it on."""
        own = {f.name: getattr(self.means, f.name) for f in fields(Dwells)}
        arrays = {name: v[trial] for name, v in own.items() if isinstance(v, np.ndarray)}
        return replace(self.means, **arrays)

    def log(self, trial: int) -> Log:
        """One campaign as a log of static postures, one row each."""
        mean = self.dwells(trial)
        row = np.arange(len(mean.force), dtype=np.float64)
        hall = mean.temperature
        return Log(
            supports=mean.supports,
            position=streams(row, mean.position),
            force=streams(row, mean.force),
            rows="postures",
            temperature=() if hall is None else (Series(row, np.repeat(hall[:, :1], 3, axis=1)),),
        )


def simulate_dwells(rig: Rig, options: Options, rng: np.random.Generator, trials: int) -> Batch:
    """`trials` independent campaigns, each with a rig of its own, as means of their dwells.

    The same physics as `simulate_campaign`. A mean's noise is `Recorder.mean_sd`, or follows
    from the sample noise, the rate, the correlation and the dwell less its settling. Vibration
    and settling are taken to be cut away; drifts are proportional to the posture's number.

    Raises as `simulate_campaign`.
    """
    stage_rng, record_rng = rng.spawn(2)
    return record_means(rig, options, set_stage(rig, options, stage_rng, trials), record_rng)


def record_means(rig: Rig, options: Options, stage: Stage, rng: np.random.Generator) -> Batch:
    """What `stage` looks like after averaging; see `simulate_dwells`."""
    recorder, walk_rng = options.recorder, rng.spawn(1)[0]
    trials, K, n = stage.servo.shape[:3]
    dwell = rng.uniform(*recorder.dwell, (trials, K))
    move = rng.uniform(*recorder.move, (trials, K))
    end = np.cumsum(dwell + move, axis=1) - move
    used = np.maximum(dwell - recorder.settling, 0.0)
    count = np.floor(used * recorder.force_rate) + 1.0
    phi = 0.0
    if recorder.noise_correlation > 0.0:
        phi = float(np.exp(-1.0 / (recorder.force_rate * recorder.noise_correlation)))
    # Variance of the mean of an AR(1) process, exact for every length.
    inflation = (1.0 + phi) / (1.0 - phi) - 2.0 * phi * (1.0 - phi**count) / (
        count * (1.0 - phi) ** 2
    )
    effective = count / inflation
    sample_sd = rng.uniform(*recorder.force_sd, (trials, n))
    mean_sd = sample_sd[:, None, :] / np.sqrt(effective)[..., None]
    if recorder.mean_sd is not None:
        mean_sd = np.full((trials, K, n), recorder.mean_sd)
    position_sd = recorder.encoder_sd / np.sqrt(np.floor(used * recorder.position_rate) + 1.0)

    force = _mean_forces(rig, options, stage, dwell)
    place = Place(np.arange(K, dtype=np.float64), np.arange(K) / max(K - 1, 1))
    signal = (
        reading(stage.truth, faults.turned_away(options.faults, force, place))
        + stage.force_offset
        + faults.zero_offset(options.faults, n, place)
        + faults.zero_walk(options.faults, n, _share(end), walk_rng)
        + mean_sd[..., None] * rng.standard_normal((trials, K, n, 3))
    )
    noise = position_sd[..., None, None] * rng.standard_normal((trials, K, n, 3))
    recorded = faults.recorded(options.faults, signal, place, rig)
    extreme = (sample_sd[:, None] * np.sqrt(2.0 * np.log(count))[..., None])[..., None]
    each, eye = np.ones((trials, K, n)), np.eye(3)
    warm = options.faults.warming is not None
    means = Dwells(
        supports=rig.supports,
        start=end - dwell,
        end=end,
        position=stage.servo + noise,
        position_cov=((position_sd**2)[..., None] * each)[..., None, None] * eye,
        force=recorded,
        force_cov=mean_sd[..., None, None] ** 2 * eye,
        force_min=recorded - extreme,
        force_max=recorded + extreme,
        count=(count[..., None] * each).astype(np.int64),
        effective=effective[..., None] * each,
        temperature=faults.temperature(options.faults, place)[:, None] * each if warm else None,
    )
    return Batch(stage.truth, stage.rest.force, means, mean_sd)


def _mean_forces(rig: Rig, options: Options, stage: Stage, dwell: FloatArray) -> FloatArray:
    """True forces, with what blows within a dwell add to its mean."""
    if not options.faults.jolts:
        return stage.rest.force
    contact = stage.load.contact.copy()
    for jolt in options.faults.jolts:
        # A half sine's mean is 2/π of its peak.
        share = (2.0 / np.pi) * jolt.duration / dwell[:, jolt.posture, None]
        contact[:, jolt.posture, 0] += share * np.asarray(jolt.force)
    _, where = stand(stage.truth, options, stage.postures.target(rig.hinge), stage.repeat)
    load = replace(stage.load, contact=contact)
    return settle(stage.truth, where, load, stage.rest.pose).force


def _share(time: FloatArray) -> FloatArray:
    """Share (B, K) of the campaign that has passed at times (B, K), s; 0 for a single one."""
    whole = np.ptp(time, axis=1, keepdims=True)
    return np.asarray((time - time[:, :1]) / np.where(whole > 0, whole, 1.0))
