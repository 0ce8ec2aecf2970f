"""How numbers are written, in text, on pages and in figures: digits, units, signs, chances, times.

An uncertainty has two significant digits, and what stands before it as many places; a probability
has two and no exponent. Text has the hyphen of a keyboard for a minus, so that a number can be
copied; what is looked at, pages and figures, has a true minus (`typeset`).
"""

from __future__ import annotations

import math
import re
from collections.abc import Mapping, Sequence
from datetime import UTC, datetime

import numpy as np

from tdfscal.errors import without_exponent
from tdfscal.numerics.distributions import INTERVAL_FACTOR
from tdfscal.records import by_wall_clock

#: Larger and smaller units in which a size is read, with their factors.
UNITS: Mapping[str, tuple[tuple[str, float], ...]] = {
    "m": (("m", 1.0), ("mm", 1e3), ("µm", 1e6)),
    "rad": (("rad", 1.0), ("mrad", 1e3), ("µrad", 1e6)),
    "s": (("s", 1.0), ("ms", 1e3), ("µs", 1e6)),
    "N": (("N", 1.0),),
    "1": (("ppm", 1e6),),
    "N·m": (("N·m", 1.0),),
    "N/m": (("MN/m", 1e-6), ("kN/m", 1e-3), ("N/m", 1.0)),
}

#: Probabilities that are told; beyond, nobody acts otherwise.
_LEAST, _MOST = 1e-3, 0.99
#: The sign of a negative number: no hyphen of a word, a date or a name, nor an exponent's.
_MINUS = re.compile(r"(?<![\w.)\]-])[-−](?=\.?\d[\d.]*(?:[\s,;:)\]%°/]|$))")
_PERCENT = re.compile(r"(?<=\d)%(?!\w)")
#: Spaces at which no line ends, and what stands there.
_UNBROKEN = re.compile(
    r"(?<=[±<>=]) (?=\d)|(?<=\d) (?=±|%|mrad\b|N\b)|(?:(?<=\b[kp])|(?<=χ²)) (?=[=<>] )"
)
FIXED = "\u00a0"
#: What arithmetic alone may add to a size that is rounded upwards, in its last digit.
_EPS = 1e-9


def quantity(
    size: float | Sequence[float],
    unit: str,
    beside: Sequence[float] = (),
    stds: Sequence[float] = (),
    sign: str = "",
) -> str:
    """Return a size with the unit in which it reads best: 0.0026, "m" as 2.6 mm; or several.

    beside : what is said in the same unit in the same sentence. stds : the uncertainty of each, by
    whose two digits it is written; else it has three. sign : "+" writes that of positive ones.
    """
    each = [size] if isinstance(size, int | float) else list(size)
    largest = max((abs(value) for value in (*each, *beside) if np.isfinite(value)), default=0.0)
    ways = UNITS.get(unit, ((unit, 1.0),))
    name, factor = next((way for way in ways if largest * way[1] >= 1.0), ways[-1])
    if largest == 0.0:
        name, factor = ways[0]
    said = [rounded(value * factor, 3) for value in each]
    if known := max(stds, default=0.0):
        ends = (places(factor * (std or known)) for std in stds)
        said = [to_place(factor * v, at, sign) for v, at in zip(each, ends, strict=True)]
    return f"{bracketed(said)} {name}".rstrip()


def bracketed(said: Sequence[str]) -> str:
    """Return several words as one: in brackets."""
    return f"({', '.join(said)})" if len(said) > 1 else "".join(said)


def when(time: float) -> str:
    """Write a time of a log, s, with the digits that find its place; by a wall clock as a date."""
    if by_wall_clock(time):
        date = f"{datetime.fromtimestamp(time, UTC):%Y-%m-%d %H:%M:%S.%f}"
        return f"{date.rstrip('0').rstrip('.')} UTC"
    if not 1e6 <= abs(time) < 1e15:
        return f"{time:.9g} s"
    return f"{f'{time:.6f}'.rstrip('0').rstrip('.')} s"


def rounded(size: float, digits: int = 2) -> str:
    """Return a size with so many significant digits, without an exponent."""
    return without_exponent(f"{size:.{digits}g}")


def measured(size: float, digits: int = 2) -> str:
    """Return what was measured or worked out with so many significant digits, zeros too: 0.300."""
    return without_exponent(f"{size:#.{digits}g}").rstrip(".")


def upwards(size: float, digits: int = 1) -> str:
    """Return a size with so many significant digits, upwards."""
    size = max(abs(size), np.finfo(float).tiny)
    step = 10.0 ** (np.floor(np.log10(size)) + 1 - digits)
    return rounded(np.ceil(size / step - _EPS) * step, digits)


def places(std: float) -> int:
    """Return the decimal places that two significant digits of an uncertainty have; below 0: tens.

    Of one that is zero, or not finite: three.
    """
    return 1 - int(f"{std:.1e}".partition("e")[2]) if 0 < std < math.inf else 3


def to_place(value: float, place: int, sign: str = "") -> str:
    """Return a number to so many decimal places; sign : "+" writes that of positive ones too."""
    return f"{round(value, place) + 0.0:{sign}.{max(place, 0)}f}"


def with_std(value: float, std: float, sign: str = "") -> str:
    """Return a number with its uncertainty, std or half an interval, by that one's two digits."""
    return f"{to_place(value, places(std), sign)} ± {two_digits(std)}"


def estimated(value: float | None, std: float | None) -> str:
    """Return the same of what may not be measured, or is left open."""
    if value is None:
        return "not measured"
    return f"{value:.3f} ± open" if std is None else with_std(value, std)


def two_digits(std: float) -> str:
    """Return an uncertainty by its two digits, zeros too: 1.0, 0.60."""
    return to_place(std, places(std))


def coverage(accepted: bool) -> str:
    """What an interval is; one that a result's own reasons refute covers nothing in particular."""
    return "95 %" if accepted else f"k = {INTERVAL_FACTOR:.2f}, by the stated uncertainties alone"


def count(number: int, noun: str) -> str:
    """Return "1 line", "26 lines"."""
    return f"{number} {noun}{'s' * (number != 1)}"


def spans(numbers: Sequence[int]) -> str:
    """Return numbers one by one, those that follow each other as one span: 3–5, 8."""
    found: list[list[int]] = []
    for number in numbers:
        if found and found[-1][-1] == number - 1:
            found[-1][1:] = [number]
        else:
            found.append([number])
    return ", ".join("–".join(map(str, span)) for span in found)


def p_text(p: float) -> str:
    """Write a p-value."""
    said = probability(p)
    return f"p {said}" if said[0] in "<>" else f"p = {said}"


def probability(p: float) -> str:
    """Return a probability with two digits; one below 0.001 or above 0.99 as that."""
    if not _LEAST <= p <= _MOST:
        return f"< {_LEAST:g}" if p < _LEAST else f"> {_MOST:g}"
    return f"{p:.2f}" if p >= 0.1 else f"{p:.2g}"


def typeset(text: str, minus: str = "−") -> str:
    """Return text with one sign for all negative numbers, which no line end parts from ± and unit.

    Code between backquotes stays as it is.
    """
    parts = text.split("`")
    parts[::2] = (
        _UNBROKEN.sub(FIXED, _PERCENT.sub(" %", _MINUS.sub(minus, part))) for part in parts[::2]
    )
    return "`".join(parts)
