"""tdfscal: calibrates how three-axis force sensors are mounted on a parallel mechanism.

>>> import tdfscal
>>> result = tdfscal.calibrate("sample_data/parquet", trials=0)
>>> result.status
'accepted'
>>> result.to_frame().shape
(9, 6)
>>> tdfscal.validate(result, "sample_data/parquet").holds
True
"""
# ruff: noqa: F403, F405 - what the names are is said once, in `tdfscal.api`

__version__ = "1.0.0"

TYPE_CHECKING = False
if TYPE_CHECKING:
    from typing import Any

    from tdfscal.api import *

#: What is loaded on first use: commands, and what else `tdfscal.api` has.
__all__ = [
    "Calibration",
    "DataError",
    "Dwells",
    "LoadedRig",
    "Log",
    "NotConvergedError",
    "NotIdentifiableError",
    "OutputError",
    "RejectedError",
    "RigError",
    "TdfscalError",
    "UsageError",
    "__version__",
    "apply",
    "calibrate",
    "capability",
    "compare",
    "export",
    "find_dwells",
    "info",
    "init",
    "load_calibration",
    "load_rig",
    "monitor",
    "plan",
    "read_log",
    "register",
    "report",
    "save_calibration",
    "simulate",
    "update",
    "validate",
]


def __getattr__(name: str) -> "Any":
    # Loaded on first use: the command line's help must not wait for numpy.
    if name in __all__:
        from importlib import import_module
        from importlib.util import find_spec

        # A command loads what it needs itself, not all that the others need.
        own = f"{__name__}.commands.{name}"
        module = import_module(own if find_spec(own) else f"{__name__}.api")
        globals()[name] = value = getattr(module, name)
        return value
    raise AttributeError(f"module 'tdfscal' has no attribute {name!r}")


def __dir__() -> list[str]:
    return sorted(__all__)


def _main() -> None:
    from tdfscal.cli import main

    main()
