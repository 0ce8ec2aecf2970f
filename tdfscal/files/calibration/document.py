"""The calibration file: what was found, how well, from what, under which convention."""

from pathlib import Path
from typing import Any, Literal, Self, TypeVar

import numpy as np
from pydantic import PrivateAttr, model_validator

from tdfscal.errors import DataError, UsageError
from tdfscal.files.calibration import evidence, parts
from tdfscal.files.calibration.parameters import ALTERED, Parameters, check, status_of
from tdfscal.files.field_types import Count, FreeText, Sha256, Strict, fault, key, open_as_infinite
from tdfscal.files.model_errors import checked, require_format
from tdfscal.files.outputs import check_suffix
from tdfscal.files.rig.reading import EmbeddedRig
from tdfscal.files.saving import content_sha256, to_json, to_yaml, write_text
from tdfscal.files.yaml import Document, Format, as_path, parse_document, read_document
from tdfscal.findings import Finding
from tdfscal.model.parameters import EVEN_TURN
from tdfscal.numerics.so3 import from_directions
from tdfscal.records import BoolArray, FloatArray, Rig, Rotations
from tdfscal.significance import COVERAGE_FACTOR

Array = TypeVar("Array", BoolArray, FloatArray)

CALIBRATION_SUFFIXES = (".json", ".yaml", ".yml")
#: What is said of a file that has a digest and was edited.
_CHANGED = "the file was changed after tdfscal wrote it (its content_sha256 does not match)"


def _read_only(array: Array) -> Array:
    """It is made anew each time that it is asked for: what is written to it would be lost."""
    array.setflags(write=False)
    return array


class Calibration(Strict):
    """The installation rotations of a rig's sensors, with all that belongs to them.

    The fields are those of the file. n supports; rotations take a sensor's frame to the BCS.
    """

    format: Literal["tdfscal-calibration/1"] = key("name and version of this format")
    status: parts.Status = key(
        "the gate's verdict; provisional: accepted, but lines of the rig file are unconfirmed"
    )
    method: parts.Method = key("self, tracker, or joint of both")
    estimator: Literal["ml", "linear"] | None = key("linear: the paper's method", None)
    created: parts.Instant = key("UTC: when the result was computed")
    measured: parts.MeasuredResult = key("when the data were recorded")
    rig: EmbeddedRig = key("the resolved rig file and its sha256, so that this file stands alone")
    software: parts.Software = key("the program that wrote the file")
    command: FreeText = key("the command line, as it was given")
    seed: Count = key("of all random numbers")
    inputs: tuple[parts.Input, ...] = key("files that went in")
    convention: parts.Convention = key("the equation that applies a rotation")
    supports: tuple[parts.SupportResult, ...] = key("one entry per support", min_length=3)
    covariance: parts.Covariance = key("of the rotations of all supports together")
    parameters: Parameters | None = key("all that were free, less what the rig states, SI", None)
    terminal: parts.TerminalResult = key("mass and barycentre after the adjustment")
    fit: parts.FitResult | None = key("how the model fits", None)
    observability: parts.ObservabilityResult | None = key("what the data determine", None)
    budget: evidence.Budget | None = key(
        "contribution of each source to each angle's variance", None
    )
    taken_as_exact: tuple[evidence.ExactQuantityResult, ...] = key(
        "and what its error would do", ()
    )
    monte_carlo: evidence.MonteCarloResult | None = key("JCGM 101", None)
    validation: evidence.ValidationResult | None = key("of held-out postures", None)
    conformity: evidence.ConformityResult | None = key("against acceptance.contact", None)
    drift: dict[Literal["time", "temperature", "parabola"], parts.Slopes] | None = key(
        "how the zeros moved: N/h, N/K, N/h²", None
    )
    tracker: evidence.TrackerResult | None = key("numbers of the survey", None)
    clocks: tuple[evidence.ClockResult, ...] = key("of all recorders but the first", ())
    motion: evidence.MotionResult | None = key("samples in motion, where they were used", None)
    postures: evidence.PostureTable | None = key("the postures in the fit, column by column", None)
    dwells: evidence.DwellTable | None = key("means of all dwells, up to 2000", None)
    campaigns: tuple[evidence.CampaignResult, ...] = key("each of several, by time", ())
    history: tuple[parts.HistoryEntry, ...] = key("what an update stands on", ())
    findings: tuple[parts.FindingResult, ...] = key("all that was found", ())
    content_sha256: Sha256 | None = key(
        "by which an edited file is refused: SHA-256 of Python's `json.dumps(rest, "
        "sort_keys=True, ensure_ascii=False)` in UTF-8, rest being all other keys, at any depth "
        "without those that are null; other programs' files need none",
        None,
        exclude=True,
    )
    """Of all that stands in a file beside it, as tdfscal wrote it; none in files of others."""
    _source: str = PrivateAttr(default="")

    @model_validator(mode="after")
    def _consistent(self) -> Self:
        _check_method(self)
        check(self)
        return self

    def __eq__(self, other: object) -> bool:
        return isinstance(other, Calibration) and self.model_dump() == other.model_dump()

    __hash__ = None  # type: ignore[assignment]

    @property
    def accepted(self) -> bool:
        """The quality gate accepts it, if provisionally; `reasons` says why not."""
        return self.status != "rejected"

    @property
    def unsealed(self) -> bool:
        """It was read from a file without `content_sha256`: nobody vouches for what it says."""
        return self.source != "" and self.content_sha256 is None

    @property
    def source(self) -> str:
        """The file that it was read from; empty for one that is new."""
        return self._source

    @property
    def reasons(self) -> tuple[parts.FindingResult, ...]:
        """The findings by which the quality gate rejects."""
        return tuple(finding for finding in self.findings if finding.severity == "rejects")

    def found(self, *codes: str) -> tuple[parts.FindingResult, ...]:
        """Return the findings of these codes."""
        return tuple(finding for finding in self.findings if finding.code in codes)

    @property
    def support_names(self) -> tuple[str, ...]:
        """Names of the supports, in order."""
        return tuple(support.name for support in self.supports)

    @property
    def mounted(self) -> tuple[parts.Mounting, ...]:
        """The angles of the sensors that the data determine."""
        found = (support.mounting for support in self.supports)
        return tuple(mounting for mounting in found if mounting is not None)

    @property
    def undetermined(self) -> tuple[str, ...]:
        """Sensors that lack an axis and have no rotation."""
        return tuple(support.name for support in self.supports if not support.determined)

    @property
    def determined(self) -> BoolArray:
        """(n,), which sensors have a rotation."""
        return _read_only(np.array([support.determined for support in self.supports]))

    @property
    def rotation(self) -> FloatArray:
        """(n, 3, 3), sensor frame → BCS; where undetermined, one with the directions measured."""
        each = zip(self.supports, self.rig.supports, strict=True)
        found = (s.rotation or from_directions(r.nominal_rpy, s.directions or {}) for s, r in each)
        return _read_only(np.array([np.array(R) for R in found]))

    def _column(self, name: str) -> FloatArray:
        """(n, 3), what the supports state under a key; not a number where that is null."""
        each = [getattr(support, name) for support in self.supports]
        return _read_only(np.array(each, dtype=np.float64))

    @property
    def rpy(self) -> FloatArray:
        """(n, 3), roll, pitch, yaw, rad; not a number where undetermined."""
        return self._column("rpy")

    @property
    def rpy_std(self) -> FloatArray:
        """(n, 3), standard uncertainties of roll, pitch, yaw, rad; ∞ where undetermined.

        Where roll and yaw are not separable: of the turns about the BCS's axes.
        """
        return _read_only(open_as_infinite(self._column("stated_std")))

    @property
    def half_widths(self) -> FloatArray:
        """(m, 3), rad, half of each mounted sensor's intervals, by the farther end.

        Where roll and yaw are not separable: the expanded uncertainty of the turns.
        """
        rows = [(m.rpy, m.rpy_std, m.interval.low, m.interval.high) for m in self.mounted]
        value, std, low, high = np.array(rows, dtype=np.float64).swapaxes(0, 1)
        half = np.maximum(value - low, high - value)
        return _read_only(np.where(np.isnan(half), COVERAGE_FACTOR * std, half))

    @property
    def limit_half_width(self) -> float:
        """acceptance.angle_std as half an interval, rad, by the widest one's coverage factor."""
        half, std = self.half_widths, self.rpy_std[self.determined]
        return float((half / std).flat[half.argmax()] * self.rig.acceptance.angle_std)

    @property
    def rotation_covariance(self) -> FloatArray:
        """(3n, 3n), rad², of d with R_true = exp([d]×) · rotation, d in the BCS.

        A sensor that is undetermined has turns spread evenly over the circle.
        """
        stand = np.repeat(self.determined, 3)
        matrix = np.diag(np.where(stand, 0.0, EVEN_TURN**2))
        matrix[np.ix_(stand, stand)] = self.covariance.matrix
        return _read_only(matrix)

    @property
    def zero(self) -> FloatArray:
        """(n, 3), zero offsets, N, sensor frames; 0 for an axis that is not measured."""
        return _read_only(np.nan_to_num(self._column("zero")))

    @property
    def zero_std(self) -> FloatArray:
        """(n, 3), standard uncertainties of the zero offsets, N; ∞ where they are open.

        An axis that is not measured has none: 0.
        """
        measured = ~np.isnan(self._column("zero"))
        return _read_only(np.where(measured, open_as_infinite(self._column("zero_std")), 0.0))

    @property
    def sensitivity(self) -> FloatArray:
        """(n, 3, 3), I + S; the identity where none was estimated."""
        stated = (support.sensitivity for support in self.supports)
        return _read_only(np.array([np.eye(3) if scale is None else scale for scale in stated]))

    def rotations(self) -> Rotations:
        """Return the rotations with their covariance as a record."""
        return Rotations(self.support_names, self.rotation, self.rotation_covariance)


def _check_method(c: Calibration) -> None:
    """Refuse a verdict, blocks and an equation that do not belong to what was found and done."""
    if c.status != status_of((f.code, f.severity) for f in c.findings):
        raise fault(f"is `{c.status}` against `findings`", "status", hint=ALTERED)
    if c.method == "self" and (None in (c.estimator, c.fit, c.observability)):
        raise fault("lacks `estimator`, `fit` or `observability`, which the method `self` has")
    if c.method == "tracker" and c.estimator is not None:
        raise fault("belongs to self-calibration, not to the method `tracker`", "estimator")
    scaled = any(support.sensitivity is not None for support in c.supports)
    if c.convention != parts.CONVENTIONS[scaled]:
        given = "some supports" if scaled else "no support"
        raise fault(f"does not fit: {given} have a `sensitivity`", "convention")
    for index, (support, rig) in enumerate(zip(c.supports, c.rig.supports, strict=False)):
        if not support.determined and set(rig.axes) == {"x", "y", "z"}:
            raise fault("is missing, though the sensor lacks no axis", "supports", index)
    if not c.determined.any():
        raise fault("have no rotation, none of them", "supports")


def overdue(rig: Rig, day: str, before: str = "") -> tuple[Finding, ...]:
    """Sensors whose own certificate had ended on a day; before : what is of that day."""
    return tuple(
        Finding("sensor-overdue", (name,), values={"due": due, "before": before})
        for due, name in rig.certificates
        if due < day
    )


def unsealed(name: str, c: Calibration) -> tuple[Finding, ...]:
    """It cannot tell whether it was edited."""
    return (Finding("calibration-unsealed", (name,)),) if c.unsealed else ()


def load_calibration(path: Path | str) -> Calibration:
    """Read and check a calibration file, JSON where its suffix is .json, else YAML.

    Raises DataError for what is no calibration file, is of a newer format, or contradicts itself,
    and UsageError where the file cannot be read.
    """
    return _from_document(read_document(as_path(path), DataError))


def parse_calibration(raw: bytes, source: str) -> Calibration:
    """Check the bytes of a calibration file, JSON or YAML; source names it in messages."""
    form: Format = "json" if raw.lstrip().startswith(b"{") else "yaml"
    return _from_document(parse_document(raw, source, DataError, form))


def file_content(calibration: Calibration) -> dict[str, Any]:
    """Return what stands in a calibration file as plain JSON values.

    One that was read without a digest gets none: what nobody vouched for is not sealed.
    """
    # By the file's own serialiser: another would be built for each class that adds methods to it.
    write = Calibration.__pydantic_serializer__.to_python
    content: dict[str, Any] = write(calibration, mode="json", exclude_none=True)
    digest = content_sha256(content)
    for support in content["supports"]:
        for name in ("rotation", "rpy_interval", "quaternion_xyzw"):
            support.setdefault(name, None)
    nothing = dict.fromkeys(parts.FindingResult.model_fields)
    content["findings"] = [nothing | finding for finding in content["findings"]]
    return {**content, "content_sha256": None if calibration.unsealed else digest}


def dump_calibration(calibration: Calibration, form: Format) -> str:
    """Return the text of a calibration file in full double precision."""
    content = file_content(calibration)
    return to_json(content) if form == "json" else to_yaml(content)


def save_calibration(calibration: Calibration, path: Path | str) -> None:
    """Write a calibration file, whole or not at all: .json, or .yaml and .yml.

    Raises UsageError for what is no calibration, another suffix, or where it cannot be written.
    """
    if not isinstance(calibration, Calibration):
        what, hint = f"is no calibration: {calibration!r:.40}", "give what `calibrate` returns"
        raise UsageError(what, where="calibration", hint=hint)
    place = as_path(path)
    check_suffix(place, CALIBRATION_SUFFIXES)
    form: Format = "json" if place.suffix.lower() == ".json" else "yaml"
    write_text(place, dump_calibration(calibration, form))


def _from_document(document: Document) -> Calibration:
    """Check a document: that it is whole, and as it was written where it has a digest."""
    require_format(document, parts.CALIBRATION_FORMAT, DataError)
    stated = document.content.get("content_sha256")
    written = {name: value for name, value in document.content.items() if name != "content_sha256"}
    intact = stated in (None, content_sha256(written))
    try:
        calibration = checked(Calibration, document, DataError)
    except DataError as error:
        if intact:
            raise
        place = str(error.where).removeprefix(document.source).lstrip(", ") or "the top"
        what = f"{_CHANGED}; look at {place}: {error.what}"
        raise error.restated(what=what, where=document.source, hint=ALTERED) from None
    # Other programs write numbers in another notation, and no defaults of a later version.
    own = calibration.model_dump(mode="json", exclude_none=True, exclude_unset=True)
    if not intact and stated != content_sha256(own):
        raise DataError(_CHANGED, where=document.source, hint=ALTERED)
    calibration._source = document.source
    return calibration
