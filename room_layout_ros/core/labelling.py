"""Labels of the superpixels: a pairwise random field solved by TRW-S (docs/method.md, section 8).

TRW-S (Kolmogorov, PAMI 2006) is a convergent, convex belief propagation over monotonic chains: its lower bound never
falls, and where it meets the energy the labelling is proved optimal.
"""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np
from numba import njit
from numpy.typing import NDArray

from .labels import N_LABELS

_WIDTH = N_LABELS


@dataclass(frozen=True, slots=True)
class LabelProblem:
    """Costs of labelling K nodes with L <= 6 labels.

    Parameters
    ----------
    unary : (K, L) float64 array
    edges : (E, 2) int32 array
        Node pairs (i, j) with i < j, each at most once.
    pairwise : (E, L, L) float64 array
        Cost of (label of i, label of j).

    Raises
    ------
    ValueError
        When shapes do not fit, an edge is not (i < j) or a cost is not finite.
    """

    unary: NDArray[np.float64]
    edges: NDArray[np.int32]
    pairwise: NDArray[np.float64]

    def __post_init__(self) -> None:
        nodes, labels = self.unary.shape
        if not 1 <= labels <= _WIDTH:
            raise ValueError(f"problem has {labels} labels; allowed are 1 to {_WIDTH}")
        if self.edges.shape != (len(self.edges), 2) or self.pairwise.shape != (len(self.edges), labels, labels):
            raise ValueError(
                f"{self.edges.shape} edges with {self.pairwise.shape} costs; "
                f"(E, 2) and (E, {labels}, {labels}) are needed"
            )
        if len(self.edges) and not (
            (self.edges[:, 0] < self.edges[:, 1]).all() and self.edges.min() >= 0 and self.edges.max() < nodes
        ):
            raise ValueError(f"an edge is not (i, j) with 0 <= i < j < {nodes}")
        if not (np.isfinite(self.unary).all() and np.isfinite(self.pairwise).all()):
            raise ValueError("a labelling cost is not finite; all must be")

    def energy(self, labels: NDArray[np.int64]) -> float:
        """Return the cost of a labelling: (K,) label indices from 0."""
        total = self.unary[np.arange(len(labels)), labels].sum()
        if len(self.edges):
            i, j = self.edges.T
            total += self.pairwise[np.arange(len(i)), labels[i], labels[j]].sum()
        return float(total)


@dataclass(frozen=True, slots=True)
class Labelling:
    """A labelling with its proof.

    Attributes
    ----------
    labels : (K,) int64 indices from 0.
    energy : its cost. bound : no labelling costs less.
    messages : (E, 2, 6) float64 to j and to i, for a warm start.
    """

    labels: NDArray[np.int64]
    energy: float
    bound: float
    messages: NDArray[np.float64]


class LabelSolver:
    """Solves labellings that differ in their unary costs only; what the edges need is prepared once.

    Parameters
    ----------
    problem : LabelProblem
    """

    def __init__(self, problem: LabelProblem) -> None:
        self._problem = problem
        self._order = _adjacency(len(problem.unary), problem.edges)
        self._pairwise = _padded_pairwise(problem.pairwise)

    def solve(self, unary: NDArray[np.float64], sweeps: int, start: Labelling | None = None) -> Labelling:
        """Minimise the cost with other unary costs (K, L); see `solve_labelling`."""
        if start is None:
            messages = np.zeros((len(self._problem.edges), 2, _WIDTH))
            first = unary.argmin(axis=1)
        else:
            messages, first = start.messages.copy(), start.labels
        padded = _padded_unary(unary, self._problem.pairwise)
        labels, energy, bound = _trws(
            padded, self._problem.edges, self._pairwise, *self._order, messages, first.astype(np.int64), sweeps
        )
        return Labelling(labels, float(energy), float(bound), messages)


def solve_labelling(problem: LabelProblem, sweeps: int = 20, start: Labelling | None = None) -> Labelling:
    """Minimise the cost over all labellings.

    Parameters
    ----------
    problem : LabelProblem
    sweeps : int
        Forward-backward sweeps at most; it ends earlier when the bound meets the energy.
    start : Labelling, optional
        Of a similar problem on the same edges. Its messages warm-start the sweeps, and the result costs no more than
        its labels.
    """
    return LabelSolver(problem).solve(problem.unary, sweeps, start)


def _padded_pairwise(pairwise: NDArray[np.float64]) -> NDArray[np.float64]:
    """(2, E, 6, 6): costs of (first, second) and of (second, first), so that kernels read rows.

    Kernels have loops of a fixed number of labels, which the compiler unrolls.
    """
    edges, labels, _ = pairwise.shape
    padded = np.zeros((2, edges, _WIDTH, _WIDTH))
    padded[0, :, :labels, :labels] = pairwise
    padded[1, :, :labels, :labels] = pairwise.transpose(0, 2, 1)
    return padded


def _padded_unary(unary: NDArray[np.float64], pairwise: NDArray[np.float64]) -> NDArray[np.float64]:
    """(K, 6); a label that is not the problem's costs more than any labelling."""
    labels = unary.shape[1]
    if labels == _WIDTH:
        return np.ascontiguousarray(unary, dtype=np.float64)
    padded = np.full((len(unary), _WIDTH), 1.0 + 2.0 * (np.abs(unary).sum() + np.abs(pairwise).sum()))
    padded[:, :labels] = unary
    return padded


def _adjacency(nodes: int, edges: NDArray[np.int32]) -> tuple[NDArray[np.int64], NDArray[np.int64]]:
    """Edges of each node: (K + 1,) starts into (2E,) codes, edge << 1 | (node is the second of the edge)."""
    ends = edges.T.ravel().astype(np.int64)  # all first nodes, then all second ones
    codes = np.concatenate([np.arange(len(edges)) << 1, np.arange(len(edges)) << 1 | 1])
    order = np.argsort(ends, kind="stable")
    starts = np.zeros(nodes + 1, dtype=np.int64)
    np.cumsum(np.bincount(ends, minlength=nodes), out=starts[1:])
    return starts, codes[order]


@njit(cache=True, nogil=True)
def _trws(unary, edges, pairwise, starts, codes, messages, labels, sweeps):  # type: ignore[no-untyped-def]
    nodes = len(unary)
    best = labels.copy()
    _descend(unary, edges, pairwise, starts, codes, best)
    best_energy = _energy(unary, edges, pairwise, best)
    bound = -np.inf
    current = np.zeros(nodes, np.int64)
    belief, out = np.empty(_WIDTH), np.empty(_WIDTH)
    for _ in range(sweeps):
        for i in range(nodes):
            _collect(unary, edges, pairwise, starts, codes, messages, current, i, belief)
            current[i] = belief.argmin()
            _send(pairwise, starts, codes, messages, unary, i, 0, belief, out)
        energy = _energy(unary, edges, pairwise, current)
        if energy < best_energy - 1e-12:
            best_energy = energy
            best[:] = current
        new_bound = 0.0
        for i in range(nodes - 1, -1, -1):
            new_bound += _send(pairwise, starts, codes, messages, unary, i, 1, belief, out)
        stalled = new_bound - bound < 1e-6 * (1.0 + abs(new_bound))
        bound = max(bound, new_bound)
        if stalled or best_energy - bound < 1e-7 * (1.0 + abs(bound)):
            break
    _descend(unary, edges, pairwise, starts, codes, best)
    return best, _energy(unary, edges, pairwise, best), bound


@njit(cache=True, nogil=True)
def _collect(unary, edges, pairwise, starts, codes, messages, current, i, belief):  # type: ignore[no-untyped-def]
    """Costs of node i given the labels already fixed (nodes before i) and the messages of the others."""
    for a in range(_WIDTH):
        belief[a] = unary[i, a]
    for c in range(starts[i], starts[i + 1]):
        e, second = codes[c] >> 1, codes[c] & 1
        if second:
            other = current[edges[e, 0]]
            for a in range(_WIDTH):
                belief[a] += pairwise[0, e, other, a]
        else:
            for a in range(_WIDTH):
                belief[a] += messages[e, 1, a]


@njit(cache=True, nogil=True)
def _send(pairwise, starts, codes, messages, unary, i, backward, belief, out):  # type: ignore[no-untyped-def]
    """Update the messages from node i to later (backward = 0) or earlier nodes; return its part of the bound."""
    for a in range(_WIDTH):
        belief[a] = unary[i, a]
    after, before = 0, 0
    for c in range(starts[i], starts[i + 1]):
        e, second = codes[c] >> 1, codes[c] & 1
        before += second
        after += 1 - second
        for a in range(_WIDTH):
            belief[a] += messages[e, 1 - second, a]
    least = belief.min()
    part = least
    share = 1.0 / max(after, before, 1)
    for c in range(starts[i], starts[i + 1]):
        e, second = codes[c] >> 1, codes[c] & 1
        if second != backward:
            continue
        # to the other end: min over own label a of share * belief(a) - incoming(a) + cost
        for b in range(_WIDTH):
            out[b] = np.inf
        for a in range(_WIDTH):
            value = share * (belief[a] - least) - messages[e, 1 - second, a]
            for b in range(_WIDTH):
                cost = value + pairwise[second, e, a, b]
                out[b] = cost if cost < out[b] else out[b]
        low = out.min()
        part += low
        for b in range(_WIDTH):
            messages[e, second, b] = out[b] - low
    return part


@njit(cache=True, nogil=True)
def _descend(unary, edges, pairwise, starts, codes, labels):  # type: ignore[no-untyped-def]
    """Relabel single nodes while that lowers the energy (iterated conditional modes)."""
    belief = np.empty(_WIDTH)
    for _ in range(10):
        changed = False
        for i in range(len(unary)):
            for a in range(_WIDTH):
                belief[a] = unary[i, a]
            for c in range(starts[i], starts[i + 1]):
                e, second = codes[c] >> 1, codes[c] & 1
                other = labels[edges[e, 1 - second]]
                for a in range(_WIDTH):
                    belief[a] += pairwise[1 - second, e, other, a]
            best = belief.argmin()
            if belief[best] < belief[labels[i]] - 1e-12:
                labels[i] = best
                changed = True
        if not changed:
            break


@njit(cache=True, nogil=True)
def _energy(unary, edges, pairwise, labels):  # type: ignore[no-untyped-def]
    total = 0.0
    for i in range(len(labels)):
        total += unary[i, labels[i]]
    for e in range(len(edges)):
        total += pairwise[0, e, labels[edges[e, 0]], labels[edges[e, 1]]]
    return total
