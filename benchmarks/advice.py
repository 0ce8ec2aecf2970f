"""Does the advice lead? One fault at a time is simulated, the advice followed, the verdict read.

    python -m benchmarks.advice [SEED] > benchmarks/advice.md

Reference rig, 24 postures, squeeze 100 N. Only the words are followed, round by round, as a user
has them: a line of rig.yaml that the first advice spells (the next one where it was in vain) is
written there; where it spells none, what it asks for is done to the simulated machine or log, and
nothing else. d²/m and the largest error, in standard uncertainties, hold the m accepted angles
against the truth.
"""

from __future__ import annotations

import re
from collections.abc import Callable, Mapping
from dataclasses import dataclass, field, replace
from pathlib import Path
from typing import Any

import numpy as np
import pyarrow as pa
import pyarrow.parquet as pq
import yaml

from benchmarks.frame import declaring, errors, heads, introduce, numbers, scratch, show
from tdfscal.commands.calibrate import calibrate
from tdfscal.errors import TdfscalError
from tdfscal.files.writers.campaign import write_campaign
from tdfscal.numerics import so3
from tdfscal.records import FloatArray, Rig, UncertainValue
from tdfscal.reporting.advice import advise
from tdfscal.simulation import Faults, Options, Recorder, Slip, reference_rig, simulate_campaign
from tdfscal.simulation.faults import Contact, DeadAxis, Drift, Gain, Warming, ZeroShift

RIG = reference_rig()
BASE = Options(squeeze=100.0)
ROUNDS = 4  # of following before a user gives up

Table = Callable[[pa.Table], pa.Table]


@dataclass(frozen=True)
class World:
    """The rig as it is and as it is stated, what is driven, what the recorder does to the log.

    lines : changes of rig.yaml by key; `ncp1/zero.std` is a key of that support.
    """

    real: Rig = RIG
    stated: Rig = RIG
    options: Options = BASE
    recorder: Table | None = None
    lines: Mapping[str, Any] = field(default_factory=dict)

    def write(self, folder: Path, seed: int) -> FloatArray:
        """Write the campaign; return the true rotations (n, 3, 3)."""
        played = simulate_campaign(self.real, self.options, np.random.default_rng(seed))
        write_campaign(replace(played, rig=self.stated), folder, format="parquet")
        log = folder / "log.parquet"
        table = pq.read_table(log)
        if played.log.temperature:
            table = table.append_column("temp", pa.array(played.log.temperature[0].value[:, 0]))
        pq.write_table(self.recorder(table) if self.recorder else table, log)
        document = yaml.safe_load((folder / "rig.yaml").read_text())
        for key, value in self.lines.items():
            change(document, key, value)
        (folder / "rig.yaml").write_text(yaml.safe_dump(document, sort_keys=False))
        return so3.from_rpy(played.truth.rpy)


def change(document: dict[str, Any], key: str, value: Any) -> None:
    """Write a line of a rig file as its owner would."""
    support, _, path = key.rpartition("/")
    if support:
        document = next(s for s in document["supports"] if s["name"] == support)
    *blocks, last = path.split(".")
    for block in blocks:
        document = document.setdefault(block, {})
    document[last] = value


def faults(**changes: Any) -> World:
    return driven(faults=Faults(**changes))


def really(**changes: Any) -> World:
    return World(real=replace(RIG, **changes))


def driven(**changes: Any) -> World:
    return World(options=replace(BASE, **changes))


def altered(pattern: str, alter: Callable[[FloatArray], FloatArray]) -> Table:
    def change_table(table: pa.Table) -> pa.Table:
        for i, name in enumerate(table.column_names):
            if re.fullmatch(pattern, name):
                table = table.set_column(i, name, pa.array(alter(table[name].to_numpy())))
        return table

    return change_table


def scaled(pattern: str, factor: float) -> Table:
    return altered(pattern, lambda values: values * factor)


def late(values: FloatArray) -> FloatArray:
    """Stamped 1.5 s late."""
    return np.concatenate([np.full(150, values[0]), values[:-150]])


LATE_FORCES = altered(r"ncp\d\.f[xyz]", late)


def cases() -> dict[str, World]:
    """Every fault of the table by its name."""
    touch = ((15.0, -25.0, 40.0), (6.0, 4.0, -3.0))
    hinge, far = RIG.hinge.copy(), RIG.hinge.copy()
    hinge[0] += [2e-3, -1e-3, 1e-3]
    far[0] += [2e-2, 0.0, 0.0]
    zero = RIG.zero.value.copy()
    zero[0] += [10.0, -5.0, 15.0]
    off = np.array([2e-2, -2e-2, 1e-2])
    sticking = declaring(RIG, hinge_moment=0.5).declared
    heavy = UncertainValue(np.array(505.0), RIG.mass.std)
    shifted = UncertainValue(RIG.barycentre.value + off, RIG.barycentre.std)
    capped = replace(RIG, capacity=np.full((3, 3), 1.02 * 500 * 9.80665 / 3))
    jump, creep = ZeroShift(0, 12, (8.0, -5.0, 12.0)), Drift(0, (10.0, -6.0, 15.0))
    warm = Warming(5.0, ((1.0, 0.5, 1.5), (-0.5, 1.0, 1.0), (0.3, -0.6, 2.0)))
    gain, cross = Gain(0, (0.02, -0.01, 0.02)), Gain(0, crosstalk=(0.02, -0.02, 0.02))
    six = tuple(Contact(k, *touch) for k in range(2, 24, 4))
    slip = Slip(0, 12, (0.004, -0.003, 0.005))
    floating = np.array([1e3, 1e3, 2e7])
    return {
        "none": World(),
        "zero jumps by 15 N at half time": faults(zero_shifts=(jump,)),
        "zero drifts by 19 N": faults(drifts=(creep,)),
        "contact at one posture": faults(contacts=six[:1]),
        "contact at six postures": faults(contacts=six),
        "mass 1 % wrong": really(mass=heavy),
        "barycentre 30 mm wrong": really(barycentre=shifted),
        "hinge friction 0.5 N·m": really(declared=sticking),
        "gain 2 % wrong": faults(gains=(gain,)),
        "crosstalk 2 %": faults(gains=(cross,)),
        "sensor turns by 7 mrad at half time": faults(slips=(slip,)),
        "zero of a sensor 19 N wrong": really(zero=UncertainValue(zero, RIG.zero.std)),
        "hinge coordinate 2 mm wrong": really(hinge=hinge),
        "hinge coordinate 20 mm wrong": really(hinge=far),
        "BCS tilted by 3 mrad": really(gravity_tilt_std=3e-3),
        "hall warms by 5 K": replace(faults(warming=warm), lines={"log.temperature": "temp"}),
        "hall warms by 5 K, not recorded": replace(
            faults(warming=warm), lines={"log.temperature": None},
            recorder=lambda t: t.drop_columns([n for n in t.column_names if n.startswith("temp")]),
        ),
        "sensors 30 times as noisy": driven(recorder=Recorder(force_sd=(60.0, 60.0))),
        "three postures": driven(postures=3),
        "no squeeze": driven(squeeze=0.0, stiffness=floating),
        "sensors swapped": faults(swapped=((0, 1),)),
        "dead axis": faults(dead_axes=(DeadAxis(0, 0, 0),)),
        "axis freezes at posture 9": faults(dead_axes=(DeadAxis(0, 0, 8),)),
        "saturation": replace(faults(saturated=True), real=capped, stated=capped),
        "positions in mm": World(recorder=scaled(r"ncp\d\.[xyz]", 1e3)),
        "forces in kN": World(recorder=scaled(r"ncp\d\.f[xyz]", 1e-3)),
        "reaction recorded": World(recorder=scaled(r"ncp\d\.f[xyz]", -1.0)),
        "one axis of opposite sign": World(recorder=scaled(r"ncp1\.fy", -1.0)),
        "forces 1.5 s late": World(recorder=LATE_FORCES),
        # Two at a time: the cure of one must not hide the other.
        "zero jump and contact": faults(zero_shifts=(jump,), contacts=six[:3]),
        "mass and crosstalk": replace(faults(gains=(cross,)), real=replace(RIG, mass=heavy)),
        "friction and hinge": really(hinge=hinge, declared=sticking),
        "drift and gain": faults(drifts=(creep,), gains=(gain,)),
        "tilt and mass": really(gravity_tilt_std=3e-3, mass=heavy),
        "positions in mm and dead axis": replace(
            faults(dead_axes=(DeadAxis(0, 0, 0),)), recorder=scaled(r"ncp\d\.[xyz]", 1e3)
        ),
    }  # fmt: skip


def _driven(world: World, **changes: Any) -> World:
    return replace(world, options=replace(world.options, **changes))


def _without(world: World, **gone: Any) -> World:
    return _driven(world, faults=replace(world.options.faults, **gone))


def _mended(world: World, name: str, *kinds: str) -> World:
    """The world without faults of these kinds at a sensor."""
    i, f = RIG.supports.index(name), world.options.faults
    return _without(
        world, **{kind: tuple(x for x in getattr(f, kind) if x.sensor != i) for kind in kinds}
    )


def _written(world: World, key: str, value: Any) -> World:
    return replace(world, lines={**world.lines, key: value})


def _free(world: World, found: re.Match[str]) -> World:
    named = {int(number) - 1 for number in re.findall(r"\d+", found[1])}
    kept = tuple(c for c in world.options.faults.contacts if c.posture not in named)
    return _without(world, contacts=kept)


def _look_at(world: World, found: re.Match[str]) -> World:
    """Whatever touched is taken away; where nothing did, the sensor's amplifier is put right."""
    if world.options.faults.contacts:
        return _without(world, contacts=())
    return _mended(world, found[1], "gains", "crosstalk")


def _repair(world: World, found: re.Match[str]) -> World:
    axis, i = "xyz".index(found[1]), RIG.supports.index(found[2])
    dead = world.options.faults.dead_axes
    return _without(world, dead_axes=tuple(d for d in dead if (d.axis, d.sensor) != (axis, i)))


def _range(world: World, found: re.Match[str]) -> World:
    wide, world = np.full((3, 3), np.inf), _without(world, saturated=False)
    real, stated = (replace(rig, capacity=wide) for rig in (world.real, world.stated))
    return replace(world, real=real, stated=stated)


def _rename(world: World, found: re.Match[str]) -> World:
    """Fields of the log block: sensors named as the message has it."""
    source = dict(re.findall(r"(ncp\d) taken from (ncp\d)", found[0]))
    block = {
        name: {
            "position": [f"{name}.{a}" for a in "xyz"],
            "force": [f"{source.get(name, name)}.f{a}" for a in "xyz"],
        }
        for name in RIG.supports
    }
    return _written(world, "log.supports", block)


def _turn_axis(world: World, found: re.Match[str]) -> World:
    before, mend = world.recorder, scaled(rf"{found[2]}\.f{found[1]}", -1.0)
    return replace(world, recorder=lambda table: mend(before(table) if before else table))


Act = Callable[[World, re.Match[str]], World]
ACTS: tuple[tuple[str, Act], ...] = (
    (r"widen the range of sensor and amplifier", _range),
    (r"see that forces and positions share one clock",
     lambda w, m: replace(w, recorder=None) if w.recorder is LATE_FORCES else w),
    # The postures before the jump, as a campaign of its own.
    (r"zero of (ncp\d) jumped by .* between postures (\d+) and .* or one of them by",
     lambda w, m: _mended(_driven(w, postures=int(m[2])), m[1], "zero_shifts")),
    (r"ind what touched the terminal or a sensor at .* look at F. of (ncp\d)", _look_at),
    (r"asten the sensor of (ncp\d)", lambda w, m: _mended(w, m[1], "slips", "zero_shifts")),
    (r"ind what touched the terminal at postures ([\d, …]+)", _free),
    (r"ook at the sensor's cable and amplifier.*: the (.) axis of the sensor of (ncp\d)", _repair),
    (r"queeze the NCPs ([\d.]+) times as hard",
     lambda w, m: _driven(w, squeeze=float(m[1]) * w.options.squeeze)),
    (r"queeze the NCPs against each other so that",
     lambda w, m: replace(w, options=replace(BASE, faults=w.options.faults))),
    (r"old eight or more postures", lambda w, m: _driven(w, postures=8)),
    (r"heck the range of the sensor and of its amplifier", _range),
    (r"positions were in (\w+) where m is declared",
     lambda w, m: _written(w, "log.length_unit", m[1])),
    (r"as if they were in (\w+) where N is declared",
     lambda w, m: _written(w, "log.force_unit", m[1])),
    (r"et log.force_on in rig.yaml to the other value",
     lambda w, m: _written(w, "log.force_on", "sensor")),
    (r"the opposite sign of F(.) of (ncp\d)", _turn_axis),
    (r"the sensors of ncp.*, and not as they are named.* Correct the force fields", _rename),
    (r"easure the hinges again",
     lambda w, m: replace(w, stated=replace(w.stated, hinge=w.real.hinge))),
)  # fmt: skip
LINE = re.compile(r"`([a-z_.]+): ([^`]+)`(?: for (ncp\d))?")


def follow(world: World, advice: str) -> World | None:
    """Do what an advice says; None where it says nothing that can be done."""
    if line := LINE.search(advice):
        key = f"{line[3]}/{line[1]}" if line[3] else line[1]
        return _written(world, key, yaml.safe_load(line[2]))
    for pattern, act in ACTS:
        if found := re.search(pattern, advice):
            return act(world, found)
    return None


@dataclass(frozen=True)
class Outcome:
    """A verdict, the advice, and of an accepted result d² per angle and the largest error.

    advice : the first one. further : what follows it, where the first was followed in vain.
    """

    verdict: str
    advice: str
    further: tuple[str, ...] = ()
    distance: float = np.nan
    worst: float = np.nan
    angles: int = 0


def calibrated(world: World, seed: int) -> Outcome:
    """Calibrate the world's campaign and read what is said first."""
    with scratch() as place:
        truth = world.write(place / "c", seed)
        try:
            result = calibrate(place / "c", trials=0)
        except TdfscalError as error:
            return Outcome(f"refused ({error.exit_status})", str(error))
    first, *further = advise(result)
    if not result.accepted:
        return Outcome("rejected", first, tuple(further))
    known = np.repeat(result.determined, 3)
    d, std, mean = errors(truth, result.rotation, result.rotation_covariance, known)
    return Outcome("accepted", first, (), mean, float(np.abs(d / std).max()), len(d))


def led(world: World, seed: int) -> list[Outcome]:
    """Follow the first advice again and again, each once; every outcome on the way."""
    outcomes, done = [calibrated(world, seed)], set[str]()
    for _ in range(ROUNDS):
        last = outcomes[-1]
        if last.verdict == "accepted":
            break
        fresh = [said for said in (last.advice, *last.further) if said not in done]
        after = follow(world, fresh[0]) if fresh else None
        if after is None:
            break
        done.add(fresh[0])
        outcomes[-1] = replace(last, advice=fresh[0])
        world = after
        outcomes.append(calibrated(world, seed))
    return outcomes


def main() -> None:
    """Print the table."""
    (seed,) = numbers(3)
    introduce("Faults, the advice given, and the verdict after", f"advice {seed}", __doc__)
    names = "fault", "verdict", "first advice of each round", "rounds", "verdict after", "d²/m"
    print(heads(*names, "largest"))
    for name, world in cases().items():
        outcomes = led(world, seed)
        first, last = outcomes[0], outcomes[-1]
        said = "<br>".join(o.advice for o in outcomes[:-1]) or "–"
        figures = f"{last.distance:.2f}", f"{last.worst:.1f}"
        show(name, first.verdict, said, len(outcomes) - 1, last.verdict, *figures)


if __name__ == "__main__":
    main()
