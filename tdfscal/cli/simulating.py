"""`tdfscal simulate`."""

from __future__ import annotations

from pathlib import Path

from tdfscal.cli.app import emit
from tdfscal.cli.progress import stages
from tdfscal.cli.rigs import survey_of
from tdfscal.files.rig.reading import load_rig
from tdfscal.files.writers.campaign import LogFormat, simulate_to_folder
from tdfscal.simulation import Recorder


def run(
    folder: Path,
    *,
    rig: Path | None,
    scenario: str,
    format: LogFormat,
    postures: int,
    tilt: float,
    squeeze: float,
    rate: float,
    seed: int,
    force: bool,
    json: bool,
    quiet: bool,
) -> None:
    """Simulate, write the folder, print what to do with it."""
    loaded = load_rig(rig) if rig else None
    stages(quiet=quiet)(f"simulating {postures} postures")
    played = simulate_to_folder(
        folder,
        loaded.rig if loaded else None,
        scenario,
        survey=survey_of(loaded) if loaded else None,
        recorder=Recorder(force_rate=rate, position_rate=rate),
        format=format,
        postures=postures,
        tilt_deg=tilt,
        squeeze=squeeze,
        seed=seed,
        overwrite=force,
    )
    if json:
        emit(
            {
                "folder": str(folder),
                "scenario": played.scenario,
                "rig": played.rig.name,
                "seed": seed,
                "truth": str(folder / "truth.yaml"),
            }
        )
    else:
        print(f"wrote {folder}: now run  tdfscal calibrate {folder}")
