"""Linear support vector machines, one against the rest, all at once.

The problem is that of scikit-learn's `LinearSVC` (squared hinge, primal), with which the tests compare it. That solves
one class after the other in double precision; here one pass over single-precision rows serves all classes.
"""

from __future__ import annotations

import numpy as np
from numpy.typing import NDArray

Floats = NDArray[np.float32]


def fit_one_vs_rest(
    rows: Floats,
    classes: NDArray[np.intp],
    count: int,
    weight: NDArray[np.floating],
    C: float,
    passes: int = 150,
) -> tuple[Floats, Floats]:
    """Minimise |w|^2 / 2 + C sum_i weight_i max(0, 1 - y_i (w x_i + b))^2 for each class.

    Parameters
    ----------
    rows : (n, D) float32. classes : (n,) 0..count-1; y is 1 for the rows of the class and -1 for the others.
    weight : (n,) of the rows. C : weight of the loss; the intercept b is not in the norm.
    passes : over the rows, at most.

    Returns
    -------
    weights : (count, D) float32
    intercepts : (count,) float32
        A class without a row has weights 0 and an intercept of -1 or less.
    """
    from scipy.optimize import minimize

    sign = np.where(classes[:, None] == np.arange(count), 1.0, -1.0).astype(np.float32)
    loss_weight = (C * np.asarray(weight, np.float64)).astype(np.float32)[:, None]

    def value(x: NDArray[np.float64]) -> tuple[float, NDArray[np.float64]]:
        w = x.reshape(count, -1)
        margin = sign * (rows @ w[:, :-1].T.astype(np.float32) + w[:, -1].astype(np.float32))
        short = np.maximum(1.0 - margin, 0.0)
        slope = -2.0 * loss_weight * short * sign
        # rows.T @ slope, not slope.T @ rows: for OpenBLAS the second is 30 times as slow
        gradient = np.column_stack([(rows.T @ slope).T, slope.sum(axis=0)]).astype(np.float64)
        gradient[:, :-1] += w[:, :-1]
        loss = (loss_weight * short * short).sum(dtype=np.float64)
        return 0.5 * float((w[:, :-1] ** 2).sum()) + float(loss), gradient.ravel()

    start = np.zeros(count * (rows.shape[1] + 1))
    options = {"maxiter": passes, "maxcor": 20, "ftol": 1e-7, "gtol": 1e-8}
    found = minimize(value, start, jac=True, method="L-BFGS-B", options=options).x.reshape(count, -1)
    return found[:, :-1].astype(np.float32), found[:, -1].astype(np.float32)
