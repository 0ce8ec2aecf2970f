"""Every command but the studies: its purpose, an example, what it does, its options."""

from __future__ import annotations

from pathlib import Path
from typing import Literal

from tdfscal.cli.app import command
from tdfscal.cli.options import (
    ALLOW_REJECTED,
    CALIBRATION,
    FIGURES,
    HTML,
    LOG_FORMATS,
    PART,
    PATHS,
    PRINTED,
    RIG,
    RIG_FILE,
    SALVAGE,
    SEED,
    TRIALS,
    argument,
    choice,
    count,
    file,
    flag,
    number,
    option,
    output,
    text,
    texts,
)
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
    calibration=CALIBRATION,
    paths=PATHS,
    output=output("Result: .csv, .parquet or .mcap."),
    rig=RIG_FILE,
    **PART,
    quasi_static=flag("--quasi-static", "Leave inertia out although the rig file states it."),
    filter=choice(
        Literal["none", "kalman", "smooth"],
        "none",
        "Kalman filter: causal, as a controller's; or smoothed, without delay.",
    ),
    walk=number(
        None, "N", "Random-walk intensity of the contact force, for the filter; default 15 N/√s."
    ),
    at=text("X,Y,Z", "Point of the LCS that moments are about, m.", "0,0,0"),
    figures=FIGURES,
    **PRINTED,
)
command(
    CALIBRATE,
    "calibrate campaign -o calibration.yaml --html report.html",
    "Calibrate the sensors of a rig from a recorded campaign.",
    {"output": "content"},
    paths=PATHS,
    rig=RIG_FILE,
    method=choice(
        Literal["self", "tracker", "joint"],
        None,
        "Default: self where there is a log, else tracker.",
    ),
    samples=choice(
        Literal["static", "moving", "all"],
        None,
        "Default: static where there are dwells enough, else moving.",
    ),
    estimator=choice(
        Literal["ml", "linear"], "ml", "Maximum likelihood, or the paper's linear method."
    ),
    **PART,
    trials=TRIALS,
    seed=SEED,
    output=output(
        "Default: calibration.yaml here; - for stdout.",
        Path("calibration.yaml"),
        show_default=False,
    ),
    json=PRINTED["json"],
    allow_rejected=ALLOW_REJECTED,
    salvage=SALVAGE,
    html=HTML,
    figures=FIGURES,
    quiet=PRINTED["quiet"],
    verbose=flag("--verbose", "Say which stretches of rest were left out.", "-v"),
)
command(
    CHECK,
    "compare last-month.yaml calibration.yaml",
    "Tell whether calibrations agree: differences, joint χ², E_n per angle, verdict.",
    files=argument(list[Path], "A B…", "Calibration files of one rig."),
    **PRINTED,
)
command(
    USE,
    "export calibration.yaml --to urdf -o sensors.urdf",
    "Write the rotations for a controller: URDF, ROS, CSV, C, or a draft certificate.",
    {"output": "content"},
    calibration=CALIBRATION,
    to=choice(
        Literal["urdf", "ros", "ros-parameters", "ros-launch", "csv", "c", "dcc", "certificate"],
        ...,
        "Format.",
    ),
    output=output("Default: stdout (-).", Path("-")),
    parent=text("FRAME", "Frame with the BCS's axes (URDF, ROS).", "bcs"),
    schema=file("Check a DCC against this schema file.", "XSD"),
    allow_rejected=flag("--allow-rejected", "Export what the quality gate rejected."),
    **PRINTED,
)
command(
    CALIBRATE,
    "info campaign/log.csv",
    "Show what is in a log: fields, rates, gaps, dwells, problems, a mapping to paste.",
    paths=PATHS,
    rig=RIG_FILE,
    **PART,
    figures=FIGURES,
    **PRINTED,
)
command(
    CALIBRATE,
    "init campaign/log.csv -o campaign/rig.yaml",
    "Write a complete, commented rig.yaml from a log; what to confirm is marked in it.",
    {"output": "yaml"},
    paths=PATHS,
    output=output("Default: stdout (-).", Path("-")),
    **PART,
    **PRINTED,
)
command(
    CHECK,
    "monitor 2026-*.yaml --html history.html",
    "Watch a rig over time: control chart, alarms (status 1), when to calibrate next.",
    files=argument(list[Path], "FILE…", "Calibration files and campaign folders of one rig."),
    rate=number(0.005, None, "False alarms per year where nothing changes."),
    **PART,
    since=text("DATE", "Alarms raised before count no more."),
    html=HTML,
    figures=FIGURES,
    **PRINTED,
)
command(
    PLAN,
    "plan rig.yaml -o plan.csv --postures 24",
    "Choose the postures and squeezes, or the motion, to drive, and say what to expect of them.",
    {"output": "content"},
    rig=RIG,
    output=output("Postures, or the time table, to drive.", metavar="FILE.csv"),
    postures=count(None, "Postures to drive, returns included; default 24."),
    target=number(None, "MRAD", "As many postures as bring every angle within this."),
    tilt=number(5.0, "DEG", "Largest tilt, degrees."),
    squeeze=number(200.0, "N", "Largest internal force at any NCP, N."),
    force_limit=number(None, "N", "Largest force at any NCP in all, N."),
    travel=texts("[NCP=]M[,M,M]", "Way from home, either side, m: of all NCPs, or of one."),
    home=text("X,Y,Z", "LCS origin in the BCS at home, m; default 0,0,0."),
    stiffness=number(None, "N/M", "Of an NCP: squeeze by displacements; else by servoed forces."),
    noise=number(
        None,
        "N",
        "Noise of a posture's mean force per axis, N; default 1, or that of --given; of a motion, "
        "of a mean over a second, default 0.1.",
    ),
    candidates=count(1000, "Postures to choose from."),
    objective=choice(
        Literal["angles", "wrench"], "angles", "The quantity whose uncertainty is minimised."
    ),
    at=text("R,P,Y", "Assembly posture for the contact wrench, rad."),
    given=option(
        list[Path] | None,
        None,
        "Campaign or log recorded already; plan what is next.",
        metavar="PATH",
    ),
    motion=flag("--motion", "Plan a motion without a stop, not postures."),
    duration=number(60.0, "S", "Of the motion, s."),
    speed=number(0.02, "M/S", "Largest speed of a hinge in motion, m/s."),
    waypoints=file("Also write the motion's waypoints for a spline.", "FILE.csv"),
    figures=FIGURES,
    seed=SEED,
    **PRINTED,
)
command(
    CALIBRATE,
    "register measured.csv drawing.csv --unit mm",
    "Fit the rigid transform from reference points to measured ones, with its uncertainty.",
    measured=argument(Path, "MEASURED", "Point file, as measured."),
    reference=argument(Path, "REFERENCE", "Point file, fitted onto it."),
    unit=text("U", "Of files that name none: m, mm, in …"),
    match=choice(
        Literal["name", "point", "order"],
        "name",
        "Pair points by group and name, by name in whatever group, or row by row.",
    ),
    groups=texts("A=B", "Measured group A is reference group B; repeatable."),
    range=number(None, "M", "Instrument: standard uncertainty of its range, m."),
    range_ppm=number(None, "P", "Instrument: what adds to it, ppm of the distance."),
    angle_arcsec=number(None, "A", "Instrument: standard uncertainty of its angles, arcsec."),
    scale=flag("--scale", "Estimate a scale of the reference too."),
    **PRINTED,
)
command(
    CALIBRATE,
    "report calibration.yaml --html report.html",
    "Summarise a calibration file, or several side by side and over time.",
    {"html": "html"},
    files=argument(list[Path], "FILE", "Calibration files; - for stdin."),
    previous=file("The calibration before: what was found, what is left."),
    html=file("Also write one HTML page; - for stdout."),
    figures=FIGURES,
    **PRINTED,
)
command(
    USE,
    "schema schemas",
    "Write the JSON Schemas of the rig, calibration and point files.",
    folder=argument(Path, "DIR", "Where to write.", Path("schemas")),
    **PRINTED,
)
command(
    PLAN,
    "simulate campaign --scenario contact",
    "Write a synthetic campaign with its truth.yaml.",
    folder=argument(Path, "DIR", "Campaign folder to write."),
    rig=RIG_FILE,
    scenario=option(
        str,
        "self",
        f"{', '.join(SCENARIOS[:6])}; or with a fault: {', '.join(SCENARIOS[6:])}.",
        metavar="NAME",
        autocompletion=lambda: list(SCENARIOS),
    ),
    format=choice(LOG_FORMATS, "csv", "Format of the log."),
    postures=count(24, "Number of postures."),
    tilt=number(5.0, None, "Largest tilt, degrees."),
    squeeze=number(200.0, None, "Commanded internal forces, N."),
    rate=number(100.0, None, "Samples per second of all signals.", min=10.0, max=20e3),
    months=count(12, "Campaigns of the scenario months."),
    seed=SEED,
    force=flag("--force", "Replace what is in the folder."),
    **PRINTED,
)
command(
    CALIBRATE,
    "update calibration.yaml this-month -o updated.yaml",
    "Bring a calibration up to date with a new campaign: zeros, load, angles.",
    {"output": "content"},
    calibration=CALIBRATION,
    paths=PATHS,
    output=output("File to write; - for stdout."),
    rig=RIG_FILE,
    **PART,
    trials=TRIALS,
    seed=SEED,
    json=PRINTED["json"],
    allow_rejected=ALLOW_REJECTED,
    salvage=SALVAGE,
    html=HTML,
    quiet=PRINTED["quiet"],
)
command(
    CHECK,
    "validate calibration.yaml check --html check.html",
    "Check a calibration on postures or on a motion without contact: valid, or what changed.",
    calibration=CALIBRATION,
    paths=PATHS,
    rig=RIG_FILE,
    samples=choice(
        Literal["static", "moving"],
        None,
        "Default: static where there are three dwells, else moving.",
    ),
    **PART,
    html=HTML,
    figures=FIGURES,
    **PRINTED,
)
