"""Which postures to buy, by their rows of information, and in which order to drive them."""

from __future__ import annotations

import numpy as np

from tdfscal.numerics.information import inverse
from tdfscal.records import FloatArray, IntArray

_SWEEPS = 12
#: A swap must lower the objective by this share, or rounding would swap for ever.
_WORTH = 1e-6
#: Candidates whose gains are worked out together.
_AT_ONCE = 32


def information(J: FloatArray) -> FloatArray:
    """Information Σ JᵀJ (p, p) of candidates' rows J (N, m, p)."""
    return np.asarray(np.einsum("kmp,kmq->pq", J, J))


def variances(C: FloatArray, L: FloatArray) -> FloatArray:
    """Diagonal (r,) of L C Lᵀ for a covariance C (p, p) and L (r, p)."""
    return np.asarray(np.einsum("rp,pq,rq->r", L, C, L))


def objective(C: FloatArray, L: FloatArray) -> float:
    """Return tr(L C Lᵀ) for a covariance C (p, p) and L (r, p)."""
    return float(np.einsum("rp,pq,rq->", L, C, L))


def gains(J: FloatArray, C: FloatArray, L: FloatArray) -> FloatArray:
    """Fall (N,) of tr(L C Lᵀ) by each candidate's rows J (N, m, p), by the matrix lemma."""
    N, m, p = J.shape
    T = (J.reshape(-1, p) @ C).reshape(N, m, p)
    S = T @ np.swapaxes(J, 1, 2)
    S[:, np.arange(m), np.arange(m)] += 1.0
    Q = (T.reshape(-1, p) @ L.T).reshape(N, m, -1)
    return np.asarray(np.einsum("kmr,kmr->k", Q, np.linalg.solve(S, Q)))


def best_gain(
    J: FloatArray, C: FloatArray, L: FloatArray, taken: list[int], least: float
) -> tuple[int, float]:
    """The candidate with the largest of the `gains`, and that; −1 where none is above `least`.

    No gain exceeds |L C Jᵀ|², S being 1 at least: few candidates are asked for their own.
    """
    Q = (J.reshape(-1, len(C)) @ (C @ L.T)).reshape(len(J), -1)
    bound = np.einsum("kr,kr->k", Q, Q)
    bound[taken] = -1.0
    best, order, first = -1, np.argsort(-bound), 0
    while first < len(order) and bound[order[first]] > least:
        some = np.sort(order[first : first + _AT_ONCE])
        some, first = some[bound[some] > least], first + _AT_ONCE
        gain = gains(J[some], C, L)
        if gain.max() > least:
            best, least = int(some[gain.argmax()]), float(gain.max())
    return best, least


def updated(C: FloatArray, J: FloatArray, sign: float = 1.0) -> FloatArray:
    """Covariance with rows J (m, p) added, or with sign −1 taken away."""
    T = J @ C
    S = np.eye(len(J)) + sign * T @ J.T
    return np.asarray(C - sign * T.T @ np.linalg.solve(S, T))


def greedy(J: FloatArray, base: FloatArray, L: FloatArray, count: int) -> list[int]:
    """Choose `count` candidates, each once, the most useful first, on top of `base` (p, p)."""
    C, chosen = inverse(base), list[int]()
    for _ in range(count):
        best, _ = best_gain(J, C, L, chosen, -1.0)
        chosen.append(best)
        C = updated(C, J[best])
    return chosen


def choose(
    J: FloatArray, base: FloatArray, L: FloatArray, count: int
) -> tuple[IntArray, FloatArray]:
    """Minimise tr(L (base + Σ JᵀJ)⁻¹ Lᵀ) over `count` of the candidates: greedy, then exchange.

    J : (N, m, p), whitened rows. base : (p, p), information held already, positive definite.
    L : (r, p). Each candidate is taken at most once. Returns their indices and the covariance.
    """
    chosen = greedy(J, base, L, count)
    for _ in range(_SWEEPS):
        C = inverse(base + information(J[chosen]))
        value = objective(C, L)
        swapped = False
        for place, old in enumerate(chosen):
            without = updated(C, J[old], -1.0)
            held = objective(without, L)
            new, gain = best_gain(J, without, L, chosen, held - value * (1 - _WORTH))
            if new >= 0:
                chosen[place], C = new, updated(without, J[new])
                value, swapped = held - gain, True
        if not swapped:
            break
    return np.array(chosen), inverse(base + information(J[chosen]))


def short_tour(place: FloatArray) -> IntArray:
    """Order (K,) in which to drive postures with hinges at place (K, n, 3), m: the first, then
    always the nearest one that is left, by the way of the slowest axis.
    """
    flat = place.reshape(len(place), -1)
    way = np.max(np.abs(flat[:, None] - flat), axis=2)
    tour, left = [0], set(range(1, len(place)))
    while left:
        tour.append(min(left, key=lambda k: (way[tour[-1], k], k)))
        left.remove(tour[-1])
    return np.array(tour)
