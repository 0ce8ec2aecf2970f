"""The rig file `tdfscal-rig/1`: its model, and how it is read."""

from tdfscal.files import RIG_NAME

__all__ = ["RIG_NAME"]
