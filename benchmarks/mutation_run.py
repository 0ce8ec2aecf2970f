"""Runs the mutants of `job.json` in the folder where it stands; started by `benchmarks.mutation`.

The libraries are imported once, no test. Then each file of tests runs in a fork (which functions
it reaches, how long it takes), and each mutant in forks of its own: the tests that noticed its
neighbours, then all files that reach its function, the fast ones first, to the first that fails.
"""

from __future__ import annotations

import contextlib
import importlib
import json
import os
import pickle
import resource
import signal
import sys
import time
import traceback
from collections import defaultdict
from collections.abc import Callable
from functools import partial
from pathlib import Path
from typing import Any

import pytest
from mutmut.mutation import trampoline

#: A mutant has so many times the seconds of its tests, and these seconds on top.
_SLOWER, _GRACE = 3.0, 10.0
#: Tests that noticed other mutants of the function and are asked first.
_ASKED_FIRST = 4
#: Libraries that are imported before the forks; pytest and its plugins take no part in that.
_SHARED = (
    "tdfscal",
    "numpy",
    "scipy",
    "pydantic",
    "yaml",
    "pyarrow",
    "pandas",
    "matplotlib",
    "mpmath",
)


def _forked(task: Callable[[], Any], seconds: float | None = None) -> Any:
    """Return what a task returns in a process of its own; None where that ended otherwise."""
    ends = os.pipe()
    sys.stdout.flush()
    child = os.fork()
    if not child:
        try:
            if seconds is not None:
                resource.setrlimit(resource.RLIMIT_CPU, (int(seconds) + 1, int(seconds) + 2))
                signal.alarm(int(6 * seconds) + 1)
            os.close(ends[0])
            answer = task()
            with os.fdopen(ends[1], "wb") as out:
                out.write(pickle.dumps(answer))
        except BaseException:
            traceback.print_exc()
        finally:
            os._exit(0)
    os.close(ends[1])
    with os.fdopen(ends[0], "rb") as into:
        answer = into.read()
    os.waitpid(child, 0)
    return pickle.loads(answer) if answer else None


class _Failures:
    """Names of the tests that failed, or of the file that could not be imported."""

    def __init__(self) -> None:
        self.names: list[str] = []

    def pytest_runtest_logreport(self, report: pytest.TestReport) -> None:
        if report.failed:
            self.names.append(report.nodeid)

    def pytest_collectreport(self, report: pytest.CollectReport) -> None:
        if report.failed:
            self.names.append(report.nodeid)


def _failed(which: str) -> list[str]:
    """Run a file of tests, or one test, to the first that fails."""
    seen = _Failures()
    options = ["-x", "-q", "-p", "no:cacheprovider", "--rootdir=.", which]
    with (
        Path(os.devnull).open("w") as nowhere,
        contextlib.redirect_stdout(nowhere),
        contextlib.redirect_stderr(nowhere),
    ):
        status = pytest.main(options, plugins=[seen])
    return seen.names or ([] if status in (0, 5) else [which])


def _reached(file: str) -> tuple[list[str], set[str], float, list[str]]:
    """Failures, functions that a file reaches, its seconds, and the libraries that it loads."""
    reached: set[str] = set()
    vars(trampoline)["record_trampoline_hit"] = lambda name, caller=None: reached.add(name)
    trampoline.set_mutant_under_test("stats")
    begin = time.process_time()
    failed = _failed(file)
    loaded = [name for name in sys.modules if name.startswith(_SHARED)]
    return failed, reached, time.process_time() - begin, loaded


def _verdict(name: str, files: list[str], seconds: dict[str, float], known: list[str]) -> Any:
    """Run a mutant: verdict and the test that failed."""

    def task(which: str) -> list[str]:
        trampoline.set_mutant_under_test(name)
        return _failed(which)

    for which in [*known[:_ASKED_FIRST], *files]:
        limit = _SLOWER * seconds[which.partition("::")[0]] + _GRACE
        failed = _forked(partial(task, which), limit)
        if failed is None:
            return {"verdict": "no end", "by": which}
        if failed:
            return {"verdict": "killed", "by": failed[0]}
    return {"verdict": "survived" if files else "no test", "by": ""}


def main() -> None:
    job = json.loads(Path("job.json").read_text(encoding="utf-8"))
    seconds: dict[str, float] = {}
    files: dict[str, list[str]] = defaultdict(list)
    for file in sorted(
        str(path)
        for given in sys.argv[1:]
        for path in (Path(given).rglob("test_*.py") if Path(given).is_dir() else [Path(given)])
    ):
        failed, reached, seconds[file], loaded = _forked(partial(_reached, file))
        if failed:
            sys.exit(f"{failed[0]} fails without a mutant")
        print(f"  {file}: {seconds[file]:.1f} s", flush=True)
        for function in reached:
            files[function].append(file)
        for name in loaded:
            with contextlib.suppress(Exception):
                importlib.import_module(name)
    known: dict[str, list[str]] = defaultdict(list)
    with Path(job["results"]).open("a", encoding="utf-8") as out:
        for mutant in job["mutants"]:
            function = mutant["name"].rpartition("__mutmut_")[0]
            begin = time.monotonic()
            those = sorted(files[function], key=lambda file: seconds[file])
            row = _verdict(mutant["name"], those, seconds, known[function])
            if row["by"] and row["by"] not in known[function]:
                known[function].insert(0, row["by"])
            row["seconds"] = round(time.monotonic() - begin, 2)
            print(json.dumps(job["about"] | mutant | row, ensure_ascii=False), file=out, flush=True)


if __name__ == "__main__":
    main()
