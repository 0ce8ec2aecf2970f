"""Command lines, how each ends and what it says: of every command each outcome."""

from collections.abc import Callable
from dataclasses import dataclass
from typing import Any

import yaml

import tdfscal
from tdfscal.cli import app

COMMANDS = {name: app.made(name) for name in app.COMMANDS}


@dataclass(frozen=True)
class Case:
    """A command line, how it ends, and what it then says: the result, or the message.

    line : the output of an error is the file `kept` of the folder `out`.
    """

    line: str
    status: int
    said: str

    @property
    def command(self) -> str:
        return self.line.split()[0]


def function_of(command: str) -> Callable[..., Any]:
    """The Python function of a command."""
    function: Callable[..., Any] = getattr(tdfscal, command)
    return function


def called(line: str) -> Any:
    """What Python makes of the words of a command line."""
    name, *words = line.split()
    parameters = COMMANDS[name].params
    of = {option: p for p in parameters for option in p.opts}
    given: list[Any] = []
    options: dict[str, Any] = {}
    rest = iter(words)
    for word in rest:
        if word not in of:
            given.append(word)
        else:
            flag = getattr(of[word], "is_flag", False)
            options[str(of[word].name)] = True if flag else yaml.safe_load(next(rest))
    *single, last = (p for p in parameters if p.param_type_name == "argument")
    if last.nargs == -1:
        given[len(single) :] = [given[len(single) :]]
    return function_of(name)(*given, **options)


FAST = "--postures 4"
#: What both the command line and Python may be asked.
CASES = [
    Case("apply own.yaml campaign -o out/w.csv --filter kalman", 0, "filter kalman"),
    Case("apply own.yaml badrig -o out/kept.csv", 2, "mass"),
    Case("apply own.yaml damaged -o out/kept.csv", 3, "log.parquet"),
    Case("calibrate campaign --trials 20 -o out/c.yaml", 0, "ACCEPTED"),
    Case("calibrate campaign --method tracker --trials 50 -o out/t.json", 0, "ACCEPTED"),
    Case("calibrate campaign -o out/kept.yaml --estimator linear --trials 50", 1, "linear method"),
    Case("calibrate strict -o out/kept.yaml --html out/page.html --trials 0", 1, "REJECTED"),
    Case("calibrate strict -o out/rejected.yaml --trials 0 --allow-rejected", 1, "REJECTED"),
    Case("calibrate campaign -o out/kept.txt", 2, ".json"),
    Case("calibrate campaign --method tracker --samples moving", 2, "leave one of the two out"),
    Case("calibrate damaged -o out/kept.yaml", 3, "log.parquet"),
    Case("calibrate brief -o out/kept.yaml --trials 0 --html out/page.html", 4, "page.html shows"),
    Case("capability own.yaml turned", 1, "NO THRESHOLDS FOR A MACHINE"),
    Case("capability own.yaml brief", 0, "smallest contact"),
    Case("capability own.yaml damaged", 3, "log.parquet"),
    Case("compare own.yaml survey.json", 0, "E_n"),
    Case("compare own.yaml survey.json rejected.yaml", 1, "Not verified: rejected"),
    Case("compare own.yaml", 2, "two files"),
    Case("compare own.yaml broken.yaml", 3, "broken.yaml"),
    Case("export own.yaml --to urdf --parent base", 0, "<robot"),
    Case("export rejected.yaml --to ros --allow-rejected", 0, "REJECTED"),
    Case("export rejected.yaml --to ros -o out/kept.yaml", 1, "--allow-rejected"),
    Case("export rejected.yaml --to urdf -o out/kept.urdf", 1, "--allow-rejected"),
    Case("export rejected.yaml --to csv -o out/kept.csv", 1, "--allow-rejected"),
    Case("export own.yaml --to ros -o own.yaml", 2, "replace an input"),
    Case("export own.yaml --to urdf -o out/kept.csv", 2, ".urdf"),
    Case("export broken.yaml --to csv -o out/kept.csv", 3, "broken.yaml"),
    Case("info campaign", 0, "Mapping"),
    Case("info hollow", 2, "no log"),
    Case("info empty.csv", 3, "empty.csv"),
    Case("init campaign", 0, "# confirm"),
    Case("init nowhere", 2, "nowhere"),
    Case("init empty.csv -o out/kept.yaml", 3, "empty.csv"),
    Case("monitor own.yaml survey.json", 0, "NO ALARM"),
    Case("monitor own.yaml turned", 1, "ALARM"),
    Case("monitor own.yaml", 2, "no history"),
    Case("monitor own.yaml broken.yaml", 3, "broken.yaml"),
    Case(f"plan campaign -o out/plan.csv --travel ncp1=0.4,0.4,0.4 {FAST}", 0, "out/plan.csv"),
    Case("plan nowhere -o out/kept.csv", 2, "nowhere"),
    Case(f"plan campaign -o out/kept.csv --squeeze 0 --noise 1 {FAST}", 4, "do not determine"),
    Case("register moved.csv points.csv", 0, "6 points fit"),
    Case("register moved.csv nowhere.csv", 2, "nowhere.csv"),
    Case("register moved.csv unitless.csv", 3, "unit"),
    Case("register line.csv line.csv", 4, "line"),
    Case("report own.yaml survey.json", 0, "survey.json"),
    Case("report rejected.yaml", 0, "REJECTED"),
    Case("report nowhere.yaml --html out/kept.html", 2, "nowhere.yaml"),
    Case("report broken.yaml --html out/kept.html", 3, "broken.yaml"),
    Case("simulate out/new --postures 3 --rate 10", 0, "out/new"),
    Case("simulate campaign", 2, "campaign"),
    Case("update own.yaml turned -o out/kept.yaml --trials 0", 1, "REJECTED"),
    Case("update own.yaml brief -o out/u.yaml --trials 0", 0, "ACCEPTED"),
    Case("update rejected.yaml brief -o out/r.yaml --trials 0", 0, "ACCEPTED"),
    Case("update own.yaml campaign -o out/kept.yaml", 2, "the same recording"),
    Case("update own.yaml damaged -o out/kept.yaml", 3, "log.parquet"),
    Case("validate own.yaml campaign", 0, "NOT CONTRADICTED"),
    Case("validate own.yaml turned --html out/v.html", 1, "RECALIBRATE"),
    Case("validate rejected.yaml turned", 1, "NOT FIT FOR USE"),
    Case("validate campaign own.yaml", 2, "a calibration file is wanted here"),
    Case("validate own.yaml damaged", 3, "log.parquet"),
]
#: Mistakes that a person makes in writing a command: the status, and words of the cure.
MISTAKES = [
    Case("calibrate campaign --html - -o out/kept.yaml", 2, "standard output"),
    Case("validate own.yaml campaign --html -", 2, "standard output"),
    Case("report own.yaml --html -  --json", 2, "name a file"),
    Case("report - -", 2, "once only"),
    Case("report own.yaml own.yaml", 2, "name each file once"),
    Case("calibrte campaign", 2, "did you mean 'calibrate'"),
    Case("calibrate", 2, "Example: tdfscal calibrate campaign"),
    Case("calibrate campain", 2, "campain: there is no such file or folder"),
    Case("calibrate campaign --trials -5", 2, "give 0 or more"),
    Case("calibrate campaign --method slef", 2, "'self', 'tracker', 'joint'"),
    Case("calibrate campaign -o nowhere/deep/result.yaml", 2, "folder"),
    Case("calibrate campaign --html page.pdf", 2, ".html"),
    Case("calibrate campaign --from noon", 2, "12.5, 1.5min or 2h"),
    Case("calibrate move.csv", 2, "--rig"),
    Case("apply own.yaml campaign -o wrench.xls", 2, ".csv, .parquet or .mcap"),
    Case("apply own.yaml campaign -o wrench.csv --at 1,2", 2, "--at"),
    Case("validate campaign/rig.yaml campaign", 2, "is a rig file; a calibration file is wanted"),
    Case("capability own.yaml", 2, "PATH"),
    Case("capability own.yaml campaign --false-stops 0", 2, "--false-stops"),
    Case("capability own.yaml campaign --detect 1", 2, "--detect"),
    Case("capability own.yaml campaign --filter 120", 2, "--filter"),
    Case("capability own.yaml campaign --filter -3", 2, "--filter"),
    Case("capability own.yaml campaign --at 1,2", 2, "--at"),
    Case("plan campaign -o out/kept.csv --home 1,2", 2, "0,0,0"),
    Case("plan campaign -o plan.csv --travel far", 2, "0.1,0.1,0.2"),
    Case("plan campaign -o plan.csv --travel 0.1 --travel 0.2", 2, "two ranges"),
    Case("plan campaign -o plan.csv --speed 0.1", 2, "--motion"),
    Case("plan campaign -o plan.csv --squeeze 1e40", 2, "too large"),
    Case("plan campaign -o plan.csv --noise 1e308", 2, "too large"),
    Case("plan campaign -o plan.csv --home 1e300,0,0", 2, "0.1,0.1,0.2"),
    Case("capability own.yaml campaign --false-stops 1e308", 2, "too large"),
    Case("simulate new --postures 1000000000", 2, "too large"),
    Case("simulate new --scenario zero-shft", 2, "the nearest one is 'zero-shift'"),
    Case("-x", 2, "--help"),
]
