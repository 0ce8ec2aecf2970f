"""A command's parameters, told once: Python's help, the command line, the reference follow."""

from __future__ import annotations

from collections.abc import Callable, Iterable, Iterator, Mapping
from dataclasses import dataclass
from functools import wraps
from inspect import Parameter, Signature, signature
from pathlib import Path
from typing import Annotated, Any, Literal, TypeVar, get_args, get_origin, get_type_hints

from tdfscal.errors import inaccessible
from tdfscal.files.outputs import together
from tdfscal.memory import is_short
from tdfscal.workflows.arguments import Instant, Numbers, PathLike, PathLikes, check_argument
from tdfscal.workflows.calibration import CalibrationSource
from tdfscal.workflows.progress import Progress

_Function = TypeVar("_Function", bound=Callable[..., Any])


@dataclass(frozen=True, slots=True)
class Option:
    """What a parameter says of itself.

    help : a clause that begins small and has no full stop. python : what Python takes besides.
    kind : its type on the command line, where that is not the annotation's; None there for what
    only Python has. metavar : what the help shows in its place. names : of the option, where they
    are not that of the parameter. default : on the command line, where it is another; `...` must
    be given. least : smallest number.
    """

    help: str
    kind: Any = ...
    metavar: str | None = None
    names: tuple[str, ...] = ()
    default: Any = None
    least: float | None = None
    python: str = ""


@dataclass(frozen=True, slots=True)
class Described:
    """A parameter of a command as the command line has it.

    kind : its type there. default : `...` where it must be given. positional : it stands without
    a name.
    """

    name: str
    kind: Any
    default: Any
    positional: bool
    option: Option

    @property
    def flags(self) -> tuple[str, ...]:
        """Names of the option."""
        return _flags(self.name, self.option)

    @property
    def values(self) -> str:
        """What it takes, in a word; nothing where it is on or off."""
        members = self.kind, *getattr(self.kind, "__args__", ())
        for one in members:
            if get_origin(one) is Literal:
                return "|".join(get_args(one))
        return self.option.metavar or ("" if self.kind is bool else "N")


@dataclass(frozen=True, slots=True)
class Command:
    """A function that is a command.

    example : a command line. carries : options that take `-` for standard output, and the text of
    the result that it gets.
    """

    function: Callable[..., Any]
    example: str
    carries: Mapping[str, str]

    @property
    def parameters(self) -> Iterator[Described]:
        """Those that the command line has, in the order of the function."""
        hints = get_type_hints(self.function, include_extras=True)
        for name, parameter in signature(self.function).parameters.items():
            kind, option = _of(hints[name])
            if option.kind is None:
                continue
            given = parameter.kind is not Parameter.KEYWORD_ONLY and not option.names
            required = given and parameter.default is Parameter.empty
            default = ... if required else parameter.default
            if option.default is not None:
                default = option.default
            shown = kind if option.kind is ... else option.kind
            yield Described(name, shown, default, given, option)


#: Commands whose modules were loaded, by name.
COMMANDS: dict[str, Command] = {}


def command(example: str, **carries: str) -> Callable[[_Function], _Function]:
    """Make a function a command: outputs together or not at all, parameters in its docstring.

    example : a command line, which begins with the command's name. carries : as in `Command`.
    """

    def make(function: _Function) -> _Function:
        made = _checked(function)
        told = "\n".join(_told(name, hint) for name, hint in _hints(function))
        head, raises, tail = str(function.__doc__).partition("\n\n    Raises\n")
        made.__doc__ = f"{head}\n\n    Parameters\n    ----------\n{told}{raises}{tail}"
        made.__signature__ = _plain(function)
        COMMANDS[function.__name__] = Command(made, example, carries)
        return made  # type: ignore[no-any-return]

    return make


def _checked(function: Callable[..., Any]) -> Any:
    """Let a function refuse arguments of a wrong type, and make its outputs all or none.

    What the system does not let be read or written is an error of this library too.
    """
    whole, types = signature(function), dict(_hints(function))

    @wraps(function)
    def call(*positional: Any, **named: Any) -> Any:
        for name, value in whole.bind(*positional, **named).arguments.items():
            kind, option = _of(types[name])
            of = whole.parameters[name].kind
            where = _flags(name, option)[0] if of is Parameter.KEYWORD_ONLY else name
            for one in value if of is Parameter.VAR_POSITIONAL else (value,):
                check_argument(where, one, kind, option.least)
        try:
            with together():
                return function(*positional, **named)
        except OSError as fault:
            if is_short(fault):
                raise
            raise inaccessible(fault) from fault

    return call


def _flags(name: str, option: Option) -> tuple[str, ...]:
    """Names of a parameter's option."""
    return option.names or (f"--{name.rstrip('_').replace('_', '-')}",)


def _plain(function: Callable[..., Any]) -> Signature:
    """Return its signature with the types alone, as `help` shows it."""
    types, whole = get_type_hints(function), signature(function)
    bare = [one.replace(annotation=types[name]) for name, one in whole.parameters.items()]
    return whole.replace(parameters=bare, return_annotation=types["return"])


def _hints(function: Callable[..., Any]) -> Iterable[tuple[str, Any]]:
    hints = get_type_hints(function, include_extras=True)
    return [(name, hint) for name, hint in hints.items() if name != "return"]


def _of(hint: Any) -> tuple[Any, Option]:
    """Return the type and the option of an annotation."""
    if get_origin(hint) is not Annotated:
        raise TypeError(f"{hint} says nothing of itself")
    kind, option = get_args(hint)
    return kind, option


def _told(name: str, hint: Any) -> str:
    _, option = _of(hint)
    more = f"; {option.python}" if option.python else ""
    return f"    {name} : {option.help}{more}."


def sentence(option: Option) -> str:
    """Return an option's help as the command line and the reference print it."""
    return f"{option.help[0].upper()}{option.help[1:]}."


_MOMENT = "12.5, 1.5min or 2h on its clock; +90 after its begin; or a date with a time"

Paths = Annotated[PathLikes, Option("campaign folder, or log files", list[Path], "PATH")]
RigFile = Annotated[
    PathLike | None, Option("a rig.yaml, where no folder holds one", Path | None, "FILE")
]
OneCalibration = Annotated[
    CalibrationSource,
    Option(
        "calibration file; - for stdin", Path, "CALIBRATION", python="or a calibration in memory"
    ),
]
Begin = Annotated[
    Instant | None,
    Option(f"use the log from T on: {_MOMENT}", str | None, "T", ("--from",)),
]
End = Annotated[Instant | None, Option("use the log up to T", str | None, "T")]
Page = Annotated[
    PathLike | None,
    Option("also write a report page, whatever the verdict", Path | None, "FILE"),
]
Trials = Annotated[int | None, Option("Monte Carlo trials at most; 0 for none", least=0)]
AllowRejected = Annotated[bool, Option("write the file even if the gate rejects it")]
LcsPoint = Annotated[
    Numbers, Option("point of the LCS that moments are about, m", str, "X,Y,Z", default="0,0,0")
]
CommandLine = Annotated[str, Option("kept with the result, as what was asked for", None)]
Telling = Annotated[Progress, Option("called as the work goes on", None)]
