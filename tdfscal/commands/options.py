"""A command's parameters, told once: Python's help, the command line, the reference follow.

So do its files, made of what its function returns. Values as a command line or Python has them.
"""

from __future__ import annotations

import os
import re
from collections.abc import Callable, Iterable, Mapping, Sequence
from contextlib import suppress
from datetime import UTC, datetime
from functools import wraps
from inspect import Parameter, signature
from math import inf, isfinite
from numbers import Integral, Real
from pathlib import Path
from reprlib import repr as shortly
from types import NoneType
from typing import Annotated, Any, Literal, TypeVar, get_args, get_origin, get_type_hints

from tdfscal.commands.campaign import PathLike, PathLikes, one
from tdfscal.commands.result import CalibrationSource, CommandResult, Result
from tdfscal.errors import TdfscalError, UsageError, expect, inaccessible
from tdfscal.files.outputs import PAGE_SUFFIXES, check_outputs, together
from tdfscal.frozen import record, replace
from tdfscal.logs import Moment, TimeWindow
from tdfscal.logs.table import seconds_of

_Function = TypeVar("_Function", bound=Callable[..., Any])

Numbers = str | Sequence[float]
#: A moment of a log as text, a number of s, or a date and time.
Instant = str | float | datetime
#: Called with the name of each stage of the work that begins.
Progress = Callable[[str], None]


def silent(stage: str) -> None:
    """Nobody follows the work."""


@record
class Option:
    """What a parameter says of itself.

    help : a clause that begins small and has no full stop. kind : its type on the command line,
    where that is not the annotation's; None there for what only Python has. metavar : what the
    help shows in its place, a number's unit. names : of the option, where they are not that of the
    parameter. default : on the command line, where it is another; `...` must be given. least,
    below : the smallest number, and the first that is too large. shell : what the command line
    takes besides. writes : endings of a file to write, any where there is none. holds : the text of
    the result that it gets; nothing where the function writes it while it works. dash : `-` sends
    that to standard output.
    """

    help: str
    kind: Any = ...
    metavar: str | None = None
    names: tuple[str, ...] = ()
    default: Any = None
    least: float | None = None
    below: float = inf
    shell: str = ""
    writes: tuple[str, ...] | None = None
    holds: str = ""
    dash: bool = True

    @property
    def sentence(self) -> str:
        """Its help as the command line and the reference print it."""
        text = "; ".join(filter(None, (self.help, self.shell)))
        return f"{text[0].upper()}{text[1:]}."


@record(kw_only=True)
class Described(Option):
    """An option that knows its parameter.

    name, python : of the parameter, and its type. kind : on the command line; None where only
    Python has it. names : without dashes where it is positional. several : each stands for itself,
    as `*files`. words : among which it chooses.
    """

    name: str
    python: Any
    positional: bool
    several: bool
    words: tuple[str, ...]

    @classmethod
    def of(cls, parameter: Parameter, annotation: Any) -> Described:
        """Read it off a function's annotation."""
        python, option = get_args(annotation)
        name = parameter.name
        given = parameter.kind is not Parameter.KEYWORD_ONLY and not option.names
        default = parameter.default if option.default is None else option.default
        flag = f"--{name.strip('_').replace('_', '-')}"
        choices = [one for one in (python, *get_args(python)) if get_origin(one) is Literal]
        told = vars(option) | {
            "name": name,
            "python": python,
            "kind": python if option.kind is ... else option.kind,
            "default": ... if default is Parameter.empty and given else default,
            "names": (name,) if given else option.names or (flag,),
            "positional": given,
            "several": parameter.kind is Parameter.VAR_POSITIONAL,
            "words": get_args(choices[0]) if choices else (),
        }
        return cls(**told)

    def check(self, value: Any) -> None:
        """Raise UsageError for none of its words or kinds, or a number out of its bounds."""
        where, least = self.names[0], self.least
        below = min(self.below, _MOST.get(self.metavar or "", inf))
        if self.words and value is not None and value not in self.words:
            raise UsageError(f"{value!r} is none of {', '.join(self.words)}", where=where)
        kinds = [get_origin(kind) or kind for kind in get_args(self.python) or (self.python,)]
        # Only Python has it, or it is left out.
        if self.kind is None or (value is None and NoneType in kinds):
            return
        number = bool({int, float}.intersection(kinds)) and str not in kinds
        # Paths and moments say themselves what they take.
        if value is None or not (self.words or {os.PathLike, datetime}.intersection(kinds)):
            taken = tuple(_TAKEN.get(kind, (kind, ""))[0] for kind in kinds)
            unlike = isinstance(value, bool) is not (bool in kinds) or (number and value != value)
            unlike |= isinstance(value, bytes)
            if isinstance(value, list | tuple):
                unlike |= not all(isinstance(each, str | Real) for each in value)
            if value is None or unlike or not isinstance(value, taken):
                wanted = self.words or [_TAKEN[kind][1] for kind in kinds if kind in _TAKEN]
                told = " or ".join(dict.fromkeys(wanted)) or "a path"
                raise UsageError(f"expected {told}, got {shortly(value)}", where=where)
        if number and least is not None and not least <= float(value) < below:
            small = float(value) < least
            what, end = ("small", "") if small else ("large", f", below {below:g}")
            hint = f"give {least:g} or more{end}"
            raise UsageError(f"{value} is too {what}", where=where, hint=hint)


#: First numbers of a unit that are too large for any machine, m too where points are named.
_MOST = {"N": 1e7, "M": 1e4, "M/S": 100.0, "HZ": 1e6, "PER_HOUR": 1e4, "MRAD": 1e4}
_MOST |= {"P": 1e6, "A": 1e6}
#: Kinds of value: what is taken for one, and what it is called.
_TAKEN: dict[Any, tuple[Any, str]] = {
    float: (Real, "a number"),
    int: (Integral, "a number"),
    bool: (bool, "True or False"),
    str: (str, "text"),
    Sequence: (Iterable, "a list of texts or numbers"),
    Mapping: (Mapping, "a mapping"),
}


@record
class Command:
    """A function that is a command.

    example : a command line, which begins with its name. every : its parameters in their order.
    """

    function: Callable[..., Result]
    example: str
    every: tuple[Described, ...]

    @property
    def parameters(self) -> tuple[Described, ...]:
        """Those that the command line has."""
        return tuple(each for each in self.every if each.kind)

    def call(self, line: str, *positional: Any, **options: Any) -> Result:
        """Call the function; its outputs appear together or not at all.

        line : what asks for it. What the system does not let be read or written is a UsageError.
        """
        given = signature(self.function).bind(*positional, **options)
        given.apply_defaults()
        values = given.arguments
        for parameter in self.every:
            parameter.check(values[parameter.name])
        values["progress"] = values["progress"] or silent
        expect("progress", values["progress"], Callable, "a function that takes a stage's name")
        if "command" in values:  # which no user sees
            values["command"] = line
        files = [p for p in self.every if p.writes is not None]
        asked = [(p, path) for p in files if (path := one(values[p.name]))]
        try:
            with together():
                check_outputs((p.names[0], path, p.writes or ()) for p, path in asked)
                result = self.function(*given.args, **given.kwargs)
                if isinstance(result, CommandResult):
                    result = replace(result, command=line)
                # What the gate rejects on request alone; a page whatever the verdict.
                accepted = result.exit_status == 0 or values.get("allow_rejected", True)
                for p, path in asked:
                    if p.holds == "html":
                        values["progress"]("drawing the report")
                    if p.holds and (accepted or p.holds == "html"):
                        result.write(path, p.holds)
                return result
        except OSError as fault:
            raise inaccessible(fault) from fault

    def in_python(self, error: TdfscalError) -> TdfscalError:
        """The same with options by the parameters' names; a line to paste stays what it is."""
        names = {p.names[0]: p.name for p in self.parameters}
        what, where, hint = (
            _FLAGS.sub(lambda found: names.get(found[0], found[0]), text or "")
            for text in (error.what, error.where, error.hint)
        )
        return error.restated(what=what * (what != error.what), where=where, hint=hint)


#: Options in a sentence, and lines to paste, which have theirs.
_FLAGS = re.compile("`tdfscal [^`]*`|--[a-z]+(?:-[a-z]+)*")
#: Commands whose modules were loaded, by name.
COMMANDS: dict[str, Command] = {}


def command(example: str) -> Callable[[_Function], _Function]:
    """Make a function a command, with its parameters in its docstring."""

    def make(function: _Function) -> _Function:
        hints, whole = get_type_hints(function, include_extras=True), signature(function)
        name = function.__name__
        named = {n: p for n, p in whole.parameters.items() if n != "command"}
        each = tuple(Described.of(p, hints[n]) for n, p in named.items())
        COMMANDS[name] = made = Command(function, example, each)

        @wraps(function)
        def run(*positional: Any, **options: Any) -> Result:
            from threadpoolctl import threadpool_limits

            # More threads of linear algebra wait for each other; numbers would follow the machine.
            with threadpool_limits(1, "blas"):
                try:
                    return made.call(f"tdfscal.{name}", *positional, **options)
                except TdfscalError as error:
                    raise made.in_python(error) from error.__cause__

        told = "\n".join(f"    {p.name} : {p.help}." for p in each)
        said = f"{str(function.__doc__).rstrip()}\n\n    Raises TdfscalError, by cause."
        run.__doc__ = f"{said}\n\n    Parameters\n    ----------\n{told}\n    "
        # `help` shows the types alone.
        bare = [named[p.name].replace(annotation=p.python) for p in each]
        bare[-1] = bare[-1].replace(default=None, annotation=Progress | None)  # nobody follows
        run.__signature__ = whole.replace(  # type: ignore[attr-defined]
            parameters=bare, return_annotation=hints["return"]
        )
        return run  # type: ignore[return-value]

    return make


def written(
    help: str, *writes: str, default: Any = ..., metavar: str = "FILE", shell: str = "",
    holds: str = "content",
) -> Option:  # fmt: skip
    """Say what the file is that a command writes; by default it must be named."""
    return Option(
        help, Path, metavar, ("--output", "-o"), default, shell=shell, writes=writes, holds=holds
    )


_UNITS = {"ms": 1e-3, "s": 1.0, "min": 60.0, "h": 3600.0}
_DURATION = re.compile(r"(\+?)\s*(-?[0-9.]+(?:[eE][+-]?[0-9]+)?)\s*(ms|s|min|h)?")


def numbers(option: str, value: Numbers) -> tuple[float, ...]:
    """Return finite numbers, of a sequence or of text such as `0.1,0.1,0.2`. Raises UsageError."""
    try:
        values = tuple(map(float, value.split(",") if isinstance(value, str) else value))
    except (TypeError, ValueError):
        values = ()
    if not values or not all(abs(one) < _MOST["M"] for one in values):
        hint = "write numbers as 0.1,0.1,0.2"
        raise UsageError(f"{value!r} is no list of numbers", where=option, hint=hint)
    return values


def triple(option: str, value: Numbers) -> tuple[float, float, float]:
    """Return three numbers, as `numbers`."""
    values = numbers(option, value)
    if len(values) != 3:
        raise UsageError(f"{value!r} is not three numbers", where=option, hint="write 0,0,0")
    return values[0], values[1], values[2]


def window(begin: Instant | None, end: Instant | None) -> TimeWindow | None:
    """Return the part of a log that `--from` and `--to` name; None for all. Raises UsageError."""
    if begin is None and end is None:
        return None
    first = None if begin is None else _moment("--from", begin)
    last = None if end is None else _moment("--to", end)
    if first and last and first.after_begin == last.after_begin and first.seconds >= last.seconds:
        what, hint = f"{first} is not before {last}", "give the earlier one first"
        raise UsageError(what, where="--from, --to", hint=hint)
    return TimeWindow(first, last)


def _moment(option: str, value: Instant) -> Moment:
    if isinstance(value, datetime):
        zoned = value if value.tzinfo else value.replace(tzinfo=UTC)
        return Moment(zoned.timestamp(), dated=True)
    text = str(value).strip()
    if found := _DURATION.fullmatch(text):
        with suppress(ValueError):
            seconds = float(found[2]) * _UNITS[found[3] or "s"]
            if isfinite(seconds):
                return Moment(seconds, after_begin=bool(found[1]))
    if (stamp := seconds_of(text)) is not None:
        return Moment(stamp, dated=True)
    raise UsageError(
        f"{text!r} is no time",
        where=option,
        hint="write s of the log's clock as 12.5, 1.5min or 2h; +90 for 90 s after the log's "
        "begin; or a date with a time, 2026-11-21T09:30:00+01:00",
    )


_MOMENT = "12.5, 1.5min or 2h on its clock; +90 after its begin; or a date with a time"

Paths = Annotated[PathLikes, Option("campaign folder, or log files", list[Path], "PATH")]
RigFile = Annotated[
    PathLike | None, Option("a rig.yaml, where no folder holds one", Path | None, "FILE")
]
OneCalibration = Annotated[
    CalibrationSource, Option("calibration file", Path, "CALIBRATION", shell="- for stdin")
]
Several = CalibrationSource | Iterable[CalibrationSource]
Begin = Annotated[Instant | None, Option(f"use the log from T on: {_MOMENT}", str | None, "T")]
End = Annotated[Instant | None, Option("use the log up to T", str | None, "T")]
Page = Annotated[
    PathLike | None,
    Option(
        "also write a report page, whatever the verdict",
        Path | None,
        "FILE",
        writes=PAGE_SUFFIXES,
        holds="html",
        dash=False,
    ),
]
Trials = Annotated[int | None, Option("Monte Carlo trials at most; 0 for none", least=0)]
AllowRejected = Annotated[bool, Option("write the file even if the gate rejects it")]
LcsPoint = Annotated[
    Numbers, Option("point of the LCS that moments are about, m", str, "X,Y,Z", default="0,0,0")
]
Telling = Annotated[Progress, Option("called with each stage of the work that begins", None)]
