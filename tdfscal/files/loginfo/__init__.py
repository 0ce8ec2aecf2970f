"""What is in a log: fields, clocks, dwells, and a mapping guessed for a file never seen before."""

from tdfscal.files.loginfo.inspect import LogInfo, inspect_logs
from tdfscal.files.loginfo.mapping_text import mapping_block

__all__ = ["LogInfo", "inspect_logs", "mapping_block"]
