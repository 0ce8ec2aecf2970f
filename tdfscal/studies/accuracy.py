"""How well each method finds the angles: Monte Carlo of whole campaigns (Sect. 4, Table 2)."""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import dataclass, field

import numpy as np

from tdfscal.errors import NotConvergedError, UsageError
from tdfscal.records import ANGLES, FloatArray, IntArray, Rig
from tdfscal.significance import BIASED
from tdfscal.simulation import Options, SurveyOptions
from tdfscal.studies.simulated_campaigns import BLOCK, METHODS, Errors, Task, commanded, run_blocks

NAMES = {
    "ml": "self-calibration, maximum likelihood",
    "linear": "self-calibration, the paper's linear method",
    "tracker": "laser tracker",
}
FEWEST_RUNS = 2
MOST_BINS = 30


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
    command: FloatArray
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

    Raises
    ------
    UsageError : too few runs. NotConvergedError : a method finds almost no result.
    """
    if setup.runs < FEWEST_RUNS:
        raise UsageError(
            f"{setup.runs} runs show no scatter", hint=f"ask for {FEWEST_RUNS} or more"
        )
    posture_seed, campaign_seed = np.random.SeedSequence(setup.seed).spawn(2)
    options = commanded(setup.rig, setup.options, np.random.default_rng(posture_seed))
    assert options.command is not None
    methods, left_out = _applicable(setup.rig, options.count)
    sizes = [min(BLOCK, setup.runs - start) for start in range(0, setup.runs, BLOCK)]
    tasks = [
        Task(setup.rig, options, setup.survey, methods, size, seed)
        for size, seed in zip(sizes, campaign_seed.spawn(len(sizes)), strict=True)
    ]
    blocks = list(run_blocks(tasks, workers, progress))
    results = tuple(_gather(method, [block[method] for block in blocks]) for method in methods)
    return Accuracy(setup, options.command, results, left_out)


def _applicable(rig: Rig, postures: int) -> tuple[tuple[str, ...], dict[str, str]]:
    """Methods that can work with so many postures, and why others cannot."""
    need = 3 * rig.n
    if postures >= need:
        return METHODS, {}
    why = f"it needs {need} postures for {rig.n} sensors, and the campaigns have {postures}"
    return tuple(m for m in METHODS if m != "linear"), {"linear": why}


def _gather(method: str, blocks: list[Errors]) -> MethodResult:
    error = np.concatenate([block.value for block in blocks])
    found = ~np.isnan(error).any(axis=(1, 2))
    if found.sum() < FEWEST_RUNS:
        raise NotConvergedError(
            f"{NAMES[method]} gives no result in {int(np.sum(~found))} of {len(error)} campaigns",
            hint="squeeze harder, or drive more postures",
        )
    stated = np.concatenate([block.stated for block in blocks])
    return MethodResult(
        method=method,
        error=error[found],
        failed=int(np.sum(~found)),
        stated=stated.mean(axis=0) if len(stated) else None,
    )


def angle_names(rig: Rig) -> list[tuple[int, int, str, str]]:
    """(sensor's index, angle's index, support, angle) of every angle."""
    return [(i, j, name, ANGLES[j]) for i, name in enumerate(rig.supports) for j in range(3)]
