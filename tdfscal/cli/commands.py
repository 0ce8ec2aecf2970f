"""Every command: its purpose, an example, what it does, its options."""

from __future__ import annotations

from pathlib import Path
from typing import Literal

from tdfscal.cli import options as opt
from tdfscal.cli.app import command
from tdfscal.cli.words import CALIBRATE, CHECK, PLAN, USE

#: As the simulation has them, which the help does not import; a test compares.
SCENARIOS = (
    *("self", "tracker", "months", "motion", "approach", "stops"),
    *("contact", "crosstalk", "dead-axis", "drift", "gain", "jolt", "no-squeeze", "saturation"),
    *("soft-supports", "swapped", "turned-frame", "walk", "warming", "zero-shift"),
    *("dead-channel", "load-cells"),
)

command(
    USE,
    "apply calibration.yaml assembly/log.csv -o wrench.csv",
    "Work out the contact force and torque over a whole log.",
    calibration=opt.CALIBRATION,
    paths=opt.PATHS,
    output=opt.output("Result: .csv, .parquet or .mcap."),
    rig=opt.RIG_FILE,
    **opt.PART,
    quasi_static=opt.flag("--quasi-static", "Leave inertia out although the rig file states it."),
    filter=opt.choice(
        Literal["none", "kalman", "smooth"],
        "none",
        "Kalman filter: causal, as a controller's; or smoothed, without delay.",
    ),
    walk=opt.number(
        None, "N", "Random-walk intensity of the contact force, for the filter; default 15 N/√s."
    ),
    at=opt.text("X,Y,Z", "Point of the LCS that moments are about, m.", "0,0,0"),
    figures=opt.FIGURES,
    **opt.PRINTED,
)
command(
    CALIBRATE,
    "calibrate campaign -o calibration.yaml --html report.html",
    "Calibrate the sensors of a rig from a recorded campaign.",
    {"output": "content"},
    paths=opt.PATHS,
    rig=opt.RIG_FILE,
    method=opt.choice(
        Literal["self", "tracker", "joint"],
        None,
        "Default: self where there is a log, else tracker.",
    ),
    samples=opt.choice(
        Literal["static", "moving", "all"],
        None,
        "Default: static where there are dwells enough, else moving.",
    ),
    estimator=opt.choice(
        Literal["ml", "linear"], "ml", "Maximum likelihood, or the paper's linear method."
    ),
    **opt.PART,
    trials=opt.TRIALS,
    seed=opt.SEED,
    output=opt.output(
        "Default: calibration.yaml here; - for stdout.",
        Path("calibration.yaml"),
        show_default=False,
    ),
    json=opt.PRINTED["json"],
    allow_rejected=opt.ALLOW_REJECTED,
    salvage=opt.SALVAGE,
    html=opt.HTML,
    figures=opt.FIGURES,
    quiet=opt.PRINTED["quiet"],
    verbose=opt.flag("--verbose", "Say which stretches of rest were left out.", "-v"),
)
command(
    CHECK,
    "compare last-month.yaml calibration.yaml",
    "Tell whether calibrations agree: differences, joint χ², E_n per angle, verdict.",
    files=opt.argument(list[Path], "A B…", "Calibration files of one rig."),
    **opt.PRINTED,
)
command(
    USE,
    "export calibration.yaml --to urdf -o sensors.urdf",
    "Write the rotations for a controller: URDF, ROS, CSV, C, or a draft certificate.",
    {"output": "content"},
    calibration=opt.CALIBRATION,
    to=opt.choice(
        Literal["urdf", "ros", "ros-parameters", "ros-launch", "csv", "c", "dcc", "certificate"],
        ...,
        "Format.",
    ),
    output=opt.output("Default: stdout (-).", Path("-")),
    parent=opt.text("FRAME", "Frame with the BCS's axes (URDF, ROS).", "bcs"),
    schema=opt.file("Check a DCC against this schema file.", "XSD"),
    allow_rejected=opt.flag("--allow-rejected", "Export what the quality gate rejected."),
    **opt.PRINTED,
)
command(
    CALIBRATE,
    "info campaign/log.csv",
    "Show what is in a log: fields, rates, gaps, dwells, problems, a mapping to paste.",
    paths=opt.PATHS,
    rig=opt.RIG_FILE,
    **opt.PART,
    figures=opt.FIGURES,
    **opt.PRINTED,
)
command(
    CALIBRATE,
    "init campaign/log.csv -o campaign/rig.yaml",
    "Write a complete, commented rig.yaml from a log; what to confirm is marked in it.",
    {"output": "yaml"},
    paths=opt.PATHS,
    output=opt.output("Default: stdout (-).", Path("-")),
    **opt.PART,
    **opt.PRINTED,
)
command(
    CHECK,
    "monitor 2026-*.yaml --html history.html",
    "Watch a rig over time: control chart, alarms (status 1), when to calibrate next.",
    files=opt.argument(list[Path], "FILE…", "Calibration files and campaign folders of one rig."),
    rate=opt.number(0.005, None, "False alarms per year where nothing changes."),
    **opt.PART,
    since=opt.text("DATE", "Alarms raised before count no more."),
    html=opt.HTML,
    figures=opt.FIGURES,
    **opt.PRINTED,
)
command(
    PLAN,
    "plan rig.yaml -o plan.csv --postures 24",
    "Choose the postures and squeezes, or the motion, to drive, and say what to expect of them.",
    {"output": "content"},
    rig=opt.RIG,
    output=opt.output("Postures, or the time table, to drive.", metavar="FILE.csv"),
    postures=opt.count(None, "Postures to drive, returns included; default 24."),
    target=opt.number(None, "MRAD", "As many postures as bring every angle within this."),
    tilt=opt.number(5.0, "DEG", "Largest tilt, degrees."),
    squeeze=opt.number(200.0, "N", "Largest internal force at any NCP, N."),
    force_limit=opt.number(None, "N", "Largest force at any NCP in all, N."),
    travel=opt.texts("[NCP=]M[,M,M]", "Way from home, either side, m: of all NCPs, or of one."),
    home=opt.text("X,Y,Z", "LCS origin in the BCS at home, m; default 0,0,0."),
    stiffness=opt.number(
        None, "N/M", "Of an NCP: squeeze by displacements; else by servoed forces."
    ),
    noise=opt.number(
        None,
        "N",
        "Noise of a posture's mean force per axis, N; default 1, or that of --given; of a motion, "
        "of a mean over a second, default 0.1.",
    ),
    candidates=opt.count(1000, "Postures to choose from."),
    objective=opt.choice(
        Literal["angles", "wrench"], "angles", "The quantity whose uncertainty is minimised."
    ),
    at=opt.text("R,P,Y", "Assembly posture for the contact wrench, rad."),
    given=opt.option(
        list[Path] | None,
        None,
        "Campaign or log recorded already; plan what is next.",
        metavar="PATH",
    ),
    motion=opt.flag("--motion", "Plan a motion without a stop, not postures."),
    duration=opt.number(60.0, "S", "Of the motion, s."),
    speed=opt.number(0.02, "M/S", "Largest speed of a hinge in motion, m/s."),
    waypoints=opt.file("Also write the motion's waypoints for a spline.", "FILE.csv"),
    figures=opt.FIGURES,
    seed=opt.SEED,
    **opt.PRINTED,
)
command(
    CALIBRATE,
    "register measured.csv drawing.csv --unit mm",
    "Fit the rigid transform from reference points to measured ones, with its uncertainty.",
    measured=opt.argument(Path, "MEASURED", "Point file, as measured."),
    reference=opt.argument(Path, "REFERENCE", "Point file, fitted onto it."),
    unit=opt.text("U", "Of files that name none: m, mm, in …"),
    match=opt.choice(
        Literal["name", "point", "order"],
        "name",
        "Pair points by group and name, by name in whatever group, or row by row.",
    ),
    groups=opt.texts("A=B", "Measured group A is reference group B; repeatable."),
    range=opt.number(None, "M", "Instrument: standard uncertainty of its range, m."),
    range_ppm=opt.number(None, "P", "Instrument: what adds to it, ppm of the distance."),
    angle_arcsec=opt.number(None, "A", "Instrument: standard uncertainty of its angles, arcsec."),
    scale=opt.flag("--scale", "Estimate a scale of the reference too."),
    **opt.PRINTED,
)
command(
    CALIBRATE,
    "report calibration.yaml --html report.html",
    "Summarise a calibration file, or several side by side and over time.",
    {"html": "html"},
    files=opt.argument(list[Path], "FILE", "Calibration files; - for stdin."),
    previous=opt.file("The calibration before: what was found, what is left."),
    html=opt.file("Also write one HTML page; - for stdout."),
    figures=opt.FIGURES,
    **opt.PRINTED,
)
command(
    USE,
    "schema schemas",
    "Write the JSON Schemas of the rig, calibration and point files.",
    folder=opt.argument(Path, "DIR", "Where to write.", Path("schemas")),
    **opt.PRINTED,
)
command(
    PLAN,
    "simulate campaign --scenario contact",
    "Write a synthetic campaign with its truth.yaml.",
    folder=opt.argument(Path, "DIR", "Campaign folder to write."),
    rig=opt.RIG_FILE,
    scenario=opt.option(
        str,
        "self",
        f"{', '.join(SCENARIOS[:6])}; or with a fault: {', '.join(SCENARIOS[6:])}.",
        metavar="NAME",
        autocompletion=lambda: list(SCENARIOS),
    ),
    format=opt.choice(opt.LOG_FORMATS, "csv", "Format of the log."),
    postures=opt.count(24, "Number of postures."),
    tilt=opt.number(5.0, None, "Largest tilt, degrees."),
    squeeze=opt.number(200.0, None, "Commanded internal forces, N."),
    rate=opt.number(100.0, None, "Samples per second of all signals.", min=10.0, max=20e3),
    months=opt.count(12, "Campaigns of the scenario months."),
    seed=opt.SEED,
    force=opt.flag("--force", "Replace what is in the folder."),
    **opt.PRINTED,
)
command(
    CALIBRATE,
    "update calibration.yaml this-month -o updated.yaml",
    "Bring a calibration up to date with a new campaign: zeros, load, angles.",
    {"output": "content"},
    calibration=opt.CALIBRATION,
    paths=opt.PATHS,
    output=opt.output("File to write; - for stdout."),
    rig=opt.RIG_FILE,
    **opt.PART,
    trials=opt.TRIALS,
    seed=opt.SEED,
    json=opt.PRINTED["json"],
    allow_rejected=opt.ALLOW_REJECTED,
    salvage=opt.SALVAGE,
    html=opt.HTML,
    quiet=opt.PRINTED["quiet"],
)
command(
    CHECK,
    "validate calibration.yaml check --html check.html",
    "Check a calibration on postures or on a motion without contact: valid, or what changed.",
    calibration=opt.CALIBRATION,
    paths=opt.PATHS,
    rig=opt.RIG_FILE,
    samples=opt.choice(
        Literal["static", "moving"],
        None,
        "Default: static where there are three dwells, else moving.",
    ),
    **opt.PART,
    html=opt.HTML,
    figures=opt.FIGURES,
    **opt.PRINTED,
)
