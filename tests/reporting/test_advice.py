"""The first advice is the cure: followed by its words alone, it ends in angles that are true."""

import pytest

from benchmarks.advice import cases, led
from tdfscal.numerics.distributions import chi2_sf

SEED = 7
#: That sound angles fail: d² over nine angles, one of a hundred thousand.
CHANCE = 1e-5
QUICK = ("hinge friction 0.5 N·m", "axis freezes at posture 9", "positions in mm and dead axis")


def _check(name: str) -> None:
    outcomes = led(cases()[name], SEED)
    last = outcomes[-1]
    assert outcomes[0].verdict != "accepted"
    assert last.verdict == "accepted", [outcome.advice for outcome in outcomes]
    assert chi2_sf(last.distance * last.angles, last.angles) > CHANCE


@pytest.mark.parametrize(
    "name", [QUICK[0], *(pytest.param(name, marks=pytest.mark.slow) for name in QUICK[1:])]
)
def test_the_first_advice_leads_to_true_angles(name: str) -> None:
    _check(name)


@pytest.mark.slow
@pytest.mark.parametrize("name", sorted(cases().keys() - {*QUICK, "none"}))
def test_so_it_does_for_every_other_fault(name: str) -> None:
    if led(cases()[name], SEED)[0].verdict != "accepted":
        _check(name)
