"""A command's parameters, told once: Python's help, the command line, the reference follow.

So do its files: no output may replace what a parameter reads, and a command's function only returns
the result from which the files are written.
"""

from __future__ import annotations

import re
from collections.abc import Callable, Iterable, Mapping, Sequence, Sized
from datetime import datetime
from functools import partial, reduce, wraps
from inspect import Parameter, signature
from math import inf
from numbers import Integral, Real
from os import PathLike
from pathlib import Path
from reprlib import repr as shortly
from types import UnionType
from typing import Annotated, Any, Literal, TypeVar, Union, get_args, get_origin, get_type_hints

from tdfscal.commands import arguments
from tdfscal.commands.arguments import Instant, Numbers, PathLikes, Progress, at_hand, listed, one
from tdfscal.commands.calibration import CalibrationSource
from tdfscal.commands.campaign import inputs_read
from tdfscal.commands.result import Result
from tdfscal.errors import TdfscalError, UsageError, inaccessible
from tdfscal.files.outputs import PAGE_SUFFIXES, check_outputs, together
from tdfscal.frozen import record, replace
from tdfscal.memory import is_short

_Function = TypeVar("_Function", bound=Callable[..., Any])
#: What takes the place of a number in Python, and what a user is told to give.
_NUMBERS: Mapping[Any, type] = {int: Integral, float: Real}
_SAID: Mapping[Any, str] = {
    datetime: "s as a number or text, or a datetime",
    PathLike[str]: "a path",
    Sequence[float]: "numbers",
    Progress: "a Progress",
    bool: "True or False",
    int: "a whole number",
    float: "a number",
    str: "text",
}


@record
class Option:
    """What a parameter says of itself.

    help : a clause that begins small and has no full stop. kind : its type on the command line,
    where that is not the annotation's; None there for what only Python has. metavar : what the
    help shows in its place. names : of the option, where they are not that of the parameter.
    default : on the command line, where it is another; `...` must be given. least, below : smallest
    number, and the first that is too large. python, shell : what Python, or the command line, takes
    besides. reads : it names files to read. writes : endings of a file to write, any where there is
    none. holds : the text of the result that it gets; nothing where the function writes it while it
    works.
    """

    help: str
    kind: Any = ...
    metavar: str | None = None
    names: tuple[str, ...] = ()
    default: Any = None
    least: float | None = None
    below: float = inf
    python: str = ""
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
    name. flags : names of the option. words : among which it chooses. repeated : it takes all that
    stands without a name.
    """

    name: str
    kind: Any
    shown: Any
    default: Any
    positional: bool
    flags: tuple[str, ...]
    words: tuple[str, ...]
    repeated: bool
    option: Option

    @classmethod
    def of(cls, parameter: Parameter, annotation: Any) -> Described:
        """Read it off a function's annotation."""
        kind, option = get_args(annotation)
        name, positional = parameter.name, parameter.kind is not Parameter.KEYWORD_ONLY
        given = positional and not option.names
        required = given and parameter.default is Parameter.empty
        default = ... if required else parameter.default
        if option.default is not None:
            default = option.default
        flags = option.names or (f"--{name.rstrip('_').replace('_', '-')}",)
        shown = kind if option.kind is ... else option.kind
        choices = [one for one in (kind, *get_args(kind)) if get_origin(one) is Literal]
        words = get_args(choices[0]) if choices else ()
        repeated = parameter.kind is Parameter.VAR_POSITIONAL
        flags = (name,) if given else flags
        return cls(name, kind, shown, default, given, flags, words, repeated, option)

    @property
    def _wanted(self) -> str:
        """What to give, in words."""
        if self.words:
            return " or ".join([", ".join(self.words[:-1]), self.words[-1]])
        if self.option.reads:
            first, _, rest = (
                self.option.help.partition(";")[0].replace(", or", " or").partition(" ")
            )
            return f"{first} {rest}" if rest.split()[0].endswith("s") else f"a {first} {rest}"
        kinds = (*get_args(self.kind), self.kind)
        return next((said for kind, said in _SAID.items() if kind in kinds), self.option.help)

    def in_python(self, text: str) -> str:
        """A text with the parameter's name in place of its flags, as Python writes it."""
        flags = "|".join(flag for flag in self.flags if flag.startswith("-"))
        if not flags:
            return text
        words = rf"(?: ({'|'.join(self.words)})\b)?" if self.words else "()"
        return re.sub(
            rf"(?<![\w/-])`?(?:{flags})(?![\w-]){words}`?",
            lambda found: f"`{self.name}={found[1]!r}`" if found[1] else f"`{self.name}`",
            text,
        )

    def check(self, value: Any) -> None:
        """Raise UsageError for what is not of the parameter's kind, or a number out of bounds."""
        if self.default == () and isinstance(value, Sized) and not len(value):
            return
        each = value if self.repeated else (value,)
        if not each or not all(_fits(one, self.kind) for one in each):
            wrong = next((one for one in each if not _fits(one, self.kind)), value)
            raise UsageError(f"expected {self._wanted}, got {shortly(wrong)}", where=self.flags[0])
        least, below = self.option.least, self.option.below
        if least is not None and value is not None and not least <= value < below:
            what, end = ("small", "") if value < least else ("large", f", below {below:g}")
            raise UsageError(
                f"{value} is too {what}", where=self.flags[0], hint=f"give {least:g} or more{end}"
            )


def _fits(value: Any, kind: Any) -> bool:
    """Tell whether a value is of a kind as annotations write it; nothing empty is."""
    origin, inside = get_origin(kind), get_args(kind)
    if origin in (Union, UnionType):
        return any(_fits(value, one) for one in inside)
    if origin is Literal:
        return isinstance(value, str) and value in inside
    if kind in _NUMBERS:
        number = isinstance(value, _NUMBERS[kind]) and not isinstance(value, bool)
        return number and value == value  # no NaN
    if origin in (Sequence, Iterable):
        if inside[0] is float and hasattr(value, "tolist"):
            value = value.tolist()
        whole = isinstance(value, list | tuple) and bool(value)
        return whole and all(_fits(one, inside[0]) for one in value)
    return isinstance(value, origin or kind) and not (isinstance(value, str) and value == "")


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
        each = {name: Described.of(p, hints[name]) for name, p in whole.parameters.items()}

        @wraps(function)
        def run(*positional: Any, **named: Any) -> Any:
            given = whole.bind(*positional, **named)
            given.apply_defaults()
            values = given.arguments
            for name, parameter in each.items():
                if isinstance(values[name], str) and parameter.kind is str:
                    values[name] = values[name].encode("utf-8", "replace").decode()
                values[name] = at_hand(values[name])  # an iterator would be empty the second time
                parameter.check(values[name])
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

        told = (
            f"    {name} : {'; '.join(filter(None, (p.option.help, p.option.python)))}."
            for name, p in each.items()
        )
        parameters = _in_python(each.values(), "\n".join(told))
        head, raises, tail = str(function.__doc__).partition("\n\n    Raises\n")
        run.__doc__ = f"{head}\n\n    Parameters\n    ----------\n{parameters}{raises}{tail}"
        # `help` shows the types alone.
        bare = [p.replace(annotation=each[name].kind) for name, p in whole.parameters.items()]
        run.__signature__ = whole.replace(  # type: ignore[attr-defined]
            parameters=bare, return_annotation=hints["return"]
        )

        @wraps(run)
        def call(*positional: Any, **named: Any) -> Any:
            try:
                return run(*positional, **named)
            except TdfscalError as error:
                error.reword(partial(_in_python, each.values()))
                raise

        named = tuple(p for p in each.values() if p.shown is not None)
        COMMANDS[function.__name__] = Command(run, example, carries, named)
        return call  # type: ignore[return-value]

    return make


def _in_python(parameters: Iterable[Described], text: str) -> str:
    """A text with parameters in place of flags, but for a command line that it gives."""
    parts = re.split(r"(`tdfscal [^`]*`)", text)
    parts[::2] = [reduce(lambda t, p: p.in_python(t), parameters, part) for part in parts[::2]]
    return "".join(parts)


def _check_files(parameters: Mapping[str, Described], values: Mapping[str, Any]) -> None:
    """Refuse outputs that cannot be written, or that would replace what the command reads."""
    reads, rig = list[Path](), None
    outputs = dict[str, tuple[Path | None, tuple[str, ...]]]()
    for name, parameter in parameters.items():
        option, value = parameter.option, values[name]
        if name == "rig":  # a file, or the folder that holds it
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
    parameters: Mapping[str, Described], values: Mapping[str, Any], result: Result
) -> None:
    """Write what is asked for; a page whatever the verdict, what the gate rejects on request."""
    written = result.exit_status == 0 or values.get("allow_rejected", True)
    for name, parameter in parameters.items():
        holds, path = parameter.option.holds, one(values[name]) if parameter.option.holds else None
        if path is None or not (written or holds == "html"):
            continue
        if holds == "html":
            values["progress"].stage("drawing the report")
        result.write(path, holds)


def written(
    help: str,
    *writes: str,
    default: Any = ...,
    metavar: str = "FILE",
    python: str = "",
    shell: str = "",
    holds: str = "content",
) -> Option:
    """Say what the file is that a command writes; by default it must be named."""
    option = Option(help, Path, metavar, ("--output", "-o"), default, python=python, shell=shell)
    return replace(option, writes=writes, holds=holds)


_MOMENT = "12.5, 1.5min or 2h on its clock; +90 after its begin; or a date with a time"

Paths = Annotated[
    PathLikes, Option("campaign folder, or log files", list[Path], "PATH", reads=True)
]
RigFile = Annotated[
    arguments.PathLike | None, Option("a rig.yaml, where no folder holds one", Path | None, "FILE")
]
OneCalibration = Annotated[
    CalibrationSource,
    Option(
        "calibration file; - for stdin",
        Path,
        "CALIBRATION",
        python="or a calibration in memory",
        reads=True,
    ),
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
