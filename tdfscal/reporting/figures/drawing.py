"""A figure that is not drawn yet, with what it says."""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import dataclass
from typing import TYPE_CHECKING

if TYPE_CHECKING:
    from matplotlib.figure import Figure


@dataclass(frozen=True, slots=True, weakref_slot=True)
class Drawing:
    """A figure with what it says.

    name : of its file. title : what is drawn. reading : its message, one sentence.
    paint : draws it; called once per rendering, since a Figure carries state.
    """

    name: str
    title: str
    reading: str
    paint: Callable[[], Figure]
