"""Outputs that appear together, whole, or not at all; and never in the place of an input.

Each file is written beside its place and moved there as the command ends.
"""

from __future__ import annotations

import contextlib
import os
import re
import secrets
from collections.abc import Iterable, Iterator, Sequence
from contextvars import ContextVar
from dataclasses import dataclass, field
from pathlib import Path

from tdfscal.errors import OutputError, UsageError, reason
from tdfscal.files.yaml import shorten

#: Of report pages.
PAGE_SUFFIXES = (".html", ".htm")
RIG, CALIBRATION, DOCUMENT = "a rig file", "a calibration", "a result as JSON"
#: What tdfscal writes, and how that begins but for quotes, not what it embeds.
_BEGINNINGS = {
    RIG: rb"(?:\A\{\s*|^ ?)format:\s*tdfscal-rig/",
    CALIBRATION: rb"(?:\A\{\s*|^ ?)format:\s*tdfscal-calibration/",
    DOCUMENT: rb"\A\{\s*command: tdfscal[ .]",
    "a plan": rb"\A# tdfscal plan ",
    "a study": rb"\A# tdfscal study",
    "contact wrenches": rb"\Atime,fx,fy,fz,mx,my,mz,u_fx,|\A(?s:.{0,230})tdfscal contact wrench",
    "an export": rb"\Asensor,r_xx,r_xy,|\btdfscal \d[^\s,]*, \w+ calibration of ",
    "a report page": rb"<meta name=generator content=tdfscal ",
    "another result of tdfscal": rb"^ *format: *tdfscal-",
}
_HEAD, _TAIL = 1 << 14, 1 << 16
#: What stands at the end of a Parquet file of contact wrenches.
_QUANTITY = b"contact wrench on the terminal: force, and moment"


@dataclass(slots=True)
class Outputs:
    """Files of one command, on their way.

    staged : by place, where the file is written until then. folders : made for them. inputs : files
    that the command reads. asked : places that its options name.
    """

    staged: dict[Path, Path] = field(default_factory=dict)
    folders: list[Path] = field(default_factory=list)
    inputs: list[Path] = field(default_factory=list)
    asked: list[Path] = field(default_factory=list)

    def appear(self) -> None:
        """Put everything in its place. Raises UsageError before anything has changed."""
        for place, beside in self.staged.items():
            with writing(place):
                checked_place(place, self.inputs)
                if place.exists():
                    require_kind(place, own_kind(beside))
                    beside.chmod(place.stat().st_mode & 0o7777)
        for place, beside in self.staged.items():
            with writing(place):
                beside.replace(place)
        self.folders.clear()
        self.vanish()

    def vanish(self) -> None:
        """Remove what has not appeared."""
        with contextlib.suppress(OSError):
            for beside in self.staged.values():
                beside.unlink(missing_ok=True)
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
    was and no trace is left. Raises UsageError where the folder is missing or cannot be written, or
    another output goes there.
    """
    with together() as outputs, writing(path):
        place = checked_place(path, outputs.inputs)
        if place in outputs.staged:
            what, hint = "two outputs go to one file", "choose another name"
            raise UsageError(what, where=str(path), hint=hint)
        beside = place.with_name(f".{place.name[:100]}.{secrets.token_hex(6)}.part")
        beside.touch(exist_ok=False)  # the mode obeys the umask
        outputs.staged[place] = beside
        try:
            yield beside
        except BaseException:
            del outputs.staged[place]
            beside.unlink(missing_ok=True)
            raise


def make_folder(path: Path) -> Path:
    """Make a folder with its parents, which go again where the outputs do not appear.

    Raises UsageError.
    """
    with together() as outputs, writing(path):
        missing = [p for p in (path, *path.parents) if not p.exists()]
        path.mkdir(parents=True, exist_ok=True)
        outputs.folders += missing
    return path


def protect(inputs: Iterable[Path]) -> None:
    """Let none of these files be replaced by the outputs that are under way. Raises UsageError."""
    outputs = _current.get()
    if outputs is not None:
        outputs.inputs += (more := list(inputs))
        for path in outputs.asked:
            checked_place(path, more)


def check_outputs(outputs: Iterable[tuple[str, Path, Sequence[str]]]) -> None:
    """Refuse places of output before the work; what is found to be an input later refuses them too.

    outputs : option, file, and what its name may end in, nothing where that is free.

    Raises UsageError where a place cannot be written, is named twice, or the name ends in what
    another kind of file has.
    """
    options = dict[Path, str]()
    for option, path, suffixes in outputs:
        if suffixes:
            check_suffix(path, suffixes)
        with writing(path):
            place = checked_place(path, ())
        if (current := _current.get()) is not None:
            current.asked.append(path)
        other = options.setdefault(place, option)
        if other != option:
            what, hint = f"{other} and {option} name one file", "give each a name of its own"
            raise UsageError(what, where=str(path), hint=hint)


def kind_by(head: bytes, tail: bytes = b"") -> str:
    """Tell what tdfscal wrote by how it begins and ends; nothing for all else."""
    head = head[:_HEAD].replace(b'"', b"")
    for kind, beginning in _BEGINNINGS.items():
        if re.search(beginning, head, re.MULTILINE):
            return kind
    return "contact wrenches" if _QUANTITY in tail[-_TAIL:] else ""


def own_kind(path: Path) -> str:
    """Tell what tdfscal wrote, as `kind_by`. A pipe is not opened: that might never end."""
    with contextlib.suppress(OSError):
        if path.is_file():
            with path.open("rb") as file:
                head = file.read(_HEAD)
                file.seek(max(0, file.seek(0, 2) - _TAIL))
                return kind_by(head, file.read())
    return ""


def require_kind(place: Path, kind: str) -> None:
    """Raise OutputError where a file of another kind would be replaced; an empty one may be."""
    if place.is_file() and place.stat().st_size and (found := own_kind(place)) != kind:
        what = f"would replace {found or 'a file that tdfscal did not write'}"
        hint = "choose another name for the result, or remove that file first"
        raise OutputError(what, where=shorten(str(place), 300), hint=hint)


def check_suffix(path: Path, suffixes: Sequence[str]) -> None:
    """Raise UsageError for a name that ends in none of the suffixes."""
    if path.suffix.lower() not in suffixes:
        *others, last = suffixes
        what = f"its name must end in {', '.join(others)}{' or ' if others else ''}{last}"
        hint = "choose such a name"
        if str(path).startswith("-") and path.name != "-":  # the option behind one without a value
            hint = f"name the file; write ./{path} for one that is called so"
        raise UsageError(what, where=str(path), hint=hint)


def checked_place(path: Path, inputs: Iterable[Path]) -> Path:
    """Return the file itself that a path leads to, through links.

    Raises UsageError for what no file can replace: an input, by whatever name, a folder, a file
    whose mode protects it (also from root), a place in a folder that is not there or cannot be
    written.
    """
    try:
        place = Path(os.path.realpath(path))
    except ValueError as fault:
        raise UsageError("is no file's name", where=shorten(str(path))) from fault
    if place.is_symlink():
        what, hint = "is a link that leads to itself", "remove the link"
    elif place.exists() and any(map(place.samefile, filter(Path.exists, inputs))):
        what, hint = "would replace an input", "choose another name for the result"
    elif place.is_dir():
        what, hint = "is a folder", "name a file in it"
    elif place.exists() and not place.is_file():
        what, hint = "is a device or a pipe", "name a file; - is standard output"
    elif place.is_file() and not place.stat().st_mode & 0o222:
        what = "is write-protected"
        hint = "choose another name for the result, or allow writing with `chmod u+w`"
    elif not os.access(place.parent, os.W_OK):
        what = "cannot be written: its folder is not there or may not be written to"
        hint = "create the folder first, or choose another"
    else:
        return place
    raise OutputError(what, where=shorten(str(path), 300), hint=hint)


@contextlib.contextmanager
def writing(path: Path) -> Iterator[None]:
    """Turn what the system says against writing a file into a UsageError."""
    try:
        yield
    except OSError as fault:
        what = f"cannot be written: {reason(fault)}"
        hint = "check that the folder exists, may be written to and has room"
        raise UsageError(what, where=shorten(str(path), 300), hint=hint) from fault
