"""Structured SVM with margin rescaling: the one-slack cutting plane of Joachims, Finley and Yu (2009), Algorithm 3.

min over w, xi >= 0 of  1/2 ||w - w0||^2 + C xi
subject to, for every choice of outputs y_hat_i,
    1/N sum_i w . (phi(x_i, y_hat_i) - phi(x_i, y_i)) >= 1/N sum_i loss_i - xi

Energies are minimised (E = w . phi), so the sign of the features is the opposite of the paper's scores. w0 is 0 in the
paper; other values keep weights that no example speaks about where they were. The quadratic program is solved in its
dual, by Clarabel:  max over alpha >= 0, sum alpha <= C of  alpha . b - 1/2 alpha . G alpha, w = w0 + sum_j alpha_j g_j.
"""

from __future__ import annotations

import io
import math
import os
import time
import zipfile
from collections.abc import Callable
from dataclasses import astuple, dataclass, field, fields
from pathlib import Path
from typing import Any

import numpy as np
from numpy.typing import NDArray

from .fingerprint import fingerprint
from .oracle import Separation, Separator

_KEEP_UNUSED = 50
"""A constraint that the solution has not used for this many rounds is forgotten (it comes back if it is needed)."""


@dataclass(frozen=True, slots=True)
class SvmConfig:
    """Settings of the learning.

    Parameters
    ----------
    C : weight of the mean slack.
    epsilon : the end: no constraint is violated by more than this above the slack (losses are of the order of 1).
    max_rounds : upper bound of the rounds.

    Raises
    ------
    ValueError
        When a value is not above 0.
    """

    C: float = 1000.0
    epsilon: float = 1e-3
    max_rounds: int = 500

    def __post_init__(self) -> None:
        if not (self.C > 0 and self.epsilon > 0 and self.max_rounds > 0):
            values = f"{self.C}, {self.epsilon}, {self.max_rounds}"
            raise ValueError(f"C, epsilon, max_rounds are {values}; all must be above 0")


@dataclass(frozen=True, slots=True)
class SvmProgress:
    """State of the learning after a round.

    Attributes
    ----------
    round : from 1. objective : primal value of the best weights so far, inf where none was measured yet.
    dual : lower bound of the objective.
    constraints : held. loss : mean loss of the most violated outputs. seconds : since the start.
    """

    round: int
    objective: float
    dual: float
    constraints: int
    loss: float
    seconds: float

    @property
    def gap(self) -> float:
        """Objective above the bound."""
        return self.objective - self.dual


@dataclass(frozen=True, slots=True)
class SvmResult:
    """The learned weights and how they came about.

    Attributes
    ----------
    weights : (d,) of the least primal objective seen. converged : whether epsilon was reached. history : a row a round.
    """

    weights: NDArray[np.float64]
    converged: bool
    history: tuple[SvmProgress, ...]


@dataclass(frozen=True, slots=True)
class CuttingPlanes:
    """The working set: one averaged constraint a row. The whole state of the learning, kept in checkpoints.

    Attributes
    ----------
    differences : (m, d) mean feature differences g. losses : (m,) mean losses b (for w, not w - w0).
    unused : (m,) rounds since the constraint last carried weight.
    best_weights, best_objective : of the best round. round : last done. seconds : spent.
    """

    differences: NDArray[np.float64]
    losses: NDArray[np.float64]
    unused: NDArray[np.int64]
    best_weights: NDArray[np.float64]
    best_objective: float = math.inf
    round: int = 0
    seconds: float = 0.0
    history: tuple[SvmProgress, ...] = field(default=())

    @classmethod
    def empty(cls, start: NDArray[np.float64]) -> CuttingPlanes:
        """Return the state before the first round."""
        return cls(np.zeros((0, len(start))), np.zeros(0), np.zeros(0, np.int64), start.copy())


def learn_one_slack(
    separator: Separator,
    start: NDArray[np.float64],
    config: SvmConfig,
    progress: Callable[[SvmProgress], object] = lambda _row: None,
    checkpoint: Path | None = None,
) -> SvmResult:
    """Learn weights by one-slack cutting planes.

    Parameters
    ----------
    separator : Separator
        Loss-augmented inference over the examples.
    start : (d,) float64
        w0: the centre of the regulariser and the first weights.
    config : SvmConfig
    progress : callable
        Told after every round.
    checkpoint : Path, optional
        File that is written after every round, and read first if it is there.

    Raises
    ------
    ValueError
        When there is no example, or the checkpoint belongs to another problem.
    RuntimeError
        When the quadratic program cannot be solved.
    """
    if separator.count == 0:
        raise ValueError("there is no example to learn from")
    start = np.asarray(start, np.float64)
    planes = CuttingPlanes.empty(start)
    problem = "" if checkpoint is None else problem_key(separator, start, config.C)
    if checkpoint is not None and checkpoint.exists():
        planes = read_checkpoint(checkpoint, problem)
    began = time.monotonic() - planes.seconds
    while True:
        alpha, dual = solve_dual(planes.differences, planes.losses - planes.differences @ start, config.C)
        if planes.history and planes.best_objective - dual <= config.C * config.epsilon:
            return SvmResult(planes.best_weights, True, planes.history)
        if planes.round >= config.max_rounds:
            return SvmResult(planes.best_weights, False, planes.history)
        weights = start + alpha @ planes.differences
        found = average(separator.separate(weights))
        slack = max(0.0, found.violation(weights))
        objective = 0.5 * float((weights - start) @ (weights - start)) + config.C * slack
        planes = _with_round(planes, weights, objective, alpha, found, dual, time.monotonic() - began)
        progress(planes.history[-1])
        if checkpoint is not None:
            write_checkpoint(checkpoint, planes, problem)


def problem_key(separator: Separator, start: NDArray[np.float64], C: float, seed: int | None = None) -> str:
    """Return the fingerprint of a problem: examples, oracle, centre of the regulariser, C and order of the examples."""
    return fingerprint(separator.fingerprint, start, C, seed)


def average(separations: list[Separation]) -> Separation:
    """Return the one-slack constraint: the means over the examples."""
    difference = np.mean([s.feature_difference for s in separations], axis=0)
    return Separation(difference, float(np.mean([s.loss for s in separations])))


def _with_round(
    planes: CuttingPlanes,
    weights: NDArray[np.float64],
    objective: float,
    alpha: NDArray[np.float64],
    found: Separation,
    dual: float,
    seconds: float,
) -> CuttingPlanes:
    unused = np.where(alpha > 1e-9 * max(alpha.sum(), 1e-300), 0, planes.unused + 1)
    keep = unused <= _KEEP_UNUSED
    better = objective < planes.best_objective
    best = objective if better else planes.best_objective
    row = SvmProgress(planes.round + 1, best, dual, int(keep.sum()) + 1, found.loss, seconds)
    return CuttingPlanes(
        differences=np.vstack([planes.differences[keep], found.feature_difference]),
        losses=np.append(planes.losses[keep], found.loss),
        unused=np.append(unused[keep], 0),
        best_weights=weights if better else planes.best_weights,
        best_objective=best,
        round=planes.round + 1,
        seconds=seconds,
        history=(*planes.history, row),
    )


def solve_dual(
    differences: NDArray[np.float64], margins: NDArray[np.float64], C: float
) -> tuple[NDArray[np.float64], float]:
    """Solve max over alpha >= 0, sum alpha <= C of alpha . margins - 1/2 ||sum alpha_j g_j||^2.

    Parameters
    ----------
    differences : (m, d) rows g_j. margins : (m,). C : float.

    Returns
    -------
    alpha : (m,), feasible. value : the dual objective at alpha (so a bound whatever the solver's accuracy).

    Raises
    ------
    RuntimeError
        When the solver fails.
    """
    m = len(margins)
    if m == 0:
        return np.zeros(0), 0.0
    import clarabel
    from scipy import sparse

    # In units of C the multipliers are shares and the solver's tolerances mean the same for every C.
    gram = C * (differences @ differences.T)
    scale = max(float(np.abs(margins).max()), float(np.abs(gram).max()), 1e-12)
    settings = clarabel.DefaultSettings()
    settings.verbose = False
    settings.max_threads = 1
    settings.tol_gap_abs = settings.tol_gap_rel = settings.tol_feas = 1e-10
    solution = clarabel.DefaultSolver(
        sparse.triu(sparse.csc_matrix(gram / scale), format="csc"),
        -margins / scale,
        sparse.csc_matrix(np.vstack([-np.eye(m), np.ones((1, m))])),
        np.append(np.zeros(m), 1.0),
        [clarabel.NonnegativeConeT(m + 1)],
        settings,
    ).solve()
    if str(solution.status) not in ("Solved", "AlmostSolved", "InsufficientProgress"):
        raise RuntimeError(f"the quadratic program with {m} constraints ended as {solution.status}")
    share = np.maximum(np.asarray(solution.x, np.float64), 0.0)
    share /= max(share.sum(), 1.0)
    value = C * (float(share @ margins) - 0.5 * float(share @ gram @ share))
    return C * share, value


def write_checkpoint(path: Path, planes: CuttingPlanes, problem: str) -> None:
    """Write the state of a run on a problem (`problem_key`); the file appears whole or not at all."""
    arrays = {name: getattr(planes, name) for name in _STORED}
    save_state(path, problem, planes.history, arrays)


_STORED = ("differences", "losses", "unused", "best_weights", "best_objective")


def read_checkpoint(path: Path, problem: str) -> CuttingPlanes:
    """Read the state of an interrupted run on the same problem.

    Raises
    ------
    ValueError
        When the file is no checkpoint, or one of another problem.
    """
    history, arrays = load_state(path, problem, _STORED)
    objective = float(arrays.pop("best_objective"))
    seconds = history[-1].seconds if history else 0.0
    return CuttingPlanes(**arrays, best_objective=objective, round=len(history), seconds=seconds, history=history)


def save_state(path: Path, problem: str, history: tuple[SvmProgress, ...], arrays: dict[str, Any]) -> None:
    """Write a checkpoint of either algorithm; the file appears whole or not at all."""
    rows = np.array([astuple(row) for row in history], np.float64).reshape(-1, len(fields(SvmProgress)))
    partial = path.with_name(f".{path.name}.{os.getpid()}.npz")
    np.savez(partial, problem=problem, history=rows, **arrays)
    partial.replace(path)


def load_state(
    path: Path, problem: str, names: tuple[str, ...]
) -> tuple[tuple[SvmProgress, ...], dict[str, NDArray[Any]]]:
    """Return the history and the arrays with these names of a checkpoint.

    Raises
    ------
    ValueError
        When the file is no checkpoint, or one of another problem.
    """
    try:
        with np.load(io.BytesIO(path.read_bytes()), allow_pickle=False) as file:
            same = str(file["problem"]) == problem
            arrays = {name: file[name] for name in names}
            history = tuple(SvmProgress(int(r[0]), r[1], r[2], int(r[3]), r[4], r[5]) for r in file["history"].tolist())
    except (OSError, KeyError, ValueError, IndexError, EOFError, zipfile.BadZipFile) as error:
        raise ValueError(f"{path} is no checkpoint of the learning: {error}") from None
    if not same:
        raise ValueError(f"{path} is the checkpoint of a run with other examples or settings; remove it")
    return history, arrays
