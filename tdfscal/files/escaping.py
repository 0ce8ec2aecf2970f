"""Text from outside in what this program writes: one escape per output format.

Names, paths, columns and foreign files may hold anything. Where a format has data (YAML and JSON
values, XML text, CSV cells) its own writer keeps the string as it is; what is here serves the rest:
comments, which end at signs of their own (those of YAML at line breaks alone: `errors.visible`),
and characters that a format cannot hold or a reader would act on. Each escape is a backslash
sequence that Python reads back, so nothing is lost.
"""

from __future__ import annotations

import re

from tdfscal.errors import visible

#: What XML 1.0 cannot hold (production 2), and the carriage return, which its parsers replace.
_NOT_XML = re.compile("[^\t\n\x20-\ud7ff\ue000-\ufffd\U00010000-\U0010ffff]")
#: A spreadsheet takes a cell that begins so for a formula.
_FORMULA = re.compile(r"(^|[,;\t\"'])(\s*)([=+\-@])")


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


def c_comment(text: str) -> str:
    """Text within a comment that it neither ends nor nests, without trigraphs and spliced lines."""
    return re.sub(r"(?<=\*)/|(?<=/)\*|(?<=\?)\?|\\$", lambda m: _hex(m[0]), visible(text))


def _hex(character: str) -> str:
    return f"\\x{ord(character):02x}"
