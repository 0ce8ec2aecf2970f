"""Work in threads ahead of its consumer: order, errors, and an early end."""

from __future__ import annotations

import threading
from collections.abc import Generator

import pytest

from tdfscal.logs.log_file import ahead


def counted(stop: int, fault: int = -1) -> Generator[int, None, None]:
    for k in range(stop):
        if k == fault:
            raise ValueError("here")
        yield k


def test_an_error_comes_in_its_turn() -> None:
    stream = ahead(counted(50, fault=3))
    assert [next(stream) for _ in range(3)] == [0, 1, 2]
    with pytest.raises(ValueError, match="here"):
        next(stream)


def test_closing_early_closes_the_stream_and_ends_the_threads() -> None:
    closed = threading.Event()

    def endless() -> Generator[int, None, None]:
        try:
            while True:
                yield 1
        finally:
            closed.set()

    stream = ahead(endless())
    next(stream)
    stream.close()
    assert closed.is_set()
    assert not any(thread.name.startswith("ahead") for thread in threading.enumerate())
