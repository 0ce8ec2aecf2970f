"""Whatever is wrong on a check of a sound calibration is named, with its size; before or during."""

from collections import Counter
from dataclasses import dataclass, replace
from functools import cache

import numpy as np
import pytest
from scipy import stats

from tdfscal.model.calibrated import Calibrated
from tdfscal.records import Rig
from tdfscal.reporting.changes import changes
from tdfscal.simulation import (
    Batch,
    Contact,
    Drift,
    Faults,
    Gain,
    Options,
    Slip,
    ZeroShift,
    make_rig,
    simulate_dwells,
)
from tdfscal.simulation.faults import Walk, Warming
from tdfscal.validation.residual_wrench import Validation, validate

from .held_out import RIG, USED, calibrate, part

CHECKED, SLIPPED, TRIALS = 12, 6, 1
TURN = (2e-3, -1e-3, 2e-3)
TURNS = ((5e-3, -2e-3, 3e-3), (-3e-3, 6e-3, -5e-3), (2e-3, 5e-3, 6e-3))
NONE = Faults()


@dataclass(frozen=True)
class Wrong:
    """What happens on the check, and the rig as it really is there."""

    faults: Faults = NONE
    real: Rig = RIG


def declared(**really: float) -> Rig:
    return replace(RIG, declared=replace(RIG.declared, **really))


WRONG = {
    "sensor turned": Wrong(Faults(slips=(Slip(1, 0, TURN),))),
    "sensors turned": Wrong(Faults(slips=tuple(Slip(k, 0, turn) for k, turn in enumerate(TURNS)))),
    "zero drifted": Wrong(Faults(zero_shifts=(ZeroShift(1, 0, (2.0, -1.0, 3.0)),))),
    "gain changed": Wrong(Faults(gains=(Gain(0, (5e-3, 5e-3, 5e-3)),))),
    "gains changed": Wrong(Faults(gains=tuple(Gain(k, (4e-3, 4e-3, 4e-3)) for k in range(3)))),
    "load changed": Wrong(real=make_rig(mass=502.0)),
    "base tilted": Wrong(real=replace(RIG, gravity_tilt_std=3e-3)),
    "contact": Wrong(Faults(contacts=tuple(Contact(k, (10.0, -20.0, 15.0)) for k in (1, 3)))),
    "noise grown": Wrong(real=declared(force_noise=0.8)),
    "hinges stick": Wrong(real=declared(hinge_moment=3.0)),
    "sensor slipped": Wrong(Faults(slips=(Slip(1, SLIPPED, TURN),))),
    "sensor slipped at the end": Wrong(Faults(slips=(Slip(1, CHECKED - 1, TURN),))),
    "zero jumped": Wrong(Faults(zero_shifts=(ZeroShift(1, SLIPPED, (0.6, -0.5, 0.6)),))),
    "zero jumped and returns": Wrong(
        Faults(zero_shifts=(ZeroShift(1, 4, (3.0, 0.0, 0.0)), ZeroShift(1, 8, (-3.0, 0.0, 0.0))))
    ),
    "zeros drift": Wrong(
        Faults(drifts=(Drift(0, (10.0, -6.0, 15.0)), Drift(1, (-5.0, 8.0, 10.0))))
    ),
    "zeros wander": Wrong(Faults(walks=tuple(Walk(k, 3.0) for k in range(RIG.n)))),
    "zeros follow temperature": Wrong(
        Faults(warming=Warming(20.0, ((0.3, -0.2, 0.3), (-0.3, 0.1, 0.2), (0.1, 0.3, -0.3))))
    ),
}


@cache
def campaigns(postures: int, kind: str | None = None) -> Batch:
    """Of the same rigs, whatever the postures and what is wrong."""
    wrong = Wrong() if kind is None else WRONG[kind]
    options = Options(postures=postures, squeeze=200.0, faults=wrong.faults)
    return simulate_dwells(wrong.real, options, np.random.default_rng(4), TRIALS)


@cache
def given(trial: int) -> Calibrated:
    return calibrate(RIG, campaigns(USED).dwells(trial))


@cache
def verdicts(kind: str, earlier: bool) -> tuple[Validation, ...]:
    """Checks of sound calibrations, on which something is wrong; or since longer before."""
    postures = np.arange(USED if earlier else 0, CHECKED + USED * earlier)
    batch = campaigns(CHECKED + USED * earlier, kind)
    return tuple(validate(given(t), part(batch.dwells(t), postures)) for t in range(TRIALS))


@pytest.mark.parametrize(
    ("kind", "earlier"),
    [*((kind, False) for kind in WRONG), ("zeros drift", True), ("zeros follow temperature", True)],
)
def test_what_is_wrong_is_named_and_held_against_it(kind: str, earlier: bool) -> None:
    found = verdicts(kind, earlier)
    assert not any(v.holds for v in found)
    assert not any(v.outcome == "touched" for v in found) or kind == "contact"
    # Another mass and a gain that all sensors have in common look alike.
    alike = ("load changed", "gains changed")
    named: Counter[str] = Counter(
        name for v in found for name in {c.kind for c in v.suspected[: 1 + (kind in alike)]}
    )
    assert named[kind.removesuffix(" at the end").removesuffix(" and returns")] == TRIALS, named
    assert kind not in alike or set(named) == set(alike)


@pytest.mark.parametrize(
    ("kind", "support", "postures", "true"),
    [
        ("sensor turned", 1, (), TURN),
        ("sensors turned", None, (), sum(TURNS, ())),
        ("zero drifted", 1, (), (2.0, -1.0, 3.0)),
        ("gain changed", 0, (), (5e-3, 5e-3, 5e-3, 0.0, 0.0, 0.0)),
        ("gains changed", None, (), (4e-3, 4e-3, 4e-3, 0.0, 0.0, 0.0)),
        ("load changed", None, (), (2.0, 0.0, 0.0, 0.0)),
        ("contact", None, (1, 3), ()),
        ("sensor slipped", 1, (SLIPPED,), TURN),
        ("zero jumped", 1, (SLIPPED,), (0.6, -0.5, 0.6)),
        ("zero jumped and returns", 1, (4, 7), (3.0, 0.0, 0.0)),
    ],
)
def test_it_is_named_with_its_place_and_an_honest_size(
    kind: str, support: int | None, postures: tuple[int, ...], true: tuple[float, ...]
) -> None:
    right, squares = 0, []
    for v in verdicts(kind, False):
        best = next(c for c in v.suspected if c.kind == kind.removesuffix(" and returns"))
        right += (best.support, best.postures) == (support, postures)
        known = best.std > 0
        squares += [*(((best.value - true)[known] / best.std[known]) ** 2)]
        code = f"change-{best.kind.removesuffix(' changed').replace(' ', '-')}"
        assert code in [found.code for found in changes(v)[:2]]
    assert right == TRIALS
    # Components of one cause are not independent: about a third of them.
    assert not squares or np.mean(squares) < stats.chi2.ppf(0.999, len(squares) / 3) * 3 / len(
        squares
    )


@pytest.mark.parametrize("share", [0.99, 1.01])
def test_a_check_that_would_miss_what_the_gate_refuses_proves_nothing(share: float) -> None:
    v = validate(given(0), part(campaigns(CHECKED).dwells(0), np.arange(CHECKED)))
    assert v.outcome == "holds"
    limit = share * v.detectable.max() / stats.norm.isf(0.025)
    real = replace(RIG, acceptance=replace(RIG.acceptance, angle_std=limit))
    assert replace(v, rig=real).outcome == ("unproven" if share < 1 else "holds")
