"""Structured SVM by block-coordinate Frank-Wolfe (Lacoste-Julien, Jaggi, Schmidt and Pletscher 2013), Algorithm 4.

The same problem as `structured_svm` with a slack per example, min 1/2 ||w - w0||^2 + C/N sum_i xi_i: equal at the
optimum, as the mean of the largest slacks is the largest mean. No quadratic program: each example's oracle answer is
mixed into that example's share of the weights by a step of closed form.
"""

from __future__ import annotations

import io
import math
import os
import time
import zipfile
from collections.abc import Callable
from dataclasses import dataclass, replace
from pathlib import Path

import numpy as np
from numpy.typing import NDArray

from .oracle import Separation, Separator
from .structured_svm import SvmConfig, SvmProgress, SvmResult, average


@dataclass(frozen=True, slots=True)
class BlockState:
    """The whole state between two passes, kept in checkpoints.

    Attributes
    ----------
    shares : (N, d) each example's part of w - w0. losses : (N,) its part of the dual.
    change : (d,) w - w0, the sum of the shares. mean : (d,) weighted average of the iterates. steps : done.
    best_weights, best_objective : of the measured points. history : a row per measurement. seconds : spent.
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
        Told after every pass in which the gap was measured.
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
    if checkpoint is not None and checkpoint.exists():
        state = read_checkpoint(checkpoint, start, N, config.C, seed)
    began = time.monotonic() - state.seconds
    while not _converged(state, config) and state.sweep < config.max_rounds:
        state = _sweep(state, separator, start, config.C, np.random.default_rng((seed, state.sweep)), batch)
        if state.sweep % gap_every == 0 or state.sweep == config.max_rounds:
            state = _measure(state, separator, start, config.C, began)
            progress(state.history[-1])
        state = replace(state, seconds=time.monotonic() - began)
        if checkpoint is not None:
            write_checkpoint(checkpoint, state, start, config.C, seed)
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
) -> BlockState:
    """One pass over the examples in random order."""
    N = separator.count
    shares, losses, change, mean, steps = (
        state.shares.copy(), state.losses.copy(), state.change.copy(), state.mean.copy(), state.steps,
    )  # fmt: skip
    order = rng.permutation(N)
    for first in range(0, N, batch):
        chosen = order[first : first + batch].tolist()
        for i, answer in zip(chosen, separator.separate(start + change, chosen), strict=True):
            change = change + _step(shares, losses, i, answer, change, start, C / N)
            mean += 2.0 / (steps + 2.0) * (change - mean)
            steps += 1
    return replace(state, shares=shares, losses=losses, change=change, mean=mean, steps=steps, sweep=state.sweep + 1)


def _measure(state: BlockState, separator: Separator, start: NDArray[np.float64], C: float, began: float) -> BlockState:
    """Measure the objective at the last and the mean iterate, and keep the best."""
    dual = float(state.losses.sum()) - 0.5 * float(state.change @ state.change)
    best, weights, loss = state.best_objective, state.best_weights, 0.0
    for candidate in (state.mean, state.change):
        found = average(separator.separate(start + candidate))
        objective = 0.5 * float(candidate @ candidate) + C * max(0.0, found.violation(start + candidate))
        loss = found.loss
        if objective < best:
            best, weights = objective, start + candidate
    row = SvmProgress(state.sweep, best, dual, separator.count, loss, time.monotonic() - began)
    return replace(state, best_objective=best, best_weights=weights, history=(*state.history, row))


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


def write_checkpoint(path: Path, state: BlockState, start: NDArray[np.float64], C: float, seed: int) -> None:
    """Write the state; the file appears whole or not at all."""
    history = [(r.round, r.objective, r.dual, r.constraints, r.loss, r.seconds) for r in state.history]
    arrays = {name: getattr(state, name) for name in BlockState.__slots__ if name != "history"}
    partial = path.with_name(f".{path.name}.{os.getpid()}.npz")
    rows = np.array(history, np.float64).reshape(-1, 6)
    np.savez(partial, history=rows, start=start, problem=np.array([C, float(seed)]), **arrays)
    partial.replace(path)


def read_checkpoint(path: Path, start: NDArray[np.float64], count: int, C: float, seed: int) -> BlockState:
    """Read the state of an interrupted run.

    Raises
    ------
    ValueError
        When the file is no checkpoint, or one of another C, seed, number of examples or other start weights.
    """
    try:
        with np.load(io.BytesIO(path.read_bytes()), allow_pickle=False) as file:
            content = {name: file[name] for name in file.files}
        rows = content.pop("history").tolist()
        same = np.array_equal(content.pop("start"), start) and content.pop("problem").tolist() == [C, float(seed)]
        arrays = {name: content[name] for name in ("shares", "losses", "change", "mean", "best_weights")}
        state = BlockState(
            **arrays,
            best_objective=float(content["best_objective"]),
            steps=int(content["steps"]),
            sweep=int(content["sweep"]),
            seconds=float(content["seconds"]),
            history=tuple(SvmProgress(int(r[0]), r[1], r[2], int(r[3]), r[4], r[5]) for r in rows),
        )
    except (OSError, KeyError, ValueError, EOFError, zipfile.BadZipFile) as error:
        raise ValueError(f"{path} is no checkpoint of the learning: {error}") from None
    if not same or len(state.shares) != count:
        raise ValueError(f"{path} is the checkpoint of a run with other settings or examples; remove it")
    return state
