"""tdfscal: calibrates how three-axis force sensors are mounted on a parallel mechanism.

>>> import tdfscal
>>> result = tdfscal.calibrate("sample_data/parquet", trials=0)
>>> result.status
'accepted'
>>> tdfscal.angles_frame(result).shape
(9, 6)
"""

from __future__ import annotations

from typing import TYPE_CHECKING, Any

__version__ = "0.1.0"

if TYPE_CHECKING:
    from tdfscal.api import (
        Calibration,
        DwellOptions,
        Dwells,
        LoadedRig,
        Log,
        TdfscalError,
        angles_frame,
        calibrate,
        dwells_frame,
        find_dwells,
        load_calibration,
        load_rig,
        read_log,
        save_calibration,
    )

__all__ = [
    "Calibration",
    "DwellOptions",
    "Dwells",
    "LoadedRig",
    "Log",
    "TdfscalError",
    "__version__",
    "angles_frame",
    "calibrate",
    "dwells_frame",
    "find_dwells",
    "load_calibration",
    "load_rig",
    "read_log",
    "save_calibration",
]


def __getattr__(name: str) -> Any:
    # Loaded on first use: the command line's help must not wait for numpy.
    if name in __all__:
        from tdfscal import api

        return getattr(api, name)
    raise AttributeError(f"module 'tdfscal' has no attribute {name!r}")


def __dir__() -> list[str]:
    return sorted(__all__)
