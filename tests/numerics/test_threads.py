"""Work in threads gives what `map` gives."""

from __future__ import annotations

import time

import pytest

from tdfscal.numerics import threads


@pytest.mark.parametrize("workers", [1, 3])
def test_results_keep_their_order(monkeypatch: pytest.MonkeyPatch, workers: int) -> None:
    monkeypatch.setattr(threads, "WORKERS", workers)

    def slow(k: int) -> int:
        time.sleep(0.01 if k % 2 == 0 else 0.0)
        return k * k

    assert threads.in_threads(slow, iter(range(9))) == [k * k for k in range(9)]
    assert threads.in_threads(slow, []) == []


@pytest.mark.parametrize("workers", [1, 3])
def test_an_error_is_raised(monkeypatch: pytest.MonkeyPatch, workers: int) -> None:
    monkeypatch.setattr(threads, "WORKERS", workers)
    with pytest.raises(ZeroDivisionError):
        threads.in_threads(lambda k: 1 // k, [2, 1, 0, 3])
