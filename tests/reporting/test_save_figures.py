"""`--figures` writes what a result has to show, as PNG, SVG and PDF, and nothing when refused."""

from __future__ import annotations

from pathlib import Path

import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st

from tdfscal.wrench.envelope import Envelope
from tests.cli.running import run
from tests.cli.world import build

COMMANDS = {
    "apply own.yaml campaign -o wrench.csv": {"contact-wrench"},
    "validate own.yaml campaign": {"validation"},
    "info campaign": {"dwells"},
    "plan campaign -o plan.csv --postures 6 --candidates 20": {"plan"},
}


@pytest.fixture(scope="module")
def world(tmp_path_factory: pytest.TempPathFactory) -> Path:
    """A campaign and its calibration."""
    home = tmp_path_factory.mktemp("world")
    build(home)
    return home


@pytest.mark.parametrize(
    "typed",
    [
        pytest.param(c, marks=[pytest.mark.slow] if c.startswith(("apply", "plan")) else [])
        for c in COMMANDS
    ],
)
def test_each_figure_in_three_formats(
    typed: str, world: Path, monkeypatch: pytest.MonkeyPatch, capsys: pytest.CaptureFixture[str]
) -> None:
    monkeypatch.chdir(world)
    folder = world / typed.split()[0]
    seen = run(capsys, *typed.split(), "--figures", folder, "-q")
    assert seen.status == 0, seen.err
    begins = {".png": b"\x89PNG", ".svg": b"<?xml", ".pdf": b"%PDF"}
    names = {f"{name}{suffix}" for name in COMMANDS[typed] for suffix in begins}
    assert {path.name for path in folder.iterdir()} == names
    for path in folder.iterdir():
        assert path.read_bytes().startswith(begins[path.suffix])


def test_a_command_that_fails_leaves_no_figures(
    world: Path, capsys: pytest.CaptureFixture[str]
) -> None:
    folder = world / "none"
    seen = run(capsys, "info", world / "damaged", "--figures", folder, "-q")
    assert seen.status == 3
    assert not folder.exists()


@given(
    sizes=st.lists(st.integers(1, 3000), min_size=1, max_size=12),
    seed=st.integers(0, 99),
)
@settings(max_examples=15, deadline=None)
def test_an_envelope_has_the_extremes_of_every_stretch(sizes: list[int], seed: int) -> None:
    """However the samples arrive: its range over any stretch is that of the samples there."""
    rng = np.random.default_rng(seed)
    value = rng.normal(size=(sum(sizes), 2)).cumsum(axis=0)
    time = np.arange(len(value), dtype=float)
    envelope = Envelope()
    for part in np.split(np.arange(len(value)), np.cumsum(sizes)[:-1]):
        envelope.add(time[part], value[part])
    at, found = envelope.finish()
    assert len(at) <= 2 * 4001
    assert np.all(np.diff(at) >= 0)
    np.testing.assert_array_equal(found.min(axis=0), value.min(axis=0))
    np.testing.assert_array_equal(found.max(axis=0), value.max(axis=0))
    low, high = found[::2], found[1::2]
    width = np.diff(at[::2], append=at[-1] + 1).max()
    for t, row in zip(time[::97], value[::97], strict=True):
        near = np.abs(at[::2] - t) <= width
        assert np.all(low[near].min(axis=0) <= row)
        assert np.all(high[near].max(axis=0) >= row)
