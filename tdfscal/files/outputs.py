"""Outputs that appear together, whole, or not at all; and never in the place of an input."""

from __future__ import annotations

import contextlib
import os
import secrets
import shutil
import signal
import tempfile
from collections.abc import Iterable, Iterator
from contextvars import ContextVar
from dataclasses import dataclass, field
from pathlib import Path

from tdfscal.errors import TdfscalError, UsageError
from tdfscal.files.yaml.scalars import shorten

#: What ends a run from outside; it waits while files are moved into their places.
_SIGNALS = ("SIGINT", "SIGTERM", "SIGHUP")
#: Device and inode of a file, whatever its name.
Identity = tuple[int, int]


@dataclass(frozen=True, slots=True)
class _Staged:
    """A file that waits beside its place. name : of the place, as it was given."""

    beside: Path
    target: Path
    name: Path

    @property
    def direct(self) -> bool:
        """The place is a device or a pipe, which is written into."""
        return self.target.exists() and not self.target.is_file()


@dataclass(slots=True)
class Outputs:
    """Files of one command, on their way.

    removed : files that go as these appear. folders : made for them. protected : files that the
    command reads. appeared : they are in their places, and stay there.
    """

    staged: list[_Staged] = field(default_factory=list)
    removed: list[Path] = field(default_factory=list)
    folders: list[Path] = field(default_factory=list)
    protected: set[Identity] = field(default_factory=set)
    appeared: bool = False

    def stage(self, path: Path) -> _Staged:
        """Return where to write what shall appear at `path`. Raises UsageError."""
        try:
            check_target(path)
            target = Path(os.path.realpath(path))
            if identity(target) in self.protected:
                raise replaces_input(path)
            if any(other.target == target for other in self.staged):
                raise UsageError(
                    "two outputs go to one file", where=str(path), hint="choose another name"
                )
            staged = _Staged(_beside(target), target, path)
        except (OSError, ValueError) as fault:
            raise unwritable(path, fault) from fault
        self.staged.append(staged)
        return staged

    def appear(self) -> None:
        """Put everything in its place. Raises UsageError; then nothing has changed."""
        for staged in self.staged:
            try:
                check_target(staged.target)
                with staged.beside.open("rb+") as written:
                    os.fsync(written.fileno())
                if staged.direct:
                    with staged.target.open("wb") as sink, staged.beside.open("rb") as source:
                        shutil.copyfileobj(source, sink)
                elif staged.target.exists():
                    staged.beside.chmod(staged.target.stat().st_mode & 0o7777)
            except OSError as fault:
                raise unwritable(staged.name, fault) from fault
        with _undisturbed():
            for staged in self.staged:
                try:
                    if not staged.direct:
                        staged.beside.replace(staged.target)
                except OSError as fault:
                    raise unwritable(staged.name, fault) from fault
            for path in self.removed:
                with contextlib.suppress(OSError):
                    path.unlink()
            self.appeared = bool(self.staged)
            self.folders.clear()
            self.vanish()

    def vanish(self) -> None:
        """Remove what has not appeared."""
        for staged in self.staged:
            with contextlib.suppress(OSError):
                staged.beside.unlink(missing_ok=True)
        self.staged.clear()
        for folder in self.folders:
            with contextlib.suppress(OSError):  # there are files in it
                folder.rmdir()


_current: ContextVar[Outputs | None] = ContextVar("outputs", default=None)


@contextlib.contextmanager
def together() -> Iterator[Outputs]:
    """Let all files that are written inside appear at its end; at an exception none does.

    Inside another one it is a part of that.
    """
    outer = _current.get()
    if outer is not None:
        yield outer
        return
    outputs = Outputs()
    token = _current.set(outputs)
    try:
        yield outputs
        outputs.appear()
    finally:
        _current.reset(token)
        outputs.vanish()


def appear_now() -> None:
    """Let what is written already appear, although an error is to follow."""
    outputs = _current.get()
    if outputs is not None:
        outputs.appear()


@contextlib.contextmanager
def replacing(path: Path) -> Iterator[Path]:
    """Give a path beside `path` to write to; at a clean end it takes the place of `path`.

    Inside `together` that is the end of all outputs. At an exception an existing file stays as it
    was and no trace is left. Raises UsageError where the folder is missing or cannot be written.
    """
    with together() as outputs:
        staged = outputs.stage(path)
        try:
            yield staged.beside
        except BaseException:
            outputs.staged.remove(staged)
            staged.beside.unlink(missing_ok=True)
            raise


def make_folder(path: Path) -> Path:
    """Make a folder with its parents, which go again where the outputs do not appear.

    Raises UsageError.
    """
    outputs = _current.get()
    try:
        check_link(path)
        missing = [p for p in (path, *path.parents) if not p.exists()]
        path.mkdir(parents=True, exist_ok=True)
    except (OSError, ValueError) as fault:
        raise unwritable(path, fault) from fault
    if outputs is not None:
        outputs.folders += missing
    return path


def protect(inputs: Iterable[Path]) -> None:
    """Let none of these files be replaced by the outputs that are under way."""
    outputs = _current.get()
    if outputs is not None:
        outputs.protected |= {one for one in map(identity, inputs) if one is not None}


def identity(path: Path) -> Identity | None:
    """Return which file a path leads to, through links; None where there is none."""
    try:
        found = path.stat()
    except (OSError, ValueError):
        return None
    return found.st_dev, found.st_ino


def check_link(path: Path) -> None:
    """Raise UsageError for a link that leads to itself."""
    if Path(os.path.realpath(path)).is_symlink():
        raise UsageError("is a link that leads to itself", where=str(path), hint="remove the link")


def check_target(path: Path) -> None:
    """Raise UsageError for what no file can replace; its mode protects a file also from root."""
    check_link(path)
    if path.is_dir():
        raise UsageError("is a folder", where=str(path), hint="name a file in it")
    if path.is_file() and not path.stat().st_mode & 0o222:
        raise UsageError(
            "is write-protected",
            where=str(path),
            hint="choose another name for the result, or allow writing with `chmod u+w`",
        )


def replaces_input(path: Path) -> UsageError:
    """Return the error of an output in the place of an input."""
    return UsageError(
        "would replace an input", where=str(path), hint="choose another name for the result"
    )


def unwritable(path: Path, fault: OSError | ValueError) -> TdfscalError:
    """Return the error of a place that cannot be written."""
    reason = fault.strerror if isinstance(fault, OSError) and fault.strerror else "no file's name"
    return UsageError(
        f"cannot be written: {reason}",
        where=shorten(str(path), 300),
        hint="check that the folder exists, may be written to and has room",
    )


def _beside(target: Path) -> Path:
    """Create a file to write to: beside its target, or elsewhere for a device's content."""
    if target.exists() and not target.is_file():
        handle, name = tempfile.mkstemp(suffix=".part")
        beside = Path(name)
    else:
        beside = target.with_name(f".{target.name[:100]}.{secrets.token_hex(6)}.part")
        # O_EXCL: never into a file that something else laid there; the mode obeys the umask.
        handle = os.open(beside, os.O_CREAT | os.O_EXCL | os.O_WRONLY, 0o666)
    os.close(handle)
    return beside


@contextlib.contextmanager
def _undisturbed() -> Iterator[None]:
    """Let signals that end a run wait."""
    if not hasattr(signal, "pthread_sigmask"):
        yield
        return
    ours = {getattr(signal, name) for name in _SIGNALS}
    before = signal.pthread_sigmask(signal.SIG_BLOCK, ours)
    try:
        yield
    finally:
        signal.pthread_sigmask(signal.SIG_SETMASK, before)
