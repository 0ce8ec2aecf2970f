"""What is known of some logs before anything is calibrated."""

from __future__ import annotations

from dataclasses import dataclass
from typing import Literal

from tdfscal.dwells import Offset
from tdfscal.logs.common.contents import Contents
from tdfscal.logs.description.mapping_guess import Guess
from tdfscal.records import Dwells, InputFile, LogMapping

Source = Literal["rig", "guessed"]


@dataclass(frozen=True, slots=True)
class Signal:
    """One vector signal as it is read with the mapping.

    fields : in the file. count : samples. start, end : s. rate : Hz, None below two samples.
    gaps : intervals of more than five periods; longest : s, the longest interval.
    """

    support: str
    quantity: Literal["position", "force"]
    fields: tuple[str, ...]
    count: int
    start: float
    end: float
    rate: float | None
    gaps: int
    longest: float


@dataclass(frozen=True, slots=True)
class LogInfo:
    """What is in some logs.

    mapping : with which the signals were read: the rig's, or the guess. guess : for the first file.
    problems : what keeps the logs from being used, or wants a look.
    """

    contents: tuple[Contents, ...]
    guess: Guess
    mapping: LogMapping | None
    source: Source
    signals: tuple[Signal, ...] = ()
    inputs: tuple[InputFile, ...] = ()
    dwells: Dwells | None = None
    offset: Offset | None = None
    problems: tuple[str, ...] = ()
