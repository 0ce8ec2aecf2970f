"""The errors a user can cause, by cause; each carries its exit status."""

from __future__ import annotations

import errno
import os
import re
from collections.abc import Callable, Sequence
from reprlib import repr as shortly
from typing import Any, ClassVar, Self

from tdfscal.findings import Finding

#: A number as a computer writes it; not a part of a name or a path.
_EXPONENT = re.compile(r"(?<![\w./-])([-+]?\d[\d.]*)e([-+]\d\d+)(?![\w/]|\.\w)")
_LONG = re.compile(r"(\S{120})\S{400,}?(\S{0,20}(?!\S))")
#: Powers of ten from which on the digits of a number are too many to be read.
_UNREADABLE = 16


def without_exponent(text: str) -> str:
    """Text for people: 2e+07 is 20000000; beyond all sense a power of ten, 1·10^300."""
    if "e-" not in text and "e+" not in text:
        return text
    from decimal import Decimal

    def written(number: re.Match[str]) -> str:
        if abs(int(number[2])) >= _UNREADABLE:
            return f"{number[1]}·10^{int(number[2])}"
        return f"{Decimal(number[0]):{'+' * (number[0][0] == '+')}f}"

    return _EXPONENT.sub(written, text)


def visible(text: str) -> str:
    r"""Text for people: a character that does not print becomes an escape such as ``\u202e``.

    So no name or file can steer a terminal, break a line, or turn the direction of reading.
    """
    if text.isprintable():
        return text
    return "".join(
        c if c.isprintable() else c.encode("unicode_escape", "surrogatepass").decode("ascii")
        for c in text
    )


def without_tails(text: str) -> str:
    """Text for people: of words longer than any path that is read, the begin."""
    return _LONG.sub(r"\1…\2", text)


#: What a finding says, where, and what to do about it; the catalogue of findings gives these words.
Words = Callable[[Finding], tuple[str, str, str]]
_words: Words = lambda finding: (f"{finding.code} {finding}", "", "")  # noqa: E731


def put_into_words(words: Words) -> None:
    """Let errors that carry a finding speak."""
    global _words
    _words = words


class TdfscalError(Exception):
    """What is wrong, where, and what to do about it: one paragraph.

    Parameters
    ----------
    what : what is wrong, a sentence without its full stop; or a finding, whose words say all.
    where : file, field, line or time; put in front of the sentence.
    hint : what to do, a sentence without its full stop.
    evidence : records of what was seen until then, for a page about it.
    fields : of a log, that are there and hold no number.
    findings : what was found, for those who have the words.
    """

    exit_status: ClassVar[int] = 3
    #: Of the finding of an error that is stated in words.
    code: ClassVar[str] = "data-unusable"

    def __init__(
        self,
        what: str | Finding,
        *,
        where: str | None = None,
        hint: str | None = None,
        evidence: object = None,
        fields: Sequence[str] = (),
        findings: tuple[Finding, ...] = (),
    ) -> None:
        self._finding = what if isinstance(what, Finding) else None
        if isinstance(what, Finding):
            what, place, advice = _words(what)
            where, hint = where or place or None, hint or advice or None
        self.what, self.where, self.hint, self.evidence = what, where, hint, evidence
        self.fields, self.findings = tuple(fields), findings
        place = f"{where}: " if where else ""
        advice = f" {hint[0].upper()}{hint[1:]}." if hint else ""
        super().__init__(without_exponent(visible(without_tails(f"{place}{what}.{advice}"))))

    def __reduce__(self) -> tuple[Any, ...]:
        return type(self).__new__, (type(self), *self.args), self.__dict__

    @property
    def finding(self) -> Finding:
        """What is wrong, by its code: its class's own where the error is stated in words."""
        return self._finding or Finding(
            self.code, values={"what": self.what, "hint": self.hint or ""}
        )

    def restated(
        self,
        *,
        what: str | None = None,
        where: str | None = None,
        hint: str | Finding | None = None,
    ) -> Self:
        """The same error, with its evidence, in other words; those not given stay."""
        if isinstance(hint, Finding):
            hint = _words(hint)[2]
        error = type(self)(
            what or self.what,
            where=where or self.where,
            hint=hint or self.hint,
            evidence=self.evidence,
            fields=self.fields,
            findings=() if what else self.findings,
        )
        error._finding = self._finding
        return error


class UsageError(TdfscalError):
    """The command line asks for what cannot be done, or names a file that is not there."""

    exit_status = 2
    code = "usage-wrong"


class OutputError(UsageError):
    """A result cannot be written where it is asked for, or would replace an input."""

    code = "output-refused"


class MemoryShortError(TdfscalError):
    """The memory that this run may use does not suffice."""

    exit_status = 2
    code = "memory-short"


class RigError(TdfscalError):
    """The rig file is wrong."""

    exit_status = 2
    code = "rig-wrong"


class DataError(TdfscalError):
    """A log, point file or calibration file cannot be used."""

    exit_status = 3


class NotIdentifiableError(TdfscalError):
    """The data do not determine what was asked for."""

    exit_status = 4
    code = "not-identifiable"


class NotConvergedError(TdfscalError):
    """The iteration found no answer that can be trusted."""

    exit_status = 4
    code = "not-converged"


class RejectedError(TdfscalError):
    """The quality gate rejected what is asked to be used."""

    exit_status = 1
    code = "calibration-rejected"


def expect(name: str, value: object, kinds: Any, wanted: str) -> None:
    """Raise UsageError where an argument is of none of these types; wanted : what to give."""
    if not isinstance(value, kinds):
        raise UsageError(f"expected {wanted}, got {shortly(value)}", where=name)


def reason(fault: OSError) -> str:
    """Say in the system's own words why it failed, not in those of a library."""
    return os.strerror(fault.errno) if fault.errno else str(fault)


def inaccessible(fault: OSError) -> TdfscalError:
    """Return the error of a file or folder that the system does not let be read or written."""
    if is_short(fault):
        return shortage()
    return UsageError(
        f"cannot be read or written: {reason(fault)}",
        where=str(fault.filename or "a file or folder"),
        hint="check the path, make room, or choose another place",
    )


def shortage() -> MemoryShortError:
    """Return the error of too little memory."""
    return MemoryShortError(
        "the memory does not suffice for this run",
        hint="close other programs, raise the limit of what the run may use (`ulimit -v "
        "unlimited`), or use a part of the log (`--from`, `--to`)",
    )


def is_short(error: BaseException) -> bool:
    """Tell whether an error comes of too little memory, itself or what it was raised from."""
    seen, at = set[int](), error
    while id(at) not in seen:  # an error may be raised from itself
        if isinstance(at, MemoryError | MemoryShortError):
            return True
        if isinstance(at, OSError) and at.errno == errno.ENOMEM:
            return True
        seen.add(id(at))
        at = at.__cause__ or at.__context__ or at
    return False
