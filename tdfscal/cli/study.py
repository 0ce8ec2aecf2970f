"""`tdfscal study …`: what several studies share stands once."""

from __future__ import annotations

from pathlib import Path
from typing import Literal

from tdfscal.cli import options as opt
from tdfscal.cli.app import command

_RIG: opt.Options = {
    "rig": opt.RIG,
    "output": opt.output("Folder for tables and figures.", metavar="DIR"),
}
_GIVEN = opt.option(list[Path] | None, None, "What it is worth; may be repeated.", metavar="FILE")
_RUNS = opt.count(20, "Runs per calibration.")
_LENGTH = opt.number(None, "MM", "Length of the engagement, default 333 mm.")
_DISTANCE = opt.number(5.0, "M", "Tracker to rig, m.")
_COMPARED: opt.Options = {
    "calibration": _GIVEN,
    "truth": opt.file("Calibration that is the truth; default all combined."),
    "runs": _RUNS,
}
_MACHINES: opt.Options = {
    "perfect": opt.option(
        bool, True, "Also the best that any calibration could do.", "--perfect/--no-perfect"
    ),
    "mounting": opt.text(
        "R,P,Y", "Simulated mounting: std of roll, pitch, yaw, rad; default 0.02,0.02,0.05."
    ),
    "drift": opt.number(0.0, "N", "Std of the zeros' drift since the calibration.", min=0),
    "tare": opt.option(bool, False, "All tare the wrench at the start."),
    "filter": opt.choice(
        Literal["low-pass", "kalman", "none"], "low-pass", "Filter of the sensors."
    ),
    "walk": opt.number(
        None, "N", "Its random-walk intensity of the contact force; default 15 N/√s."
    ),
    "logs": opt.choice(opt.LOG_FORMATS, None, "Write each run's log."),
}
_IMPEDANCE: opt.Options = {
    "stiffness": opt.text("K[,KR]", "Impedance: stiffness, N/m (and N·m/rad); 10 kN/m."),
    "damping": opt.text("B[,BR]", "Impedance: damping, N·s/m; default the least stable."),
    "virtual_mass": opt.text("M[,MR]", "Impedance: virtual mass, kg; default the real one."),
    "servo": opt.number(None, "HZ", "Bandwidth of the servos, 15 Hz."),
}
_GEARS: opt.Options = {
    "contact_stiffness": opt.number(None, "N/M", "Contact stiffness of a tooth.", min=0),
    "friction": opt.number(None, "MU", "Of the teeth; default 0.15.", min=0),
    "clearance": opt.number(None, "MM", "Radial clearance, default 0.05 mm.", min=0),
}
_SHARED: opt.Options = {
    "seed": opt.SEED,
    "workers": opt.count(None, "Processes; default one per core."),
}


def _study(name: str, text: str, **options: opt.Option) -> None:
    """Make a command of the study of this name; text : what it does."""
    command(None, f"study {name} rig.yaml -o {name}", text, **_RIG, **options)


_study(
    "sensitivity",
    "Contact force and torque error against each installation angle (Fig. 4).",
    calibration=_GIVEN,
    rpy=opt.text("R,P,Y", "A posture beside the aligned one, rad."),
    squeeze=opt.number(200.0, "N", "Internal forces, standard deviation, N.", min=0),
    span=opt.number(0.05, "RAD", "Sweep by ± this."),
    seed=opt.SEED,
    json=opt.JSON,
)
_study(
    "accuracy",
    "Monte Carlo of self-calibration and laser tracker (Figs. 7–9, 12–14, Table 2).",
    calibration=_GIVEN,
    runs=opt.count(1000, "Simulated campaigns per method.", 2),
    postures=opt.count(24, "Postures of a campaign."),
    tilt=opt.number(5.0, "DEG", "Largest tilt, degrees."),
    squeeze=opt.number(200.0, "N", "Commanded internal forces, N."),
    stiffness=opt.number(20.0e6, "N/M", "Of an NCP."),
    distance=_DISTANCE,
    **_SHARED,
    **opt.PRINTED,
)
_study(
    "free-space",
    "Deviation of the terminal in free space under impedance control (Table 4, Fig. 16).",
    **_COMPARED,
    moves=opt.file("CSV of moves instead of the six stated."),
    **_MACHINES,
    **_IMPEDANCE,
    **_SHARED,
    **opt.PRINTED,
)
_study(
    "docking",
    "Contact force and torque while the gears are docked (Figs. 17 and 18).",
    **_COMPARED,
    engagement=_LENGTH,
    **_MACHINES,
    **_IMPEDANCE,
    **_GEARS,
    **_SHARED,
    **opt.PRINTED,
)
_study(
    "success",
    "Probability that the assembly succeeds, against angle error and contact stiffness.",
    runs=opt.count(20, "Runs of each case."),
    errors=opt.text("MRAD,…", "Angle errors, std per axis; default 0.05 to 5 mrad."),
    engagement=opt.number(60.0, "MM", "Length of the engagement, mm."),
    **_IMPEDANCE,
    **_GEARS,
    **_SHARED,
    **opt.PRINTED,
)
_study(
    "paper",
    "Paper against here: Figs. 4, 7–9, 12–14, 16–18, Tables 2 and 3, in one table.",
    runs=_RUNS,
    campaigns=opt.count(200, "Simulated campaigns for the accuracy.", 2),
    engagement=_LENGTH,
    **_SHARED,
    **opt.PRINTED,
)
_study(
    "cost",
    "Cost of self-calibration (static, moving), tracker and both, against their accuracy.",
    assumptions=opt.file("YAML of times and rates that differ from the usual."),
    runs=opt.count(10, "Simulated rigs of each."),
    squeeze=opt.number(200.0, "N", "Commanded internal forces, N.", min=0),
    distance=_DISTANCE,
    seed=opt.SEED,
    **opt.PRINTED,
)
