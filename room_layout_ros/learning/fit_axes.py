"""Room axes of a labelled frame: the vertical from floor and ceiling, the yaw from walls, both with image lines."""

from __future__ import annotations

import numpy as np
from numpy.typing import NDArray

from .fit_observation import FitClass, FitObservation

_DOWN = np.array([0.0, 1.0, 0.0])
_MAX_TILT = np.deg2rad(50.0)


def axis_hypotheses(seen: FitObservation, count: int = 4) -> list[NDArray[np.float64]]:
    """Return up to `count` rotations R_room_camera, best supported first.

    Z is the horizontal axis nearest to the optical axis, so at most left, front and right walls are in view.
    """
    ranked: list[tuple[float, NDArray[np.float64]]] = []
    for down in _verticals(seen):
        for yaw in _yaws(seen, down):
            R = refine_axes(seen, _rotation(down, yaw))
            if all(_angle(R, other) > np.deg2rad(4.0) for _, other in ranked):
                ranked.append((support(seen, R), R))
    ranked.sort(key=lambda entry: -entry[0])
    return [R for _, R in ranked[:count]]


def support(seen: FitObservation, R: NDArray[np.float64], sigma: float = 0.06) -> float:
    """Share of surface cells and of line length that agree with the axes; 0..2."""
    cells, weights, allowed = _cell_terms(seen)
    near = np.where(allowed, np.exp(-0.5 * (_sine(cells @ R.T) / sigma) ** 2), 0.0).max(axis=1, initial=0.0)
    total = float(weights @ near) / max(float(weights.sum()), 1e-9)
    lines = np.exp(-0.5 * (np.abs(seen.line_normal @ R.T) / 0.02) ** 2).max(axis=1, initial=0.0)
    return total + 0.3 * float(seen.line_length @ lines) / max(float(seen.line_length.sum()), 1e-9)


def refine_axes(seen: FitObservation, R: NDArray[np.float64], iterations: int = 6) -> NDArray[np.float64]:
    """Turn the axes to the weighted least squares of cell normals and lines, both robust (Gauss-Newton on SO(3))."""
    R = np.asarray(R, np.float64)
    cells, weights, allowed = _cell_terms(seen)
    for step in range(iterations):
        sigma_cell, sigma_line = (0.15, 0.04) if step < 2 else (0.06, 0.012)
        cosine = np.where(allowed, np.abs(cells @ R.T), -1.0)
        A, b = 1e-3 * np.eye(3), np.zeros(3)
        for k in range(3):
            mine = cosine.argmax(axis=1) == k
            normal = cells[mine] * np.sign(cells[mine] @ R[k])[:, None]
            error = np.cross(R[k], normal)  # rotation that takes axis k onto the normal
            robust = weights[mine] * np.exp(-0.5 * (error**2).sum(1) / sigma_cell**2) / sigma_cell**2
            A += robust.sum() * (np.eye(3) - np.outer(R[k], R[k]))
            b += robust @ error
        distance = seen.line_normal @ R.T
        nearest = np.abs(distance).argmin(axis=1) if len(distance) else np.zeros(0, int)
        for k in range(3):
            mine = nearest == k
            residual = distance[mine, k]
            robust = 0.002 * seen.line_length[mine] * np.exp(-0.5 * (residual / sigma_line) ** 2) / sigma_line**2
            J = np.cross(R[k], seen.line_normal[mine])  # d(m . a)/d omega, a -> a + omega x a
            A += (J * robust[:, None]).T @ J
            b -= J.T @ (robust * residual)
        R = np.asarray(R @ rotation_from_vector(np.asarray(np.linalg.solve(A, b), np.float64)).T, np.float64)
    return _nearest_rotation(R)


def _cell_terms(seen: FitObservation) -> tuple[NDArray[np.float64], NDArray[np.float64], NDArray[np.bool_]]:
    """Normals, weights and which of X, Y, Z each may follow: walls X or Z, floor and ceiling Y, clutter any."""
    kind = seen.cell_kind
    allowed = np.ones((len(kind), 3), bool)
    allowed[kind == FitClass.WALL, 1] = False
    flat = (kind == FitClass.FLOOR) | (kind == FitClass.CEILING)
    allowed[np.ix_(flat, [0, 2])] = False
    weights = seen.cell_weight * np.where(kind == FitClass.CLUTTER, 0.2, 1.0)
    return seen.cell_normal, weights, allowed


def _verticals(seen: FitObservation) -> list[NDArray[np.float64]]:
    """Candidates for the room's down direction."""
    kind, normal = seen.cell_kind, seen.cell_normal
    down = np.where(normal[:, 1:2] < 0, -normal, normal)
    near = np.arccos(np.clip(down[:, 1], -1, 1)) < _MAX_TILT
    found = []
    flat = near & ((kind == FitClass.FLOOR) | (kind == FitClass.CEILING))
    if flat.sum() >= 15:
        found.append(_mode(down[flat], seen.cell_weight[flat]))
    if not found or flat.sum() < 60:
        level = near & (kind == FitClass.CLUTTER)
        if level.sum() >= 15:
            found.append(_mode(down[level], seen.cell_weight[level]))
        found.append(_from_upright(seen, found[0] if found else _DOWN))
        found.append(_DOWN)
    distinct: list[NDArray[np.float64]] = []
    for v in found:
        if all(v @ u < np.cos(np.deg2rad(3.0)) for u in distinct):
            distinct.append(v)
    return distinct


def _mode(directions: NDArray[np.float64], weight: NDArray[np.float64], sigma: float = 0.05) -> NDArray[np.float64]:
    """Strongest mode of unit vectors by mean shift from the best of up to 64 of them."""
    starts = directions[:: max(1, len(directions) // 64)]
    density = np.exp((starts @ directions.T - 1.0) / sigma**2) @ weight
    v = starts[int(density.argmax())]
    for _ in range(8):
        pull = weight * np.exp((directions @ v - 1.0) / sigma**2)
        v = pull @ directions
        v /= np.linalg.norm(v)
    return np.asarray(v)


def _from_upright(seen: FitObservation, start: NDArray[np.float64]) -> NDArray[np.float64]:
    """Vertical as the direction normal to wall normals and met by upright image lines."""
    v = start
    walls = seen.cell_kind == FitClass.WALL
    for sigma in (0.3, 0.2, 0.1, 0.1):
        rows = [(seen.cell_normal[walls], seen.cell_weight[walls]), (seen.line_normal, 0.02 * seen.line_length)]
        A = -0.5 * np.outer(start, start)
        for vectors, weight in rows:
            robust = weight * np.exp(-0.5 * ((vectors @ v) / sigma) ** 2)
            A = A + (vectors * robust[:, None]).T @ vectors
        v = np.linalg.eigh(A)[1][:, 0]
        v = v * np.sign(v @ start)
    return v if v @ _DOWN > np.cos(_MAX_TILT) else start


def _yaws(seen: FitObservation, down: NDArray[np.float64]) -> list[float]:
    """Peaks of the horizontal directions modulo 90 degrees, from wall normals, clutter normals and level lines."""
    across, ahead = _level_basis(down)
    normal = seen.cell_normal
    level = np.abs(normal @ down) < 0.35
    trust = np.select([seen.cell_kind == FitClass.WALL, seen.cell_kind == FitClass.CLUTTER], [1.0, 0.25], 0.0)
    strength = seen.cell_weight * trust * level
    direction = np.cross(seen.line_normal, down)  # a line in a level plane has this direction
    length = np.linalg.norm(direction, axis=1)
    both = np.concatenate([normal, direction])
    angle = np.arctan2(both @ across, both @ ahead)
    upright = np.abs(seen.line_normal @ down) < 0.05
    weight = np.concatenate([strength, np.where(upright | (length < 0.2), 0.0, 0.01 * seen.line_length)])
    bins = 180
    index = np.floor((angle % (np.pi / 2)) / (np.pi / 2) * bins).astype(int) % bins
    histogram = np.bincount(index, weight, bins)
    offsets = np.minimum(np.arange(bins), bins - np.arange(bins))
    smooth = np.real(np.fft.ifft(np.fft.fft(histogram) * np.fft.fft(np.exp(-0.5 * (offsets / 4.0) ** 2))))
    peaks = [i for i in range(bins) if smooth[i] >= smooth[i - 1] and smooth[i] > smooth[(i + 1) % bins]]
    peaks.sort(key=lambda i: -smooth[i])
    return [(i + 0.5) / bins * np.pi / 2 for i in peaks[:3]] or [0.0]


def _level_basis(down: NDArray[np.float64]) -> tuple[NDArray[np.float64], NDArray[np.float64]]:
    ahead = np.array([0.0, 0.0, 1.0]) - down[2] * down
    ahead = ahead / np.linalg.norm(ahead)
    return np.cross(down, ahead), ahead


def _rotation(down: NDArray[np.float64], yaw: float) -> NDArray[np.float64]:
    """Rows X, Y, Z with Y = down and Z at the yaw (modulo 90 degrees) nearest to the optical axis."""
    yaw = (yaw + np.pi / 4) % (np.pi / 2) - np.pi / 4
    across, ahead = _level_basis(down)
    z = np.cos(yaw) * ahead + np.sin(yaw) * across
    return np.stack([np.cross(down, z), down, z])


def _sine(cosine: NDArray[np.float64]) -> NDArray[np.float64]:
    return np.sqrt(np.maximum(1.0 - cosine**2, 0.0))


def _angle(R: NDArray[np.float64], other: NDArray[np.float64]) -> float:
    return float(np.arccos(np.clip((np.trace(R @ other.T) - 1.0) / 2.0, -1.0, 1.0)))


def rotation_from_vector(omega: NDArray[np.float64]) -> NDArray[np.float64]:
    """Rotation matrix of a rotation vector (Rodrigues)."""
    angle = float(np.linalg.norm(omega))
    x, y, z = omega
    S = np.array([[0.0, -z, y], [z, 0.0, -x], [-y, x, 0.0]])
    if angle < 1e-9:
        return np.eye(3) + S
    return np.eye(3) + np.sin(angle) / angle * S + (1 - np.cos(angle)) / angle**2 * (S @ S)


def _nearest_rotation(R: NDArray[np.float64]) -> NDArray[np.float64]:
    U, _, Vt = np.linalg.svd(R)
    return np.asarray(U @ np.diag([1.0, 1.0, np.linalg.det(U @ Vt)]) @ Vt)
