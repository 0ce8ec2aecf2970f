"""What of a log serves: not what is frozen or clipped, and nothing that is touched."""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import dataclass

from tdfscal.motioncal import checks
from tdfscal.motioncal.blocks import Block, blocks
from tdfscal.motioncal.contact import Stretch, merged, outside, touched
from tdfscal.motioncal.estimator import MovingFit
from tdfscal.motioncal.streams import Slow
from tdfscal.records import BoolArray, Rig

#: Rounds in which contacts come to light.
_ROUNDS = 6
#: Left-out stretches closer than this are one, s.
_TOGETHER = 4.0


@dataclass(frozen=True, slots=True)
class Usable:
    """What of a log serves: its instants (a mask (N,)), their blocks, and what was left out."""

    keep: BoolArray
    blocks: tuple[Block, ...]
    rejected: tuple[Stretch, ...]


def usable_samples(rig: Rig, slow: Slow) -> Usable:
    """Leave out what is frozen or clipped. Raises DataError where nothing serves."""
    checks.check_stream(rig, slow)
    keep, rejected = checks.frozen(rig, slow)
    rejected += checks.clipped(rig, slow)
    keep &= ~slow.clipped
    cut = blocks(slow, keep)
    checks.check_blocks(slow, cut)
    return Usable(keep, cut, rejected)


def without_contacts(
    fit: MovingFit, usable: Usable, again: Callable[[tuple[Block, ...], MovingFit], MovingFit]
) -> tuple[MovingFit, Usable]:
    """Leave out what touches the terminal, and fit anew, until nothing does.

    again : the fit of what is left, from the last one.
    """
    slow, rejected, cut = fit.slow, usable.rejected, usable.blocks
    for _ in range(_ROUNDS):
        found = touched(fit)
        if not found:
            break
        rejected = merged([*rejected, *found], _TOGETHER)
        cut = blocks(slow, usable.keep & outside(slow.time, rejected))
        checks.check_blocks(slow, cut)
        fit = again(cut, fit)
    return fit, Usable(usable.keep & outside(slow.time, rejected), cut, rejected)
