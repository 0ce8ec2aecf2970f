"""`tdfscal simulate`."""

from __future__ import annotations

from enum import StrEnum
from pathlib import Path
from typing import Annotated

import typer

from tdfscal.cli.app import RigFile, Seed, app


class LogFormat(StrEnum):
    """Formats of a simulated log."""

    CSV = "csv"
    PARQUET = "parquet"
    MCAP = "mcap"


@app.command()
def simulate(
    folder: Annotated[Path, typer.Argument(metavar="DIR", help="Campaign folder to write.")],
    rig: RigFile = None,
    scenario: Annotated[
        str, typer.Option(help="self, tracker, or a fault; an unknown name lists them all.")
    ] = "self",
    format: Annotated[LogFormat, typer.Option(help="Format of the log.")] = LogFormat.CSV,
    postures: Annotated[int, typer.Option(min=1, help="Number of postures.")] = 24,
    tilt: Annotated[float, typer.Option(help="Largest tilt, degrees.")] = 5.0,
    squeeze: Annotated[float, typer.Option(help="Commanded internal forces, N.")] = 200.0,
    rate: Annotated[
        float, typer.Option(min=10.0, max=20e3, help="Samples per second of all signals.")
    ] = 100.0,
    seed: Seed = 0,
    force: Annotated[bool, typer.Option("--force", help="Replace what is in the folder.")] = False,
) -> None:
    """Write a synthetic campaign with its truth.yaml."""
    from tdfscal.files.campaign_writer import simulate_to_folder
    from tdfscal.files.rig import load_rig
    from tdfscal.simulation import Recorder, SurveyOptions

    loaded = load_rig(rig) if rig else None
    survey = None
    if loaded is not None and (files := loaded.tracker) is not None:
        survey = SurveyOptions(
            instrument=files.instrument,
            drawing=files.drawing,
            body_misalignment=files.misalignment,
        )
    simulate_to_folder(
        folder,
        loaded.rig if loaded else None,
        scenario,
        survey=survey,
        recorder=Recorder(force_rate=rate, position_rate=rate),
        format=format.value,
        postures=postures,
        tilt_deg=tilt,
        squeeze=squeeze,
        seed=seed,
        overwrite=force,
    )
    print(f"wrote {folder}: now run  tdfscal calibrate {folder}")
