"""Python and the command line: the same options, the same numbers, the same errors."""

from __future__ import annotations

import inspect
import json
import os
from collections.abc import Callable
from dataclasses import dataclass
from pathlib import Path
from typing import Any

import numpy as np
import pandas as pd
import pytest
from matplotlib.figure import Figure
from pyarrow import csv

import tdfscal
from tdfscal.cli import app
from tdfscal.errors import DataError, NotIdentifiableError, RejectedError, RigError, UsageError
from tdfscal.files.calibration.document import file_content
from tests.cli.running import SAMPLES, run

#: What differs from call to call: the time, and how the call was written down.
PASSING = ("content_sha256", "created", "command")
SMALL: dict[str, Any] = {"postures": 4}


@dataclass(frozen=True)
class Both:
    """The same work by the command line and in Python."""

    line: str
    call: Callable[[], Any]


BOTH = [
    Both("calibrate campaign --trials 20 -o out/c.yaml",
         lambda: tdfscal.calibrate("campaign", trials=20, output="out/c.yaml")),
    Both("calibrate campaign --method tracker --trials 50 -o out/t.json",
         lambda: tdfscal.calibrate(Path("campaign"), method="tracker", trials=50)),
    Both("validate own.yaml brief", lambda: tdfscal.validate("own.yaml", "brief")),
    Both("apply own.yaml campaign -o out/w.csv --filter kalman",
         lambda: tdfscal.apply("own.yaml", ["campaign"], output="out/w.csv", filter="kalman")),
    Both("capability own.yaml turned", lambda: tdfscal.capability("own.yaml", "turned")),
    Both("compare own.yaml survey.json rejected.yaml",
         lambda: tdfscal.compare("own.yaml", "survey.json", "rejected.yaml")),
    Both("plan campaign -o out/p.csv --postures 4 --travel ncp1=0.4,0.4,0.4",
         lambda: tdfscal.plan("campaign", output="out/p.csv", travel={"ncp1": (0.4, 0.4, 0.4)},
                              **SMALL)),
    Both("info campaign", lambda: tdfscal.info("campaign")),
    Both("init campaign -o out/rig.yaml", lambda: tdfscal.init("campaign", output="out/rig.yaml")),
    Both("report own.yaml survey.json", lambda: tdfscal.report(["own.yaml", "survey.json"])),
    Both("export own.yaml --to urdf --parent base", lambda: tdfscal.export("own.yaml", "urdf",
                                                                           parent="base")),
    Both("register moved.csv points.csv", lambda: tdfscal.register("moved.csv", "points.csv")),
    Both("update own.yaml brief -o out/u.yaml --trials 0",
         lambda: tdfscal.update("own.yaml", "brief", output="out/u.yaml", trials=0)),
    Both("monitor own.yaml turned", lambda: tdfscal.monitor("own.yaml", "turned")),
    Both("simulate out/new --postures 3 --rate 10 --force",
         lambda: tdfscal.simulate("out/new", postures=3, rate=10.0, force=True)),
    Both("schema out/schemas", lambda: tdfscal.schema("out/schemas")),
]  # fmt: skip

BAD: list[tuple[str, Callable[[], Any], type[tdfscal.TdfscalError]]] = [
    ("calibrate nowhere", lambda: tdfscal.calibrate("nowhere"), UsageError),
    ("calibrate badrig", lambda: tdfscal.calibrate("badrig"), RigError),
    ("calibrate damaged", lambda: tdfscal.calibrate("damaged"), DataError),
    ("calibrate brief --trials 0", lambda: tdfscal.calibrate("brief", trials=0),
     NotIdentifiableError),
    ("calibrate campaign -o out/c.txt",
     lambda: tdfscal.calibrate("campaign", output="out/c.txt"), UsageError),
    ("apply broken.yaml campaign -o out/w.csv",
     lambda: tdfscal.apply("broken.yaml", "campaign", output="out/w.csv"), DataError),
    ("compare own.yaml", lambda: tdfscal.compare("own.yaml"), UsageError),
    ("plan campaign -o out/p.csv --home 1,2",
     lambda: tdfscal.plan("campaign", home="1,2"), UsageError),
    ("export rejected.yaml --to ros", lambda: tdfscal.export("rejected.yaml", "ros"),
     RejectedError),
    ("register line.csv line.csv", lambda: tdfscal.register("line.csv", "line.csv"),
     NotIdentifiableError),
]  # fmt: skip


@pytest.fixture
def here(home: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    """Work in the folder; draw no figures into files, which takes seconds too."""
    monkeypatch.chdir(home)
    monkeypatch.setattr("tdfscal.reporting.html.to_svg", lambda drawing: "<svg></svg>")


COMMANDS = {name: app.made(name) for name in app.COMMANDS}


def named(line: str) -> str:
    """The command of a command line."""
    return line.split()[0]


def function_of(command: str) -> Callable[..., Any]:
    found: Any = tdfscal
    for word in command.split():
        found = getattr(found, word.replace("-", "_"))
    function: Callable[..., Any] = found
    return function


def lasting(document: dict[str, Any]) -> dict[str, Any]:
    """A document without what differs from call to call."""
    return {
        key: [lasting(part) for part in value] if key == "calibrations" else value
        for key, value in document.items()
        if key not in PASSING
    } if isinstance(document, dict) else document  # fmt: skip


@pytest.mark.usefixtures("here")
@pytest.mark.parametrize("both", BOTH, ids=lambda both: both.line)
def test_python_and_json_are_the_same_numbers(
    both: Both, capsys: pytest.CaptureFixture[str]
) -> None:
    """And with `-q`, which stands wherever there is progress, little is said beside the result."""
    quiet = ["-q"] if "quiet" in {p.name for p in COMMANDS[named(both.line)].params} else []
    seen = run(capsys, *both.line.split(), "--json", *quiet)
    assert not seen.err or seen.status == 1 or "rejected" in both.line
    json.loads(seen.out, parse_constant=pytest.fail)
    result = both.call()
    assert result.exit_status == seen.status, seen.err
    assert capsys.readouterr().out == ""
    assert lasting(json.loads(json.dumps(result.to_dict()))) == lasting(json.loads(seen.out))
    assert 1 <= len(repr(result).splitlines()) <= 8
    assert len(repr(result)) < 1000
    assert result._repr_html_().startswith("<")
    frame = result.to_frame()
    assert isinstance(frame, pd.DataFrame)
    assert len(frame)
    if not both.line.startswith("schema"):
        assert isinstance(result.plot(), Figure)


def test_every_command_is_compared() -> None:
    assert {named(both.line) for both in BOTH} == set(COMMANDS)


@pytest.mark.parametrize("command", COMMANDS)
def test_options_have_the_same_names(command: str) -> None:
    """Every option of a command is a parameter of its function, and the other way round."""
    of_cli = {p.name for p in COMMANDS[command].params} - {"json", "quiet", "verbose", "help"}
    parameters = inspect.signature(function_of(command)).parameters
    of_both = {p.name for p in app.described(command).parameters}
    assert of_cli == of_both <= set(parameters)
    assert set(parameters) - of_both <= {"progress", "command"}


@pytest.mark.usefixtures("here")
@pytest.mark.parametrize(("line", "call", "kind"), BAD, ids=[line for line, _, _ in BAD])
def test_errors_are_those_of_the_command(
    line: str,
    call: Callable[[], Any],
    kind: type[tdfscal.TdfscalError],
    capsys: pytest.CaptureFixture[str],
) -> None:
    quiet = ["-q"] if "quiet" in {p.name for p in COMMANDS[named(line)].params} else []
    seen = run(capsys, *line.split(), *quiet)
    with pytest.raises(tdfscal.TdfscalError) as caught:
        call()
    assert isinstance(caught.value, kind)
    assert caught.value.exit_status == seen.status
    said = seen.err.splitlines()[-1]
    assert bare(said) == bare(f"tdfscal: {caught.value}")
    assert "--" not in str(caught.value)


def bare(text: str) -> str:
    """A text whose options are written as on no side."""
    return text.replace("`", "").replace("--", "").replace("_", "-")


@pytest.mark.usefixtures("here")
@pytest.mark.parametrize(
    "call",
    [
        lambda: tdfscal.calibrate("campaign", method="guess"),  # type: ignore[arg-type]
        lambda: tdfscal.calibrate("campaign", trials=-1),
        lambda: tdfscal.plan("campaign", postures=0),
        lambda: tdfscal.export("own.yaml", "matlab"),  # type: ignore[arg-type]
        lambda: tdfscal.simulate("out/x", rate=1.0),
        lambda: tdfscal.load_calibration("own.yaml").plot("nothing"),
        lambda: tdfscal.calibrate(None),  # type: ignore[arg-type]
        lambda: tdfscal.calibrate(""),
        lambda: tdfscal.calibrate([3]),  # type: ignore[list-item]
        lambda: tdfscal.apply("own.yaml", []),
        lambda: tdfscal.report(),
        lambda: tdfscal.report([]),
        lambda: tdfscal.report({}),
        lambda: tdfscal.report(set()),
        lambda: tdfscal.calibrate(b"campaign"),  # type: ignore[arg-type]
        lambda: tdfscal.compare("own.yaml", None),  # type: ignore[arg-type]
        lambda: tdfscal.calibrate("campaign", output=3),  # type: ignore[arg-type]
        lambda: tdfscal.plan("campaign", home=object()),  # type: ignore[arg-type]
        lambda: tdfscal.monitor(np.array(["campaign"])),
        lambda: tdfscal.monitor(np.zeros(3)),
        lambda: tdfscal.monitor(tdfscal.load_calibration("own.yaml"), np.array(["campaign"])),
        lambda: tdfscal.compare("own.yaml", np.array(["own.yaml"])),
        lambda: tdfscal.report(np.array("own.yaml")),
        lambda: tdfscal.calibrate(np.array(["campaign"])),  # type: ignore[arg-type]
    ],
)
def test_arguments_that_the_command_line_cannot_pass(call: Callable[[], Any]) -> None:
    with pytest.raises(UsageError):
        call()


@pytest.mark.usefixtures("here")
@pytest.mark.parametrize(
    ("name", "value"),
    [("samples", 3), ("method", 1.5), ("estimator", "LS"), ("trials", 2.5),
     ("trials", "many"), ("trials", True), ("trials", 10**400 * -1), ("allow_rejected", 1)],
)  # fmt: skip
def test_one_value_that_is_wrong(name: str, value: object) -> None:
    with pytest.raises(UsageError) as caught:
        function_of("calibrate")("campaign", **{name: value})
    assert caught.value.where == name


@pytest.mark.usefixtures("here")
@pytest.mark.parametrize(
    ("call", "said"),
    [
        (
            lambda: tdfscal.calibrate(3),  # type: ignore[arg-type]
            "paths: expected a campaign folder or log files, got 3.",
        ),
        (lambda: tdfscal.calibrate("campaign", from_=3, to=2), "from_, to: 3 s is not before 2 s"),
        (
            lambda: tdfscal.calibrate("campaign", method="joint", samples="all"),
            "`method='joint'` does not go with `samples='all'`: ",
        ),
        (
            lambda: tdfscal.calibrate("hollow"),
            "hollow: there is no rig.yaml. Name the rig file with `rig`.",
        ),
        (lambda: tdfscal.calibrate("junk.yaml"), "junk.yaml: is not a log. "),
        (lambda: tdfscal.calibrate("bin.csv"), "bin.csv: the file is not text. "),
    ],
)
def test_python_is_told_its_own_names(call: Callable[[], Any], said: str) -> None:
    Path("hollow").mkdir(exist_ok=True)
    Path("junk.yaml").write_text("a: 1\n")
    Path("bin.csv").write_bytes(bytes(range(256)) * 20)
    with pytest.raises(tdfscal.TdfscalError) as caught:
        call()
    assert str(caught.value).startswith(said)


@pytest.mark.usefixtures("here")
@pytest.mark.parametrize(
    "call",
    [
        tdfscal.calibrate,
        tdfscal.info,
        tdfscal.init,
        lambda paths: tdfscal.apply("own.yaml", paths),
        lambda paths: tdfscal.validate("own.yaml", paths),
        lambda paths: tdfscal.capability("own.yaml", paths),
        lambda paths: tdfscal.update("own.yaml", paths),
    ],
)
def test_a_path_that_is_named_twice_is_refused(call: Callable[[list[str]], Any]) -> None:
    with pytest.raises(UsageError, match="campaign: is named twice"):
        call(["campaign", "./campaign"])


@pytest.mark.usefixtures("here")
def test_a_command_that_is_no_text_is_kept_as_one() -> None:
    assert tdfscal.calibrate("campaign", trials=0, command="é\udc80").command == "é?"


@pytest.mark.usefixtures("here")
def test_a_calibration_in_memory_is_as_good_as_its_file(
    sample: tdfscal.Calibration, tmp_path: Path
) -> None:
    made = sample
    made.save(tmp_path / "c.json")
    read = tdfscal.load_calibration(tmp_path / "c.json")
    assert read == made
    frame = tdfscal.apply(made, "campaign").to_frame()
    tdfscal.apply(tmp_path / "c.json", "campaign", output=tmp_path / "w.csv")
    written = csv.read_csv(tmp_path / "w.csv").to_pandas()
    pd.testing.assert_frame_equal(frame, written, check_exact=True)


def test_no_name_of_a_calibration_is_pydantics_older_one(sample: tdfscal.Calibration) -> None:
    made = sample
    for name in ("validate", "json", "dict", "copy", "schema", "construct", "parse_obj"):
        assert not hasattr(made, name)
    assert made.validation is not None


def test_progress_is_reported() -> None:
    stages: list[str] = []
    progress = tdfscal.Progress(stage=stages.append)
    tdfscal.calibrate(os.fspath(SAMPLES / "parquet"), trials=0, progress=progress)
    assert len(stages) >= 2


def test_a_file_that_cannot_tell_its_edits_is_used_with_a_warning(
    sample: tdfscal.Calibration, tmp_path: Path
) -> None:
    made = sample
    document = file_content(made)
    whole, bare = tmp_path / "whole.json", tmp_path / "bare.json"
    whole.write_text(json.dumps(document), encoding="utf-8")
    bare.write_text(
        json.dumps({k: v for k, v in document.items() if k != "content_sha256"}), encoding="utf-8"
    )
    for source, expected in ((made, 0), (whole, 0), (bare, 1)):
        for result in (
            tdfscal.export(source, "csv"),
            tdfscal.apply(source, SAMPLES / "parquet", to="+1"),
        ):
            assert sum("has no `content_sha256`" in text for text in result.notes) == expected
