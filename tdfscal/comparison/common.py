"""What several campaigns have in common: the rig's constants, and each terminal as stated.

A weighing that M rig files state alike is one realisation; taken as each campaign's own its error
would be averaged M times away (theory, section 13). Each campaign has the constants of the rig, and
of the terminals its own.
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass, replace

import numpy as np

from tdfscal.estimation.fit import Priors
from tdfscal.estimation.observation import stated
from tdfscal.model.calibrated import free_constants, of_load, same_load
from tdfscal.model.parameters import LOAD, State, retract
from tdfscal.numerics.information import Information, nothing
from tdfscal.records import FloatArray, IntArray, Rig


@dataclass(frozen=True, slots=True)
class Common:
    """Common parameters (C,) of campaigns with these rig files; rotations first.

    places : per campaign (c,), which of them its own free constants are.
    terminal : per campaign, the first one whose rig file states the same load.
    """

    rigs: tuple[Rig, ...]
    size: int
    places: tuple[IntArray, ...]
    terminal: tuple[int, ...]

    def embedded(self, index: int, own: Information) -> Information:
        """What one campaign says of its own constants (c,), as of all common ones."""
        out, at = nothing(self.size), self.places[index]
        out.matrix[np.ix_(at, at)], out.score[at] = own.matrix, own.score
        return out

    def of(self, index: int, known: Information) -> Information:
        """What is known of one campaign's own constants (c,), whatever the others are."""
        at = self.places[index]
        other = np.ones(self.size, dtype=np.bool_)
        other[at] = False
        rest = known.without(other)
        return Information(rest.matrix[np.ix_(at, at)], rest.score[at])

    def load(self, index: int) -> IntArray:
        """Places of a campaign's terminal."""
        return self.places[index][of_load(self.rigs[index])]

    def stated(self, references: Sequence[State]) -> Information:
        """What the rig files state of them, counted once, about each campaign's reference."""
        out = nothing(self.size)
        for k in sorted(set(self.terminal)):
            own = self.embedded(k, stated(Priors(self.rigs[k]), references[k]))
            at = self.places[k]
            out.matrix[at], out.score[at] = own.matrix[at], own.score[at]
        return out

    def moved(self, references: Sequence[State], move: FloatArray) -> list[State]:
        """Return the references after a step (C,) of the common parameters."""
        return [retract(reference, self.step(k, move)) for k, reference in enumerate(references)]

    def step(self, index: int, move: FloatArray) -> FloatArray:
        """Step (P,) of one campaign's parameters by one of the common ones."""
        free = free_constants(self.rigs[index])
        step = np.zeros(len(free))
        step[free] = move[self.places[index]]
        return step


def common(rigs: Sequence[Rig]) -> Common:
    """Find what campaigns of one rig have in common, by what their rig files state."""
    size, places, terminal = int(free_constants(rigs[0]).sum()), list[IntArray](), list[int]()
    constant = np.flatnonzero(~of_load(rigs[0]))
    for k, rig in enumerate(rigs):
        first = next(j for j in range(k + 1) if same_load(rigs[j], rig))
        terminal.append(first)
        if first < k:
            places.append(places[first])
            continue
        load = of_load(rig)
        at = np.empty(len(load), dtype=np.int_)
        at[~load] = constant
        new = np.arange(int(load.sum()))
        at[load] = np.flatnonzero(load) if k == 0 else size + new
        size += len(new) * (k > 0)
        places.append(at)
    return Common(tuple(rigs), size, tuple(places), tuple(terminal))


def with_load(reference: State, of: State) -> State:
    """Return the reference with another state's terminal."""
    return replace(reference, **{group: getattr(of, group) for group in LOAD})
