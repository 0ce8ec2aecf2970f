"""What a validation claims, in sentences: its tests, what they found and would have found."""

from __future__ import annotations

import numpy as np

from tdfscal.catalogue import cure, told
from tdfscal.reporting import layout
from tdfscal.reporting.validation_changes import Tested, changes
from tdfscal.significance import DETECTION_POWER
from tdfscal.validation.in_motion import MovingValidation
from tdfscal.validation.verdict import CHI2_LIMIT, SEARCH_LIMIT


def search_test(v: Tested) -> str:
    """The probability of the likeliest single change, with its limit."""
    return f"{layout.p_value(v.search_p)}, limit {SEARCH_LIMIT:.3g}"


def chi2_test(v: Tested) -> str:
    """The probability of χ², with its limit; and by what, where it is not by χ² alone."""
    by = ", by Fisher's F" if np.isfinite(v.judged.noise_dof) else ""
    tails = ", heavy tails allowed for" if v.judged.tails else ""
    return f"{layout.p_value(v.p_value)}, limit {CHI2_LIMIT:.3g}{by}{tails}"


def extent(v: Tested) -> str:
    """How much was tested."""
    if isinstance(v, MovingValidation):
        return f"{v.seconds:.0f} s of motion"
    whole = f" of {len(v.dwells)}" if v.left_out else ""
    return f"{len(v.used)}{whole} postures"


def reasons(v: Tested) -> list[str]:
    """Sentences: the reason, and what to do."""
    moving = isinstance(v, MovingValidation)
    noise = " and the noise of this log" if moving else ""
    explained = f"what the stated uncertainties{noise} explain"
    found = changes(v)
    zeros = [layout.begun(told(f), ".") for f in found if f.code.startswith("zeros-")]
    if v.holds:
        tests = f"χ²: {chi2_test(v)}; single change: {search_test(v)}"
        return [f"The residual wrench of {extent(v)} is {explained} ({tests}).", *zeros, _sure(v)]
    said = [f"The residual wrench of {extent(v)} is not {explained}: {_rejecting(v)}."]
    if not v.suspected:
        none = "No single change, of a sensor, a zero or the load, whose size is told from none "
        return [*said, f"{none}explains all of it."]
    said += [layout.begun(cure(found[0]), "."), *zeros]
    if len(v.suspected) > 1:
        said.append(
            f"{'The motion does' if moving else 'The postures do'} not tell the causes below "
            f"apart; {'a longer motion' if moving else 'more postures'}, more tilt and a squeeze "
            "would."
        )
    return said


def _rejecting(v: Tested) -> str:
    """The tests that reject, the one that decides first; what does not reject is left out."""
    both = [
        (v.search_p < SEARCH_LIMIT, "a single change explains more of it than chance would"),
        (v.p_value < CHI2_LIMIT, f"χ² = {v.chi2:.4g} for {v.dof} degrees of freedom"),
    ]
    tests = (search_test(v), chi2_test(v))
    said = [
        f"{what} ({test})" for (rejects, what), test in zip(both, tests, strict=True) if rejects
    ]
    return "; ".join(said if v.decided_by_search else said[::-1])


def _sure(v: Tested) -> str:
    """What would have been detected."""
    lean, twist = v.detectable[:, :2].max(), v.detectable[:, 2].max()
    text = (
        f"A single sensor turned by more than {1e3 * lean:.2g} mrad in roll or pitch would have "
        f"been detected with {DETECTION_POWER:.0%} probability"
    )
    if twist > np.pi / 4:
        return f"{text}; a turn about the vertical would not show here."
    return f"{text}, about the vertical by more than {1e3 * twist:.2g} mrad."
