"""Structured SVM by block-coordinate Frank-Wolfe (Lacoste-Julien, Jaggi, Schmidt and Pletscher 2013), Algorithm 4.

The same problem as `structured_svm` with a slack per example, min 1/2 ||w - w0||^2 + C/N sum_i xi_i: equal at the
optimum, as the mean of the largest slacks is the largest mean. No quadratic program: each example's oracle answer is
mixed into that example's share of the weights by a step of closed form.
"""

from __future__ import annotations

import math
import time
from collections.abc import Callable
from dataclasses import dataclass, replace
from pathlib import Path

import numpy as np
from numpy.typing import NDArray

from .oracle import Separation, Separator
from .structured_svm import SvmConfig, SvmProgress, SvmResult, average, load_state, problem_key, save_state


@dataclass(frozen=True, slots=True)
class BlockState:
    """The whole state between two passes, kept in checkpoints.

    Attributes
    ----------
    shares : (N, d) each example's part of w - w0. losses : (N,) its part of the dual.
    change : (d,) w - w0, the sum of the shares. mean : (d,) weighted average of the iterates. steps : done.
    best_weights, best_objective : of the measured points. history : a row a pass. seconds : spent.
    sweep : passes done.
    """

    shares: NDArray[np.float64]
    losses: NDArray[np.float64]
    change: NDArray[np.float64]
    mean: NDArray[np.float64]
    best_weights: NDArray[np.float64]
    best_objective: float = math.inf
    steps: int = 0
    sweep: int = 0
    seconds: float = 0.0
    history: tuple[SvmProgress, ...] = ()


def learn_frank_wolfe(
    separator: Separator,
    start: NDArray[np.float64],
    config: SvmConfig,
    seed: int,
    progress: Callable[[SvmProgress], object] = lambda _row: None,
    checkpoint: Path | None = None,
    batch: int = 1,
    gap_every: int = 5,
) -> SvmResult:
    """Learn weights by block-coordinate Frank-Wolfe; `config.max_rounds` counts passes over the examples.

    Parameters
    ----------
    separator : Separator
    start : (d,) float64, w0.
    config : SvmConfig
    seed : int
        Of the order of the examples in each pass.
    progress : callable
        Told after every pass. The dual is known each time, the objective is that of the last measurement.
    checkpoint : Path, optional
        File that is written after every pass, and read first if it is there.
    batch : int
        Examples asked at the same weights, so that processes can share them; 1 is the published algorithm.
    gap_every : int
        Passes between measurements of the duality gap, each of which costs two more passes.

    Raises
    ------
    ValueError
        When there is no example, or the checkpoint belongs to another problem.
    """
    if separator.count == 0:
        raise ValueError("there is no example to learn from")
    start = np.asarray(start, np.float64)
    N, d = separator.count, len(start)
    state = BlockState(np.zeros((N, d)), np.zeros(N), np.zeros(d), np.zeros(d), start.copy())
    problem = "" if checkpoint is None else problem_key(separator, start, config.C, seed)
    if checkpoint is not None and checkpoint.exists():
        state = read_checkpoint(checkpoint, problem)
    began = time.monotonic() - state.seconds
    while not _converged(state, config) and state.sweep < config.max_rounds:
        state, loss = _sweep(state, separator, start, config.C, np.random.default_rng((seed, state.sweep)), batch)
        if state.sweep % gap_every == 0 or state.sweep == config.max_rounds:
            state = _measure(state, separator, start, config.C)
        state = _with_row(state, loss, time.monotonic() - began)
        progress(state.history[-1])
        if checkpoint is not None:
            write_checkpoint(checkpoint, state, problem)
    if math.isinf(
        state.best_objective
    ):  # a checkpoint of more passes than are wanted now, stopped before a measurement
        state = _measure(state, separator, start, config.C)
    return SvmResult(state.best_weights, _converged(state, config), state.history)


def _converged(state: BlockState, config: SvmConfig) -> bool:
    return bool(state.history) and state.history[-1].gap <= config.C * config.epsilon


def _sweep(
    state: BlockState,
    separator: Separator,
    start: NDArray[np.float64],
    C: float,
    rng: np.random.Generator,
    batch: int,
) -> tuple[BlockState, float]:
    """One pass over the examples in random order; returns the mean loss of the answers too."""
    N, loss = separator.count, 0.0
    shares, losses, change, mean, steps = (
        state.shares.copy(), state.losses.copy(), state.change.copy(), state.mean.copy(), state.steps,
    )  # fmt: skip
    order = rng.permutation(N)
    for first in range(0, N, batch):
        chosen = order[first : first + batch].tolist()
        for i, answer in zip(chosen, separator.separate(start + change, chosen), strict=True):
            change = change + _step(shares, losses, i, answer, change, start, C / N)
            mean += 2.0 / (steps + 2.0) * (change - mean)
            loss += answer.loss / N
            steps += 1
    after = replace(state, shares=shares, losses=losses, change=change, mean=mean, steps=steps, sweep=state.sweep + 1)
    return after, loss


def _measure(state: BlockState, separator: Separator, start: NDArray[np.float64], C: float) -> BlockState:
    """Measure the objective at the last and the mean iterate, and keep the best."""
    best, weights = state.best_objective, state.best_weights
    for candidate in (state.mean, state.change):
        found = average(separator.separate(start + candidate))
        objective = 0.5 * float(candidate @ candidate) + C * max(0.0, found.violation(start + candidate))
        if objective < best:
            best, weights = objective, start + candidate
    return replace(state, best_objective=best, best_weights=weights)


def _with_row(state: BlockState, loss: float, seconds: float) -> BlockState:
    """Write the pass down; its dual is that of the shares, so it costs nothing."""
    dual = float(state.losses.sum()) - 0.5 * float(state.change @ state.change)
    row = SvmProgress(state.sweep, state.best_objective, dual, len(state.shares), loss, seconds)
    return replace(state, seconds=seconds, history=(*state.history, row))


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


def write_checkpoint(path: Path, state: BlockState, problem: str) -> None:
    """Write the state of a run on a problem (`problem_key`); the file appears whole or not at all."""
    save_state(path, problem, state.history, {name: getattr(state, name) for name in _STORED})


_ARRAYS = ("shares", "losses", "change", "mean", "best_weights")
_STORED = (*_ARRAYS, "best_objective", "steps", "sweep", "seconds")


def read_checkpoint(path: Path, problem: str) -> BlockState:
    """Read the state of an interrupted run on the same problem.

    Raises
    ------
    ValueError
        When the file is no checkpoint, or one of another problem.
    """
    history, content = load_state(path, problem, _STORED)
    return BlockState(
        **{name: content[name] for name in _ARRAYS},
        best_objective=float(content["best_objective"]),
        steps=int(content["steps"]),
        sweep=int(content["sweep"]),
        seconds=float(content["seconds"]),
        history=history,
    )
