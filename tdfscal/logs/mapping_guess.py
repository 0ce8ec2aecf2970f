"""Which fields are the positions and forces of which support, by names and plausibility."""

from __future__ import annotations

import re
from collections.abc import Collection, Mapping, Sequence
from typing import Any, Final, Literal, cast

import numpy as np

from tdfscal.files.rig.draft import flow, named_supports
from tdfscal.files.rig.recorders import LogBlock, LogTime, SupportFields, by_scale, unit_factor
from tdfscal.frozen import record, replace
from tdfscal.logs.contents import Contents, Vector, force_unit, length_unit, resampled, time_unit
from tdfscal.logs.formats import natural
from tdfscal.logs.messages.buffer import topic_of
from tdfscal.numerics import so3
from tdfscal.records import Rig

Role = Literal["position", "force", "other"]
TimeUnit = Literal["s", "ms", "us", "ns"]

_FORCE: Final = frozenset(
    {"f", "force", "forces", "kraft", "tdfs", "load", "loadcell", "wrench", "sensor"}
)
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
_LARGEST: Final = 1e15  # squares of more overflow


@record
class Guess:
    """recorders : a block each; none where no pairs of positions and forces are found, several
    where these are in files of their own. notes : why, and doubts. problems : where what the file
    says of its units cannot be. cure : what to do where none is guessed.
    """

    recorders: tuple[LogBlock, ...]
    notes: tuple[str, ...]
    problems: tuple[str, ...] = ()
    cure: str = ""

    @property
    def supports(self) -> tuple[str, ...]:
        """All that the recorders name."""
        return named_supports(self.recorders)


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
    owned = [
        (pattern, vector)
        for pattern, contents in files.items()
        for vector in map(_plausible, contents.vectors)
        if vector.time.size
    ]
    vectors = [vector for _, vector in owned]
    owner = {id(vector): pattern for pattern, vector in owned}
    positions = _measured([v for v in vectors if _role(v) == "position"])
    # Drivers fill what they do not measure with zeros: the efforts of a JointState.
    forces = _measured([v for v in vectors if _role(v) == "force" and v.value.any()])
    pairs = _paired(positions, [v for v in forces if not _is_commanded(v)])
    if len(pairs) < 3:
        found = f"{len(positions)} vectors look like positions and {len(forces)} like forces"
        cure = "where two recorders wrote positions and forces apart, name the files of both; else "
        cure = f"{cure if positions or forces else ''}{_by_hand(files.values())}"
        return Guess((), (_why_none(found, vectors, files.values()),), cure=cure)
    pairs, notes = _named(sorted(pairs, key=lambda p: natural(p.position.label)), rig)
    length = length_unit([p.position for p in pairs], rig)
    force = force_unit([p.force for p in pairs], rig)
    on, why_on = _force_on(pairs, rig)
    notes += [length.note, force.note, why_on]
    problems = [length.problem, force.problem]
    recorders: list[LogBlock] = []
    for pattern, contents in files.items():
        held: dict[str, dict[str, Any]] = {
            pair.support: {
                what: vector.fields
                for what, vector in (("position", pair.position), ("force", pair.force))
                if owner[id(vector)] == pattern
            }
            for pair in pairs
        }
        kinds = {what for fields in held.values() for what in fields}
        if not kinds:
            continue
        used = {name for own in held.values() for fields in own.values() for name in fields}
        clock, note, problem = _clock(used, contents, alone=not pattern)
        notes.append(note)
        problems.append(problem)
        if clock is None:
            texts = [f.name for f in contents.streams[0].fields if f.kind == "text"][:2]
            cure = "give each row its time, in one column"
            if len(texts) > 1:
                cure += f", such as 2026-11-03 08:15:00.5 of {' and '.join(texts)}"
            return Guess((), (note,), cure=cure)
        stated: dict[str, Any] = {"files": pattern} if pattern else {}
        if "position" in kinds:
            stated["length_unit"] = length.unit
        if "force" in kinds:
            stated |= {"force_unit": force.unit, "force_on": on}
        if contents.decimal != ".":
            stated["decimal"] = contents.decimal
        # Unchecked, as the names are any that a file may have.
        fields = {name: SupportFields.model_construct(**own) for name, own in held.items() if own}
        recorders.append(LogBlock.model_construct(**stated, **clock, supports=fields))
    return Guess(tuple(recorders), tuple(filter(None, notes)), tuple(filter(None, problems)))


def _why_none(found: str, vectors: Sequence[Vector], files: Collection[Contents]) -> str:
    """Why no mapping is guessed, and what would be known."""
    none = f"no mapping is guessed: {found}; three of each are needed"
    for role in ("position", "force"):
        units = {v.unit: by_scale(role, v.unit) for v in vectors if v.unit is not None}
        none += "".join(f"; {unit}: {line}" for unit, line in units.items() if line)
    if neither := [v.fields[0] for v in vectors if v.unit is None and _role(v) == "other"]:
        none += f"; {', '.join(neither[:_SHOWN])} and the like are neither by their names: "
        none += "X1, X1 [mm], NCP1_X_mm are known for positions, F1x, F1x [kN] for forces"
    if twice := ", ".join(name for contents in files for name in contents.repeated):
        none += f"; columns that are there more than once are passed over: {twice}"
    return none


def _by_hand(files: Collection[Contents]) -> str:
    """How to name columns, or the log block with those of the files, in their order."""
    fields = [field for contents in files for field in contents.streams[0].fields]
    clock, *others = [f.name for f in fields if f.low is not None and f.name] or ["Time"]
    supports = {
        f"ncp{k // 6 + 1}": {"position": others[k : k + 3], "force": others[k + 3 : k + 6]}
        for k in range(0, len(others) - 5, 6)
    }
    units = {"length_unit": "mm", "force_unit": "N", "force_on": "terminal"}
    block = flow({"time": {"field": clock, "unit": "s"}, **units, "supports": supports})
    return (
        "name the columns of each support, such as X1, Y1, Z1, F1x, F1y, F1z, and draft again, or "
        f"write in rig.yaml, with each column where it belongs, `log: {block}`"
    )


def _clock(
    used: Collection[str], contents: Contents, *, alone: bool
) -> tuple[dict[str, Any] | None, str, str]:
    """What a block says of its clock, or None, why, and what is wrong with the clock.

    used : fields that serve a quantity. alone : there is no other recorder.
    """
    if contents.by_topic:
        topics = {topic_of(name, {stream.name for stream in contents.streams}) for name in used}
        stamped = all(stream.stamped for stream in contents.streams if stream.name in topics)
        return {"time": LogTime(source="header" if stamped else "log")}, "", ""
    if columns := [c for c in contents.columns if c.name and c.name not in used]:
        best = max(columns, key=lambda column: _is_time(column.name))
        unit = time_unit(best, (words(best.name) or [""])[-1])
        seconds = cast(TimeUnit, unit.unit)
        time = LogTime.model_construct(field=best.name, unit=seconds)
        return {"time": time}, unit.note, unit.problem
    if contents.columns and not all(column.name for column in contents.columns):
        number = [field.name for field in contents.streams[0].fields].index("") + 1
        nameless = f"column {number} has no name, and ascends as a time does: name it"
        return None, f"no mapping is guessed: {nameless}", ""
    rows = sum(stream.count for stream in contents.streams)
    none = "no column ascends as a time does"
    if rows <= _MOST_POSTURES and alone:
        why = f"{none}, so each row is taken for a posture"
        return {"rows": "postures"}, why, ""
    many = f"{rows} rows are too many for averaged postures: no mapping is guessed"
    return None, f"{none}, and {many}", ""


def _is_time(name: str) -> int:
    """How much a name says that its column is the time."""
    found = set(words(name))
    return 2 * bool({"time", "timestamp"} & found) + bool({"t", "stamp", "clock"} & found)


def _plausible(vector: Vector) -> Vector:
    """The vector without readings that no unit makes a position or a force."""
    keep = np.abs(vector.value).max(axis=1, initial=0.0) < _LARGEST
    return replace(vector, time=vector.time[keep], value=vector.value[keep])


def words(label: str) -> list[str]:
    """Words of a name, small: TDFS_F*1 → tdfs, f, *, 1."""
    return [w.lower() for w in _WORD.findall(label)]


def _role(vector: Vector) -> Role:
    """What a vector's unit or name says; the words nearest to its end say it best."""
    if vector.unit is not None:
        is_length = unit_factor("position", vector.unit) is not None
        is_force = unit_factor("force", vector.unit) is not None
        return "position" if is_length else "force" if is_force else "other"
    found = words(vector.label)
    # `X1_mm`: a unit behind a bare axis letter.
    if [w for w in found if not w.isdigit()][-2:-1] == ["*"] and found[-1] in _LENGTHS:
        del found[-1]
    joints = vector.kind.rpartition(" ")[2] if len(vector.fields) == 3 else ""
    if joints in ("position", "effort"):
        return "position" if joints == "position" else "force"
    if joints == "velocity" or (set(found) & _OTHER and found[-1:] != ["force"]):
        return "other"
    for word in reversed(found):
        if word in _FORCE:
            return "force"
        if word in _POSITION or word.startswith(_POSITION_PART) or word.endswith(_POSITION_PART):
            return "position"
    if "Wrench" in vector.kind or "Force" in vector.kind:
        return "force"
    # A bare axis letter, `ncp1.x`, `X1`: a position, but where it is the current of a motor.
    bare = [w for w in found if not w.isdigit()][-1:] == ["*"]
    return "position" if bare and "current" not in found else "other"


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
        best[_key(vector)] = min(best.get(_key(vector), 2), rank(vector))
    chosen = [vector for vector in vectors if rank(vector) == best[_key(vector)]]
    free = [vector for vector in chosen if not _is_commanded(vector)]
    return free if len(free) >= 3 else chosen


def _key(vector: Vector) -> tuple[str, ...]:
    """What a name says of the support: its numbers, else its words that name no quantity."""
    found = words(vector.label)
    numbers = [w for w in found if w.isdigit()]
    general = {"*", "geometry", "msgs", "msg", "tcp", *_FORCE, *_POSITION, *_MEASURED, *_COMMANDED}
    others = [w for w in found if w not in general and not w.endswith(_POSITION_PART)]
    return tuple(numbers or others)


def _paired(positions: Sequence[Vector], forces: Sequence[Vector]) -> list[_Pair]:
    """Pair by equal keys where these are unique, else by their order."""
    keys_p, keys_f = list(map(_key, positions)), list(map(_key, forces))
    common = [k for k in keys_p if keys_p.count(k) == 1 and keys_f.count(k) == 1 and k]
    if len(common) >= 3:
        named = [f"ncp{k[0]}" if len(k) == 1 and k[0].isdigit() else "_".join(k) for k in common]
        return [
            _Pair(name, positions[keys_p.index(k)], forces[keys_f.index(k)])
            for name, k in zip(named, common, strict=True)
        ]
    if len(positions) != len(forces):
        return []
    both = enumerate(zip(positions, forces, strict=True), 1)
    return [_Pair(f"ncp{i}", position, force) for i, (position, force) in both]


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
    there = f"the log has {len(pairs)} supports, the rig {rig.n}"
    return pairs, [f"{there}; the names are not the rig's"]


def _force_on(pairs: Sequence[_Pair], rig: Rig | None) -> tuple[Literal["terminal", "sensor"], str]:
    """The NCPs push the terminal up: a sum that points down is that of the reactions."""
    forces = resampled([q.force for q in pairs])
    if rig is not None and [p.support for p in pairs] == list(rig.supports):
        forces = np.einsum("nij,nkj->nki", so3.from_rpy(rig.nominal_rpy), forces)
    total = forces.sum(axis=0).mean(axis=0)
    on: Literal["terminal", "sensor"] = "terminal" if total[2] > 0 else "sensor"
    way = "up" if on == "terminal" else "down"
    note = f"force_on: {on}, as the forces' sum points {way} along the sensors' z"
    if abs(total[2]) < 0.5 * float(np.linalg.norm(total)):
        note += "; it is far from vertical, so check this"
    return on, note
