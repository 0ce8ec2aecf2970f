"""`tdfscal study …`."""

from __future__ import annotations

from pathlib import Path
from typing import Annotated, Any, Literal

import typer

from tdfscal.cli.app import Json, Quiet, Rig, Seed, app
from tdfscal.cli.perform import perform
from tdfscal.cli.words import STUDY, Grouped, example

study = typer.Typer(cls=Grouped, no_args_is_help=True, help="The paper's studies, on any rig.")
app.add_typer(study, name="study", rich_help_panel=STUDY)

Filter = Literal["low-pass", "kalman", "none"]
LogFormat = Literal["csv", "parquet", "mcap"]

Folder = Annotated[
    Path, typer.Option("--output", "-o", metavar="DIR", help="Folder for tables and figures.")
]
Calibrations = Annotated[
    list[Path] | None,
    typer.Option("--calibration", metavar="FILE", help="What it is worth; may be repeated."),
]
Runs = Annotated[int, typer.Option(min=1, help="Runs per calibration.")]
Truth = Annotated[
    Path | None,
    typer.Option(metavar="FILE", help="Calibration that is the truth; default all combined."),
]
Perfect = Annotated[
    bool,
    typer.Option("--perfect/--no-perfect", help="Also the best that any calibration could do."),
]


Stiffness = Annotated[
    str | None,
    typer.Option(metavar="K[,KR]", help="Impedance: stiffness, N/m (and N·m/rad); 10 kN/m."),
]
Damping = Annotated[
    str | None,
    typer.Option(metavar="B[,BR]", help="Impedance: damping, N·s/m; default the least stable."),
]
VirtualMass = Annotated[
    str | None,
    typer.Option(metavar="M[,MR]", help="Impedance: virtual mass, kg; default the real one."),
]
ServoBandwidth = Annotated[
    float | None, typer.Option("--servo", metavar="HZ", help="Bandwidth of the servos, 15 Hz.")
]
Contact = Annotated[
    float | None, typer.Option(metavar="N/M", min=0, help="Contact stiffness of a tooth.")
]
Friction = Annotated[
    float | None, typer.Option(metavar="MU", min=0, help="Of the teeth; default 0.15.")
]
Clearance = Annotated[
    float | None, typer.Option(metavar="MM", min=0, help="Radial clearance, default 0.05 mm.")
]
Workers = Annotated[int | None, typer.Option(min=1, help="Processes; default one per core.")]
Mounting = Annotated[
    str | None,
    typer.Option(
        metavar="R,P,Y",
        help="Simulated mounting: std of roll, pitch, yaw, rad; default 0.02,0.02,0.05.",
    ),
]
Drift = Annotated[
    float, typer.Option(metavar="N", min=0, help="Std of the zeros' drift since the calibration.")
]
Tare = Annotated[bool, typer.Option(help="All tare the wrench at the start.")]
Filtered = Annotated[
    Filter, typer.Option("--filter", case_sensitive=False, help="Filter of the sensors.")
]
Walking = Annotated[
    float | None,
    typer.Option(
        "--walk",
        metavar="N",
        help="Its random-walk intensity of the contact force; default 15 N/√s.",
    ),
]
Logs = Annotated[
    LogFormat | None, typer.Option("--logs", case_sensitive=False, help="Write each run's log.")
]


def _perform(name: str, options: dict[str, Any]) -> int:
    if "calibration" in options:
        options["calibration"] = options["calibration"] or ()
    return perform(f"study.{name}", options).exit_status


@study.command(epilog=example("tdfscal study sensitivity rig.yaml -o sensitivity"))
def sensitivity(
    rig: Rig,
    output: Folder,
    calibration: Calibrations = None,
    rpy: Annotated[
        str | None,
        typer.Option(metavar="R,P,Y", help="A posture beside the aligned one, rad."),
    ] = None,
    squeeze: Annotated[
        float, typer.Option(metavar="N", min=0, help="Internal forces, standard deviation, N.")
    ] = 200.0,
    span: Annotated[float, typer.Option(metavar="RAD", help="Sweep by ± this.")] = 0.05,
    seed: Seed = 0,
    json: Json = False,
) -> int:
    """Contact force and torque error against each installation angle (Fig. 4)."""
    return _perform("sensitivity", locals())


@study.command(epilog=example("tdfscal study accuracy rig.yaml -o accuracy"))
def accuracy(
    rig: Rig,
    output: Folder,
    calibration: Calibrations = None,
    runs: Annotated[int, typer.Option(min=2, help="Simulated campaigns per method.")] = 1000,
    postures: Annotated[int, typer.Option(min=1, help="Postures of a campaign.")] = 24,
    tilt: Annotated[float, typer.Option(metavar="DEG", help="Largest tilt, degrees.")] = 5.0,
    squeeze: Annotated[
        float, typer.Option(metavar="N", help="Commanded internal forces, N.")
    ] = 200.0,
    stiffness: Annotated[float, typer.Option(metavar="N/M", help="Of an NCP.")] = 20.0e6,
    distance: Annotated[float, typer.Option(metavar="M", help="Tracker to rig, m.")] = 5.0,
    seed: Seed = 0,
    workers: Workers = None,
    json: Json = False,
    quiet: Quiet = False,
) -> int:
    """Monte Carlo of self-calibration and laser tracker (Figs. 7–9, 12–14, Table 2)."""
    return _perform("accuracy", locals())


@study.command("free-space", epilog=example("tdfscal study free-space rig.yaml -o free-space"))
def free_space(
    rig: Rig,
    output: Folder,
    calibration: Calibrations = None,
    truth: Truth = None,
    runs: Runs = 20,
    moves: Annotated[
        Path | None, typer.Option(metavar="FILE", help="CSV of moves instead of the six stated.")
    ] = None,
    perfect: Perfect = True,
    mounting: Mounting = None,
    drift: Drift = 0.0,
    tare: Tare = False,
    filter: Filtered = "low-pass",
    walk: Walking = None,
    logs: Logs = None,
    stiffness: Stiffness = None,
    damping: Damping = None,
    virtual_mass: VirtualMass = None,
    servo: ServoBandwidth = None,
    seed: Seed = 0,
    workers: Workers = None,
    json: Json = False,
    quiet: Quiet = False,
) -> int:
    """Deviation of the terminal in free space under impedance control (Table 4, Fig. 16)."""
    return _perform("free_space", locals())


@study.command(epilog=example("tdfscal study docking rig.yaml -o docking"))
def docking(
    rig: Rig,
    output: Folder,
    calibration: Calibrations = None,
    truth: Truth = None,
    runs: Runs = 20,
    engagement: Annotated[
        float | None, typer.Option(metavar="MM", help="Length of the engagement, default 333 mm.")
    ] = None,
    perfect: Perfect = True,
    mounting: Mounting = None,
    drift: Drift = 0.0,
    tare: Tare = False,
    filter: Filtered = "low-pass",
    walk: Walking = None,
    logs: Logs = None,
    stiffness: Stiffness = None,
    damping: Damping = None,
    virtual_mass: VirtualMass = None,
    servo: ServoBandwidth = None,
    contact_stiffness: Contact = None,
    friction: Friction = None,
    clearance: Clearance = None,
    seed: Seed = 0,
    workers: Workers = None,
    json: Json = False,
    quiet: Quiet = False,
) -> int:
    """Contact force and torque while the gears are docked (Figs. 17 and 18)."""
    return _perform("docking", locals())


@study.command(epilog=example("tdfscal study success rig.yaml -o success"))
def success(
    rig: Rig,
    output: Folder,
    runs: Annotated[int, typer.Option(min=1, help="Runs of each case.")] = 20,
    errors: Annotated[
        str | None,
        typer.Option(metavar="MRAD,…", help="Angle errors, std per axis; default 0.05 to 5 mrad."),
    ] = None,
    engagement: Annotated[
        float, typer.Option(metavar="MM", help="Length of the engagement, mm.")
    ] = 60.0,
    stiffness: Stiffness = None,
    damping: Damping = None,
    virtual_mass: VirtualMass = None,
    servo: ServoBandwidth = None,
    contact_stiffness: Contact = None,
    friction: Friction = None,
    clearance: Clearance = None,
    seed: Seed = 0,
    workers: Workers = None,
    json: Json = False,
    quiet: Quiet = False,
) -> int:
    """Probability that the assembly succeeds, against angle error and contact stiffness."""
    return _perform("success", locals())


@study.command(epilog=example("tdfscal study paper rig.yaml -o paper"))
def paper(
    rig: Rig,
    output: Folder,
    runs: Runs = 20,
    campaigns: Annotated[
        int, typer.Option(min=2, help="Simulated campaigns for the accuracy.")
    ] = 200,
    engagement: Annotated[
        float | None, typer.Option(metavar="MM", help="Length of the engagement, default 333 mm.")
    ] = None,
    seed: Seed = 0,
    workers: Workers = None,
    json: Json = False,
    quiet: Quiet = False,
) -> int:
    """Paper against here: Figs. 4, 7–9, 12–14, 16–18, Tables 2 and 3, in one table."""
    return _perform("paper", locals())


@study.command(epilog=example("tdfscal study cost rig.yaml -o cost"))
def cost(
    rig: Rig,
    output: Folder,
    assumptions: Annotated[
        Path | None,
        typer.Option(metavar="FILE", help="YAML of times and rates that differ from the usual."),
    ] = None,
    runs: Annotated[int, typer.Option(min=1, help="Simulated rigs of each.")] = 10,
    squeeze: Annotated[
        float, typer.Option(metavar="N", min=0, help="Commanded internal forces, N.")
    ] = 200.0,
    distance: Annotated[float, typer.Option(metavar="M", help="Tracker to rig, m.")] = 5.0,
    seed: Seed = 0,
    json: Json = False,
    quiet: Quiet = False,
) -> int:
    """Cost of self-calibration (static, moving), tracker and both, against their accuracy."""
    return _perform("cost", locals())
