"""Python and the command line: the same options, the same numbers, the same errors."""

import inspect
import json
import os
import re
import shutil
from collections.abc import Hashable
from datetime import datetime
from pathlib import Path
from types import NoneType
from typing import Any, get_args

import numpy as np
import pandas as pd
import pytest
from matplotlib.figure import Figure
from pyarrow import csv

import tdfscal
from tdfscal.cli import app
from tdfscal.errors import RejectedError
from tests.cli.cases import CASES, COMMANDS, Case, called, function_of
from tests.cli.running import SAMPLES, Cli, run

#: What differs from call to call: the time, and how the call was written down.
PASSING = ("content_sha256", "created", "command")


def lasting(document: dict[str, Any]) -> dict[str, Any]:
    """A document without what differs from call to call."""
    return {
        key: [lasting(part) for part in value] if key == "calibrations" else value
        for key, value in document.items()
        if key not in PASSING
    } if isinstance(document, dict) else document  # fmt: skip


@pytest.mark.usefixtures("here")
@pytest.mark.parametrize(
    "case", {c.command: c for c in CASES if c.status < 2}.values(), ids=lambda case: case.line
)
def test_python_and_json_are_the_same(case: Case, capsys: pytest.CaptureFixture[str]) -> None:
    """And with `-q`, which stands wherever there is progress, little is said beside the result."""
    quiet = ["-q"] if "quiet" in {p.name for p in COMMANDS[case.command].params} else []
    seen = run(capsys, *case.line.split(), "--json", *quiet)
    said = seen.err.splitlines()
    assert all(line.startswith("tdfscal: ") for line in said)
    if error := json.loads(seen.out).get("error"):
        assert error["code"] == "calibration-rejected"
        with pytest.raises(RejectedError) as caught:
            called(case.line)
        assert case.status == caught.value.exit_status == 1
        return
    json.loads(seen.out, parse_constant=pytest.fail)
    shutil.rmtree("out/new", ignore_errors=True)  # simulate writes into a new folder alone
    result = called(case.line)
    assert result.exit_status == seen.status, seen.err
    assert capsys.readouterr().out == ""
    assert lasting(json.loads(json.dumps(result.to_dict()))) == lasting(json.loads(seen.out))
    document = result.to_dict()
    assert list(document)[:2] == ["command", "findings"]
    assert document["command"] == f"tdfscal.{case.command}"
    of_each = [document, *document.get("comparisons", ())]
    written = {found["code"] for part in of_each for found in part.get("findings", ())}
    assert {found.code for found in getattr(result, "findings", ())} == written
    assert len(repr(result).splitlines()) == 1
    assert 20 < len(repr(result)) < 140
    assert " at 0x" not in repr(result.drawings())
    if not isinstance(result, Hashable):
        assert case.command in ("calibrate", "update")  # equal by content
    else:
        hash(result)
    assert result._repr_html_().startswith("<")
    frame = result.to_frame()
    assert isinstance(frame, pd.DataFrame)
    assert len(frame)
    figure = result.plot(next(iter(result.drawings()), None))
    assert isinstance(figure, Figure)
    assert any(ax.has_data() for ax in figure.axes)
    for ax in figure.axes:  # nothing lies outside
        own = [line for line in ax.lines if line.get_transform() == ax.transData]
        drawn = np.concatenate([[0.0], *(np.asarray(line.get_ydata(), float) for line in own)])
        assert np.nanmax(drawn) <= max(ax.get_ylim())
    for name in ("command", "status", "new"):
        with pytest.raises(AttributeError, match=f"cannot assign to field '{name}'"):
            setattr(result, name, "")


@pytest.mark.parametrize("command", COMMANDS)
def test_options_have_the_same_names(command: str) -> None:
    """Every option of a command is a parameter of its function, and the other way round."""
    of_cli = {p.name for p in COMMANDS[command].params} - {"json", "quiet", "verbose", "help"}
    parameters = inspect.signature(function_of(command)).parameters
    of_both = {p.name for p in app.described(command).parameters}
    assert of_cli == of_both <= set(parameters)
    assert set(parameters) - of_both == {"progress"}


@pytest.mark.usefixtures("here")
@pytest.mark.parametrize(
    "line",
    [
        *("report BARE", "compare BARE survey.json", "report BARE survey.json"),
        *("validate BARE brief", "apply BARE brief -o out/w.csv", "capability BARE brief"),
        *("export BARE --to csv", "monitor BARE survey.json", "update BARE brief -o out/u.yaml"),
    ],
)
def test_a_file_without_digest_is_told_by_whatever_uses_it(line: str, cli: Cli) -> None:
    """And none is shown as if it stated one."""
    own = Path("own.yaml").read_text(encoding="utf-8")
    Path("bare.yaml").write_text(re.sub("content_sha256: .*\n", "", own), encoding="utf-8")
    digest = re.findall(r"content_sha256: (\w+)", own)[0]
    said = cli.json(*line.replace("BARE", "bare.yaml").split(), "-q")
    assert "UNSEALED" in cli("report", "bare.yaml").out.splitlines()[0]
    Path("bare.yaml").unlink()
    assert "calibration-unsealed" in {found["code"] for found in said["findings"]}
    assert digest not in json.dumps(said)


def test_a_function_follows_the_work(capsys: pytest.CaptureFixture[str]) -> None:
    tdfscal.info(SAMPLES / "parquet", progress=print)
    assert capsys.readouterr().out == "reading the log\n"


@pytest.mark.usefixtures("here")
def test_a_calibration_serves_as_its_file(sample: tdfscal.Calibration, tmp_path: Path) -> None:
    made = sample
    made.save(tmp_path / "c.json")
    read = tdfscal.load_calibration(tmp_path / "c.json")
    assert read == made
    frame = tdfscal.apply(made, "campaign").to_frame()
    tdfscal.apply(tmp_path / "c.json", "campaign", output=tmp_path / "w.csv")
    written = csv.read_csv(tmp_path / "w.csv").to_pandas()
    pd.testing.assert_frame_equal(frame, written, check_exact=True)


@pytest.mark.parametrize("command", COMMANDS)
def test_what_is_of_no_kind_that_an_option_takes_is_refused(command: str) -> None:
    """None where it says nothing, a class, bytes and a list of these, which no option takes."""
    for option in app.described(command).parameters:
        kinds = get_args(option.python)
        if {os.PathLike[str], datetime}.isdisjoint(kinds):  # these are read before they are refused
            for given in (object, b"x", [None], *([] if NoneType in kinds else [None])):
                with pytest.raises(tdfscal.UsageError, match=r"expected|is none of"):
                    option.check(given)
