"""Work in threads ahead of its consumer: numpy, pyarrow and zlib let others run meanwhile."""

from __future__ import annotations

from collections import deque
from collections.abc import Callable, Generator, Iterable
from concurrent.futures import Future, ThreadPoolExecutor
from itertools import repeat
from typing import Final, TypeVar, cast

Given = TypeVar("Given")
Item = TypeVar("Item")
_END: Final = object()


def mapped(
    function: Callable[[Given], Item], given: Iterable[Given], workers: int
) -> Generator[Item, None, None]:
    """The results in order, each computed in one of the threads; few wait to be taken.

    What `function` or `given` raises is raised here in its turn. Closing it ends the threads.
    """
    waiting: deque[Future[Item]] = deque()
    pool = ThreadPoolExecutor(workers, thread_name_prefix="ahead")
    try:
        for one in given:
            waiting.append(pool.submit(function, one))
            if len(waiting) > workers:
                yield waiting.popleft().result()
        while waiting:
            yield waiting.popleft().result()
    finally:
        pool.shutdown(wait=True, cancel_futures=True)


def ahead(stream: Generator[Item, None, None]) -> Generator[Item, None, None]:
    """The same stream, computed in a thread of its own."""
    steps = mapped(lambda _: next(stream, _END), repeat(None), 1)
    try:
        for item in steps:
            if item is _END:
                return
            yield cast(Item, item)
    finally:
        steps.close()
        stream.close()
