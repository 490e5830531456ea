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


@dataclass(frozen=True, slots=True)
class LabelProblem:
    """Costs of labelling K nodes with 6 labels.

    Parameters
    ----------
    unary : (K, 6) float64 array
    edges : (E, 2) int32 array
        Node pairs (i, j) with i < j, each at most once.
    pairwise : (E, 6, 6) float64 array
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
        nodes, edges = len(self.unary), len(self.edges)
        if self.unary.shape != (nodes, N_LABELS):
            raise ValueError(f"unary costs are {self.unary.shape}; (K, {N_LABELS}) is needed")
        if self.edges.shape != (edges, 2) or self.pairwise.shape != (edges, N_LABELS, N_LABELS):
            raise ValueError(
                f"{self.edges.shape} edges with {self.pairwise.shape} costs; "
                f"(E, 2) and (E, {N_LABELS}, {N_LABELS}) are needed"
            )
        if not _rising(self.edges, nodes):
            raise ValueError(f"an edge is not (i, j) with 0 <= i < j < {nodes}")
        if not (_finite(np.ravel(self.unary)) and _finite(np.ravel(self.pairwise))):
            raise ValueError("a labelling cost is not finite; all must be")

    def energy(self, labels: NDArray[np.int64]) -> float:
        """Return the cost of a labelling: (K,) label indices from 0."""
        return float(_cost(self.unary, self.edges, self.pairwise, labels))


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
        self._pairwise = _both_ways(problem.pairwise)

    def solve(self, unary: NDArray[np.float64], sweeps: int, start: Labelling | None = None) -> Labelling:
        """Minimise the cost over all labellings.

        Parameters
        ----------
        unary : (K, 6) float64
            In place of the problem's.
        sweeps : int
            Forward-backward sweeps at most; it ends earlier when the bound meets the energy.
        start : Labelling, optional
            Of a similar problem on the same edges. Its messages warm-start the sweeps, and the result costs no more
            than its labels.
        """
        if start is None:
            messages, first = np.zeros((len(self._problem.edges), 2, N_LABELS)), np.full(len(unary), -1)
        else:
            messages, first = start.messages.copy(), start.labels
        costs, flat = np.ascontiguousarray(unary, dtype=np.float64), messages.reshape(-1, N_LABELS)
        labels, energy, bound = _trws(costs, self._problem.edges, self._pairwise, *self._order, flat, first, sweeps)
        return Labelling(labels, float(energy), float(bound), messages)


@njit(cache=True, nogil=True)
def _both_ways(pairwise):  # type: ignore[no-untyped-def]
    """(2E, 6, 6): costs of (first, second) and of (second, first) of each edge, so that kernels read rows."""
    both = np.empty((2 * len(pairwise), N_LABELS, N_LABELS))
    for e in range(len(pairwise)):
        for a in range(N_LABELS):
            for b in range(N_LABELS):
                both[2 * e, a, b] = both[2 * e + 1, b, a] = pairwise[e, a, b]
    return both


@njit(cache=True, nogil=True)
def _cost(unary, edges, pairwise, labels):  # type: ignore[no-untyped-def]
    total = 0.0
    for i in range(len(labels)):
        total += unary[i, labels[i]]
    for e in range(len(edges)):
        total += pairwise[e, labels[edges[e, 0]], labels[edges[e, 1]]]
    return total


def _adjacency(nodes: int, edges: NDArray[np.int32]) -> tuple[NDArray[np.int64], NDArray[np.uint32]]:
    """Edges of each node: (K + 1,) starts into (2E,) codes, edge << 1 | (node is the second of the edge).

    The code is the number of the message from the node and of the costs with the node's label first; the other
    direction has the code ^ 1.
    """
    result: tuple[NDArray[np.int64], NDArray[np.uint32]] = _incident(nodes, edges)
    return result


@njit(cache=True, nogil=True)
def _rising(edges, nodes):  # type: ignore[no-untyped-def]
    """Whether every edge is (i, j) with 0 <= i < j < nodes."""
    rising = True
    for e in range(len(edges)):
        rising = rising and 0 <= edges[e, 0] < edges[e, 1] < nodes
    return rising


@njit(cache=True, nogil=True)
def _finite(values):  # type: ignore[no-untyped-def]
    total = 0.0
    for i in range(len(values)):
        total += values[i] * 0.0  # NaN from the first that is not finite on
    return total == 0.0


@njit(cache=True, nogil=True)
def _incident(nodes, edges):  # type: ignore[no-untyped-def]
    starts = np.zeros(nodes + 1, np.int64)
    codes = np.empty(2 * len(edges), np.uint32)
    for e in range(len(edges)):
        starts[edges[e, 0] + 1] += 1
        starts[edges[e, 1] + 1] += 1
    starts[:] = np.cumsum(starts)
    filled = starts.copy()
    for second in range(2):
        for e in range(len(edges)):
            node = edges[e, second]
            codes[filled[node]] = 2 * e + second
            filled[node] += 1
    return starts, codes


@njit(cache=True, nogil=True)
def _trws(unary, edges, pairwise, starts, codes, messages, labels, sweeps):  # type: ignore[no-untyped-def]
    """Sweep from `labels`, where they are not negative; updates the messages in place."""
    nodes = len(unary)
    best = labels.copy()
    for i in range(nodes):
        best[i] = _argmin(unary[i]) if labels[i] < 0 else labels[i]
    _descend(unary, edges, pairwise, starts, codes, best)
    best_energy = _cost(unary, edges, pairwise[::2], best)
    bound = -np.inf
    current = np.zeros(nodes, np.int64)
    belief, fixed = np.empty(N_LABELS), np.empty(N_LABELS)
    for _ in range(sweeps):
        for i in range(nodes):
            _collect(unary, edges, pairwise, starts, codes, messages, current, i, belief, fixed)
            current[i] = _argmin(fixed)
            _send(pairwise, starts, codes, messages, i, 0, belief)
        energy = _cost(unary, edges, pairwise[::2], current)
        if energy < best_energy - 1e-12:
            best_energy = energy
            best[:] = current
        new_bound = 0.0
        for i in range(nodes - 1, -1, -1):
            _believe(unary, starts, codes, messages, i, belief)
            new_bound += _send(pairwise, starts, codes, messages, i, 1, belief)
        stalled = new_bound - bound < 1e-6 * (1.0 + abs(new_bound))
        bound = max(bound, new_bound)
        if stalled or best_energy - bound < 1e-7 * (1.0 + abs(bound)):
            break
    _descend(unary, edges, pairwise, starts, codes, best)
    return best, _cost(unary, edges, pairwise[::2], best), bound


@njit(cache=True, nogil=True, inline="always")
def _argmin(values):  # type: ignore[no-untyped-def]
    """First of the least of `N_LABELS` values."""
    best = 0
    for a in range(1, N_LABELS):
        best = a if values[a] < values[best] else best
    return best


@njit(cache=True, nogil=True)
def _collect(unary, edges, pairwise, starts, codes, messages, current, i, belief, fixed):  # type: ignore[no-untyped-def]
    """Costs of node i by all messages, and by the labels already fixed (of nodes before i) and the others' messages."""
    for a in range(N_LABELS):
        belief[a] = fixed[a] = unary[i, a]
    for c in range(starts[i], starts[i + 1]):
        code = codes[c]
        incoming = code ^ 1
        if code & 1:
            other = current[edges[code >> 1, 0]]
            for a in range(N_LABELS):
                fixed[a] += pairwise[incoming, other, a]
        else:
            for a in range(N_LABELS):
                fixed[a] += messages[incoming, a]
        for a in range(N_LABELS):
            belief[a] += messages[incoming, a]


@njit(cache=True, nogil=True)
def _believe(unary, starts, codes, messages, i, belief):  # type: ignore[no-untyped-def]
    """Costs of node i by all messages."""
    for a in range(N_LABELS):
        belief[a] = unary[i, a]
    for c in range(starts[i], starts[i + 1]):
        incoming = codes[c] ^ 1
        for a in range(N_LABELS):
            belief[a] += messages[incoming, a]


@njit(cache=True, nogil=True)
def _send(pairwise, starts, codes, messages, i, backward, belief):  # type: ignore[no-untyped-def]
    """Update the messages from node i to later (backward = 0) or earlier nodes; return its part of the bound.

    `belief` is used up.
    """
    before = 0
    for c in range(starts[i], starts[i + 1]):
        before += codes[c] & 1
    share = 1.0 / max(starts[i + 1] - starts[i] - before, before, 1)
    least = belief[_argmin(belief)]
    part = least
    for a in range(N_LABELS):
        belief[a] = share * (belief[a] - least)
    for c in range(starts[i], starts[i + 1]):
        code = codes[c]
        if code & 1 == backward:
            part += _pass_on(pairwise, messages, code, belief)
    return part


@njit(cache=True, nogil=True, inline="always")
def _pass_on(pairwise, messages, code, belief):  # type: ignore[no-untyped-def]
    """One message: min over the own label a of belief(a) - incoming(a) + cost(a, b), less its least value, which is
    returned.
    """
    back = code ^ 1
    own0, own1, own2 = belief[0] - messages[back, 0], belief[1] - messages[back, 1], belief[2] - messages[back, 2]
    own3, own4, own5 = belief[3] - messages[back, 3], belief[4] - messages[back, 4], belief[5] - messages[back, 5]
    for b in range(N_LABELS):
        one = min(own0 + pairwise[code, 0, b], own1 + pairwise[code, 1, b])
        two = min(own2 + pairwise[code, 2, b], own3 + pairwise[code, 3, b])
        three = min(own4 + pairwise[code, 4, b], own5 + pairwise[code, 5, b])
        messages[code, b] = min(min(one, two), three)
    low = messages[code, 0]
    for b in range(1, N_LABELS):
        low = min(low, messages[code, b])
    for b in range(N_LABELS):
        messages[code, b] -= low
    return low


@njit(cache=True, nogil=True)
def _descend(unary, edges, pairwise, starts, codes, labels):  # type: ignore[no-untyped-def]
    """Relabel single nodes while that lowers the energy (iterated conditional modes)."""
    belief = np.empty(N_LABELS)
    for _ in range(10):
        changed = False
        for i in range(len(unary)):
            for a in range(N_LABELS):
                belief[a] = unary[i, a]
            for c in range(starts[i], starts[i + 1]):
                code = codes[c]
                other = labels[edges[code >> 1, 1 - (code & 1)]]
                for a in range(N_LABELS):
                    belief[a] += pairwise[code ^ 1, other, a]
            best = _argmin(belief)
            if belief[best] < belief[labels[i]] - 1e-12:
                labels[i] = best
                changed = True
        if not changed:
            break
