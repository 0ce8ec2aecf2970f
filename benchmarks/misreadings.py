"""One mistake in the readings: is it named instead of advice on postures, and never without one?

    python -m benchmarks.misreadings [--campaigns 12]

Rewrites `benchmarks/misreadings.md`.
"""

from __future__ import annotations

import argparse
import time
from collections import Counter
from collections.abc import Callable, Iterator
from dataclasses import dataclass, replace

import numpy as np

from benchmarks.frame import heads, publish, row
from tdfscal.catalogue import sentence
from tdfscal.errors import DataError, TdfscalError
from tdfscal.numerics import so3
from tdfscal.records import Dwells, FloatArray, Rig
from tdfscal.selfcal.pipeline import self_calibrate
from tdfscal.simulation import Options, make_rig, simulate_dwells

Random = np.random.Generator
#: Forces with a mistake in them, and the words by which it is named.
Misread = tuple[FloatArray, tuple[str, ...]]
Draw = Callable[[FloatArray, Random], Misread]
#: What an error says of a mistake, whichever it is.
CLAIMS = ("exchanged", "opposite sign", "taken from", "reads", "jumped by")
FARTHEST = 0.3  # rad, of a mounting from the nominal one


@dataclass(frozen=True)
class Run:
    """What was said. verdict : named, misnamed, refused, not identifiable, rejected, accepted."""

    verdict: str
    said: str
    seconds: float


def channel(a: int, i: int) -> str:
    return f"F{'xyz'[a]} of ncp{i + 1}"


def scaled(factors: tuple[float, ...], axes: tuple[int, ...]) -> Draw:
    def draw(force: FloatArray, rng: Random) -> Misread:
        i, a, by = int(rng.integers(force.shape[1])), int(rng.choice(axes)), rng.choice(factors)
        force[:, i, a] *= by
        said = f"opposite sign of {channel(a, i)}" if by == -1 else f"{channel(a, i)} reads"
        return force, (said,)

    return draw


def sensor_in_kgf(force: FloatArray, rng: Random) -> Misread:
    i = int(rng.integers(force.shape[1]))
    force[:, i] /= 9.80665
    return force, (f"every axis of ncp{i + 1} reads", "in kgf")


def channels_exchanged(force: FloatArray, rng: Random) -> Misread:
    i, j = sorted(rng.choice(force.shape[1], 2, replace=False))
    a, b = rng.integers(2, size=2)
    force[:, [i, j], [a, b]] = force[:, [j, i], [b, a]]
    return force, (f"{channel(a, i)} and {channel(b, j)} exchanged",)


def axes_exchanged(force: FloatArray, rng: Random) -> Misread:
    i = int(rng.integers(force.shape[1]))
    force[:, i] = force[:, i][:, [1, 0, 2]]
    return force, (f"Fx and Fy of ncp{i + 1} exchanged",)


def sensors_exchanged(force: FloatArray, rng: Random) -> Misread:
    i, j = sorted(rng.choice(force.shape[1], 2, replace=False))
    force[:, [i, j]] = force[:, [j, i]]
    return force, (f"ncp{i + 1} taken from ncp{j + 1} and ncp{j + 1} taken from ncp{i + 1}",)


def place(force: FloatArray, rng: Random) -> tuple[int, int]:
    """A sensor, and a posture amid the campaign."""
    return int(rng.integers(force.shape[1])), int(rng.integers(3, len(force) - 3))


def tared(force: FloatArray, rng: Random) -> Misread:
    i, k = place(force, rng)
    force[k:, i] -= force[k - 1, i]
    return force, (f"zero of ncp{i + 1} jumped", f"between postures {k} and {k + 1} ", "as a tare")


def jumped(force: FloatArray, rng: Random) -> Misread:
    i, k = place(force, rng)
    by = rng.standard_normal(3)
    force[k:, i] += 300.0 * by / np.linalg.norm(by)
    return force, (f"zero of ncp{i + 1} jumped", f"before posture {k + 1}|{k} and {k + 1} ")


MISTAKES: dict[str, Draw] = {
    "a lateral channel in kgf": scaled((1 / 9.80665,), (0, 1)),
    "a lateral channel in kN": scaled((1e-3,), (0, 1)),
    "a vertical channel in kgf or kN": scaled((1 / 9.80665, 1e-3), (2,)),
    "a channel at 0.6 or 3 times": scaled((0.6, 3.0), (0, 1)),
    "the sign of a channel": scaled((-1.0,), (0, 1, 2)),
    "a sensor in kgf": sensor_in_kgf,
    "lateral channels of two sensors": channels_exchanged,
    "x and y of a sensor": axes_exchanged,
    "two sensors": sensors_exchanged,
    "a tare in mid-campaign": tared,
    "a zero that jumps by 300 N": jumped,
}


def drawn(rng: Random) -> tuple[Rig, Dwells]:
    """A campaign; mountings are up to `FARTHEST` from the nominal ones that the rig states."""
    rig = make_rig(int(rng.integers(3, 7)))
    turn = rng.standard_normal((rig.n, 3))
    turn *= (FARTHEST * rng.uniform(size=rig.n) / np.linalg.norm(turn, axis=1))[:, None]
    options = Options(
        postures=int(rng.integers(12, 41)),
        squeeze=float(rng.choice([0.0, 100.0, 300.0])),
        rpy=so3.to_rpy(so3.exp(turn)),
    )
    return rig, simulate_dwells(rig, options, rng, 1).dwells(0)


def poor(rng: Random) -> tuple[Rig, Dwells]:
    """Too few postures, or postures too alike, on carriages that build up no force."""
    rig, few = make_rig(int(rng.integers(3, 7))), bool(rng.integers(2))
    options = Options(
        postures=int(rng.integers(2, 6) if few else rng.integers(8, 25)),
        tilt=np.deg2rad(5.0 if few else rng.uniform(0.01, 0.5)),
        travel=0.0,
        stiffness=np.diag([1e3, 1e3, 1e9]),
        installation_std=(0.1, 0.1, 0.1),
    )
    return rig, simulate_dwells(rig, options, rng, 1).dwells(0)


def changed(dwells: Dwells, force: FloatArray) -> Dwells:
    off = force - dwells.force
    return replace(
        dwells, force=force, force_min=dwells.force_min + off, force_max=dwells.force_max + off
    )


def run(rig: Rig, dwells: Dwells, right: tuple[str, ...]) -> Run:
    """Calibrate, and hold what is said against the words of the mistake."""
    start = time.process_time()
    try:
        result = self_calibrate(rig, dwells, rng=np.random.default_rng(0), max_trials=0)
    except TdfscalError as error:
        said = str(error)
        claims = isinstance(error, DataError) and any(claim in said for claim in CLAIMS)
        verdict = "misnamed" if claims else "refused"
        if error.exit_status == 4:
            verdict = "not identifiable"
    else:
        said = " | ".join(map(sentence, result.reasons))
        verdict = "rejected" if result.reasons else "accepted"
    if right and all(any(one in said for one in words.split("|")) for words in right):
        verdict = "named"
    return Run(verdict, said, time.process_time() - start)


def runs(campaigns: int) -> Iterator[tuple[str, int, Run]]:
    for k, (name, draw) in enumerate(MISTAKES.items()):
        for seed in range(campaigns):
            rng = np.random.default_rng([k, seed])
            rig, dwells = drawn(rng)
            force, right = draw(dwells.force.copy(), rng)
            yield name, seed, run(rig, changed(dwells, force), right)
    for name, source, many in (("none", drawn, 3), ("none, poor postures", poor, 5)):
        for seed in range(many * campaigns):
            rng = np.random.default_rng([len(MISTAKES), seed])
            yield name, seed, run(*source(rng), ())


VERDICTS = ("named", "misnamed", "refused", "not identifiable", "rejected", "accepted")
HEAD = """\
# One mistake in the readings

Made by `python -m benchmarks.misreadings --campaigns {campaigns}`. Rigs of 3 to 6 supports, 12 to
40 postures, squeeze 0, 100 or 300 N, sensors turned by up to 0.3 rad from the nominal mounting that
is stated. Named: sensor, channel and kind (of a jump: sensor and posture; of a tare: that it is
one). Misnamed: another mistake. Poor postures: 2 to 5, or tilted by less than half a degree.

"""


def main() -> None:
    """Rewrite the table."""
    parser = argparse.ArgumentParser()
    parser.add_argument("--campaigns", type=int, default=12)
    campaigns = parser.parse_args().campaigns
    rows: dict[str, list[Run]] = {}
    for name, seed, one in runs(campaigns):
        rows.setdefault(name, []).append(one)
        if one.verdict in ("misnamed", "refused", "not identifiable"):
            print(name, seed, one.verdict, f"{one.seconds:.1f} s", one.said[:200], flush=True)
    lines = [heads("mistake", "campaigns", *VERDICTS, "CPU s, median", "largest")]
    for name, each in rows.items():
        count, cpu = Counter(one.verdict for one in each), [one.seconds for one in each]
        cells = (count[verdict] for verdict in VERDICTS)
        lines.append(row(name, len(each), *cells, f"{np.median(cpu):.1f}", f"{max(cpu):.1f}"))
    publish(__file__, HEAD.format(campaigns=campaigns) + "\n".join(lines) + "\n")


if __name__ == "__main__":
    main()
