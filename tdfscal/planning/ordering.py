"""In which order to drive postures: short ways, returns for drift, approaches from both sides."""

from __future__ import annotations

import numpy as np

from tdfscal.records import FloatArray, IntArray

_ROUNDS = 50


def distances(place: FloatArray) -> FloatArray:
    """Way (K, K), m, between postures with hinges at place (K, n, 3): that of the slowest axis."""
    flat = place.reshape(len(place), -1)
    return np.asarray(np.max(np.abs(flat[:, None] - flat), axis=2))


def short_tour(distance: FloatArray, start: int) -> IntArray:
    """Order (K,) of a closed tour from `start`: nearest neighbour, then 2-opt."""
    K = len(distance)
    tour, left = [start], set(range(K)) - {start}
    while left:
        here = distance[tour[-1]]
        tour.append(min(left, key=lambda k: (here[k], k)))
        left.remove(tour[-1])
    order = np.array(tour)
    for _ in range(_ROUNDS * K):
        # Turning round order[a + 1 .. b] replaces the ways a → a + 1 and b → b + 1.
        after = np.roll(order, -1)
        way = distance[order, after]
        change = distance[np.ix_(order, order)] + distance[np.ix_(after, after)]
        change -= way[:, None] + way
        change[np.tril_indices(K, 1)] = 0.0
        a, b = np.unravel_index(int(np.argmin(change)), change.shape)
        if change[a, b] > -1e-12:
            break
        order[a + 1 : b + 1] = order[a + 1 : b + 1][::-1]
    return order


def with_returns(order: IntArray, returns: int) -> IntArray:
    """Insert the first posture again, `returns` times, evenly, the last time at the very end."""
    pieces = np.array_split(order[1:], returns) if returns else [order[1:]]
    out = [order[:1]]
    for piece in pieces:
        out += [piece, order[:1]] if returns else [piece]
    return np.concatenate(out)


def approaches(order: IntArray) -> IntArray:
    """Side (K,), ±1, from which to come to each posture.

    Sides alternate, and a posture that comes again is reached from the other side than before, so
    that backlash and friction show as scatter and as differences, and not as angles.
    """
    side, last = np.empty(len(order), dtype=np.int64), dict[int, int]()
    for k, posture in enumerate(order.tolist()):
        side[k] = -last[posture] if posture in last else (-1) ** k
        last[posture] = int(side[k])
    return side
