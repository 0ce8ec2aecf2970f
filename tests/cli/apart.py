"""A campaign whose positions and forces were recorded apart, as a folder with a file of each."""

from __future__ import annotations

from pathlib import Path
from typing import Any

import numpy as np

from tdfscal.files.saving import to_yaml
from tdfscal.files.writers.documents import rig_document
from tdfscal.records import Log, Rig


def write_apart(folder: Path, rig: Rig, moves: Log, loads: Log) -> None:
    """Write rig.yaml, cnc.csv (ms, mm, semicolons, decimal commas) and daq.csv (s, kN).

    moves : with the positions alone. loads : with the forces alone, on a clock of its own.
    """
    folder.mkdir(parents=True, exist_ok=True)
    places = {name: [f"X{i}", f"Y{i}", f"Z{i}"] for i, name in enumerate(rig.supports, 1)}
    forces = {name: [f"F{i}{a}" for a in "xyz"] for i, name in enumerate(rig.supports, 1)}
    with (folder / "cnc.csv").open("w", encoding="ascii") as file:
        file.write(";".join(["t", *(c for own in places.values() for c in own)]) + "\n")
        values = np.hstack([series.value for series in moves.position]) * 1e3
        for time, row in zip(moves.position[0].time, values, strict=True):
            line = ";".join([f"{1e3 * time:.3f}", *(f"{value:.4f}" for value in row)])
            file.write(line.replace(".", ",") + "\n")
    with (folder / "daq.csv").open("w", encoding="ascii") as file:
        file.write(",".join(["Time", *(c for own in forces.values() for c in own)]) + "\n")
        values = np.hstack([series.value for series in loads.force]) / 1e3
        for time, row in zip(loads.force[0].time, values, strict=True):
            file.write(",".join([f"{time:.6f}", *(f"{value:.6f}" for value in row)]) + "\n")
    blocks: list[dict[str, Any]] = [
        {
            "files": "cnc*.csv",
            "time": {"field": "t", "unit": "ms"},
            "length_unit": "mm",
            "decimal": ",",
            "supports": {name: {"position": own} for name, own in places.items()},
        },
        {
            "files": "daq*.csv",
            "time": {"field": "Time", "unit": "s"},
            "force_unit": "kN",
            "supports": {name: {"force": own} for name, own in forces.items()},
        },
    ]
    document = rig_document(rig) | {"log": blocks}
    (folder / "rig.yaml").write_text(to_yaml(document), encoding="utf-8")
