"""The Manhattan frame of a room: three orthogonal axes from surface normals (docs/method.md, section 4).

Hypothesise, score, refine [N12]: a first axis from the modes of the cell normals, the rotation about it from the
azimuths of the others modulo 90 degrees; the triple that explains most normals wins. It is then refined on whole
planes: cells that agree with an axis are grown into connected planes whose summed moments give normals far more
precise than a cell's, and the rotation that fits these best follows in closed form.
"""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np
from numba import njit
from numpy.typing import NDArray

from .depth import NOISE_FLOOR_M, NOISE_QUADRATIC, CellPlanes, DepthGeometry, depth_sigma, fit_cell_planes, solve_plane

_KERNEL_RAD = np.deg2rad(5.0)
_MIN_NORMALS = 12
_SAME_FRAME_RAD = np.deg2rad(8.0)


@dataclass(frozen=True, slots=True)
class ManhattanFrame:
    """Room axes in the camera frame.

    Attributes
    ----------
    R_room_camera : (3, 3) float64, rows X right, Y down, Z towards the wall that faces the camera most.
    confidence : 0..1 share of the normals' weight that the axes explain.
    hypotheses : alternatives, best first, `R_room_camera` included: the other visible wall as front, other triples.
    """

    R_room_camera: NDArray[np.float64]
    confidence: float
    hypotheses: tuple[NDArray[np.float64], ...]


def estimate_manhattan_frame(
    geometry: DepthGeometry,
    prior: NDArray[np.float64] | None = None,
    gravity: NDArray[np.float64] | None = None,
) -> ManhattanFrame | None:
    """Estimate the room's axes from depth.

    Parameters
    ----------
    geometry : DepthGeometry
    prior : (3, 3) array, optional
        Axes of the previous frame; used as the only start while they explain the normals (warm start).
    gravity : (3,) array, optional
        Direction of gravity in the camera frame (TF, IMU); decides which axis is vertical.

    Returns
    -------
    ManhattanFrame or None
        None where too few cells are planar.
    """
    cells = fit_cell_planes(geometry, radius=2)
    if len(cells.sigma) < _MIN_NORMALS:
        return None
    weight = 1.0 / (cells.sigma**2 + _KERNEL_RAD**2)
    weight /= weight.sum()
    starts = _candidates(cells.normal, weight) if prior is None else [prior]
    scored = sorted(((_score(R, cells.normal, weight), i) for i, R in enumerate(starts)), reverse=True)
    if prior is not None and scored[0][0] < 0.5:
        return estimate_manhattan_frame(geometry, None, gravity)
    refined: list[tuple[float, NDArray[np.float64]]] = []
    for _, i in scored[:3]:
        R = refine_on_planes(geometry, starts[i])
        if all(angle_between_frames(R, other) > _SAME_FRAME_RAD for _, other in refined):
            refined.append((_score(R, cells.normal, weight), name_axes(R, gravity)))
    refined.sort(key=lambda item: -item[0])
    hypotheses = [turned for _, R in refined for turned in (R, other_front(R))]
    return ManhattanFrame(refined[0][1], float(refined[0][0]), tuple(hypotheses))


def name_axes(R: NDArray[np.float64], gravity: NDArray[np.float64] | None = None) -> NDArray[np.float64]:
    """Order and sign three orthogonal rows as X right, Y down, Z front (the one nearest the optical axis)."""
    down = np.array([0.0, 1.0, 0.0]) if gravity is None else gravity
    k = int(np.argmax(np.abs(R @ down)))
    y = R[k] * np.sign(R[k] @ down)
    horizontal = [R[j] for j in range(3) if j != k]
    z = max(horizontal, key=lambda v: abs(v[2]))
    z = z if z[2] >= 0 else -z
    return np.array([np.cross(y, z), y, z])


def other_front(R: NDArray[np.float64]) -> NDArray[np.float64]:
    """Return the frame with the other horizontal axis as front (towards the camera's view)."""
    x, y, _ = R
    z = x if x[2] >= 0 else -x
    return np.array([np.cross(y, z), y, z])


def angle_between_frames(a: NDArray[np.float64], b: NDArray[np.float64]) -> float:
    """Smallest rotation in radians between two frames, modulo the 24 rotations of the cube."""
    m = np.abs(a @ b.T)
    order = np.argmax(m, axis=1)
    if len(set(order.tolist())) < 3:
        return float(np.pi / 4)
    signed = (a @ b.T)[np.arange(3), order]
    c = a * np.sign(signed)[:, None]
    trace = float(np.sum(c * b[order]))
    return float(np.arccos(np.clip((trace - 1.0) / 2.0, -1.0, 1.0)))


def _candidates(normals: NDArray[np.float64], weight: NDArray[np.float64]) -> list[NDArray[np.float64]]:
    """Triples from the strongest normal modes and the azimuths around each."""
    triples = []
    for axis in _modes(normals, weight, 4):
        basis = _complete(axis)
        for angle in _azimuths(normals, weight, basis):
            c, s = np.cos(angle), np.sin(angle)
            triples.append(np.array([c * basis[0] + s * basis[1], -s * basis[0] + c * basis[1], basis[2]]))
    return triples


def _modes(normals: NDArray[np.float64], weight: NDArray[np.float64], count: int) -> list[NDArray[np.float64]]:
    """Greedy modes of axial directions: densest normal, mean of its neighbourhood, suppress, repeat."""
    seeds = normals[:: max(1, len(normals) // 200)]
    kernel = np.exp(-(1.0 - np.abs(seeds @ normals.T)) / (_KERNEL_RAD**2))
    density = kernel @ weight
    modes: list[NDArray[np.float64]] = []
    for _ in range(count):
        k = int(np.argmax(density))
        if modes and density[k] <= 0.01:
            break
        mode = seeds[k]
        for _ in range(3):
            cosine = normals @ mode
            w = weight * np.exp(-(1.0 - np.abs(cosine)) / (_KERNEL_RAD**2)) * np.sign(cosine)
            mode = w @ normals
            mode = mode / np.linalg.norm(mode)
        modes.append(mode)
        density = np.where(np.abs(seeds @ mode) > np.cos(np.deg2rad(12.0)), 0.0, density)
    return modes


def _complete(axis: NDArray[np.float64]) -> NDArray[np.float64]:
    """Rows (u, v, axis): a right-handed basis with `axis` last."""
    helper = np.eye(3)[int(np.argmin(np.abs(axis)))]
    u = np.cross(helper, axis)
    u /= np.linalg.norm(u)
    return np.array([u, np.cross(axis, u), axis])


def _azimuths(normals: NDArray[np.float64], weight: NDArray[np.float64], basis: NDArray[np.float64]) -> list[float]:
    """Peaks of the azimuth modulo 90 degrees of the normals across `basis[2]`; the view's heading if there are none."""
    local = normals @ basis.T
    across = np.abs(local[:, 2]) < np.sin(np.deg2rad(20.0))
    if weight[across].sum() < 0.02:
        heading = basis @ np.array([0.0, 0.0, 1.0])
        return [float(np.arctan2(heading[1], heading[0]))]
    azimuth = np.rad2deg(np.arctan2(local[across, 1], local[across, 0])) % 90.0
    histogram = np.bincount((azimuth / 2.0).astype(int) % 45, weight[across], 45)
    smooth = histogram + 0.7 * (np.roll(histogram, 1) + np.roll(histogram, -1))
    peaks = []
    for _ in range(2):
        k = int(np.argmax(smooth))
        if peaks and smooth[k] <= 0.02:
            break
        turned = (azimuth - (2.0 * k + 1.0) + 45.0) % 90.0 - 45.0
        near = np.abs(turned) < 5.0
        mean = float(np.average(turned[near], weights=weight[across][near])) if near.any() else 0.0
        peaks.append(float(np.deg2rad(2.0 * k + 1.0 + mean)))
        smooth[np.arange(k - 4, k + 5) % 45] = 0.0
    return peaks


def _score(R: NDArray[np.float64], normals: NDArray[np.float64], weight: NDArray[np.float64]) -> float:
    """Share of the weight whose normal lies on an axis, with a Gaussian kernel of 5 degrees."""
    cosine = np.abs(normals @ R.T).max(axis=1)
    return float(weight @ np.exp(-(1.0 - cosine) / (_KERNEL_RAD**2)))


def refine_on_planes(geometry: DepthGeometry, R: NDArray[np.float64], rounds: int = 3) -> NDArray[np.float64]:
    """Refine axes on whole planes: grow, fit in inverse depth, solve for the rotation; repeated as planes improve."""
    cells = fit_cell_planes(geometry, radius=1)
    for round_ in range(rounds):
        tolerance = np.deg2rad(15.0 if round_ == 0 else 8.0)
        plane, n_planes = _grow(
            geometry.moments.shape[0], geometry.moments.shape[1], cells.cell, cells.normal, cells.centroid, cells.sigma, R, tolerance
        )
        normals, axes, weights = _plane_normals(geometry, cells, plane, n_planes, R)
        if len(axes) == 0:
            return R
        R = _rotation_to(normals, axes, weights, R)
    return R


def _plane_normals(
    geometry: DepthGeometry, cells: CellPlanes, plane: NDArray[np.int32], n_planes: int, R: NDArray[np.float64]
) -> tuple[NDArray[np.float64], NDArray[np.intp], NDArray[np.float64]]:
    """Normals, axes and weights of the grown planes of at least 30 cells."""
    normals, axes, weights = [], [], []
    moments = geometry.moments[cells.cell[:, 0], cells.cell[:, 1]]
    for p in range(n_planes):
        members = plane == p
        if members.sum() < 30:
            continue
        s = moments[members].sum(axis=0)
        try:
            m, covariance = solve_plane(s)
        except np.linalg.LinAlgError:
            continue
        normal = m / np.linalg.norm(m)
        sigma_w = float(np.mean([depth_sigma(z, NOISE_FLOOR_M, NOISE_QUADRATIC) / z**2 for z in cells.centroid[members, 2]]))
        # Neighbouring errors go together: a cell (100 px) is taken as one measurement, and never trusted below 0.3 deg.
        spread = sigma_w * np.sqrt(100.0 * np.trace(covariance[:2, :2])) / np.linalg.norm(m)
        cosine = R @ normal
        k = int(np.argmax(np.abs(cosine)))
        normals.append(normal * np.sign(cosine[k]))
        axes.append(k)
        weights.append(np.sqrt(members.sum()) / (spread**2 + np.deg2rad(0.3) ** 2))
    return np.array(normals).reshape(-1, 3), np.array(axes, dtype=np.intp), np.array(weights)


def _rotation_to(
    normals: NDArray[np.float64], axes: NDArray[np.intp], weights: NDArray[np.float64], R: NDArray[np.float64]
) -> NDArray[np.float64]:
    """Robust small rotation that turns the rows of R onto the normals of their axes (Gauss-Newton, Cauchy weights)."""
    for _ in range(10):
        targets = R[axes]
        residual = np.cross(targets, normals)  # rotation vector that takes target to normal
        angle = np.linalg.norm(residual, axis=1)
        w = weights / (1.0 + (angle / np.deg2rad(1.5)) ** 2)
        # A normal says nothing about the rotation around itself: weight (I - a a^T), a weak prior keeps it solvable.
        A = np.einsum("i,ijk->jk", w, np.eye(3) - np.einsum("ij,ik->ijk", targets, targets)) + 1e-3 * weights.sum() * np.eye(3)
        step = np.linalg.solve(A, w @ residual)
        R = R @ _rotation(step).T
        if np.linalg.norm(step) < 1e-6:
            break
    u, _, vt = np.linalg.svd(R)
    return np.asarray(u @ vt)


def _rotation(vector: NDArray[np.float64]) -> NDArray[np.float64]:
    """Rodrigues: rotation matrix of a rotation vector."""
    angle = float(np.linalg.norm(vector))
    if angle < 1e-12:
        return np.eye(3)
    x, y, z = vector / angle
    K = np.array([[0, -z, y], [z, 0, -x], [-y, x, 0]])
    return np.asarray(np.eye(3) + np.sin(angle) * K + (1 - np.cos(angle)) * K @ K)


@njit(cache=True, nogil=True)
def _grow(rows, cols, cell, normal, centroid, sigma, R, tolerance):  # type: ignore[no-untyped-def]
    """Connected cells on one plane along an axis: (plane index per cell or -1, number of planes)."""
    n = len(cell)
    at = -np.ones((rows, cols), np.int32)
    axis = -np.ones(n, np.int8)
    for i in range(n):
        at[cell[i, 0], cell[i, 1]] = i
        best = 0.0
        for k in range(3):
            c = abs(R[k, 0] * normal[i, 0] + R[k, 1] * normal[i, 1] + R[k, 2] * normal[i, 2])
            if c > best:
                best = c
                if c > np.cos(min(tolerance + 1.5 * sigma[i], 0.6)):
                    axis[i] = k
    plane = -np.ones(n, np.int32)
    stack = np.empty(n, np.int32)
    count = 0
    for seed in range(n):
        if axis[seed] < 0 or plane[seed] >= 0:
            continue
        plane[seed] = count
        stack[0] = seed
        top = 1
        k = axis[seed]
        while top > 0:
            top -= 1
            i = stack[top]
            for move in range(4):
                r = cell[i, 0] + (1 if move == 0 else -1 if move == 1 else 0)
                c = cell[i, 1] + (1 if move == 2 else -1 if move == 3 else 0)
                if r < 0 or r >= rows or c < 0 or c >= cols:
                    continue
                j = at[r, c]
                if j < 0 or plane[j] >= 0 or axis[j] != k:
                    continue
                dx = centroid[j, 0] - centroid[i, 0]
                dy = centroid[j, 1] - centroid[i, 1]
                dz = centroid[j, 2] - centroid[i, 2]
                off = abs(R[k, 0] * dx + R[k, 1] * dy + R[k, 2] * dz)
                length = np.sqrt(dx * dx + dy * dy + dz * dz)
                z = centroid[i, 2]
                if off < length * tolerance + 2.0 * (0.01 + 0.0019 * z * z):
                    plane[j] = count
                    stack[top] = j
                    top += 1
        count += 1
    return plane, count


