"""Slow twins of the kernels that fit a room to depth: each written from its definition, one pixel or cell at a time."""

from __future__ import annotations

from collections import deque

import numpy as np
from numpy.typing import NDArray

from room_layout_ros.core.depth import NOISE_FLOOR_M, NOISE_QUADRATIC
from room_layout_ros.core.frame import CameraIntrinsics
from room_layout_ros.core.layout import FACE_AXIS, FACE_SIGN

F64 = NDArray[np.float64]


def sigma_of(z: float) -> float:
    return NOISE_FLOOR_M + NOISE_QUADRATIC * z * z


def ray_of(camera: CameraIntrinsics, x: float, y: float) -> F64:
    return np.array([(x - camera.cx) / camera.fx, (y - camera.cy) / camera.fy, 1.0])


def cast(R: F64, distances: F64, camera: CameraIntrinsics) -> tuple[NDArray[np.uint8], F64]:
    """Walk each pixel's ray to all five planes: the nearest plane in front of the camera is what is seen."""
    faces = np.zeros((camera.height, camera.width), np.uint8)
    depth = np.full((camera.height, camera.width), np.inf)
    for y in range(camera.height):
        for x in range(camera.width):
            ray = R @ ray_of(camera, x, y)
            for k in range(5):
                speed = FACE_SIGN[k] * ray[FACE_AXIS[k]]
                if speed > 0 and np.isfinite(distances[k]) and distances[k] / speed < depth[y, x]:
                    depth[y, x], faces[y, x] = distances[k] / speed, k + 1
    return faces, depth


def cell_moments(inverse: NDArray[np.float32], size: int, camera: CameraIntrinsics) -> F64:
    rows, cols = inverse.shape[0] // size, inverse.shape[1] // size
    moments = np.zeros((rows, cols, 10))
    for y in range(rows * size):
        for x in range(cols * size):
            w = float(inverse[y, x])
            if w > 0:
                rx, ry, _ = ray_of(camera, x, y)
                moments[y // size, x // size] += [1, rx, ry, w, rx * rx, rx * ry, ry * ry, rx * w, ry * w, w * w]
    return moments


def fit_windows(inverse: NDArray[np.float32], size: int, radius: int, limit: float, camera: CameraIntrinsics) -> list[
    tuple[int, int, F64, float, F64]
]:  # fmt: skip
    """(row, column, normal, distance, centroid) per window: numpy's least squares over its pixels, no sums kept."""
    rows, cols = inverse.shape[0] // size, inverse.shape[1] // size
    found = []
    for row in range(radius, rows - radius):
        for col in range(radius, cols - radius):
            ys = range((row - radius) * size, (row + radius + 1) * size)
            xs = range((col - radius) * size, (col + radius + 1) * size)
            samples = [(ray_of(camera, x, y), float(inverse[y, x])) for y in ys for x in xs if inverse[y, x] > 0]
            if len(samples) < 0.5 * len(ys) * len(xs):
                continue
            rays, w = np.array([r for r, _ in samples]), np.array([v for _, v in samples])
            m = np.linalg.lstsq(rays, w, rcond=None)[0]
            mean = float(w.mean())
            if np.sqrt(((rays @ m - w) ** 2).mean()) > limit * sigma_of(1 / mean) * mean**2:
                continue
            length = float(np.linalg.norm(m))
            found.append((row, col, m / length, 1 / length, rays.mean(axis=0) / mean))
    return found


def grow(cell: NDArray[np.int32], normal: F64, centroid: F64, sigma: F64, R: F64, tolerance: float) -> list[set[int]]:
    """Connected planes as sets of cell indices: breadth first, over a table from place to cell."""
    at = {(int(r), int(c)): i for i, (r, c) in enumerate(cell)}
    axis = {}
    for i in range(len(cell)):
        cosines = np.abs(R @ normal[i])
        if cosines.max() > np.cos(min(tolerance + 1.5 * sigma[i], 0.6)):
            axis[i] = int(np.argmax(cosines))
    planes, taken = [], set()
    for seed in axis:
        if seed in taken:
            continue
        plane, queue = {seed}, deque([seed])
        taken.add(seed)
        while queue:
            i = queue.popleft()
            for move in ((1, 0), (-1, 0), (0, 1), (0, -1)):
                j = at.get((int(cell[i, 0]) + move[0], int(cell[i, 1]) + move[1]), -1)
                if j < 0 or j in taken or axis.get(j) != axis[i]:
                    continue
                step = centroid[j] - centroid[i]
                slack = 2 * sigma_of(float(centroid[i, 2]))
                if abs(R[axis[i]] @ step) < np.linalg.norm(step) * tolerance + slack:
                    plane.add(j)
                    taken.add(j)
                    queue.append(j)
        planes.append(plane)
    return planes


def face_seen(ray: F64, R: F64, distances: F64, least: float = 1e-3) -> tuple[int, float]:
    """(face 0..4 or -1, depth of the empty room) along a camera ray with z = 1."""
    values = [FACE_SIGN[k] * (R[FACE_AXIS[k]] @ ray) / distances[k] for k in range(5)]
    k = int(np.argmax(values))
    return (k, 1 / values[k]) if values[k] > least else (-1, np.inf)


def mean_cost(
    rays: F64, inverse_depth: F64, probability: F64, behind: F64, R: F64, distances: F64, costs: F64
) -> float:
    """The cost of a cuboid as docs/method.md has it, cell by cell."""
    wrong_kind, beyond, apart, in_use, slack, slack_per_m, wall_beyond, wrong_wall, kind, name = costs
    total = 0.0
    for ray, w, p, q in zip(rays, inverse_depth, probability, behind, strict=True):
        face, _ = face_seen(ray, R, distances)
        structure, clutter = p[:5].sum(), p[5]
        if face < 0:
            total += wrong_kind * structure + beyond * clutter + kind * q.sum()
            continue
        is_wall = face >= 2
        mine = p[2:5].sum() if is_wall else p[face]
        likely = q[2:].sum() if is_wall else q[face]
        total += kind * (q.sum() - likely) + (name * (likely - q[face]) if is_wall else 0.0)
        total += wrong_kind * (structure - mine) + (wrong_wall * (mine - p[face]) if is_wall else 0.0)
        if w <= 0:
            continue
        beyond_m = float(FACE_SIGN[face] * (R[FACE_AXIS[face]] @ ray) / w - distances[face])
        off = min(abs(beyond_m) / (slack + slack_per_m / w), 1.0) ** 2
        if beyond_m > 0:
            total += off * ((wall_beyond if is_wall else 1.0) * mine + beyond * clutter)
        else:
            total += off * mine + apart * clutter * min(-beyond_m, 1.0)
    return float(total / len(rays) + in_use * np.isfinite(distances).sum())


def balance(rays: F64, inverse_depth: F64, probability: F64, R: F64, distances: F64) -> F64:
    counts = np.zeros((5, 3))
    for ray, w, p in zip(rays, inverse_depth, probability, strict=True):
        face, _ = face_seen(ray, R, distances)
        if face < 0:
            continue
        counts[face, 2] += 1
        if w > 0:
            beyond_m = FACE_SIGN[face] * (R[FACE_AXIS[face]] @ ray) / w - distances[face]
            if abs(beyond_m) < 3 * sigma_of(1 / w):
                counts[face, 0] += p[:5].sum()
            elif beyond_m > 0:
                counts[face, 1] += 1
    return counts


def cell_means(index: NDArray[np.int32], values: F64, size: int) -> F64:
    """Mean of the superpixels' values over every second pixel of each cell."""
    image = values[index]
    rows, cols = index.shape[0] // size, index.shape[1] // size
    cells = [
        image[r * size : (r + 1) * size : 2, c * size : (c + 1) * size : 2].mean(axis=(0, 1))
        for r in range(rows)
        for c in range(cols)
    ]
    return np.array(cells)


def candidates(rays: F64, inverse_depth: F64, probability: F64, R: F64) -> list[list[float]]:
    """Distances worth trying per face, nearest relatives left out: modes, extents, guesses, and out of view."""
    seen = inverse_depth > 0
    points, p = (rays[seen] / inverse_depth[seen, None]) @ R.T, probability[seen]
    result = []
    for face in range(5):
        along = FACE_SIGN[face] * points[:, FACE_AXIS[face]]
        mine = p[:, face] if face < 2 else p[:, 2:5].sum(axis=1)
        values = modes(along, mine, 5)
        if face >= 2:
            values += modes(along, p[:, 5], 2)
            if (along > 0.05).sum() > 12:
                values += [float(v) for v in np.quantile(along[along > 0.05], (0.98, 0.995))]
        elif mine.sum() < 4.0:
            values = [0.9, 1.1, 1.3, 1.5] if face == 1 else []
        kept: list[float] = []
        for value in values:
            if value > 0.05 and all(abs(value - other) > 0.03 + 0.02 * other for other in kept):
                kept.append(value)
        result.append([*kept, np.inf])
    return result


def modes(along: F64, weight: F64, count: int) -> list[float]:
    """Up to `count` strongest local maxima of the smoothed histogram in bins of 25 mm."""
    keep = (along > 0.05) & (along < 15.0)
    if weight[keep].sum() < 2.0:
        return []
    histogram = np.bincount((along[keep] / 0.025).astype(int), weight[keep], minlength=601)
    kernel = np.exp(-0.5 * (np.arange(-6, 7) / 2.0) ** 2)
    smooth = np.convolve(histogram, kernel / kernel.sum(), mode="same")
    padded = np.concatenate([[0.0], smooth, [0.0]])
    peaks = np.flatnonzero((padded[1:-1] >= padded[:-2]) & (padded[1:-1] > padded[2:]) & (smooth > 0.1))
    return [float((i + 0.5) * 0.025) for i in peaks[np.argsort(-smooth[peaks], kind="stable")][:count]]


def score_face(points: F64, agreement: F64, sigma: F64, distances: F64, violation_weight: float) -> float:
    """Score of one whole cuboid: what its faces gain from the cells on them, less what lies beyond. Room axes."""
    total = 0.0
    for i in range(len(points)):
        face, _ = face_seen(points[i], np.eye(3), distances, least=0.0)
        if face < 0 or not np.isfinite(points[i, 2]):
            continue
        axis = FACE_AXIS[face]
        gap = float(distances[face] - FACE_SIGN[face] * points[i, axis])
        width = 2 * sigma[i] + 0.01 * distances[face]
        if gap <= 4 * width:
            total += np.exp(-0.5 * (gap / width) ** 2) * agreement[i, axis]
        if gap < -width:
            total -= violation_weight * min((-gap - width) / 0.15, 1.0)
    return total / len(points)


def votes(
    R: F64,
    distances: F64,
    layout: NDArray[np.uint8],
    inverse: NDArray[np.float32],
    camera: CameraIntrinsics,
    index: NDArray[np.int32],
    count: int,
    on_plane_m: float = 0.10,
) -> F64:
    """Pixels per superpixel on their face, and in front of it (6); an unmeasured pixel is worth a hundredth."""
    table = np.zeros((count, 7))
    for y, x in np.ndindex(layout.shape):
        face, w = int(layout[y, x]), float(inverse[y, x])
        if face == 0:
            continue
        if w <= 0:
            table[index[y, x], face] += 0.01
            continue
        k = face - 1
        in_front_m = distances[k] - FACE_SIGN[k] * (R[FACE_AXIS[k]] @ (ray_of(camera, x, y) / w))
        table[index[y, x], 6 if in_front_m > on_plane_m + 2 * sigma_of(1 / w) else face] += 1
    return table
