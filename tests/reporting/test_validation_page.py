"""The page of `validate --html`: verdict, cause, figure and where it comes from."""

from dataclasses import replace
from functools import cache

from tdfscal.files.calibration.parameters import calibrated
from tdfscal.files.calibration.parts import MeasuredResult
from tdfscal.findings import Finding
from tdfscal.records import CampaignInfo, InputFile, SensorInfo
from tdfscal.reporting.headline import exact_name
from tdfscal.reporting.traceability import Making, report_digest
from tdfscal.reporting.validation import Origin, validation_document
from tdfscal.validation.residual_wrench import Validation, validate
from tests.reporting.pages import render_validation
from tests.reporting.samples import changed, sample
from tests.reporting.test_page import read

LOG = InputFile("march/log.csv", "cd" * 32, 4321, "verified")
COMMAND = "tdfscal validate january.yaml march"


@cache
def validation(push: float, offset: float = 0.0) -> Validation:
    """Of the sample's own dwells; at the third of them something pushes along x, N."""
    dwells = sample().dwells
    force = dwells.force.copy()
    force[2, 0, 0] += push
    times = {name: getattr(dwells, name) + offset for name in ("start", "end")}
    given = calibrated(sample().calibration)
    return validate(given, replace(dwells, force=force, **times), rig=sample().rig.rig)


def origin_of_check() -> Origin:
    """In March, of a calibration of January that was computed in November."""
    told = CampaignInfo("2026-03-02", "A. Muster", "Hall 3", note="doors closed")
    sensors = tuple(SensorInfo(f"T-{i}", f"D-K-{i}", "2027-01-31") for i in (1, 2, 3))
    loaded = sample().rig
    rig = replace(
        loaded,
        rig=replace(loaded.rig, serial="RH-02", campaign=told, sensors=sensors),
        document={**loaded.document, "serial": "RH-02"},
    )
    when = {"begin": "2026-01-07T00:00:00Z", "end": "2026-01-08T00:00:00Z", "source": "log"}
    c = changed(sample().calibration, measured=when, created="2026-11-23T00:00:00Z")
    checked = MeasuredResult(begin="2026-03-02T10:00:00Z", end="2026-03-02T10:00:40Z", source="log")
    making = Making(COMMAND, (LOG,), "2026-03-03T10:00:00Z")
    return Origin(c, "january.yaml", rig, checked, making)


def words(v: Validation, *found: Finding) -> str:
    origin = origin_of_check()
    page = render_validation(v, found, origin)
    assert "http" not in page.split("</style>")[1].split("<svg")[0]
    assert page.count("<svg") == 1
    return " ".join(read(page).words)


def test_still_valid() -> None:
    v = validation(0.0)
    assert v.holds
    said = words(v, Finding("rig-renamed", values={"own": "a warning", "other": "b"}))
    assert "STILL VALID" in said
    assert "Keep this calibration in use" in said
    assert "a warning" in said
    assert f"{len(v.dwells)} of {len(v.dwells)}" in said
    assert all(text in said for text in ("january.yaml", COMMAND, LOG.sha256, "4,321"))
    own = origin_of_check()
    for text in (
        "of 2026-01-08, by the log's own clock, on",  # when it was measured, not computed
        "2026-03-02 10:00:00 UTC to 2026-03-02 10:00:40 UTC",
        "2026-03-03 10:00:00 UTC",
        *("RH-02", "A. Muster", "Hall 3", "doors closed", "T-2", "D-K-2", "2027-01-31"),
        *(str(report_digest(own.calibration)), own.rig.sha256),
        *(exact_name(own.calibration, q.name) for q in own.calibration.taken_as_exact),
        "0.5 % of calibrations that hold",
    ):
        assert text in said
    written = validation_document(v, (), own)
    assert written["command"] == COMMAND
    assert written["inputs"][0]["sha256"] == LOG.sha256
    assert written["rig"] == own.rig.document
    assert written["calibration"]["content_sha256"] == report_digest(own.calibration)
    assert written["calibration"]["measured"]["end"] == "2026-01-08T00:00:00Z"
