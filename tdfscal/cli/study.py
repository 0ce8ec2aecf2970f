"""`tdfscal study …`: each option once, each study a list of options."""

from __future__ import annotations

from inspect import Parameter, Signature
from pathlib import Path
from typing import Annotated, Any, Literal

import typer

from tdfscal.cli import options
from tdfscal.cli.app import app
from tdfscal.cli.perform import perform
from tdfscal.cli.words import STUDY, Grouped, example

study = typer.Typer(cls=Grouped, no_args_is_help=True, help="The paper's studies, on any rig.")
app.add_typer(study, name="study", rich_help_panel=STUDY)

Folder = Annotated[
    Path, typer.Option("--output", "-o", metavar="DIR", help="Folder for tables and figures.")
]
#: Type and default of options, by their names; the order is that of the help.
Options = dict[str, tuple[Any, Any]]


def _option(kind: Any, default: Any, *names: str, **more: Any) -> tuple[Any, Any]:
    return kind, typer.Option(default, *names, **more)


def _number(default: float | None, metavar: str, help: str, *names: str, **more: Any) -> Any:
    return _option(float | None, default, *names, metavar=metavar, help=help, **more)


def _text(metavar: str, help: str) -> tuple[Any, Any]:
    return _option(str | None, None, metavar=metavar, help=help)


def _file(help: str) -> tuple[Any, Any]:
    return _option(Path | None, None, metavar="FILE", help=help)


def _count(default: int | None, help: str, least: int = 1) -> tuple[Any, Any]:
    return _option(int | None, default, min=least, help=help)


def _choice(kind: Any, default: str | None, name: str, help: str) -> tuple[Any, Any]:
    return _option(kind, default, name, case_sensitive=False, help=help)


_RIG: Options = {"rig": (options.Rig, Parameter.empty), "output": (Folder, Parameter.empty)}
_GIVEN: Options = {
    "calibration": _option(
        list[Path] | None,
        None,
        "--calibration",
        metavar="FILE",
        help="What it is worth; may be repeated.",
    )
}
_RUNS: Options = {"runs": _count(20, "Runs per calibration.")}
_COMPARED: Options = _GIVEN | {
    "truth": _file("Calibration that is the truth; default all combined."),
    **_RUNS,
}
_LENGTH: Options = {"engagement": _number(None, "MM", "Length of the engagement, default 333 mm.")}
_MACHINES: Options = {
    "perfect": _option(
        bool, True, "--perfect/--no-perfect", help="Also the best that any calibration could do."
    ),
    "mounting": _text(
        "R,P,Y", "Simulated mounting: std of roll, pitch, yaw, rad; default 0.02,0.02,0.05."
    ),
    "drift": _number(0.0, "N", "Std of the zeros' drift since the calibration.", min=0),
    "tare": _option(bool, False, help="All tare the wrench at the start."),
    "filter": _choice(
        Literal["low-pass", "kalman", "none"], "low-pass", "--filter", "Filter of the sensors."
    ),
    "walk": _number(
        None, "N", "Its random-walk intensity of the contact force; default 15 N/√s.", "--walk"
    ),
    "logs": _choice(
        Literal["csv", "parquet", "mcap"] | None, None, "--logs", "Write each run's log."
    ),
}
_IMPEDANCE: Options = {
    "stiffness": _text("K[,KR]", "Impedance: stiffness, N/m (and N·m/rad); 10 kN/m."),
    "damping": _text("B[,BR]", "Impedance: damping, N·s/m; default the least stable."),
    "virtual_mass": _text("M[,MR]", "Impedance: virtual mass, kg; default the real one."),
    "servo": _number(None, "HZ", "Bandwidth of the servos, 15 Hz.", "--servo"),
}
_GEARS: Options = {
    "contact_stiffness": _number(None, "N/M", "Contact stiffness of a tooth.", min=0),
    "friction": _number(None, "MU", "Of the teeth; default 0.15.", min=0),
    "clearance": _number(None, "MM", "Radial clearance, default 0.05 mm.", min=0),
}
_SEED: Options = {"seed": (options.Seed, 0)}
_SHARED: Options = _SEED | {"workers": _count(None, "Processes; default one per core.")}
_JSON: Options = {"json": (options.Json, False)}
_PRINTED: Options = _JSON | {"quiet": (options.Quiet, False)}
_DISTANCE: Options = {"distance": _number(5.0, "M", "Tracker to rig, m.")}


def _study(name: str, text: str, **taken: tuple[Any, Any]) -> None:
    """Make a command of the study of this name; text : its help."""

    def call(**given: Any) -> int:
        if "calibration" in given:
            given["calibration"] = given["calibration"] or ()
        return perform(f"study.{name}", given).exit_status

    call.__doc__ = text
    parameters = [
        Parameter(option, Parameter.KEYWORD_ONLY, annotation=kind, default=default)
        for option, (kind, default) in taken.items()
    ]
    call.__signature__ = Signature(parameters)  # type: ignore[attr-defined]
    shown = name.replace("_", "-")
    study.command(shown, epilog=example(f"tdfscal study {shown} rig.yaml -o {shown}"))(call)


_study(
    "sensitivity",
    "Contact force and torque error against each installation angle (Fig. 4).",
    **_RIG,
    **_GIVEN,
    rpy=_text("R,P,Y", "A posture beside the aligned one, rad."),
    squeeze=_number(200.0, "N", "Internal forces, standard deviation, N.", min=0),
    span=_number(0.05, "RAD", "Sweep by ± this."),
    **_SEED,
    **_JSON,
)
_study(
    "accuracy",
    "Monte Carlo of self-calibration and laser tracker (Figs. 7–9, 12–14, Table 2).",
    **_RIG,
    **_GIVEN,
    runs=_count(1000, "Simulated campaigns per method.", 2),
    postures=_count(24, "Postures of a campaign."),
    tilt=_number(5.0, "DEG", "Largest tilt, degrees."),
    squeeze=_number(200.0, "N", "Commanded internal forces, N."),
    stiffness=_number(20.0e6, "N/M", "Of an NCP."),
    **_DISTANCE,
    **_SHARED,
    **_PRINTED,
)
_study(
    "free_space",
    "Deviation of the terminal in free space under impedance control (Table 4, Fig. 16).",
    **_RIG,
    **_COMPARED,
    moves=_file("CSV of moves instead of the six stated."),
    **_MACHINES,
    **_IMPEDANCE,
    **_SHARED,
    **_PRINTED,
)
_study(
    "docking",
    "Contact force and torque while the gears are docked (Figs. 17 and 18).",
    **_RIG,
    **_COMPARED,
    **_LENGTH,
    **_MACHINES,
    **_IMPEDANCE,
    **_GEARS,
    **_SHARED,
    **_PRINTED,
)
_study(
    "success",
    "Probability that the assembly succeeds, against angle error and contact stiffness.",
    **_RIG,
    runs=_count(20, "Runs of each case."),
    errors=_text("MRAD,…", "Angle errors, std per axis; default 0.05 to 5 mrad."),
    engagement=_number(60.0, "MM", "Length of the engagement, mm."),
    **_IMPEDANCE,
    **_GEARS,
    **_SHARED,
    **_PRINTED,
)
_study(
    "paper",
    "Paper against here: Figs. 4, 7–9, 12–14, 16–18, Tables 2 and 3, in one table.",
    **_RIG,
    **_RUNS,
    campaigns=_count(200, "Simulated campaigns for the accuracy.", 2),
    **_LENGTH,
    **_SHARED,
    **_PRINTED,
)
_study(
    "cost",
    "Cost of self-calibration (static, moving), tracker and both, against their accuracy.",
    **_RIG,
    assumptions=_file("YAML of times and rates that differ from the usual."),
    runs=_count(10, "Simulated rigs of each."),
    squeeze=_number(200.0, "N", "Commanded internal forces, N.", min=0),
    **_DISTANCE,
    **_SEED,
    **_PRINTED,
)
