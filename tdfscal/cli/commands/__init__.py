"""The commands, in the order in which the help lists them.

Each module declares its options and imports what it needs inside the command, so that the help
stays light.
"""

from tdfscal.cli.commands import (
    apply,
    calibrate,
    compare,
    export,
    info,
    plan,
    register,
    report,
    schema,
    simulate,
    study,
    studycontrol,
    validate,
)

__all__ = [
    "apply",
    "calibrate",
    "compare",
    "export",
    "info",
    "plan",
    "register",
    "report",
    "schema",
    "simulate",
    "study",
    "studycontrol",
    "validate",
]
