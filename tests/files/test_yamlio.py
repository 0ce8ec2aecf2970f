import json
import math
from typing import Any

import numpy as np
import pytest
import yaml
from hypothesis import given, settings
from hypothesis import strategies as st

from tdfscal.errors import DataError
from tdfscal.files.saving import to_json, to_yaml
from tdfscal.files.yaml import Format, parse_document


def read(text: str | bytes, form: Format = "yaml") -> Any:
    raw = text.encode() if isinstance(text, str) else text
    return parse_document(raw, "file", DataError, form).content


def refused(text: str | bytes, form: Format = "yaml") -> str:
    with pytest.raises(DataError) as fault:
        read(text, form)
    assert fault.value.hint
    assert "\n" not in str(fault.value)
    return str(fault.value)


@pytest.mark.parametrize(
    ("text", "value"),
    [
        ("1e-5", 1e-5),
        ("-3", -3),
        ("+.5E+3", 500.0),
        ("0x1F", 31),
        ("0o17", 15),
        ("0500", 500),
        ("123456789012345678901", 123456789012345678901.0),
        (".inf", math.inf),
        ("-.INF", -math.inf),
        ("true", True),
        ("Null", None),
        ("~", None),
        ("on", "on"),
        ("yes", "yes"),
        ("1:30", "1:30"),
        ("1_000", "1_000"),
        ("2026-11-21T02:00:00Z", "2026-11-21T02:00:00Z"),
        ('"5"', "5"),
        ("1e999", "1e999"),
        ("9" * 400, "9" * 400),
        ("1.2.3", "1.2.3"),
    ],
)
def test_scalars_of_yaml_1_2(text: str, value: object) -> None:
    got = read(f"key: {text}")["key"]
    assert (got, type(got)) == (value, type(value))


def test_lines_and_places() -> None:
    text = "a: 1\nb:\n  - x\n  - {c: 2,\n     d: [3, 4]}\nf:\n  g: 5\n"
    document = parse_document(text.encode(), "some.yaml", DataError)
    assert document.content == {"a": 1, "b": ["x", {"c": 2, "d": [3, 4]}], "f": {"g": 5}}
    assert document.where(("b", 1, "d", 1)) == "some.yaml, line 5, b[1].d[1]"
    assert document.where(("f", "g")) == "some.yaml, line 7, f.g"
    assert document.where(("b", 7)) == "some.yaml, line 2, b[7]"
    assert document.where() == "some.yaml"


@pytest.mark.parametrize(
    ("text", "word"),
    [
        ("a: 1\n\tb: 2\n", "tab"),
        ("a: 1\nb: [1, 2\nc: 3\n", "line 3"),
        ("a: 1\nb: 2\na: 3\n", "line 3: the key `a` occurs twice"),
        ("a: 1\n---\nb: 2\n", "more than one document"),
        ("a: &x [*x]\n", "anchors and aliases"),
        ("a: *x\n", "line 1: anchors and aliases"),
        ("? [1, 2]\n: 3\n", "plain text"),
        ("a: !!python/object/apply:os.system ['true']\n", "tag"),
        ("a: !!str 5\n", "tag"),
        ("[" * 40 + "]" * 40, "nested deeper"),
        ("a: \x00\n", "character"),
        (b"a: \xff\xfe\n", "0xff is not UTF-8"),
        ("x" * 4_000_001, "larger than 4 MB"),
    ],
)
def test_refused_yaml(text: str | bytes, word: str) -> None:
    assert word in refused(text)


@pytest.mark.parametrize(
    ("text", "word"),
    [
        ('{"a": 1, "a": 2}', "`a` occurs twice"),
        ('{"a": 1,\n}', "line 2"),
        ("[" * 40 + "]" * 40, "nested deeper"),
        ("[" * 100_000 + "]" * 100_000, "nested deeper"),
        ("", "line 1"),
    ],
)
def test_refused_json(text: str, word: str) -> None:
    assert word in refused(text, "json")


values = st.recursive(
    st.none()
    | st.booleans()
    | st.integers(-(10**17), 10**17)
    | st.floats(allow_nan=False, allow_infinity=False)
    | st.text(st.characters(exclude_categories=["Cs"]), max_size=12)
    | st.sampled_from(
        ["1e5", "0x1F", "0o7", "on", "null", ".inf", "~", "", "1:30", "<<", "=", "é"]
    ),
    lambda inner: (
        st.lists(inner, max_size=4)
        | st.dictionaries(
            st.text(st.characters(codec="ascii", categories=["L"]), min_size=1), inner, max_size=4
        )
    ),
    max_leaves=20,
)


def same(a: Any, b: Any) -> bool:
    """Equal to the bit and in type."""
    if isinstance(a, dict):
        return isinstance(b, dict) and list(a) == list(b) and all(same(a[k], b[k]) for k in a)
    if isinstance(a, list):
        return isinstance(b, list) and len(a) == len(b) and all(map(same, a, b))
    if isinstance(a, float):
        return isinstance(b, float) and a.hex() == b.hex()
    return type(a) is type(b) and a == b


@given(st.dictionaries(st.sampled_from("abc"), values, max_size=3))
@settings(max_examples=25, deadline=None)
def test_what_is_written_reads_back_to_the_bit(content: dict[str, Any]) -> None:
    """With our reader (YAML 1.2 scalars), PyYAML (1.1) and the json module alike."""
    text = to_yaml(content)
    assert same(read(text), content)
    assert same(yaml.safe_load(text), content)
    assert same(read(to_json(content), "json"), content)
    assert same(json.loads(to_json(content)), content)


def test_ambiguous_words_are_quoted_and_matrices_are_rows() -> None:
    for word in ("1e5", "0x1F", "0o7", ".inf", "null", "1e999", "yes", "1:30", "\x85", "\u2028"):
        text = to_yaml({"a": word})
        assert read(text) == yaml.safe_load(text) == {"a": word}
    text = to_yaml({"matrix": np.eye(2), "names": ["a", "b"]})
    assert text.splitlines() == ["matrix:", "- [1.0, 0.0]", "- [0.0, 1.0]", "names: [a, b]"]
