"""What an unquoted word in a YAML or JSON file means: the YAML 1.2 core schema."""

from __future__ import annotations

import math
import re

Scalar = str | float | int | bool | None

_INTEGER = re.compile(r"[-+]?[0-9]+|0o[0-7]+|0x[0-9a-fA-F]+")
_FLOAT = re.compile(r"[-+]?(\.[0-9]+|[0-9]+(\.[0-9]*)?)([eE][-+]?[0-9]+)?")
_SPECIAL = {".nan": math.nan, "+.inf": math.inf, ".inf": math.inf, "-.inf": -math.inf}
_CONSTANTS: dict[str, bool | None] = {"": None, "~": None, "null": None}
_CONSTANTS |= {"true": True, "false": False}


def plain_scalar(text: str) -> Scalar:
    """Return the value of an unquoted YAML 1.2 scalar.

    Raises OverflowError for a number beyond double precision, which is never read as infinite.
    """
    lower = text.lower()
    if lower in _CONSTANTS and text in (lower, lower.capitalize(), lower.upper()):
        return _CONSTANTS[lower]
    if lower in _SPECIAL:
        return _SPECIAL[lower]
    if _INTEGER.fullmatch(text):
        return integer(text)
    if _FLOAT.fullmatch(text):
        return decimal(text)
    return text


def integer(text: str) -> int | float:
    """Value of an integer's digits, decimal or 0x…, 0o…; OverflowError beyond double precision."""
    base = {"0o": 8, "0x": 16}.get(text[:2])
    if base is not None:
        return int(text[2:18], base) if len(text) <= 18 else _overflow(text)
    # Huge integers are slow to convert, and above 2⁵³ a double does not hold them exactly anyway.
    return int(text) if len(text) <= 20 else decimal(text)


def decimal(text: str) -> float:
    """Value of a decimal number; OverflowError beyond double precision."""
    value = float(text)
    return value if math.isfinite(value) else _overflow(text)


def _overflow(text: str) -> float:
    raise OverflowError(f"{shorten(text)} is beyond double precision")


def shorten(text: str, limit: int = 40) -> str:
    """Text cut for a message, without line breaks or characters that do not print."""
    clean = "".join(letter if letter.isprintable() else "·" for letter in text[: limit + 1])
    return clean if len(clean) <= limit else clean[: limit - 1] + "…"
