"""What is in a log: fields, clocks, dwells, and a mapping guessed for a file never seen before."""

from tdfscal.logs.description.describe import LogInfo, inspect_logs
from tdfscal.logs.description.mapping_text import mapping_block

__all__ = ["LogInfo", "inspect_logs", "mapping_block"]
