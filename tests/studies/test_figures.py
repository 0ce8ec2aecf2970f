"""The docking figures, drawn without a docking."""

from __future__ import annotations

import numpy as np
import pytest

from studies import controlled, docking
from studies.arms import KNOWS, Arm, tared
from studies.control.contact import GearPair
from studies.control.runs import Controller, Result, Traces
from tdfscal.reporting.figures import style
from tests.simulation.rigs import loose_rig
from tests.studies.benches import truths

RUNS = 3


def dockings(largest: float) -> docking.Dockings:
    """Every calibration, wrenches up to so many N or N·m; the first never comes to contact."""
    truth = truths(RUNS)
    arms = tuple(Arm(name, truth, truth) for name in KNOWS)
    arms = (*arms, *(tared(arm) for arm in arms[3:]))
    lanes, rng = RUNS * len(arms), np.random.default_rng(1)
    time = np.linspace(0.0, 300.0, 50)
    wrench = largest * rng.uniform(-1.0, 1.0, (len(time), lanes, 6))
    starts = np.tile([0.0, 45.0, 46.0, 262.0], (lanes, 1))
    starts[:RUNS, 1:] = np.nan
    peak = np.abs(largest * rng.uniform(size=(lanes, 4, 6)))
    result = Result(
        Traces(time, wrench, wrench, wrench), peak, peak, np.full(lanes, np.nan),
        np.ones(lanes, dtype=np.bool_), starts, np.zeros((lanes, 3, 3)), np.zeros((lanes, 6)),
    )  # fmt: skip
    return docking.Dockings(docking.Setup(loose_rig(), Controller(), GearPair()), arms, result)


def test_scales_are_shared_and_their_numbers_plain() -> None:
    """A layout that has no room warns, which is an error here."""
    for largest in (0.5, 3.0e4):
        one = dockings(largest)
        run = docking.drawings("0.66 N/µm, B (ẋ − ẋ_d)", one)
        assert [d.name for d in run] == ["fig-17-docking", "fig-18-docking"]
        for drawing, which in zip(run, "yx", strict=True):
            if (largest, which) == (3.0e4, "x"):  # the longest numbers, side by side
                style.to_svg(drawing)
            panels = np.array(style.to_figure(drawing).axes).reshape(2, 3)
            for row in panels:
                limits = [getattr(ax, f"get_{which}lim")() for ax in row]
                assert limits == limits[:1] * 3
                low, high = limits[0]
                axis = getattr(row[0], f"{which}axis")
                ticks = list(axis.get_majorticklocs())
                names = [axis.get_major_formatter()(tick) for tick in ticks]
                assert [float(n.replace("−", "-")) for n in names] == pytest.approx(ticks, rel=1e-5)
                assert low <= 0.0 < high
    assert len(controlled.MARKS) == len(one.arms)
