"""Writing files whole or not at all, in JSON and YAML that any parser reads to the same numbers."""

from __future__ import annotations

import contextlib
import json
import os
import secrets
from collections.abc import Iterator
from pathlib import Path
from typing import Any

import yaml

from tdfscal.errors import TdfscalError, UsageError
from tdfscal.files.yaml.scalars import plain_scalar, shorten


@contextlib.contextmanager
def replacing(path: Path) -> Iterator[Path]:
    """Give a path beside `path` to write to; at a clean end it takes the place of `path`.

    At an exception an existing file stays as it was and no trace is left. What is no regular file
    (a pipe, /dev/null) is written to directly. Raises UsageError where the folder is missing or
    cannot be written.
    """
    try:
        target = path.resolve()
        direct = target.exists() and not target.is_file()
        if direct and target.is_dir():
            raise UsageError("is a folder", where=str(path), hint="name a file in it")
        beside = target.with_name(f".{target.name[:100]}.{secrets.token_hex(6)}.part")
        if not direct:
            # O_EXCL: never into a file that something else laid there; the mode obeys the umask.
            os.close(os.open(beside, os.O_CREAT | os.O_EXCL | os.O_WRONLY, 0o666))
    except (OSError, ValueError) as fault:
        raise _unwritable(path, fault) from fault
    if direct:
        yield target
        return
    try:
        yield beside
        try:
            _put_in_place(beside, target)
        except OSError as fault:
            raise _unwritable(path, fault) from fault
    finally:
        with contextlib.suppress(OSError):
            beside.unlink(missing_ok=True)


def _put_in_place(beside: Path, target: Path) -> None:
    if target.exists():
        beside.chmod(target.stat().st_mode & 0o7777)
    with beside.open("rb") as written:
        os.fsync(written.fileno())
    beside.replace(target)


def write_text(path: Path, text: str) -> None:
    """Write text as UTF-8, whole or not at all. Raises UsageError where that is not possible."""
    with replacing(path) as beside:
        try:
            beside.write_text(text, encoding="utf-8", newline="\n")
        except OSError as fault:
            raise _unwritable(path, fault) from fault


def make_folder(path: Path) -> Path:
    """Make a folder with its parents, where it is not there yet. Raises UsageError."""
    try:
        path.mkdir(parents=True, exist_ok=True)
    except (OSError, ValueError) as fault:
        raise _unwritable(path, fault) from fault
    return path


def _unwritable(path: Path, fault: OSError | ValueError) -> TdfscalError:
    reason = fault.strerror if isinstance(fault, OSError) and fault.strerror else "no file's name"
    return UsageError(
        f"cannot be written: {reason}",
        where=shorten(str(path), 300),
        hint="check that the folder exists, may be written to and has room",
    )


def to_json(content: Any) -> str:
    """Strict JSON, indented; ValueError for NaN and infinity: a model must not let them through."""
    return json.dumps(content, indent=2, ensure_ascii=False, allow_nan=False) + "\n"


def to_yaml(content: Any) -> str:
    """Plain YAML in the order given, lists of numbers and short words on one line each."""
    return yaml.dump(
        content,
        Dumper=_PlainDumper,
        sort_keys=False,
        allow_unicode=True,
        width=float("inf"),
        default_flow_style=False,
    )


class _PlainDumper(yaml.SafeDumper):
    """Without aliases; text that YAML 1.2 would take for a number is quoted."""

    def ignore_aliases(self, data: Any) -> bool:
        return True


def _represent_list(dumper: _PlainDumper, data: list[Any]) -> yaml.Node:
    short = all(
        item is None or isinstance(item, (int, float)) or (isinstance(item, str) and len(item) < 20)
        for item in data
    )
    return dumper.represent_sequence("tag:yaml.org,2002:seq", data, flow_style=short)


def _represent_text(dumper: _PlainDumper, data: str) -> yaml.Node:
    try:
        ambiguous = not isinstance(plain_scalar(data), str)
    except OverflowError:
        ambiguous = True
    # Only double quotes escape what does not print; a bare U+0085 would read back as a line break.
    style = "'" if ambiguous else None if data.isprintable() else '"'
    return dumper.represent_scalar("tag:yaml.org,2002:str", data, style=style)


_PlainDumper.add_representer(list, _represent_list)
_PlainDumper.add_representer(str, _represent_text)
