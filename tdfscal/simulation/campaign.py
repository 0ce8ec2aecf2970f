"""A whole campaign as its recorder writes it down."""

from __future__ import annotations

from dataclasses import fields

import numpy as np

from tdfscal.frozen import record, replace
from tdfscal.records import Dwells, FloatArray, Log, Rig, Series
from tdfscal.simulation import faults
from tdfscal.simulation.equilibrium import (
    Load,
    Postures,
    Stage,
    between,
    inertial,
    internal_part,
    reading,
    set_stage,
    settle,
    stand,
)
from tdfscal.simulation.faults import Place, streams
from tdfscal.simulation.options import Moment, Options, Recorder, Timeline, draw_timeline
from tdfscal.simulation.truth import Truth, draw_inertia


@record
class Campaign:
    """A simulated campaign: what is known of it, what is true, what was recorded.

    postures : (K,), as commanded. servo : (K, n, 3), m, BCS, as commanded.
    force : (K, n, 3), N, BCS, true force of each NCP on the terminal at rest.
    start, end : (K,), s, true dwells (row numbers with rows == "postures").
    """

    rig: Rig
    options: Options
    truth: Truth
    log: Log
    postures: Postures
    servo: FloatArray
    force: FloatArray
    start: FloatArray
    end: FloatArray


def simulate_campaign(
    rig: Rig, options: Options, rng: np.random.Generator, truth: Truth | None = None
) -> Campaign:
    """Drive one campaign and record it.

    The rig's truth, the postures, the machine's errors and the recorder draw from streams of
    their own: with one seed, other faults, rates or noise leave the rest as it was.

    truth : one trial, where the rig has been used before; drawn otherwise.

    Raises UsageError for options that do not fit the rig, RigError for a scatter that cannot be
    simulated, NotConvergedError where the terminal finds no rest.
    """
    stage_rng, record_rng, inertia_rng = rng.spawn(3)
    stage = set_stage(rig, options, stage_rng, 1, truth)
    if options.rows == "postures":
        batch = record_means(rig, options, stage, record_rng)
        log, dwells = batch.log(0), batch.dwells(0)
        start, end = dwells.start, dwells.end
    else:
        timeline_rng, force_rng, position_rng = record_rng.spawn(3)
        timeline = draw_timeline(options.recorder, options.count, timeline_rng)
        start, end = timeline.start, timeline.end
        stamps = timeline.samples(options.recorder.force_rate)
        inertia = draw_inertia(rig, stage.truth.trial(0), inertia_rng)
        log = Log(
            supports=rig.supports,
            position=_record_positions(rig, options, stage, timeline, position_rng),
            force=_record_forces(rig, options, stage, timeline, inertia, force_rng),
            temperature=faults.thermometer(options.faults, stamps, timeline.place(stamps)),
        )
    return Campaign(
        rig=rig,
        options=options,
        truth=stage.truth.trial(0),
        log=log,
        postures=stage.postures.trial(0),
        servo=stage.servo[0],
        force=stage.rest.force[0],
        start=start,
        end=end,
    )


def _record_positions(
    rig: Rig, options: Options, stage: Stage, timeline: Timeline, rng: np.random.Generator
) -> tuple[Series, ...]:
    time = timeline.samples(options.recorder.position_rate)
    target = between(stage.postures.trial(0), timeline.at(time)).target(rig.hinge)
    servo, _ = stand(stage.truth.trial(0), options, target, np.zeros_like(target))
    noise = options.recorder.encoder_sd * rng.standard_normal(servo.shape)
    return streams(time, servo + noise)


def _record_forces(
    rig: Rig,
    options: Options,
    stage: Stage,
    timeline: Timeline,
    inertia: FloatArray,
    rng: np.random.Generator,
) -> tuple[Series, ...]:
    recorder = options.recorder
    sd_rng, shake_rng, noise_rng, walk_rng = rng.spawn(4)
    time = timeline.samples(recorder.force_rate)
    moment = timeline.at(time)
    truth = stage.truth.trial(0)
    force = _true_forces(rig, options, stage, timeline, inertia, time)
    stops = stage.rest.pose.place(rig.hinge)[0]
    way = between(stage.postures.trial(0), moment).pose.place(rig.hinge)
    force += _shaking(recorder, timeline, time, stops, way, shake_rng)
    sd = sd_rng.uniform(*recorder.force_sd, rig.n)
    place = timeline.place(time)
    signal = (
        reading(truth, faults.turned_away(options.faults, force, place))
        + moment.blend(stage.force_offset[0])
        + faults.zero_offset(options.faults, rig.n, place)
        + faults.zero_walk(options.faults, rig.n, place.progress, walk_rng)
        + sd[:, None] * noise_rng.standard_normal((len(time), rig.n, 3))
    )
    return streams(time, faults.recorded(options.faults, signal, place, rig))


def _true_forces(
    rig: Rig,
    options: Options,
    stage: Stage,
    timeline: Timeline,
    inertia: FloatArray,
    time: FloatArray,
) -> FloatArray:
    """Forces of the NCPs on the terminal, (N, n, 3), N, BCS; its carriages follow at once.

    inertia : (3, 3), kg m², about the LCS origin.
    """
    moment = timeline.at(time)
    force = stage.rest.force[0][moment.index]
    blow = np.zeros((len(time), 3))
    for jolt in options.faults.jolts:
        start, end = timeline.start[jolt.posture], timeline.end[jolt.posture]
        phase = 0.5 + (time - start - jolt.at * (end - start)) / jolt.duration
        inside = (phase > 0.0) & (phase < 1.0)
        blow[inside] += np.sin(np.pi * phase[inside])[:, None] * np.asarray(jolt.force)
    solve = (moment.share > 0.0) | np.any(blow != 0.0, axis=1)
    if np.any(solve):
        part = Moment(moment.index[solve], moment.share[solve], moment.speed[solve])
        truth, driven = stage.truth.trial(0), stage.postures.trial(0)
        postures = between(driven, part)
        _, where = stand(truth, options, postures.target(rig.hinge), part.blend(stage.repeat[0]))
        contact = part.blend(stage.load.contact[0])
        contact[:, 0] += blow[solve]
        course = lambda at: between(driven, timeline.at(at)).pose  # noqa: E731
        contact += inertial(course, truth, inertia, time[solve])[0]
        load = Load(contact, part.blend(stage.load.friction[0]))
        force[solve] = settle(truth, where, load, postures.pose).force
    return np.asarray(force, dtype=np.float64)


def _shaking(
    recorder: Recorder,
    timeline: Timeline,
    time: FloatArray,
    hinge: FloatArray,
    way: FloatArray,
    rng: np.random.Generator,
) -> FloatArray:
    """Vibration in the moves and settling after them, (N, n, 3), N, to be added to the forces.

    Settling: a relaxation and an oscillation of equal size, both falling to 5 % in
    `recorder.settling`. The relaxation builds up during the move before the stop; of internal
    forces at every place on the way, since nothing else could hold it in balance.

    hinge : (K, n, 3), m, BCS, at the stops; way : (N, n, 3), at these times.
    """
    shape = hinge.shape
    K, n = shape[:2]
    moment = timeline.at(time)
    hum_rate, hum_phase = rng.uniform(8.0, 25.0, shape), rng.uniform(-np.pi, np.pi, shape)
    ring_rate = rng.uniform(5.0, 12.0, shape)
    relax, ring = recorder.settling_force * rng.standard_normal((2, *shape)) / np.sqrt(2.0)
    relax = internal_part(hinge, relax) * np.sqrt(3 * n / (3 * n - 6))  # as large as drawn
    relax[0] = ring[0] = 0.0  # the first dwell follows no move
    k = moment.index
    since = (time - timeline.start[k])[:, None, None]
    hum = np.sin(2.0 * np.pi * hum_rate[k] * since + hum_phase[k])
    out = recorder.vibration * moment.speed[:, None, None] * hum
    if recorder.settling > 0.0:
        decay = np.exp(-since * np.log(20.0) / recorder.settling)
        out += decay * (relax[k] + ring[k] * np.sin(2.0 * np.pi * ring_rate[k] * since))
        after = np.minimum(k + 1, K - 1)
        out += moment.share[:, None, None] * internal_part(way, relax[after])
    return np.asarray(out, dtype=np.float64)


@record
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
    from the sample noise, the rate and the dwell less its settling. Vibration,
    settling and jolts are taken to be cut away; drifts are proportional to the posture's number.

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
    sample_sd = rng.uniform(*recorder.force_sd, (trials, n))
    mean_sd = sample_sd[:, None, :] / np.sqrt(count)[..., None]
    if recorder.mean_sd is not None:
        mean_sd = np.full((trials, K, n), recorder.mean_sd)
    position_sd = recorder.encoder_sd / np.sqrt(np.floor(used * recorder.position_rate) + 1.0)

    place = Place(np.arange(K, dtype=np.float64), np.arange(K) / max(K - 1, 1))
    signal = (
        reading(stage.truth, faults.turned_away(options.faults, stage.rest.force, place))
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
        effective=count[..., None] * each,
        temperature=faults.temperature(options.faults, place)[:, None] * each if warm else None,
    )
    return Batch(stage.truth, stage.rest.force, means, mean_sd)


def _share(time: FloatArray) -> FloatArray:
    """Share (B, K) of the campaign that has passed at times (B, K), s; 0 for a single one."""
    whole = np.ptp(time, axis=1, keepdims=True)
    return np.asarray((time - time[:, :1]) / np.where(whole > 0, whole, 1.0))
