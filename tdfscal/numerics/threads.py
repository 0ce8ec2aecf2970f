"""Work on large arrays in threads: numpy lets others run meanwhile."""

from __future__ import annotations

import os
from collections.abc import Callable, Iterable
from concurrent.futures import ThreadPoolExecutor
from typing import TypeVar

Given = TypeVar("Given")
Item = TypeVar("Item")

WORKERS = min(os.cpu_count() or 1, 4)


def in_threads(function: Callable[[Given], Item], given: Iterable[Given]) -> list[Item]:
    """The results in order, as by `map`; what is raised first in that order is raised here."""
    items = list(given)
    if WORKERS == 1 or len(items) < 2:
        return [function(one) for one in items]
    with ThreadPoolExecutor(WORKERS, thread_name_prefix="arrays") as pool:
        return list(pool.map(function, items))
