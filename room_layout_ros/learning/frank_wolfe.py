"""Structured SVM by block-coordinate Frank-Wolfe (Lacoste-Julien, Jaggi, Schmidt and Pletscher 2013), Algorithm 4.

The same problem as `structured_svm` with a slack per example, min 1/2 ||w - w0||^2 + C/N sum_i xi_i: equal at the
optimum, as the mean of the largest slacks is the largest mean. No quadratic program: each example's oracle answer is
mixed into that example's share of the weights by a step of closed form.
"""

from __future__ import annotations

import time
from collections.abc import Callable

import numpy as np
from numpy.typing import NDArray

from .oracle import Separation, Separator
from .structured_svm import SvmConfig, SvmProgress, SvmResult, average


def learn_frank_wolfe(
    separator: Separator,
    start: NDArray[np.float64],
    config: SvmConfig,
    rng: np.random.Generator,
    progress: Callable[[SvmProgress], object] = lambda _row: None,
    batch: int = 1,
    gap_every: int = 5,
) -> SvmResult:
    """Learn weights by block-coordinate Frank-Wolfe; `config.max_rounds` counts passes over the examples.

    Parameters
    ----------
    separator : Separator
    start : (d,) float64, w0.
    config : SvmConfig
    rng : numpy.random.Generator
        Order of the examples.
    progress : callable
        Told after every pass in which the gap was measured.
    batch : int
        Examples asked at the same weights, so that processes can share them; 1 is the published algorithm.
    gap_every : int
        Passes between measurements of the duality gap, each of which is one more pass.

    Raises
    ------
    ValueError
        When there is no example.
    """
    if separator.count == 0:
        raise ValueError("there is no example to learn from")
    start = np.asarray(start, np.float64)
    N, C = separator.count, config.C
    # w = w0 + sum of shares; the dual value is sum of losses - 1/2 ||w - w0||^2
    shares, losses = np.zeros((N, len(start))), np.zeros(N)
    change = np.zeros(len(start))
    mean, steps = np.zeros(len(start)), 0
    history: list[SvmProgress] = []
    best, best_weights = np.inf, start.copy()
    began = time.monotonic()
    for sweep in range(1, config.max_rounds + 1):
        order = rng.permutation(N)
        for first in range(0, N, batch):
            chosen = order[first : first + batch].tolist()
            for i, answer in zip(chosen, separator.separate(start + change, chosen), strict=True):
                change = change + _step(shares, losses, i, answer, change, start, C / N)
                mean += 2.0 / (steps + 2.0) * (change - mean)  # weighted average of the iterates
                steps += 1
        if sweep % gap_every and sweep < config.max_rounds:
            continue
        dual = float(losses.sum()) - 0.5 * float(change @ change)
        for candidate in (mean, change):
            found = average(separator.separate(start + candidate))
            objective = 0.5 * float(candidate @ candidate) + C * max(0.0, found.violation(start + candidate))
            if objective < best:
                best, best_weights = objective, start + candidate
        history.append(SvmProgress(sweep, best, dual, N, found.loss, time.monotonic() - began))
        progress(history[-1])
        if best - dual <= C * config.epsilon:
            return SvmResult(best_weights, True, tuple(history))
    return SvmResult(best_weights, False, tuple(history))


def _step(
    shares: NDArray[np.float64],
    losses: NDArray[np.float64],
    i: int,
    answer: Separation,
    change: NDArray[np.float64],
    start: NDArray[np.float64],
    scale: float,
) -> NDArray[np.float64]:
    """Move example i's share towards its answer by the exact line search (eq. 12 there); return the change of w."""
    corner = scale * answer.feature_difference
    value = scale * (answer.loss - float(start @ answer.feature_difference))
    direction = corner - shares[i]
    squared = float(direction @ direction)
    ascent = value - losses[i] - float(direction @ change)
    gamma = min(max(ascent / squared, 0.0), 1.0) if squared > 0 else float(ascent > 0)
    shares[i] += gamma * direction
    losses[i] += gamma * (value - losses[i])
    return gamma * direction
