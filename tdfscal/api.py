"""What `import tdfscal` offers: every command as a function, and the steps behind them."""

from __future__ import annotations

from tdfscal import logs
from tdfscal.commands.apply import apply as apply
from tdfscal.commands.calibrate import calibrate as calibrate
from tdfscal.commands.campaign import PathLike, PathLikes, listed
from tdfscal.commands.capability import capability as capability
from tdfscal.commands.compare import compare as compare
from tdfscal.commands.export import export as export
from tdfscal.commands.info import info as info
from tdfscal.commands.init import init as init
from tdfscal.commands.monitor import monitor as monitor
from tdfscal.commands.plan import plan as plan
from tdfscal.commands.register import register as register
from tdfscal.commands.report import report as report
from tdfscal.commands.result import Calibration as Calibration
from tdfscal.commands.result import load_calibration as load_calibration
from tdfscal.commands.simulate import simulate as simulate
from tdfscal.commands.update import update as update
from tdfscal.commands.validate import validate as validate
from tdfscal.dwells import find_dwells as find_dwells
from tdfscal.errors import DataError as DataError
from tdfscal.errors import NotConvergedError as NotConvergedError
from tdfscal.errors import NotIdentifiableError as NotIdentifiableError
from tdfscal.errors import OutputError as OutputError
from tdfscal.errors import RejectedError as RejectedError
from tdfscal.errors import RigError as RigError
from tdfscal.errors import TdfscalError as TdfscalError
from tdfscal.errors import UsageError as UsageError
from tdfscal.files.calibration.document import save_calibration as save_calibration
from tdfscal.files.rig.reading import LoadedRig as LoadedRig
from tdfscal.files.rig.reading import load_rig as load_rig
from tdfscal.files.yaml import as_path
from tdfscal.records import Dwells as Dwells
from tdfscal.records import Log as Log


def read_log(paths: PathLikes, rig: LoadedRig | PathLike) -> Log:
    """Read one or several recorded logs of a campaign into memory, SI units.

    Parameters
    ----------
    paths : log files.
    rig : a loaded rig, or its file.

    Raises
    ------
    UsageError, RigError, DataError
    """
    loaded = rig if isinstance(rig, LoadedRig) else load_rig(as_path(rig))
    return logs.read_log(listed(paths), loaded.log, loaded.rig.supports, axes=loaded.rig.axes)
