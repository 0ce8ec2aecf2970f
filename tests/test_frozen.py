"""Records do what `dataclass(frozen=True)` promises."""

import copy
import pickle
from dataclasses import FrozenInstanceError, replace

import numpy as np
import pytest

from tdfscal.findings import Finding
from tdfscal.records import UncertainValue


def test_a_record_is_a_frozen_value() -> None:
    one, same, other = Finding("slip", ("a",)), Finding("slip", ("a",)), Finding("slip", ("b",))
    assert one == same != other != object()
    assert replace(one, subject=("b",)) == other
    assert copy.copy(one) == pickle.loads(pickle.dumps(one)) == one
    assert eval(repr(one)) == one
    assert repr(UncertainValue(np.ones((9, 3)), np.ones(3))).count("9×3") == 1
    for name in ("code", "colour"):
        with pytest.raises(FrozenInstanceError):
            setattr(one, name, "x")
        with pytest.raises(FrozenInstanceError):
            delattr(one, name)
    assert len({one, same, other}) == 2
    with pytest.raises(TypeError):
        Finding()  # type: ignore[call-arg]
