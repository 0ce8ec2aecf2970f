"""Too little memory, said plainly; one thread for the linear algebra of small matrices."""

from __future__ import annotations

import errno
import os

from tdfscal.errors import MemoryShortError


def limit_threads() -> None:
    """Ask for one thread of linear algebra; call it before the libraries are loaded.

    More of them wait for each other, and numbers would follow the machine.
    """
    for name in ("OMP_NUM_THREADS", "OPENBLAS_NUM_THREADS"):
        os.environ.setdefault(name, "1")


def shortage() -> MemoryShortError:
    """Return the error of too little memory."""
    return MemoryShortError(
        "the memory does not suffice for this run",
        hint="close other programs, raise the limit of what the run may use (`ulimit -v "
        "unlimited`), or use a part of the log (`--from`, `--to`)",
    )


def is_short(error: BaseException) -> bool:
    """Tell whether an error comes of too little memory, itself or what it was raised from."""
    seen: set[int] = set()
    at: BaseException | None = error
    while at is not None and id(at) not in seen:
        seen.add(id(at))
        if isinstance(at, MemoryError | MemoryShortError):
            return True
        if isinstance(at, OSError) and at.errno == errno.ENOMEM:
            return True
        at = at.__cause__ or (None if at.__suppress_context__ else at.__context__)
    return False
