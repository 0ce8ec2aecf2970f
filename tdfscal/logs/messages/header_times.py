"""Whether a topic's header times can be the time of its samples."""

from __future__ import annotations

import struct
from collections.abc import Callable
from typing import Final

import numpy as np

from tdfscal.errors import DataError
from tdfscal.logs.common.clock import Clock
from tdfscal.logs.common.damage import one_line
from tdfscal.logs.messages.buffer import Messages
from tdfscal.records import FloatArray

MAX_DEPARTURE: Final = 1.0
"""s; header times that leave their usual distance to the recorder's by more are no times."""


class Stamps:
    """Header times of one topic, followed from chunk to chunk.

    Parameters
    ----------
    topic : its name.
    read : (N,), s, the header times of N messages; raises ValueError where there is none.
    """

    def __init__(self, topic: str, read: Callable[[Messages], FloatArray]) -> None:
        self._topic, self._read = topic, read
        self._clock = Clock(topic, "", "timeseries")
        self._usual = np.nan
        self._departure = 0.0
        self._last = np.full((2, 1), np.nan)
        self._longest = np.zeros(2)
        self._some = False
        self._fault: str | None = None

    def note(self, messages: Messages) -> None:
        """Take in the topic's next messages, in the order of the file."""
        if self._fault is not None or not len(messages.offset):
            return
        try:
            time = self._read(messages)
            self._some = self._some or bool(time.any())
            log = messages.log_time() / 1e9
            skew = time - log
            if np.isnan(self._usual):
                self._usual = float(np.median(skew))
            self._departure = max(self._departure, float(np.abs(skew - self._usual).max()))
            both = np.stack([time, log])
            step = np.nan_to_num(np.diff(both, prepend=self._last))
            self._last = both[:, -1:]
            self._longest = np.maximum(self._longest, step.max(axis=1))
            self._clock.ascending(time)
        except DataError as error:
            self._fault = error.what
        except (ValueError, OverflowError, struct.error) as error:
            self._fault = f"a header time of {self._topic} cannot be read: {one_line(error)}"

    def unusable(self) -> str | None:
        """Why the header times cannot be used, if so."""
        if not self._some and self._fault is None:
            return f"the header times of {self._topic} are all zero"
        # Where the recorder stalled, it is its own time that jumps.
        header, log = self._longest
        if self._departure > MAX_DEPARTURE and log - header < self._departure / 2.0:
            return (
                f"the header times of {self._topic} leave their usual distance to the recorder's "
                f"by up to {self._departure:.3g} s"
            )
        if self._fault is None:
            try:
                self._clock.finish()
            except DataError as error:
                self._fault = error.what
        return None if self._fault is None else f"by their header times, {self._fault}"
