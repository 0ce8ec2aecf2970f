"""How a finding is put into words: a row of the catalogue, and what its fields may be."""

from __future__ import annotations

import re
from collections.abc import Sequence
from string import Formatter
from typing import Any, cast

import numpy as np

from tdfscal.catalogue.numbers import (
    UNITS,
    p_text,
    probability,
    quantity,
    upwards,
    when,
    with_std,
)
from tdfscal.errors import visible, without_exponent
from tdfscal.findings import Finding, Severity
from tdfscal.frozen import record
from tdfscal.numerics.distributions import INTERVAL_FACTOR

#: Times so close, s, are told to a tenth.
_CLOSE = 10.0


@record
class Entry:
    """What is said of a code.

    sentence, cure : templates; the cure is an imperative, empty where nothing is to do. Their
    fields: {subject} (names, joined), {size} (with its unit), {number} (without), {p}, {stated}
    (the size upwards to one digit, as a rig file states it), {spread} (half of the size's 95 %
    interval), and the finding's own values, after a
    colon with a unit (± before it: as half an interval), with `time` (two moments), or with words
    for yes|no, where ~ is the value; so have {subjects} for more than one name, {several} for a
    count above one, {until} and {cut} for where to end the part before something changed, and to
    begin the part behind, s.
    clauses : what the sentence goes on with where a value holds. where : what of a campaign it is
    about, where an error says it.
    """

    severity: Severity
    sentence: str
    cure: str
    clauses: tuple[tuple[str, str], ...]
    where: str

    def words(self, finding: Finding) -> str:
        """Return what a finding says."""
        fields = _fields(finding)
        said = [clause for name, clause in self.clauses if fields.get(name)]
        return _said(self.sentence + "".join(said), fields)

    def advice(self, finding: Finding) -> str:
        """Return what to do about it."""
        return _said(self.cure, _fields(finding))


def entries(rows: str, sentence: str = "%s", more: str = "", code: str = "%s") -> dict[str, Entry]:
    """Read a table of findings, by their codes.

    rows : of each finding `code severity`, and indented below it the sentence; behind `?` a value
    and the clause that it adds, behind `->` the cure, behind `@` where. more : lines that each row
    has besides. sentence, code : what stands around each row's own.
    """
    found = {}
    for row in re.split(r"\n(?=\S)", rows.strip()):
        name, severity, *words = f"{row}\n{more}".split()
        own, *marked = re.split(r" (->|[?@]) ", " ".join(words))
        parts: dict[str, list[str]] = {"?": [], "->": [], "@": []}
        for mark, text in zip(marked[::2], marked[1::2], strict=True):
            parts[mark].append(text)
        found[code % name] = Entry(
            cast(Severity, severity),
            sentence % own,
            "".join(parts["->"]),
            tuple(_clause(*text.split(" ", 1)) for text in parts["?"]),
            "".join(parts["@"]),
        )
    return found


def _clause(value: str, text: str) -> tuple[str, str]:
    return value, text if text[0] in ",;:" else f" {text}"


class _Sizes(list[float]):
    """Sizes with the uncertainty of each, and what is `beside` them in the same unit."""

    def __init__(self, sizes: Sequence[float], stds: Sequence[float], beside: Sequence[float]):
        super().__init__(sizes)
        self.stds, self.beside = stds, beside


class _Words(Formatter):
    """Fields with units, yes and no, and lists."""

    def get_value(self, key: int | str, args: Any, kwargs: Any) -> Any:
        return kwargs.get(key)

    def format_field(self, value: Any, format_spec: str) -> str:
        if "|" in format_spec:
            said = ", ".join(value) if isinstance(value, list | tuple) else str(value)
            return format_spec.split("|")[0 if value else 1].replace("~", said)
        if format_spec == "time":
            if not value:
                return ""
            digits = 0 if value[1] - value[0] > _CLOSE else 1
            first, last = (when(round(each, digits)) for each in value)
            return f", between {first} and {last}"
        if value is None:
            return "–"
        if format_spec == "when":
            return when(value)
        if isinstance(value, _Sizes):
            unit, sign = ("", format_spec) if format_spec in ("+", "-") else (format_spec, "")
            return quantity(value, unit, value.beside, value.stds, sign)
        if format_spec == "p":
            return probability(value)
        if format_spec.startswith("±"):
            return f"± {quantity(value, format_spec[1:], stds=[value])}"
        if format_spec in UNITS:
            return quantity(value, format_spec)
        if isinstance(value, Sequence) and not isinstance(value, str):
            return ", ".join(format(each, format_spec) for each in value)
        said = str(format(value, format_spec)) if not isinstance(value, str) else value
        return said.replace("%", " %") if format_spec.endswith("%") else said


_FORMAT = _Words()


def _said(template: str, fields: dict[str, Any]) -> str:
    return without_exponent(visible(_FORMAT.vformat(template, (), fields)))


def _fields(finding: Finding) -> dict[str, Any]:
    size = finding.size
    fields: dict[str, Any] = {"subject": finding.subject, **finding.values}
    fields["subjects"] = len(finding.subject) > 1
    if isinstance(cut := finding.values.get("cut"), float):
        until = cast(float, finding.values.get("until", cut))
        fields |= {
            "until": f"{np.floor(10 * until) / 10:.1f}",
            "cut": f"{np.ceil(10 * cut) / 10:.1f}",
        }
    std = finding.values.get("std")
    known = [std] if isinstance(std, float) else []
    beside = known.copy()
    for name, half in finding.values.items():
        value = finding.values.get(stem := name.removesuffix("_95"))
        if stem == name:
            continue
        if isinstance(value, float) and isinstance(half, float):
            value, half = [value], [half]
        if isinstance(value, list) and isinstance(half, list):
            both = [float(one) for one in (*value, *half)]
            beside += both if stem == "change" else ()
            largest = both if size is None or stem != "change" else (*both, size)
            stds = both[len(value) :]
            fields |= {stem: _Sizes(both[: len(value)], stds, largest)}
            fields |= {name: _Sizes(stds, stds, largest)}
    if size is not None:
        fields |= {"size": quantity(size, finding.unit, beside, known), "number": size}
        fields["several"] = f"{size:.0f}" if size > 1.0 else ""
        fields["stated"] = upwards(float(fields.get("component", size)))
        fields["degrees"] = np.degrees(size)
        if isinstance(std, float):
            half = INTERVAL_FACTOR * std
            fields["spread"] = quantity(half, finding.unit, (size, *beside), known)
    if isinstance(half := finding.values.get("expanded"), float):
        fields["difference"] = with_std(fields["difference"], half, "+")
    if finding.harm is not None:
        fields["harm"] = quantity(finding.harm, "rad", stds=[finding.harm])
    if isinstance(hinges := fields.get("hinges"), list):
        places = zip(fields["measured"], np.reshape(hinges, (-1, 3)), strict=True)
        lines = (f"`hinge: [{', '.join(f'{c:.6f}' for c in at)}]` of {own}" for own, at in places)
        fields["hinges"] = ", ".join(lines)
    if finding.p_value is not None:
        fields["p"] = p_text(finding.p_value)
    return fields


def begun(text: str, end: str = "") -> str:
    """A sentence with its capital, but for a name that begins it; and what ends it."""
    first = re.sub("[-',;:]", "", text.split(maxsplit=1)[0])
    return f"{text[0].upper() if first.isalpha() else text[0]}{text[1:]}{end}"
