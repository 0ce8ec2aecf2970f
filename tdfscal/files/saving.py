"""Writing files: JSON and YAML that any parser reads to the same numbers, escapes of text, digests.

Names, paths, columns and foreign files may hold anything. Where a format has data (YAML and JSON
values, XML text, CSV cells) its own writer keeps the string as it is; the escapes serve the rest:
comments, which end at signs of their own (those of YAML at line breaks alone: `errors.visible`),
and characters that a format cannot hold or a reader would act on. Each escape is a backslash
sequence that Python reads back, so nothing is lost.
"""

from __future__ import annotations

import dataclasses
import hashlib
import json
import re
import threading
from collections.abc import Callable, Iterator, Mapping
from concurrent.futures import ThreadPoolExecutor
from contextlib import contextmanager
from pathlib import Path, PurePath
from typing import TYPE_CHECKING, Any

import numpy as np
import yaml

from tdfscal.errors import DataError, UsageError, visible
from tdfscal.files.outputs import replacing
from tdfscal.files.yaml import NUMBER, plain_scalar
from tdfscal.records import BoolArray, FloatArray, InputFile, IntArray, Integrity

#: What XML 1.0 cannot hold (production 2), and the carriage return, which its parsers replace.
_NOT_XML = re.compile("[\x00-\x08\x0b-\x1f\ud800-\udfff\ufffe\uffff]")
#: A spreadsheet takes a cell that begins so for a formula.
_FORMULA = re.compile(r"(^|[,;\t\"'])(\s*)([=+\-@])")


def write_text(path: Path, text: str) -> None:
    """Write text as UTF-8, whole or not at all. Raises UsageError where that is not possible."""
    with replacing(path) as beside:
        beside.write_text(text, encoding="utf-8", newline="\n")


def to_json(content: Any, indent: int = 2) -> str:
    """Strict JSON, indented; ValueError for NaN and infinity: a model must not let them through."""
    return json.dumps(content, indent=indent, ensure_ascii=False, allow_nan=False) + "\n"


def to_yaml(content: Any) -> str:
    """Plain YAML in the order given, lists of numbers and short words on one line each.

    content : mappings, lists, numbers, text; records and arrays as these.
    """
    return yaml.dump(
        plain(content),
        Dumper=_PlainDumper,
        sort_keys=False,
        allow_unicode=True,
        width=1 << 30,
        default_flow_style=False,
    )


def plain(value: Any, null: Callable[[float], bool] = lambda number: False) -> Any:
    """Records, arrays and what holds them, as JSON has values; null : numbers that are written so.

    What is neither, such as a block of a file, stays as it is.
    """
    if isinstance(value, np.ndarray | np.generic):
        whole = value.dtype.kind != "f" or np.isfinite(value).all()
        value = value.tolist()
        if whole:  # no need to look at each
            return value
    if isinstance(value, float):
        return None if null(value) else value
    if isinstance(value, list | tuple):
        return [plain(item, null) for item in value]
    if isinstance(value, Mapping):
        return {key: plain(item, null) for key, item in value.items()}
    if isinstance(value, PurePath):
        return str(value)
    if dataclasses.is_dataclass(value):
        fields = dataclasses.fields(value)
        return {field.name: plain(getattr(value, field.name), null) for field in fields}
    return value


if TYPE_CHECKING:
    _SafeDumper = yaml.SafeDumper
else:  # libyaml's, where PyYAML has it: a quarter of the time
    _SafeDumper = getattr(yaml, "CSafeDumper", yaml.SafeDumper)


class _PlainDumper(_SafeDumper):
    """Without aliases; text that YAML 1.2 would take for a number is quoted."""

    def ignore_aliases(self, data: Any) -> bool:
        return True


def _represent_list(dumper: _PlainDumper, data: list[Any]) -> yaml.Node:
    short = all(
        item is None or isinstance(item, (int, float)) or (isinstance(item, str) and len(item) < 20)
        for item in data
    )
    return dumper.represent_sequence("tag:yaml.org,2002:seq", data, flow_style=short)


def represent_text(dumper: yaml.SafeDumper, data: str) -> yaml.Node:
    """Write a text so that YAML 1.1 and 1.2 both read it as one."""
    ambiguous = not isinstance(plain_scalar(data), str) or NUMBER.fullmatch(data)
    # Only double quotes escape what does not print; a bare U+0085 would read back as a line break.
    style = "'" if ambiguous else None if data.isprintable() else '"'
    return dumper.represent_scalar("tag:yaml.org,2002:str", data, style=style)


_PlainDumper.add_representer(list, _represent_list)
_PlainDumper.add_representer(str, represent_text)


def csv_comment(text: str) -> str:
    """Text of one line after `# ` in a CSV: a spreadsheet splits it, and may run what follows."""
    return _FORMULA.sub(lambda m: f"{m[1]}{m[2]}{_hex(m[3])}", visible(text))


def csv_cell(text: str) -> str:
    """A cell of words: an apostrophe in front keeps a spreadsheet from running it."""
    return f"'{text}" if text[:1] in "=+-@\t\r'" and text else text


def xml_text(text: str) -> str:
    """Text or attribute before XML's own escapes."""
    return _NOT_XML.sub(lambda m: visible(m[0]), text)


def xml_comment(text: str) -> str:
    """Text within a comment, which holds no `--` and does not end in `-`."""
    return re.sub(r"-(?=-|$)", lambda m: _hex(m[0]), visible(text))


def _hex(character: str) -> str:
    return f"\\x{ord(character):02x}"


_BLOCK = 1 << 22


def in_utf8(text: str) -> str:
    r"""A file's name need not be UTF-8, what is written of it must: other bytes become \\xNN."""
    return text.encode("utf-8", "surrogateescape").decode("utf-8", "backslashreplace")


def content_sha256(content: Mapping[str, Any]) -> str:
    """SHA-256 of a document's values, whatever their order and notation.

    It is that of the document as Python's JSON in UTF-8, its keys sorted, those that are null left
    out at any depth. content : plain JSON values.
    """
    text = json.dumps(_without_nulls(content), sort_keys=True, ensure_ascii=False)
    return hashlib.sha256(text.encode("utf-8", "surrogatepass")).hexdigest()


def _without_nulls(value: Any) -> Any:
    if isinstance(value, dict):
        return {key: _without_nulls(each) for key, each in value.items() if each is not None}
    if not isinstance(value, list) or set(map(type, value)) <= {float, str}:
        return value
    return [_without_nulls(each) for each in value]


@contextmanager
def fingerprint(path: Path) -> Iterator[Callable[[Integrity], InputFile]]:
    """Compute a file's digest in a thread, beside its reading.

    The function given waits for it and returns the record: its path as it was given, and how far
    the reader could check the content. Leaving early abandons it.

    Raises UsageError where the file is not there or cannot be opened.
    """
    stop = threading.Event()
    with ThreadPoolExecutor(max_workers=1, thread_name_prefix="sha256") as pool:
        digest = pool.submit(_sha256, path, stop.is_set)
        try:
            yield lambda integrity: InputFile(in_utf8(str(path)), *digest.result(), integrity)
        finally:
            stop.set()


def _sha256(path: Path, stopped: Callable[[], bool]) -> tuple[str, int]:
    digest = hashlib.sha256()
    block = bytearray(_BLOCK)
    size = 0
    try:
        with path.open("rb", buffering=0) as stream:
            while not stopped() and (count := stream.readinto(block)):
                digest.update(memoryview(block)[:count])
                size += count
    except (FileNotFoundError, IsADirectoryError, PermissionError) as error:
        raise UsageError(
            f"the file cannot be opened ({error.strerror})", where=str(path)
        ) from error
    except OSError as error:
        raise DataError(f"the file cannot be read ({error.strerror})", where=str(path)) from error
    return digest.hexdigest(), size


def as_arrow(values: FloatArray | IntArray, missing: BoolArray | None = None) -> Any:
    """An array of (N,) numbers, null where they are missing, which shares their memory.

    pyarrow's own conversion imports pandas first, which takes a quarter of a second.
    """
    import pyarrow as pa  # of tables alone

    known = None if missing is None else pa.py_buffer(np.packbits(~missing, bitorder="little"))
    buffers = [known, pa.py_buffer(np.ascontiguousarray(values))]
    return pa.Array.from_buffers(pa.from_numpy_dtype(values.dtype), len(values), buffers)
