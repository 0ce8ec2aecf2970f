"""How a caller follows a work: a record of functions that are called as it goes on."""

from __future__ import annotations

from collections.abc import Callable, Sequence
from contextlib import AbstractContextManager, nullcontext
from dataclasses import dataclass
from pathlib import Path

#: Takes the share that is read, from 0 to 1.
Share = Callable[[float], None]


def _unheard(text: str) -> None:
    """Nobody listens."""


def _unseen(paths: Sequence[Path]) -> AbstractContextManager[Share | None]:
    return nullcontext()


@dataclass(frozen=True, slots=True)
class Progress:
    """Called while a command works.

    stage : with the name of each stage that begins. count : with a line of what is done so far.
    reading : with the log files that are read; gives what takes the share of them, or None.
    """

    stage: Callable[[str], None] = _unheard
    count: Callable[[str], None] = _unheard
    reading: Callable[[Sequence[Path]], AbstractContextManager[Share | None]] = _unseen


SILENT = Progress()
