"""A whole campaign as its recorder writes it down."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np

from tdfscal.records import FloatArray, Log, Rig, Series
from tdfscal.simulation import faults
from tdfscal.simulation.equilibrium import Load, settle
from tdfscal.simulation.options import Options
from tdfscal.simulation.postures import Postures, Stage, reading, set_stage, stand
from tdfscal.simulation.time_course import (
    Moment,
    Timeline,
    between,
    draw_timeline,
    sensor_noise,
    shaking,
    streams,
)
from tdfscal.simulation.truth import Truth


@dataclass(frozen=True, slots=True)
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
    stage_rng, record_rng = rng.spawn(2)
    stage = set_stage(rig, options, stage_rng, 1, truth)
    if options.rows == "postures":
        from tdfscal.simulation.posture_means import record_means

        batch = record_means(rig, options, stage, record_rng)
        log, dwells = batch.log(0), batch.dwells(0)
        start, end = dwells.start, dwells.end
    else:
        timeline_rng, force_rng, position_rng = record_rng.spawn(3)
        timeline = draw_timeline(options.recorder, options.count, timeline_rng)
        start, end = timeline.start, timeline.end
        stamps = timeline.samples(options.recorder.force_rate)
        log = Log(
            supports=rig.supports,
            position=_record_positions(rig, options, stage, timeline, position_rng),
            force=_record_forces(rig, options, stage, timeline, force_rng),
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
    rig: Rig, options: Options, stage: Stage, timeline: Timeline, rng: np.random.Generator
) -> tuple[Series, ...]:
    recorder = options.recorder
    sd_rng, shake_rng, noise_rng, walk_rng = rng.spawn(4)
    time = timeline.samples(recorder.force_rate)
    moment = timeline.at(time)
    truth = stage.truth.trial(0)
    force = _true_forces(rig, options, stage, timeline, time)
    force += shaking(recorder, timeline, time, rig.n, shake_rng)
    sd = sd_rng.uniform(*recorder.force_sd, rig.n)
    place = timeline.place(time)
    signal = (
        reading(truth, faults.turned_away(options.faults, force, place))
        + moment.blend(stage.force_offset[0])
        + faults.zero_offset(options.faults, rig.n, place)
        + faults.zero_walk(options.faults, rig.n, place.progress, walk_rng)
        + sensor_noise(sd, recorder.noise_correlation, recorder.force_rate, len(time), noise_rng)
    )
    return streams(time, faults.recorded(options.faults, signal, place, rig))


def _true_forces(
    rig: Rig, options: Options, stage: Stage, timeline: Timeline, time: FloatArray
) -> FloatArray:
    """Forces of the NCPs on the terminal, (N, n, 3), N, BCS, in quasi-static motion."""
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
        truth = stage.truth.trial(0)
        postures = between(stage.postures.trial(0), part)
        _, where = stand(truth, options, postures.target(rig.hinge), part.blend(stage.repeat[0]))
        contact = part.blend(stage.load.contact[0])
        contact[:, 0] += blow[solve]
        load = Load(contact, part.blend(stage.load.friction[0]))
        force[solve] = settle(truth, where, load, postures.pose).force
    return np.asarray(force, dtype=np.float64)
