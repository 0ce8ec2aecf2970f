"""Which files are logs, and which reader takes which."""

from __future__ import annotations

from collections.abc import Sequence
from pathlib import Path
from typing import Literal

from tdfscal.errors import DataError, UsageError
from tdfscal.files.logs.request import Reader
from tdfscal.records import LogMapping

_TEXT = (".csv", ".tsv")
_COMPRESSED = (".gz", ".zst")
_BAG = "metadata.yaml"


def is_log(path: Path) -> bool:
    """Tell whether a path looks like a log: by its suffix, or as a rosbag2 folder."""
    if path.is_dir():
        return (path / _BAG).is_file()
    return _suffix(path) in (*_TEXT, ".parquet", ".mcap")


def kind_of(path: Path) -> Literal["text", "parquet", "mcap"]:
    """Return the kind of a log file, by its suffix.

    Raises
    ------
    UsageError : the file is of no kind that is read here.
    """
    suffix = _suffix(path)
    if suffix == ".parquet":
        return "parquet"
    if suffix == ".mcap":
        return "mcap"
    if suffix in (*_TEXT, ".txt", ".dat"):
        return "text"
    raise UsageError(
        f"no kind of log ends in {suffix or 'nothing'!r}",
        where=str(path),
        hint="logs are .csv, .tsv (also .gz, .zst), .parquet, .mcap or a rosbag2 folder",
    )


def reader_of(path: Path, mapping: LogMapping | None) -> Reader:
    """Return the reader for a file, by its suffix.

    Raises
    ------
    UsageError : the file is of no kind that is read here.
    DataError : an MCAP file without a mapping: its topics cannot be guessed.
    """
    kind = kind_of(path)
    if kind == "parquet":
        from tdfscal.files.logs.parquet import read_parquet

        return read_parquet
    if kind == "text":
        from tdfscal.files.logs.text import read_text

        return read_text
    if mapping is None:
        raise DataError(
            "a recording in MCAP needs to be told which topics to read",
            where=str(path),
            hint="add a `log:` block to rig.yaml; `tdfscal info` proposes one",
        )
    from tdfscal.files.logs.mcap import read_mcap

    return read_mcap


def expand(paths: Sequence[Path]) -> list[Path]:
    """Replace rosbag2 folders by their files, in the order of their metadata.

    Raises
    ------
    UsageError : a path is not there, or is a folder that is no recording.
    DataError : a rosbag2 folder whose files are not MCAP, or are not there.
    """
    files: list[Path] = []
    for path in paths:
        if path.is_dir():
            files += _bag_files(path)
        elif path.exists():
            files.append(path)
        else:
            raise UsageError("there is no such file", where=str(path))
    return files


def _suffix(path: Path) -> str:
    suffix = path.suffix.lower()
    return Path(path.stem).suffix.lower() if suffix in _COMPRESSED else suffix


def _bag_files(folder: Path) -> list[Path]:
    import yaml

    where = str(folder / _BAG)
    try:
        text = (folder / _BAG).read_text(encoding="utf-8")
    except FileNotFoundError as error:
        raise UsageError(
            "the folder is no recording: it has no metadata.yaml",
            where=str(folder),
            hint="name the log files",
        ) from error
    except (OSError, UnicodeDecodeError) as error:
        raise DataError(f"the file cannot be read ({error})", where=where) from error
    try:
        information = yaml.safe_load(text)["rosbag2_bagfile_information"]
        storage = information["storage_identifier"]
        names = [str(name) for name in information["relative_file_paths"]]
    except (yaml.YAMLError, KeyError, TypeError, ValueError, RecursionError) as error:
        raise DataError("this is no description of a rosbag2 recording", where=where) from error
    if storage != "mcap":
        raise DataError(
            f"the recording is stored as {storage}",
            where=where,
            hint="convert it to MCAP with `ros2 bag convert`",
        )
    files = [folder / name for name in names]
    absent = [path.name for path in files if not path.is_file()]
    if absent or not files:
        raise DataError(f"the recording lacks {', '.join(absent) or 'any file'}", where=where)
    return files
