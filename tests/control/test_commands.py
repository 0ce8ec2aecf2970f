"""`tdfscal study free-space` and `docking`, and their logs under `apply` and `info`."""

from __future__ import annotations

import json
from dataclasses import dataclass
from pathlib import Path

import numpy as np
import pyarrow.csv as pa_csv
import pytest

from tdfscal.files.calibration.document import save_calibration
from tdfscal.files.writers.campaign import simulate_to_folder
from tdfscal.reporting.studies import free_space as figures
from tdfscal.simulation import Recorder, make_rig
from tdfscal.studies import cost, docking, free_space, success
from tdfscal.studies.compared_calibrations import KNOWS
from tdfscal.workflows.calibrate import calibrate
from tdfscal.workflows.study.assembly import DockingResult
from tdfscal.workflows.study.paper import PaperResult
from tdfscal.wrench.filtering import Walk
from tests.cli.running import rows, run, shortened

MOVE = "roll,pitch,yaw,x,y,z,roll,pitch,yaw,x,y,z\n0,0,0,0,0,0,0.01,0,0,0,0,0.002\n"


@dataclass(frozen=True)
class Bench:
    """A campaign folder, its calibration, one of another rig, and a table of one move."""

    rig: Path
    calibration: Path
    other: Path
    moves: Path


@pytest.fixture(scope="module")
def bench(tmp_path_factory: pytest.TempPathFactory) -> Bench:
    home = tmp_path_factory.mktemp("control")
    for name, rig in (("rig", None), ("heavier", make_rig(mass=600.0))):
        simulate_to_folder(
            home / name, rig, postures=12, rows="postures", recorder=Recorder(mean_sd=0.1)
        )
        save_calibration(calibrate([home / name], trials=0), home / f"{name}.yaml")
    (home / "moves.csv").write_text(MOVE, encoding="utf-8")
    return Bench(home / "rig", home / "rig.yaml", home / "heavier.yaml", home / "moves.csv")


def test_docking(
    bench: Bench,
    tmp_path: Path,
    monkeypatch: pytest.MonkeyPatch,
    capsys: pytest.CaptureFixture[str],
) -> None:
    shortened(monkeypatch, docking.Setup, gap=5e-4, ramp=0.2)
    drawn = DockingResult.drawings
    monkeypatch.setattr(DockingResult, "drawings", lambda self: drawn(self)[-1:])
    out = tmp_path / "out"
    line = ("study", "docking", bench.rig, "-o", out, "--runs", 1, "--engagement", 8, "--seed", 2)
    options = ("--perfect", "--filter", "kalman", "--walk", 5, "--mounting", "1e-3,1e-3,0.01")
    seen = run(capsys, *line, *options, "-q", "--json")
    assert seen.status == 0, seen.err
    document = json.loads(seen.out)
    assert [c["name"] for c in document["calibrations"]] == list(KNOWS)
    assert document["filter_delay"] == pytest.approx(Walk.of(5.0, 1.75, 4e-3).delay)
    assert document["cell"]["virtual_mass"][0] == 500.0
    assert document["calibrations"][0]["angle_error"] < 0.02
    assert len(document["ratios"]) == len(document["ratios_seen"]) == 14
    paper = {r["of"] for r in document["ratios_seen"] if r["paper"] is not None}
    assert paper == {"tracker", "linear"}  # beside the like ones only
    assert all(r["paper"] is None for r in document["ratios"])
    table = rows(out / "maxima.csv")
    assert len(table) == 8
    for c in document["calibrations"]:
        own = [row for row in table if row["calibration"] == c["name"]]
        assert [row["outcome"] for row in own].count("seated") == c["seated"]
        met = [row for row in own if row["first_contact_s"]]
        force = [np.mean([float(row[f"seen_f{a}_N"]) for a in "xyz"]) for row in met]
        assert c["seen_force"]["runs"] == len(met)
        assert c["seen_force"]["mean"] == (pytest.approx(np.mean(force)) if met else None)
    assert (out / "maxima.png").read_bytes().startswith(b"\x89PNG")
    assert "Beside the paper" in (out / "study.html").read_text(encoding="utf-8")


@pytest.mark.parametrize(
    "form", [*(pytest.param(form, marks=pytest.mark.slow) for form in ("csv", "parquet")), "mcap"]
)
def test_the_logs_of_a_run_are_those_of_any_recorder(
    bench: Bench,
    tmp_path: Path,
    monkeypatch: pytest.MonkeyPatch,
    capsys: pytest.CaptureFixture[str],
    form: str,
) -> None:
    """`info` finds every stream, and `apply` finds the wrench that the controller saw."""
    shortened(monkeypatch, free_space.Setup, duration=1.0, rest=3.0)
    if form != "csv":  # figures take their time, and do not depend on the logs
        monkeypatch.setattr(figures, "drawings", lambda study: ())
    out, target = tmp_path / "out", tmp_path / "wrench.csv"
    line = ("study", "free-space", bench.rig, "-o", out, "--calibration", bench.calibration)
    seen = run(capsys, *line, "--moves", bench.moves, "--runs", 1, "--logs", form, "--json", "-q")
    assert seen.status == 0, seen.err
    assert [c["name"] for c in json.loads(seen.out)["calibrations"]] == [
        "none", "rig", "perfect-angles", "perfect",
    ]  # fmt: skip
    if form == "csv":
        assert (out / "free-space.png").read_bytes().startswith(b"\x89PNG")
    log = out / "logs" / f"rig-01.{form}"
    assert f"logs/rig-01.{form}" in json.loads(seen.out)["files"]
    seen = run(capsys, "info", log, "--rig", out / "logs" / "rig.yaml", "--json")
    assert seen.status == 0, seen.err
    seen = run(
        capsys, "apply", bench.calibration, log, "--rig", out / "logs" / "rig.yaml", "-o", target,
        "--json",
    )  # fmt: skip
    assert seen.status == 0, seen.err
    assert json.loads(seen.out)["rows"] == 100  # 4 s at 25 Hz
    wrench = pa_csv.read_csv(target).to_pydict()
    trace = [row for row in rows(out / "traces.csv") if row["calibration"] == "rig"]
    assert len(trace) == 100
    for axis in "xyz":
        found = np.mean(wrench[f"f{axis}"])
        # 1.75 N on three sensors; the trace is smoothed, the log is not.
        noise = 1.75 * np.sqrt(3 / 100)
        said = np.mean([float(row[f"seen_f{axis}"]) for row in trace])
        assert abs(found - said) < 4 * noise


@pytest.mark.slow
def test_success_falls_with_the_angle_error(
    bench: Bench,
    tmp_path: Path,
    monkeypatch: pytest.MonkeyPatch,
    capsys: pytest.CaptureFixture[str],
) -> None:
    shortened(monkeypatch, docking.Setup, gap=0.02, ramp=0.5)
    monkeypatch.setattr(success, "FACTORS", (0.1, 1.0))
    out = tmp_path / "out"
    line = ("study", "success", bench.rig, "-o", out, "--runs", 2, "--engagement", 6)
    seen = run(capsys, *line, "--errors", "0,20", "--workers", 1, "-q", "--json")
    assert seen.status == 0, seen.err
    cases = json.loads(seen.out)["cases"]
    assert [c["angle_std_rad"] for c in cases] == [0.0, 0.02] * 2
    assert cases[1]["contact_N_per_m"] * 10 == pytest.approx(cases[3]["contact_N_per_m"])
    for exact, wrong in (cases[:2], cases[2:]):
        assert exact["succeeded"] == 2
        assert wrong["succeeded"] == 0
        assert wrong["high"] == pytest.approx(1 - 0.025**0.5)
    # A stiffer contact asks for more damping.
    assert cases[2]["damping_Ns_per_m"] > 3 * cases[0]["damping_Ns_per_m"]
    assert (out / "success.png").read_bytes().startswith(b"\x89PNG")


@pytest.mark.slow
def test_paper_against_here(
    bench: Bench,
    tmp_path: Path,
    monkeypatch: pytest.MonkeyPatch,
    capsys: pytest.CaptureFixture[str],
) -> None:
    shortened(monkeypatch, docking.Setup, gap=5e-4, ramp=0.2)
    shortened(monkeypatch, free_space.Setup, duration=0.2, rest=0.1)
    monkeypatch.setattr("tdfscal.reporting.figures.style.save", lambda *a, **k: [])
    monkeypatch.setattr(PaperResult, "drawings", lambda self: ())
    out = tmp_path / "out"
    line = ("study", "paper", bench.rig, "-o", out, "--runs", 2, "--campaigns", 10)
    seen = run(capsys, *line, "--engagement", 4, "--workers", 1, "-q", "--json")
    assert seen.status == 0, seen.err
    document = json.loads(seen.out)
    items = document["items"]
    assert {i["figure"] for i in items} == {
        "Fig. 4", "Figs. 7–9", "Figs. 12–14", "Table 2", "Table 3", "Fig. 16", "Fig. 17", "Fig. 18",
    }  # fmt: skip
    assert all(i["why"] for i in items)
    by = {(i["figure"], i["quantity"]): i for i in items}
    first = by["Fig. 4", "force at 0.05 rad"]
    assert first["verdict"] == "reproduced"
    assert first["here"] == pytest.approx(81.7, abs=0.05)
    assert by["Table 2", "σ, self − tracker"]["like"] == "like"
    assert by["Table 2", "σ, self (ML) − tracker"]["verdict"] == "unlike"
    assert by["Fig. 18", "force, self"]["paper"] == 4.19
    assert len(rows(out / "paper.csv")) == len(items)
    page = (out / "study.html").read_text(encoding="utf-8")
    assert "Paper against here" in page


@pytest.mark.slow
def test_cost_follows_its_assumptions(
    bench: Bench,
    tmp_path: Path,
    monkeypatch: pytest.MonkeyPatch,
    capsys: pytest.CaptureFixture[str],
) -> None:
    monkeypatch.setattr(cost, "POSTURES", (12, 14))
    monkeypatch.setattr(cost, "SECONDS", (20.0,))
    out, assumed = tmp_path / "out", tmp_path / "ours.yaml"
    assumed.write_text("tracker_setup: 2\nperson: 0\nmachine: 100\ntracker: 0\n", encoding="utf-8")
    line = ("study", "cost", bench.rig, "-o", out, "--runs", 2, "--assumptions", assumed)
    seen = run(capsys, *line, "-q", "--json")
    assert seen.status == 0, seen.err
    document = json.loads(seen.out)
    by = {c["method"]: c for c in document["choices"]}
    assert list(by) == ["self, static", "self, moving", "tracker", "joint"]
    # 2 h, 3 sensors of 0.1 h, 3 × (4 + 12) points of 20 s.
    assert by["tracker"]["machine_h"] == pytest.approx(2.3 + 48 * 20 / 3600)
    assert by["tracker"]["people_h"] == pytest.approx(2 * by["tracker"]["machine_h"])
    assert by["self, static"]["machine_h"] == pytest.approx(0.25 + 14 * 7 / 3600)
    for choice in document["choices"]:
        assert choice["cost"] == pytest.approx(100 * choice["machine_h"])
        assert 1e-5 < choice["rms_error_rad"] < 2e-3
    assert by["joint"]["rms_error_rad"] < by["tracker"]["rms_error_rad"]
    assert (out / "cost.png").read_bytes().startswith(b"\x89PNG")
    assumed.write_text("trackr: 2\n", encoding="utf-8")
    seen = run(capsys, *line[:4], tmp_path / "new", *line[5:], "-q")
    assert seen.status == 2
    assert "the nearest known key is `tracker`" in " ".join(seen.err.split())


def test_bad_input_is_refused_with_the_reason(
    bench: Bench, tmp_path: Path, capsys: pytest.CaptureFixture[str]
) -> None:
    out, moves = tmp_path / "out", tmp_path / "moves.csv"
    moves.write_text(MOVE.replace("\n0,0,0,0,", "\n0,0,0,0.4,"), encoding="utf-8")
    broken = tmp_path / "broken.csv"
    broken.write_text("a,b\n1,2\n", encoding="utf-8")
    for study, options, said in (
        ("free-space", ("--calibration", bench.other), "calibration is of another rig: the mass"),
        ("docking", ("--calibration", bench.other), "calibration is of another rig: the mass"),
        ("free-space", ("--moves", moves), "initial posture of move 1: the NCP of ncp1 would"),
        ("free-space", ("--moves", broken), "is no table of moves"),
        ("free-space", ("--moves", tmp_path / "none.csv"), "cannot be read"),
        ("docking", ("--engagement", 1), "lead-in is longer than the engagement"),
        ("docking", ("--walk", 5), "--walk: a walk without a filter"),
        ("docking", ("--filter", "kalman", "--walk", -5), "--walk: a force cannot walk by -5 N"),
        ("docking", ("--mounting", "1,2"), "--mounting"),
        ("docking", ("--mounting", "0,0,0", "--calibration", bench.calibration), "--mounting"),
        ("docking", ("--logs", "xml"), "--logs"),
        ("docking", ("--virtual-mass", 80, "--filter", "none", "--damping", 3e4), "mass of 80 kg"),
        ("docking", ("--damping", "1e3"), "the impedance is unstable in contact"),
        ("docking", ("--stiffness", "1,2,3"), "--stiffness"),
        ("free-space", ("--truth", bench.calibration), "--truth"),
        (
            "free-space",
            ("--truth", bench.calibration, "--calibration", bench.calibration),
            "cannot be its own judge",
        ),
    ):
        seen = run(capsys, "study", study, bench.rig, "-o", out, "--runs", 1, "-q", *options)
        assert seen.status == 2, (options, seen.err)
        assert said in " ".join(seen.err.split()), (said, seen.err)
    assert not out.exists()
