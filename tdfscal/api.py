"""What `import tdfscal` offers: all that the commands do, for scripts and notebooks."""

from __future__ import annotations

from collections.abc import Sequence
from os import PathLike
from pathlib import Path
from typing import TYPE_CHECKING

import numpy as np

from tdfscal import logs
from tdfscal.dwells import DwellOptions, find_dwells
from tdfscal.errors import TdfscalError
from tdfscal.files.calibration.document import Calibration, load_calibration, save_calibration
from tdfscal.files.rig.reading import LoadedRig, load_rig
from tdfscal.records import Dwells, Log
from tdfscal.selfcal.pipeline import Estimator
from tdfscal.workflows.calibrate import Method
from tdfscal.workflows.calibrate import calibrate as calibrate_campaign

if TYPE_CHECKING:
    import pandas as pd

Paths = str | PathLike[str] | Sequence[str | PathLike[str]]


def _listed(paths: Paths) -> list[Path]:
    if isinstance(paths, str | PathLike):
        return [Path(paths)]
    return [Path(p) for p in paths]


def read_log(paths: Paths, rig: LoadedRig, *, salvage: bool = False) -> Log:
    """Read one or several recorded logs of a campaign into memory, SI units.

    Raises UsageError, RigError, DataError.
    """
    return logs.read_log(_listed(paths), rig.log, rig.rig.supports, salvage=salvage)


def calibrate(
    paths: Paths,
    *,
    rig: str | PathLike[str] | None = None,
    method: Method | None = None,
    estimator: Estimator = "ml",
    trials: int | None = None,
    seed: int = 0,
    salvage: bool = False,
) -> Calibration:
    """Calibrate from a campaign folder, or from logs with a rig file.

    The result may be rejected: look at `.status` and `.quality.reasons`.
    `workflows.calibrate.calibrate` takes the same and also returns the records behind the result.

    Raises TdfscalError by cause.
    """
    return calibrate_campaign(
        _listed(paths),
        rig=Path(rig) if rig is not None else None,
        method=method,
        estimator=estimator,
        trials=trials,
        seed=seed,
        salvage=salvage,
    ).calibration


def angles_frame(calibration: Calibration) -> pd.DataFrame:
    """One row per angle: support, angle, value, std, low, high, in rad."""
    import pandas as pd

    rows = [
        (support.name, angle, support.rpy[j], support.rpy_std[j],
         support.rpy_interval.low[j], support.rpy_interval.high[j])
        for support in calibration.supports
        for j, angle in enumerate(("roll", "pitch", "yaw"))
    ]  # fmt: skip
    return pd.DataFrame(rows, columns=["support", "angle", "value", "std", "low", "high"])


def dwells_frame(dwells: Dwells) -> pd.DataFrame:
    """One row per dwell and support: times in s, mean position in m, force and its std in N."""
    import pandas as pd

    K, n = dwells.force.shape[:2]
    std = np.sqrt(np.diagonal(dwells.force_cov, axis1=2, axis2=3))
    columns = {
        "dwell": np.repeat(np.arange(K), n),
        "support": np.tile(np.array(dwells.supports), K),
        "start": np.repeat(dwells.start, n),
        "end": np.repeat(dwells.end, n),
        "samples": dwells.count.ravel(),
    }
    for j, axis in enumerate("xyz"):
        columns[axis] = dwells.position[..., j].ravel()
    for j, axis in enumerate("xyz"):
        columns[f"f{axis}"] = dwells.force[..., j].ravel()
        columns[f"f{axis}_std"] = std[..., j].ravel()
    return pd.DataFrame(columns)


__all__ = [
    "Calibration",
    "DwellOptions",
    "Dwells",
    "LoadedRig",
    "Log",
    "TdfscalError",
    "angles_frame",
    "calibrate",
    "dwells_frame",
    "find_dwells",
    "load_calibration",
    "load_rig",
    "read_log",
    "save_calibration",
]
