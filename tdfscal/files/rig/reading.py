"""Reading rig.yaml: from the file to the resolved records."""

from __future__ import annotations

import dataclasses
import re
from collections.abc import Iterable, Mapping, Sequence
from pathlib import Path
from typing import Any, Literal

import numpy as np

from tdfscal.errors import RigError
from tdfscal.files.field_types import Sha256, key
from tdfscal.files.model_errors import checked, require_format
from tdfscal.files.rig.model import RIG_FORMAT, RigFile
from tdfscal.files.rig.recorders import LogBlock, TrackerBlock
from tdfscal.files.yaml import Document, as_path, parse_document, read_document
from tdfscal.findings import Finding
from tdfscal.frozen import record, replace
from tdfscal.records import (
    Acceptance,
    CampaignInfo,
    DeclaredUncertainty,
    Drift,
    Rig,
    SensorInfo,
    UncertainValue,
)

#: s
HOUR = 3600.0
#: What a drift of the record is multiplied by for the file.
DRIFT_UNITS = {"time": HOUR, "temperature": 1.0, "walk": HOUR**0.5, "angle": 1.0}


#: What a line says whose value the user has still to confirm.
_MARK = re.compile(r"#.*\bconfirm\b")
#: Findings whose channels are forces, not positions.
_OF_FORCES = ("forces-exchanged", "sensor-turned")


@record
class LoadedRig:
    """A rig file, resolved.

    log : a block per recorder; none where the file has no log block. tracker : None where it
    declares no survey, or where the rig was read back from a calibration file, which does not carry
    the survey's files.
    path : where it was read. sha256 : of the rig file. document : the rig with its defaults filled
    in, as plain JSON values, to be embedded in a calibration file. unconfirmed : keys, with values
    and lines, that the file still marks to be confirmed.
    """

    rig: Rig
    log: tuple[LogBlock, ...]
    tracker: TrackerBlock | None
    path: Path
    sha256: str
    document: Mapping[str, Any]
    unconfirmed: tuple[str, ...] = ()

    @property
    def averaged(self) -> bool:
        """Whether each row of a log is a posture."""
        return any(recorder.rows == "postures" for recorder in self.log)

    @property
    def crossed(self) -> tuple[str, ...]:
        """Supports whose forces are those of others by the numbers in the names of their fields."""
        numbers: dict[str, list[tuple[str, ...]]] = {"position": [], "force": []}
        for what, found in numbers.items():
            for name in self.rig.supports:
                each = [getattr(block.support_fields(name), what) for block in self.log]
                found.append(_common_numbers([field for fields in each for field in fields or ()]))
        places, forces = numbers.values()
        if not all(places) or len(set(places)) < len(places) or set(places) != set(forces):
            return ()
        pairs = zip(self.rig.supports, places, forces, strict=True)
        return tuple(name for name, place, force in pairs if place != force)

    @property
    def surveys(self) -> tuple[Path, ...]:
        """The tracker's point files, as `TrackerBlock.files` has them; none without a survey."""
        names = self.tracker.files if self.tracker else ()
        return tuple(self.path.parent / name for name in names)

    def written(self, found: Finding) -> Finding:
        """The same; where it says which channels are another's, or out of scale, with the lines."""
        quantity: Literal["position", "force"] = "force" if found.code in _OF_FORCES else "position"
        whole, lines = bool(found.values.get("whole")), list[str]()
        for name, *sources in _threes(found, "moved", "sources"):
            for what in ("position", "force") if whole else (quantity,):
                lines += filter(None, [self._line(name, what, map(int, sources))])
        scales = {
            name: self._recorder(name, quantity).scale(quantity, name)[0]
            for name in (self.rig.supports if found.values.get("turned") else ())
        }
        alike = len(set(scales.values())) == 1
        for name, *signs in _threes(found, "turned", "signs"):
            own = [name] if alike or name in scales else scales
            for one in own:
                scale = scales.get(one, scales[self.rig.supports[0]])
                each = ", ".join(map(_plain, np.multiply(signs, scale).tolist()))
                lines.append(f"`log.supports.{one}.{quantity}_scale: [{each}]`")
        if found.values.get("either"):  # who reads whose force has the position that it read
            order = {str(name): int(at) // 3 for name, at, *_ in _threes(found, "moved", "sources")}
            names = {self.rig.supports[j]: 3 * self.rig.supports.index(i) for i, j in order.items()}
            others = [self._line(name, "position", range(at, at + 3)) for name, at in names.items()]
            found = replace(found, values={**found.values, "others": [*filter(None, others)]})
        return replace(found, values={**found.values, "lines": lines}) if lines else found

    def _line(self, support: str, quantity: str, channels: Iterable[int]) -> str | None:
        """That a support's fields are those of channels; None where one has no field of its own."""
        fields = [self._channel(quantity, at) for at in channels]
        named = ", ".join(filter(None, fields))
        return None if None in fields else f"`log.supports.{support}.{quantity}: [{named}]`"

    def _recorder(self, support: str, quantity: str) -> LogBlock:
        """Who records a support's position or force."""
        logs = self.log or (LogBlock(),)
        return next(log for log in logs if getattr(log.support_fields(support), quantity))

    def _channel(self, quantity: str, at: int) -> str | None:
        """The field of a channel, 3 i + axis; None where it has none of its own."""
        i, axis = divmod(at, 3)
        name = self.rig.supports[i]
        fields = getattr(self._recorder(name, quantity).support_fields(name), quantity)
        measured = self.rig.axes[i] if quantity == "force" else np.ones(3, dtype=np.bool_)
        if len(fields) == 1 and measured.sum() > 1:
            return f"{fields[0]}.{'xyz'[axis]}"
        place = axis if len(fields) == 3 else int(measured[:axis].sum())
        return str(fields[place]) if measured[axis] else None


def _plain(number: float) -> str:
    """To 14 digits, without an exponent."""
    return np.format_float_positional(number, 14, unique=True, fractional=False, trim="-")


def _common_numbers(fields: Sequence[str]) -> tuple[str, ...]:
    """Numbers that all these names have."""
    first, *others = [re.findall(r"\d+", field) for field in fields] or [[]]
    return tuple(number for number in first if all(number in other for other in others))


def _threes(found: Finding, names: str, numbers: str) -> list[tuple[Any, ...]]:
    """Names of a finding, each with its three numbers."""
    of, each = (found.values.get(key) for key in (names, numbers))
    if not isinstance(of, list) or not isinstance(each, list):
        return []
    return list(zip(of, each[::3], each[1::3], each[2::3], strict=True))


class EmbeddedRig(RigFile):
    """A resolved rig within a calibration file. sha256 : of the file it came from."""

    sha256: Sha256 = key("of the rig file")

    def record(self) -> Rig:
        """Return what the mathematics needs of it."""
        return _rig(self)

    def loaded(self, source: str = "calibration") -> LoadedRig:
        """Resolve it, without the survey's files; source : where it was read, for messages."""
        return dataclasses.replace(_resolved(self, Path(source), self.sha256), tracker=None)


def load_rig(path: Path | str) -> LoadedRig:
    """Read and check a rig file.

    Raises RigError for anything wrong in it and UsageError where it cannot be read.
    """
    place = as_path(path)
    return _from_document(read_document(place, RigError), place)


def parse_rig(raw: bytes, source: str) -> LoadedRig:
    """Check the bytes of a rig file; the paths in it are relative to the folder of `source`."""
    return _from_document(parse_document(raw, source, RigError), Path(source))


def _from_document(document: Document, path: Path) -> LoadedRig:
    require_format(document, RIG_FORMAT, RigError)
    loaded = _resolved(checked(RigFile, document, RigError), path, document.sha256)
    marked = {
        number: line[: mark.start()].partition(":")[2].strip()
        for number, line in enumerate(document.text.splitlines(), 1)
        if (mark := _MARK.search(line)) and not line.lstrip().startswith("#")
    }
    found: dict[int, str] = {}
    for place, number in document.lines.items():
        if place and number in marked and number not in found:
            names, content = [], document.content
            for part in place:  # a support goes by its name
                content = content[part]
                own = content.get("name") if isinstance(content, dict) else None
                names.append(str(own or part if isinstance(part, int) else part))
            value = f": {marked[number]}" if marked[number] else ""
            found[number] = f"{'.'.join(names)}{value} (line {number})"
    return dataclasses.replace(loaded, unconfirmed=tuple(found.values()))


def _resolved(file: RigFile, path: Path, sha256: str) -> LoadedRig:
    document = file.model_dump(mode="json", exclude_none=True) | {"sha256": sha256}
    if not isinstance(file, EmbeddedRig):
        document["stated_limits"] = sorted(file.acceptance.model_fields_set)
    return LoadedRig(
        rig=_rig(file),
        log=file.log or (),
        tracker=file.tracker,
        path=path,
        sha256=sha256,
        document=document,
    )


def _rig(file: RigFile) -> Rig:
    supports, terminal, acceptance = file.supports, file.terminal, dict(file.acceptance)
    declared = dict(file.uncertainty)
    contact, compliance = acceptance.pop("contact"), declared.pop("compliance")
    sensors = tuple(SensorInfo(**dict(support.sensor or ())) for support in supports)
    return Rig(
        name=file.name,
        supports=tuple(support.name for support in supports),
        gravity=file.gravity.magnitude,
        gravity_tilt_std=file.gravity.tilt_std,
        mass=terminal.mass.record(),
        barycentre=terminal.barycenter.record(),
        inertia=terminal.inertia.record() if terminal.inertia else None,
        hinge=np.array([support.hinge for support in supports]),
        zero=UncertainValue(
            np.array([support.zero.value for support in supports]),
            np.array([support.zero.std for support in supports]),
        ),
        nominal_rpy=np.array([support.nominal_rpy for support in supports]),
        rpy_std=np.array([support.rpy_std for support in supports]),
        capacity=np.array([support.capacity or (np.inf,) * 3 for support in supports]),
        axes=np.array([[axis in support.axes for axis in "xyz"] for support in supports]),
        declared=DeclaredUncertainty(
            **declared,
            compliance_lateral=compliance.lateral,
            compliance_vertical=compliance.vertical,
        ),
        acceptance=Acceptance(
            **acceptance, **{f"contact_{what}": limit for what, limit in contact or ()}
        ),
        drift=Drift(**{name: value / DRIFT_UNITS[name] for name, value in file.drift}),
        serial=file.serial,
        campaign=CampaignInfo(**dict(file.campaign or ())),
        sensors=sensors if any(support.sensor for support in supports) else (),
    )
