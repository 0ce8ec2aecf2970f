"""Laser-tracker surveys in which one source of noise is understated.

python -m benchmarks.tracker_components [SURVEYS] > benchmarks/tracker_components.md
"""

from __future__ import annotations

import sys
from collections.abc import Callable
from dataclasses import replace

import numpy as np

from tdfscal.errors import TdfscalError
from tdfscal.records import Instrument
from tdfscal.trackercal import calibrate_tracker
from tests.tracker.world import PAPER, Survey, error_vector, make_survey

STATED = 10e-6


def times(instrument: Instrument, factor: float) -> Instrument:
    return Instrument(
        instrument.range * factor, instrument.range_ppm * factor, instrument.angle_arcsec * factor
    )


def drawing(seed: int, factor: float, targets: int) -> Survey:
    survey = make_survey(seed, drawing=factor * STATED, layout=layout(targets))
    return survey.with_session(drawing=STATED)


def positioner(seed: int, factor: float, targets: int) -> Survey:
    survey = make_survey(seed, positioner=factor * STATED, drawing=STATED, layout=layout(targets))
    return replace(
        survey,
        rig=replace(survey.rig, declared=replace(survey.rig.declared, positioner=STATED)),
    )


def instrument(seed: int, factor: float, targets: int) -> Survey:
    survey = make_survey(seed, drawing=STATED, tracker=times(PAPER, factor), layout=layout(targets))
    return survey.with_session(instrument=PAPER)


def layout(targets: int) -> np.ndarray[tuple[int, int], np.dtype[np.float64]]:
    """Targets on a circle of 0.5, every other one raised; in units of the spacing."""
    turn = 2 * np.pi * np.arange(targets) / targets
    return np.stack([np.cos(turn), np.sin(turn), 0.4 * (np.arange(targets) % 2)], axis=1) / 2


def row(
    make: Callable[[int, float, int], Survey], factor: float, targets: int, surveys: int
) -> str:
    """Mean Mahalanobis² over its degrees of freedom, coverage, and the stated uncertainty."""
    squares, inside, stated, refused = list[float](), list[float](), list[float](), 0
    for seed in range(surveys):
        survey = make(1000 + seed, factor, targets)
        try:
            result = calibrate_tracker(survey.rig, survey.session, trials=0)
        except TdfscalError:
            refused += 1
            continue
        d = error_vector(survey.X, result.rotations.rotation)
        cov = result.rotations.covariance
        squares.append(float(d @ np.linalg.solve(cov, d)) / len(d))
        std = np.sqrt(np.diag(cov))
        inside.append(float(np.mean(np.abs(d) < 1.96 * std)))
        stated.append(float(np.mean(std**2)))
    return (
        f"{make.__name__} | {factor:g} | {targets} | {np.mean(squares):.2f} "
        f"± {np.std(squares) / np.sqrt(len(squares)):.2f} | "
        f"{100 * np.mean(inside):.1f} % | {1e3 * np.sqrt(np.mean(stated)):.3f} | {refused}"
    )


def main() -> None:
    """Print the table as Markdown."""
    print("# Laser tracker: one source of noise understated\n")
    surveys = int(sys.argv[1]) if len(sys.argv) > 1 else 60
    print(f"`python -m benchmarks.tracker_components {surveys}`\n")
    print(
        f"Three sensors 5 m away, 10 moves per NCP, stated: the paper's instrument, 10 µm each of "
        f"the positioners and the drawing; one of them is really larger by the factor. {surveys} "
        f"surveys a row; d² / 9 should be 1 ± {np.sqrt(2 / (9 * surveys)):.2f}.\n"
    )
    print("| source | factor | targets | d² / 9 | in 95 % | stated, mrad | refused |")
    print("|---|---:|---:|---:|---:|---:|---:|")
    for targets in (4, 6):
        print(f"| {row(drawing, 1.0, targets, surveys)} |")
        for make in (drawing, positioner, instrument):
            for factor in (3.0, 5.0, 10.0):
                print(f"| {row(make, factor, targets, surveys)} |", flush=True)


if __name__ == "__main__":
    main()
