"""How well each method finds the angles: Monte Carlo of whole campaigns (Sect. 4, Table 2)."""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import dataclass, field, replace
from itertools import repeat

import numpy as np

from studies.runs.simulated_campaigns import attempted, by_tracker, mapped
from tdfscal.errors import NotConvergedError
from tdfscal.model.statics import postures
from tdfscal.numerics import so3
from tdfscal.records import ANGLES, FloatArray, IntArray, Rig
from tdfscal.selfcal.covariance import evaluate, information_root
from tdfscal.selfcal.linear_method import linear_data, linear_rotations
from tdfscal.selfcal.outliers import fit_robust
from tdfscal.significance import BIASED
from tdfscal.simulation import Options, SurveyOptions, simulate_dwells
from tdfscal.simulation.postures import draw_postures

#: Methods in the order of the tables, and in words.
NAMES = {
    "ml": "self-calibration, maximum likelihood",
    "linear": "self-calibration, the paper's linear method",
    "tracker": "laser tracker",
}
#: Campaigns that are simulated together; the seeds go by blocks, so that the number of processes
#: changes no number.
_BLOCK = 25
#: Campaigns per block whose stated uncertainty is worked out; it hardly varies between them.
_STATED = 2
MOST_BINS = 30

#: Estimate minus truth of one method, (B, n, 3), rad, roll, pitch, yaw in (−π, π], NaN where a
#: campaign has no result; and standard uncertainties that it states itself, (S, n, 3), rad.
Errors = tuple[FloatArray, FloatArray]


@dataclass(frozen=True, slots=True)
class Setup:
    """What is simulated: campaigns as `options` has them, surveys as `survey` has them."""

    rig: Rig
    options: Options
    survey: SurveyOptions = field(default_factory=SurveyOptions)
    runs: int = 1000
    seed: int = 0


@dataclass(frozen=True, slots=True)
class MethodResult:
    """Errors (estimate − truth) of one method.

    error : (N, n, 3), rad, of the campaigns that gave a result. failed : how many gave none.
    stated : (n, 3), rad, mean standard uncertainty that the method states; None where it has none.
    """

    method: str
    error: FloatArray
    failed: int
    stated: FloatArray | None

    @property
    def name(self) -> str:
        """In words."""
        return NAMES[self.method]

    @property
    def mean(self) -> FloatArray:
        """Mean error (n, 3), rad."""
        return np.asarray(self.error.mean(axis=0))

    @property
    def std(self) -> FloatArray:
        """Standard deviation of the error (n, 3), rad."""
        return np.asarray(self.error.std(axis=0, ddof=1))

    @property
    def rms(self) -> FloatArray:
        """Quadratic mean of the error (n, 3), rad: bias and scatter."""
        return np.asarray(np.sqrt(np.mean(self.error**2, axis=0)))

    @property
    def bias(self) -> FloatArray:
        """Mean error (n, 3) in units of its standard error."""
        return np.asarray(self.mean / (self.std / np.sqrt(len(self.error))))

    @property
    def unbiased(self) -> bool:
        """Every mean lies within three standard errors of zero."""
        return bool(np.all(np.abs(self.bias) <= BIASED))

    def histogram(self, i: int, j: int) -> tuple[IntArray, FloatArray]:
        """Counts (b,) and edges (b + 1,), rad, of one angle's errors; 2 ∛N bins, up to 30."""
        bins = min(MOST_BINS, int(np.ceil(2 * np.cbrt(len(self.error)))))
        counts, edges = np.histogram(self.error[:, i, j], bins=bins)
        return counts.astype(np.int64), edges


@dataclass(frozen=True, slots=True)
class Accuracy:
    """The study's result; left_out : method → why it does not stand in it."""

    setup: Setup
    results: tuple[MethodResult, ...]
    left_out: dict[str, str]

    def of(self, method: str) -> MethodResult:
        """Result of one method."""
        return next(result for result in self.results if result.method == method)

    @property
    def ranking(self) -> tuple[MethodResult, ...]:
        """Methods by the mean of their angles' rms errors, the best first."""
        return tuple(sorted(self.results, key=lambda r: float(r.rms.mean())))

    @property
    def verdict(self) -> str:
        """One sentence: which method is better on this rig, by what factor."""
        best, *others = self.ranking
        text = f"{best.name} is the most accurate on this rig"
        if others:
            factors = [
                f"{float(other.rms.mean() / best.rms.mean()):.3g} times better than {other.name}"
                for other in others
            ]
            text += f": {' and '.join(factors)}"
        return f"{text} (mean rms error of an angle {1e3 * best.rms.mean():.3g} mrad)"


def accuracy(
    setup: Setup, *, workers: int = 1, progress: Callable[[int], None] = lambda done: None
) -> Accuracy:
    """Simulate `runs` campaigns and surveys and calibrate each by every method.

    The postures are drawn once per study; the rig's truth (angles, zeros, mass, hinges, …), the
    machine's errors and the noise anew in every campaign, within what the rig file states. The
    estimates are those of `tdfscal calibrate`. workers : processes; they change no number.

    Raises NotConvergedError where a method finds almost no result.
    """
    posture_seed, campaign_seed = np.random.SeedSequence(setup.seed).spawn(2)
    driven = commanded(setup, np.random.default_rng(posture_seed))
    methods, left_out = _applicable(setup.rig, setup.options.count)
    sizes = [min(_BLOCK, setup.runs - start) for start in range(0, setup.runs, _BLOCK)]
    tasks = repeat(driven), repeat(methods), sizes, campaign_seed.spawn(len(sizes))
    blocks: list[dict[str, Errors]] = []
    for block in mapped(run_block, *tasks, workers=min(workers, len(sizes))):
        blocks.append(block)
        progress(min(setup.runs, len(blocks) * _BLOCK))
    results = tuple(_result(method, [block[method] for block in blocks]) for method in methods)
    return Accuracy(setup, results, left_out)


def commanded(setup: Setup, rng: np.random.Generator) -> Setup:
    """Draw the postures once for all campaigns of a study, as in Sect. 4."""
    command = draw_postures(setup.rig, setup.options, rng, 1).target(setup.rig.hinge)[0]
    return replace(setup, options=replace(setup.options, command=command))


def _applicable(rig: Rig, count: int) -> tuple[tuple[str, ...], dict[str, str]]:
    """Methods that can work with so many postures, and why others cannot."""
    need = 3 * rig.n
    if count >= need:
        return tuple(NAMES), {}
    why = f"it needs {need} postures for {rig.n} sensors, and the campaigns have {count}"
    return tuple(m for m in NAMES if m != "linear"), {"linear": why}


def run_block(
    setup: Setup, methods: tuple[str, ...], size: int, seed: np.random.SeedSequence
) -> dict[str, Errors]:
    """Simulate and calibrate one block of campaigns; method → errors."""
    rig = setup.rig
    dwell_rng, survey_rng = (np.random.default_rng(s) for s in seed.spawn(2))
    batch = simulate_dwells(rig, setup.options, dwell_rng, size)
    campaigns = [postures(rig, batch.dwells(i)) for i in range(size)]
    fits = attempted(lambda i: fit_robust(rig, campaigns[i]).fit, size)
    surveys = attempted(
        lambda i: by_tracker(rig, batch.truth.trial(i), setup.survey, survey_rng), size
    )
    rotations: dict[str, list[FloatArray | None]] = {
        "ml": [None if fit is None else fit.state.rotation for fit in fits],
        "tracker": [None if found is None else found.rotations.rotation for found in surveys],
    }
    if "linear" in methods:
        rotations["linear"] = [linear_rotations(linear_data(rig, c)) for c in campaigns]
    seen = [fit for fit in fits if fit is not None][:_STATED]
    stated = {
        "ml": [evaluate(fit, information_root(fit), 1.0).rpy_std for fit in seen],
        "tracker": [found.rpy_std for found in surveys if found is not None],
    }
    out = {}
    for method in methods:
        value = np.full((size, rig.n, 3), np.nan)
        for i, rotation in enumerate(rotations[method]):
            if rotation is not None:
                value[i] = so3.wrapped(so3.to_rpy(rotation) - batch.truth.rpy[i])
        out[method] = value, np.reshape(stated.get(method, []), (-1, rig.n, 3))
    return out


def _result(method: str, blocks: list[Errors]) -> MethodResult:
    error = np.concatenate([value for value, _ in blocks])
    found = ~np.isnan(error).any(axis=(1, 2))
    failed = int(np.sum(~found))
    if found.sum() < 2:
        raise NotConvergedError(
            f"{NAMES[method]} gives no result in {failed} of {len(error)} campaigns",
            hint="squeeze harder, or drive more postures",
        )
    stated = np.concatenate([own for _, own in blocks])
    return MethodResult(method, error[found], failed, stated.mean(axis=0) if len(stated) else None)


def angle_names(rig: Rig) -> list[tuple[int, int, str, str]]:
    """(sensor's index, angle's index, support, angle) of every angle."""
    return [(i, j, name, ANGLES[j]) for i, name in enumerate(rig.supports) for j in range(3)]
