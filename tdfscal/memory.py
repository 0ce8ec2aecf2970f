"""Whether the memory suffices: asked before a run, and of every fault that ends one.

Below what they need, numerical libraries do not fail: they wait for ever, end the process or blame
the file. So the room is looked at first, and no fault is believed where memory lacks.
"""

from __future__ import annotations

import errno
import os
from importlib import import_module
from pathlib import Path

from tdfscal.errors import MemoryShortError

#: Addresses that a command and its libraries take, with one thread each (`benchmarks/memory.md`).
NEEDED = 900_000_000
#: Of these, what is written to: a limit may concern it alone.
WRITTEN = 600_000_000
#: What any step finds free in a healthy run.
_LEFT = 64_000_000
#: What a file may need at most beside its own size, some times.
_BESIDE, _TIMES = 256_000_000, 4
#: What libraries and the loader say, whose exceptions are of any kind.
_SAID = (
    "cannot allocate memory",
    "not enough memory",
    "out of memory",
    "bad_alloc",
    "allocation_failed",
    "failed to map segment",
    "malloc of size",
    "realloc of size",
    "can't start new thread",
    "failed to launch worker thread",
)
#: The matrices are small: more threads wait for each other, and numbers would follow the machine.
_ONE_THREAD = ("OMP_NUM_THREADS", "OPENBLAS_NUM_THREADS")
#: Threads reserve addresses, each some hundred megabytes; a pool reserves them by the gigabyte.
_MODEST = {
    "ARROW_IO_THREADS": "1",
    "ARROW_DEFAULT_MEMORY_POOL": "system",
}


def check_room() -> None:
    """Look whether a command has room to run; call it before the libraries are loaded.

    Linear algebra is asked to take one thread. Where memory is limited, the libraries are asked to
    take little, and those that would end the process later, when they find none, are loaded at
    once.

    Raises MemoryShortError where it has not.
    """
    for name in _ONE_THREAD:
        os.environ.setdefault(name, "1")
    limited = _limited()
    if limited:
        for name, value in _MODEST.items():
            os.environ.setdefault(name, value)
    if not (_free(NEEDED, written=False) and _free(WRITTEN)):
        raise shortage()
    if limited:
        import_module("scipy.linalg")


def shortage() -> MemoryShortError:
    """Return the error of too little memory."""
    return MemoryShortError(
        "the memory does not suffice for this run; its files were not judged",
        hint="close other programs, or raise the limit of what the run may use (`ulimit -v "
        "unlimited`, or 1000000 at the least and more for a long log)",
    )


def is_short(error: BaseException) -> bool:
    """Tell whether an error comes of too little memory, itself or what it was raised from."""
    return _says_so(error) or not _free(_LEFT)


def is_short_for(path: Path, error: BaseException) -> bool | None:
    """Tell whether too little memory is to blame that a file cannot be read, or the file.

    None where the error does not come of memory; False where it does, though there is more of it
    than a sound file of this size takes: then the file states lengths that it does not hold.
    """
    if not is_short(error):
        return None
    try:
        size = path.stat().st_size
    except OSError:
        size = 0
    return not _free(_BESIDE + _TIMES * size)


def _says_so(error: BaseException) -> bool:
    seen: set[int] = set()
    at: BaseException | None = error
    while at is not None and id(at) not in seen:
        seen.add(id(at))
        if isinstance(at, MemoryError | MemoryShortError):
            return True
        if isinstance(at, OSError) and at.errno == errno.ENOMEM:
            return True
        if type(at).__module__.partition(".")[0] != "tdfscal":
            said = str(at).lower()
            if any(words in said for words in _SAID):
                return True
        at = at.__cause__ or (None if at.__suppress_context__ else at.__context__)
    return False


def _limited() -> bool:
    try:
        import resource
    except ImportError:  # no POSIX
        return False
    limits = (resource.RLIMIT_AS, resource.RLIMIT_DATA)
    return any(resource.getrlimit(each)[0] != resource.RLIM_INFINITY for each in limits)


def _free(size: int, *, written: bool = True) -> bool:
    """Tell whether so many bytes of addresses can be had now; they are given back at once."""
    import mmap

    if not hasattr(mmap, "MAP_PRIVATE"):
        return True
    private = mmap.MAP_PRIVATE | mmap.MAP_ANONYMOUS
    access = mmap.PROT_READ | (mmap.PROT_WRITE if written else 0)
    try:
        mmap.mmap(-1, size, flags=private, prot=access).close()
    except (OSError, MemoryError, OverflowError):
        return False
    return True
