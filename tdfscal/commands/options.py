"""A command's parameters, told once: Python's help, the command line, the reference follow.

So do its files: no output may replace what a parameter reads, and a command's function only returns
the result from which the files are written.
"""

from __future__ import annotations

from collections.abc import Callable, Iterable, Mapping
from functools import wraps
from inspect import Parameter, signature
from math import inf
from numbers import Integral, Real
from os import PathLike
from pathlib import Path
from reprlib import repr as shortly
from typing import Annotated, Any, Literal, TypeVar, get_args, get_origin, get_type_hints

from tdfscal.commands import arguments
from tdfscal.commands.arguments import Instant, Numbers, PathLikes, Progress, listed, one
from tdfscal.commands.campaign import inputs_read
from tdfscal.commands.result import CalibrationSource, Result
from tdfscal.errors import UsageError, inaccessible, is_short
from tdfscal.files.outputs import PAGE_SUFFIXES, check_outputs, together
from tdfscal.files.yaml import as_path
from tdfscal.frozen import record

_Function = TypeVar("_Function", bound=Callable[..., Any])


@record
class Option:
    """What a parameter says of itself.

    help : a clause that begins small and has no full stop. kind : its type on the command line,
    where that is not the annotation's; None there for what only Python has. metavar : what the
    help shows in its place. names : of the option, where they are not that of the parameter.
    default : on the command line, where it is another; `...` must be given. least, below : smallest
    number, and the first that is too large. shell : what the command line takes besides. reads : it
    names files to read. writes : endings of a file to write, any where there is none. holds : the
    text of the result that it gets; nothing where the function writes it while it works.
    """

    help: str
    kind: Any = ...
    metavar: str | None = None
    names: tuple[str, ...] = ()
    default: Any = None
    least: float | None = None
    below: float = inf
    shell: str = ""
    reads: bool = False
    writes: tuple[str, ...] | None = None
    holds: str = ""

    @property
    def sentence(self) -> str:
        """Its help as the command line and the reference print it."""
        text = "; ".join(filter(None, (self.help, self.shell)))
        return f"{text[0].upper()}{text[1:]}."


@record
class Described:
    """A parameter of a command.

    kind, shown : its types in Python and on the command line; shown None where only Python has it.
    default : on the command line; `...` where it must be given. positional : it stands without a
    name. flags : names of the option. words : among which it chooses.
    """

    name: str
    kind: Any
    shown: Any
    default: Any
    positional: bool
    flags: tuple[str, ...]
    words: tuple[str, ...]
    option: Option

    @classmethod
    def of(cls, parameter: Parameter, annotation: Any) -> Described:
        """Read it off a function's annotation."""
        kind, option = get_args(annotation)
        name = parameter.name
        given = parameter.kind is not Parameter.KEYWORD_ONLY and not option.names
        required = given and parameter.default is Parameter.empty
        default = ... if required else parameter.default
        if option.default is not None:
            default = option.default
        flags = option.names or (f"--{name.rstrip('_').replace('_', '-')}",)
        shown = kind if option.kind is ... else option.kind
        choices = [one for one in (kind, *get_args(kind)) if get_origin(one) is Literal]
        words = get_args(choices[0]) if choices else ()
        return cls(name, kind, shown, default, given, (name,) if given else flags, words, option)

    def check(self, value: Any) -> None:
        """Raise UsageError for none of its words, or for what is no number within its bounds."""
        if value is None:
            return
        where, least, below = self.flags[0], self.option.least, self.option.below
        if self.words and value not in self.words:
            raise UsageError(f"{value!r} is none of {', '.join(self.words)}", where=where)
        kinds = (self.kind, *get_args(self.kind))
        if int in kinds or (float in kinds and not {str, PathLike[str]}.intersection(kinds)):
            wanted = Integral if int in kinds else Real
            if not isinstance(value, wanted) or isinstance(value, bool) or value != value:
                raise UsageError(f"expected a number, got {shortly(value)}", where=where)
            if least is not None and not least <= float(value) < below:
                small = float(value) < least
                what, end = ("small", "") if small else ("large", f", below {below:g}")
                hint = f"give {least:g} or more{end}"
                raise UsageError(f"{value} is too {what}", where=where, hint=hint)


@record
class Command:
    """A function that is a command.

    example : a command line. carries : options that take `-` for standard output, and the text of
    the result that it gets. parameters : those that the command line has, in their order.
    """

    function: Callable[..., Any]
    example: str
    carries: Mapping[str, str]
    parameters: tuple[Described, ...]


#: Commands whose modules were loaded, by name.
COMMANDS: dict[str, Command] = {}


def command(example: str, **carries: str) -> Callable[[_Function], _Function]:
    """Make a function a command: outputs together or not at all, parameters in its docstring.

    What the system does not let be read or written is an error of this library too.

    example : a command line, which begins with the command's name. carries : as in `Command`.
    """

    def make(function: _Function) -> _Function:
        hints, whole = get_type_hints(function, include_extras=True), signature(function)
        each = tuple(Described.of(p, hints[name]) for name, p in whole.parameters.items())

        @wraps(function)
        def run(*positional: Any, **named: Any) -> Any:
            given = whole.bind(*positional, **named)
            given.apply_defaults()
            values = given.arguments
            for parameter in each:
                parameter.check(values[parameter.name])
            try:
                with together():
                    _check_files(each, values)
                    result = function(*given.args, **given.kwargs)
                    _write_files(each, values, result)
                    return result
            except OSError as fault:
                if is_short(fault):
                    raise
                raise inaccessible(fault) from fault

        told = "\n".join(f"    {p.name} : {p.option.help}." for p in each)
        head, raises, tail = str(function.__doc__).partition("\n\n    Raises\n")
        run.__doc__ = f"{head}\n\n    Parameters\n    ----------\n{told}{raises}{tail}"
        # `help` shows the types alone.
        bare = [whole.parameters[p.name].replace(annotation=p.kind) for p in each]
        run.__signature__ = whole.replace(  # type: ignore[attr-defined]
            parameters=bare, return_annotation=hints["return"]
        )
        named = tuple(p for p in each if p.shown is not None)
        COMMANDS[function.__name__] = Command(run, example, carries, named)
        return run  # type: ignore[return-value]

    return make


def _check_files(parameters: Iterable[Described], values: Mapping[str, Any]) -> None:
    """Refuse outputs that cannot be written, or that would replace what the command reads."""
    reads, rig = list[Path](), None
    outputs = dict[str, tuple[Path | None, tuple[str, ...]]]()
    for parameter in parameters:
        option, value = parameter.option, values[parameter.name]
        if parameter.name == "rig":  # a file, or the folder that holds it
            rig = one(value)
        elif option.reads:
            reads += _paths_in(value)
        elif option.writes is not None:
            outputs[parameter.flags[0]] = one(value), option.writes
    check_outputs(outputs, inputs_read(reads, rig))


def _paths_in(value: Any) -> list[Path]:
    """Paths, not what is in memory."""
    if isinstance(value, list | tuple):
        return [path for one in value for path in _paths_in(one)]
    return listed(value) if isinstance(value, str | PathLike) else []


def _write_files(
    parameters: Iterable[Described], values: Mapping[str, Any], result: Result
) -> None:
    """Write what is asked for; a page whatever the verdict, what the gate rejects on request."""
    written = result.exit_status == 0 or values.get("allow_rejected", True)
    for parameter in parameters:
        holds, path = parameter.option.holds, values[parameter.name]
        if not holds or path is None or not (written or holds == "html"):
            continue
        if holds == "html":
            values["progress"].stage("drawing the report")
        result.write(as_path(path), holds)


def written(
    help: str, *writes: str, default: Any = ..., metavar: str = "FILE", shell: str = "",
    holds: str = "content",
) -> Option:  # fmt: skip
    """Say what the file is that a command writes; by default it must be named."""
    return Option(
        help, Path, metavar, ("--output", "-o"), default, shell=shell, writes=writes, holds=holds
    )


_MOMENT = "12.5, 1.5min or 2h on its clock; +90 after its begin; or a date with a time"

Paths = Annotated[
    PathLikes, Option("campaign folder, or log files", list[Path], "PATH", reads=True)
]
RigFile = Annotated[
    arguments.PathLike | None, Option("a rig.yaml, where no folder holds one", Path | None, "FILE")
]
OneCalibration = Annotated[
    CalibrationSource,
    Option("calibration file", Path, "CALIBRATION", shell="- for stdin", reads=True),
]
Several = CalibrationSource | Iterable[CalibrationSource]
Begin = Annotated[
    Instant | None,
    Option(f"use the log from T on: {_MOMENT}", str | None, "T", ("--from",)),
]
End = Annotated[Instant | None, Option("use the log up to T", str | None, "T")]
Page = Annotated[
    arguments.PathLike | None,
    Option(
        "also write a report page, whatever the verdict",
        Path | None,
        "FILE",
        writes=PAGE_SUFFIXES,
        holds="html",
    ),
]
Trials = Annotated[int | None, Option("Monte Carlo trials at most; 0 for none", least=0)]
AllowRejected = Annotated[bool, Option("write the file even if the gate rejects it")]
LcsPoint = Annotated[
    Numbers, Option("point of the LCS that moments are about, m", str, "X,Y,Z", default="0,0,0")
]
CommandLine = Annotated[str, Option("kept with the result, as what was asked for", None)]
Telling = Annotated[Progress, Option("called as the work goes on", None)]
