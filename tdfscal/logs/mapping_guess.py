"""Which fields are the positions and forces of which support, by names and plausibility."""

from __future__ import annotations

import re
from collections.abc import Mapping, Sequence, Set
from typing import Final, Literal, cast

import numpy as np

from tdfscal.files.units import by_scale, unit_factor
from tdfscal.frozen import record, replace
from tdfscal.logs.contents import Column, Contents, Vector
from tdfscal.logs.messages.paths import topic_of
from tdfscal.logs.plausible_units import (
    Proposal,
    distances,
    force_unit,
    length_unit,
    resampled,
    time_unit,
)
from tdfscal.records import LogMapping, Rig

Role = Literal["position", "force", "other"]
TimeUnit = Literal["s", "ms", "us", "ns"]

_FORCE: Final = frozenset({"f", "force", "forces", "tdfs", "load", "loadcell", "wrench", "sensor"})
_POSITION: Final = frozenset({"p", "pos", "position", "positions", "ncp", "actpos", "pose", "xyz"})
_POSITION_PART: Final = ("pos", "point")
_OTHER: Final = frozenset(
    {"m", "t", "torque", "torques", "moment", "moments", "v", "vel", "velocity", "a", "acc"}
    | {"accel", "acceleration", "angular", "orientation", "rot", "rotation", "rpy", "angle", "w"}
    | {"err", "error", "temp", "temperature", "gyro", "mag", "euler", "joint", "speed"}
)
_MEASURED: Final = frozenset({"current", "actual", "act", "measured", "meas", "feedback", "fbk"})
_COMMANDED: Final = frozenset(
    {"cmd", "command", "commanded", "set", "setpoint", "target", "ref", "reference", "demand"}
    | {"goal", "desired", "nominal", "action", "planned"}
)
_LENGTHS: Final = frozenset({"m", "cm", "mm", "um"})
_WORD = re.compile(r"[A-Z]+(?![a-z])|[A-Z]?[a-z]+|\d+|\*")
_SHOWN: Final = 3
_MOST_POSTURES: Final = 1000
_LARGEST: Final = 1e15
_RIGID: Final = 0.02  # largest relative spread of distances that a rigid terminal leaves


@record
class Guess:
    """recorders : a mapping each; none where no pairs of positions and forces are found, several
    where these are in files of their own. notes : why, and doubts. problems : where what the file
    says of its units cannot be.
    """

    recorders: tuple[LogMapping, ...]
    notes: tuple[str, ...]
    problems: tuple[str, ...] = ()

    @property
    def mapping(self) -> LogMapping | None:
        """That of the first recorder."""
        return self.recorders[0] if self.recorders else None


@record
class _Pair:
    support: str
    position: Vector
    force: Vector


def guess_recorders(files: Mapping[str, Contents], rig: Rig | None = None) -> Guess:
    """Guess the `log:` block of files never seen before, or that of each of several recorders.

    files : by the pattern of their names, one for each layout of fields that there is.
    rig : gives the supports their names, and decides what names leave open.
    """
    first, *others = files.values()
    guess = _guess({"": first}, rig)
    if guess.recorders or not others:
        return guess
    each = (_guess({pattern: contents}, rig) for pattern, contents in files.items())
    return next((one for one in each if one.recorders), None) or _guess(files, rig)


def _guess(files: Mapping[str, Contents], rig: Rig | None) -> Guess:
    """Guess from the vectors of all files together."""
    vectors: list[Vector] = []
    owner: dict[int, str] = {}
    for pattern, contents in files.items():
        own = [v for v in map(_plausible, contents.vectors) if v.time.size]
        owner |= dict.fromkeys(map(id, own), pattern)
        vectors += own
    positions = _measured([v for v in vectors if _role(v) == "position"])
    # Drivers fill what they do not measure with zeros: the efforts of a JointState.
    forces = _measured([v for v in vectors if _role(v) == "force" and v.value.any()])
    forces = [v for v in forces if not _is_commanded(v)]
    pairs = _paired(positions, forces)
    if len(pairs) < 3:
        found = f"{len(positions)} vectors look like positions and {len(forces)} like forces"
        none = f"no mapping is guessed: {found}; three of each are needed"
        for role in ("position", "force"):
            units = {v.unit: by_scale(role, v.unit) for v in vectors if v.unit is not None}
            none += "".join(f"; {unit}: {line}" for unit, line in units.items() if line)
        neither = [v.fields[0] for v in vectors if v.unit is None and _role(v) == "other"]
        if neither:
            none += f"; {', '.join(neither[:_SHOWN])} and the like are neither by their names: "
            none += "X1, X1 [mm], NCP1_X_mm are known for positions, F1x, F1x [kN] for forces"
        if twice := ", ".join(name for c in files.values() for name in c.repeated):
            none += f"; columns that are there more than once are passed over: {twice}"
        return Guess((), (none, *(note for c in files.values() for note in _joints(c))))
    pairs = sorted(pairs, key=lambda p: _natural(p.position.label))
    pairs, by_rig = _named(pairs, rig)
    length = length_unit([p.position for p in pairs], rig)
    force = force_unit([p.force for p in pairs], rig)
    on, why_on = _force_on(pairs, rig)
    notes = [*by_rig, *length.notes, *force.notes, *why_on, *_rigidity(pairs)]
    if commanded := [p.position.label for p in pairs if _is_commanded(p.position)]:
        notes.append(f"by their names these positions were commanded: {', '.join(commanded)}")
    problems = [*length.problems, *force.problems]
    recorders: list[LogMapping] = []
    for pattern, contents in files.items():
        held = [
            tuple(v.fields if owner[id(v)] == pattern else () for v in side)
            for side in ([p.position for p in pairs], [p.force for p in pairs])
        ]
        if not any(held[0]) and not any(held[1]):
            continue
        mapping = LogMapping(
            supports=tuple(p.support for p in pairs),
            position=held[0],
            force=held[1],
            length_unit=length.unit if any(held[0]) else "m",
            force_unit=force.unit if any(held[1]) else "N",
            force_on=on if any(held[1]) else "terminal",
            decimal=contents.decimal,
            files=pattern or None,
        )
        clock = _with_clock(mapping, contents)
        notes += clock.notes
        problems += clock.problems
        if not clock.recorders:
            return Guess((), tuple(notes), tuple(problems))
        recorders += clock.recorders
    return Guess(tuple(recorders), tuple(notes), tuple(problems))


def _with_clock(mapping: LogMapping, contents: Contents) -> Guess:
    """The mapping with its clock, and why; none where that fails."""
    used = {name for fields in (*mapping.position, *mapping.force) for name in fields}
    rows = sum(stream.count for stream in contents.streams)
    if contents.by_topic:
        source, why = _time_source(used, contents)
        return Guess((replace(mapping, time_source=source),), tuple(why))
    if timed := _time([c for c in contents.columns if c.name and c.name not in used]):
        column, unit = timed
        seconds = cast(TimeUnit, unit.unit)
        mapping = replace(mapping, time_field=column.name, time_unit=seconds)
        return Guess((mapping,), unit.notes, unit.problems)
    none = "no column ascends as a time does"
    if any(not column.name for column in contents.columns):
        number = [field.name for field in contents.streams[0].fields].index("") + 1
        nameless = f"column {number} has no name, and ascends as a time does: name it"
        return Guess((), (f"no mapping is guessed: {nameless}",))
    if rows <= _MOST_POSTURES and not mapping.files:
        why_rows = f"{none}, so each row is taken for a posture"
        return Guess((replace(mapping, rows="postures"),), (why_rows,))
    many = f"{rows} rows are too many for averaged postures: no mapping is guessed"
    return Guess((), (f"{none}, and {many}",))


def _plausible(vector: Vector) -> Vector:
    """The vector without readings that no unit makes a position or a force; squares overflow."""
    keep = np.abs(vector.value).max(axis=1, initial=0.0) < _LARGEST
    return replace(vector, time=vector.time[keep], value=vector.value[keep])


def words(label: str) -> list[str]:
    """Words of a name, small: TDFS_F*1 → tdfs, f, *, 1."""
    return [w.lower() for w in _WORD.findall(label)]


def _role(vector: Vector) -> Role:
    """What a vector's name says; the words nearest to its end say it best."""
    if vector.unit is not None:
        for role in ("position", "force"):
            if unit_factor(role, vector.unit) is not None:
                return "position" if role == "position" else "force"
        return "other"
    found = words(vector.label)
    # `X1_mm`: a unit behind a bare axis letter.
    if [w for w in found if not w.isdigit()][-2:-1] == ["*"] and found[-1] in _LENGTHS:
        del found[-1]
    joints = vector.kind.rpartition(" ")[2] if len(vector.fields) == 3 else ""
    if joints == "position":
        return "position"
    if joints == "effort":
        return "force"
    if joints == "velocity":
        return "other"
    if set(found) & _OTHER and found[-1:] != ["force"]:
        return "other"
    for word in reversed(found):
        if word in _FORCE:
            return "force"
        if word in _POSITION or word.startswith(_POSITION_PART) or word.endswith(_POSITION_PART):
            return "position"
    if "Wrench" in vector.kind or "Force" in vector.kind:
        return "force"
    if "current" in found:  # of a motor
        return "other"
    # A bare axis letter, `ncp1.x`, `X1`: a position.
    return "position" if [w for w in found if not w.isdigit()][-1:] == ["*"] else "other"


def _is_commanded(vector: Vector) -> bool:
    found = set(words(vector.label))
    return bool(found & _COMMANDED) and not found & _MEASURED


def _measured(vectors: Sequence[Vector]) -> list[Vector]:
    """Of vectors that differ in such words alone: measured, else unnamed, else commanded ones.

    Where three others are there, none that was commanded.
    """

    def rank(vector: Vector) -> int:
        return 0 if set(words(vector.label)) & _MEASURED else 1 + _is_commanded(vector)

    best: dict[tuple[str, ...], int] = {}
    for vector in vectors:
        key = tuple(_key(vector))
        best[key] = min(best.get(key, 2), rank(vector))
    chosen = [vector for vector in vectors if rank(vector) == best[tuple(_key(vector))]]
    free = [vector for vector in chosen if not _is_commanded(vector)]
    return free if len(free) >= 3 else chosen


def _joints(contents: Contents) -> list[str]:
    """What to write where the joints' names do not say which are x, y and z of an NCP."""
    notes = []
    for topic, names in ((s.name, s.joints) for s in contents.streams if s.joints):
        shown = ", ".join(names[:12]) + (", …" if len(names) > 12 else "")
        x, y, z = (*names[:3], "…", "…", "…")[:3]
        notes.append(
            f"the joints of {topic} are {shown}; where three of them move an NCP along x, y and z, "
            f"write position: [{', '.join(f'{topic}.position.{j}' for j in (x, y, z))}]"
        )
    return notes


def _key(vector: Vector) -> list[str]:
    """What a name says of the support: its numbers, else its words that name no quantity."""
    found = words(vector.label)
    numbers = [w for w in found if w.isdigit()]
    general = {"*", "geometry", "msgs", "msg", "tcp", *_FORCE, *_POSITION, *_MEASURED, *_COMMANDED}
    return numbers or [w for w in found if w not in general and not w.endswith(_POSITION_PART)]


def _paired(positions: Sequence[Vector], forces: Sequence[Vector]) -> list[_Pair]:
    """Pair by equal keys where these are unique, else by their order."""
    keys_p = [tuple(_key(v)) for v in positions]
    keys_f = [tuple(_key(v)) for v in forces]
    common = [k for k in keys_p if keys_p.count(k) == 1 and keys_f.count(k) == 1 and k]
    if len(common) >= 3:
        return [
            _Pair(f"ncp{k[0]}" if len(k) == 1 and k[0].isdigit() else "_".join(k),
                  positions[keys_p.index(k)], forces[keys_f.index(k)])
            for k in common
        ]  # fmt: skip
    if len(positions) == len(forces):
        return [
            _Pair(f"ncp{i + 1}", p, f)
            for i, (p, f) in enumerate(zip(positions, forces, strict=True))
        ]
    return []


def _named(pairs: list[_Pair], rig: Rig | None) -> tuple[list[_Pair], list[str]]:
    """Give the pairs the rig's names: those in the fields' names, else in order."""
    if rig is None:
        return pairs, []
    by_name = {}
    for name in rig.supports:
        hits = [p for p in pairs if name.lower() in p.position.label.lower() or p.support == name]
        if len(hits) == 1:
            by_name[name] = hits[0]
    if len(by_name) == rig.n:
        return [replace(p, support=name) for name, p in by_name.items()], []
    if len(pairs) == rig.n:
        named = [replace(p, support=n) for n, p in zip(rig.supports, pairs, strict=True)]
        return named, ["the supports are matched with the rig's in order; check them"]
    return pairs, [
        f"the log has {len(pairs)} supports, the rig {rig.n}; the names are not the rig's"
    ]


def _force_on(
    pairs: Sequence[_Pair], rig: Rig | None
) -> tuple[Literal["terminal", "sensor"], list[str]]:
    """The NCPs push the terminal up: a sum that points down is that of the reactions."""
    forces = resampled([q.force for q in pairs])
    if rig is not None and [p.support for p in pairs] == list(rig.supports):
        from tdfscal.numerics import so3

        forces = np.einsum("nij,nkj->nki", so3.from_rpy(rig.nominal_rpy), forces)
    total = forces.sum(axis=0).mean(axis=0)
    on: Literal["terminal", "sensor"] = "terminal" if total[2] > 0 else "sensor"
    way = "up" if on == "terminal" else "down"
    note = f"force_on: {on}, as the forces' sum points {way} along the sensors' z"
    if abs(total[2]) < 0.5 * float(np.linalg.norm(total)):
        note += "; it is far from vertical, so check this"
    return on, [note]


def _rigidity(pairs: Sequence[_Pair]) -> list[str]:
    distance = distances([p.position for p in pairs])
    mean = distance.mean(axis=0)
    if not mean.all():
        return ["two of the positions are the same throughout"]
    spread = float(np.max(np.std(distance, axis=0) / mean))
    if spread < _RIGID:
        return []
    return [
        f"the distances between the positions vary by {100 * spread:.1f} %: they may be something "
        "else than hinges of one rigid terminal"
    ]


def _time_source(
    fields: Set[str], contents: Contents
) -> tuple[Literal["header", "log"], list[str]]:
    """The header's time where every topic has one that can be used."""
    named = {topic_of(name, {s.name for s in contents.streams}) for name in fields}
    streams = [stream for stream in contents.streams if stream.name in named]
    unusable = [stream for stream in streams if stream.unusable]
    if not all(stream.stamped for stream in streams):
        return "log", []
    if not unusable:
        return "header", []
    return "log", [f"time source: log, as header times cannot be used: {unusable[0].unusable}"]


def _time(columns: Sequence[Column]) -> tuple[Column, Proposal] | None:
    """The column that is best taken for the time, and its unit."""
    if not columns:
        return None

    def rank(column: Column) -> tuple[bool, bool]:
        found = words(column.name)
        return ("time" in found or "timestamp" in found, bool({"t", "stamp", "clock"} & set(found)))

    best = max(columns, key=rank)
    return best, time_unit(best, (words(best.name) or [""])[-1])


def _natural(label: str) -> list[tuple[int, int, str]]:
    parts = re.split(r"(\d+)", label)
    return [(1, int(p), "") if p.isdecimal() else (0, 0, p) for p in parts]
