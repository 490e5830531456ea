"""Slow, obvious twins of the kernels of forest.py, orientation_map.py, lines.py and pixel_statistics.py."""

from __future__ import annotations

import numpy as np

from room_layout_ros.core.evidence import pixel_statistics as ps
from room_layout_ros.core.forest import Forest
from room_layout_ros.core.frame import CameraIntrinsics


def evaluate_forest(forest: Forest, rows: np.ndarray) -> np.ndarray:
    out = np.tile(forest.baseline.astype(np.float64), (len(rows), 1))
    for i, row in enumerate(rows):
        for first, k in zip(forest.root, forest.output, strict=True):
            node = int(first)
            while forest.feature[node] >= 0:
                value = row[forest.feature[node]]
                goes_left = forest.missing_left[node] if np.isnan(value) else value <= forest.threshold[node]
                node = int(first) + int((forest.left if goes_left else forest.right)[node])
            out[i, k] += forest.threshold[node]
    return out


def first_hits(point: np.ndarray, toward: np.ndarray, segments: np.ndarray) -> list[tuple[float, int]]:
    """(distance, segment) of all crossings of the half line from `point` along `toward`, nearest first."""
    hits = []
    for k, (x1, y1, x2, y2) in enumerate(segments):
        a, b = np.array([x1, y1]), np.array([x2, y2])
        matrix = np.stack([toward, a - b], axis=1)
        if abs(np.linalg.det(matrix)) < 1e-9:
            continue
        t, s = np.linalg.solve(matrix, a - point)
        if t > 0 and 0 <= s <= 1:
            hits.append((float(t), k))
    return sorted(hits)


def orientation_at(
    point: np.ndarray, segments: np.ndarray, line_class: np.ndarray, R: np.ndarray, camera: CameraIntrinsics
) -> int:
    """Face id of one pixel by the definition: look along each axis both ways at exact segments."""
    seen: list[set[int]] = [set(), set(), set()]
    for axis in range(3):
        vx, vy, vw = camera.matrix @ R[axis]
        toward = np.array([vx - vw * point[0], vy - vw * point[1]])
        toward /= np.linalg.norm(toward)
        limit = np.inf if abs(vw) < 1e-12 else np.hypot(vx / vw - point[0], vy / vw - point[1])
        ahead = limit < np.inf and np.dot([vx / vw - point[0], vy / vw - point[1]], toward) > 0
        for sign in (1.0, -1.0):
            reach = limit if ahead == (sign > 0) else np.inf
            for distance, k in first_hits(point, sign * toward, segments):
                if line_class[k] >= 0 and line_class[k] != axis:
                    if distance < reach:
                        seen[axis].add(int(line_class[k]))
                    break
    found = [k for k in range(3) if (k + 1) % 3 in seen[(k + 2) % 3] and (k + 2) % 3 in seen[(k + 1) % 3]]
    if len(found) != 1:
        return 0
    d = R @ np.linalg.inv(camera.matrix) @ np.array([point[0], point[1], 1.0])
    if found[0] == 2:
        return 4
    if found[0] == 0:
        return 3 if d[0] < 0 else 5
    return 1 if d[1] < 0 else 2


def classify(normal: np.ndarray, middle: np.ndarray, length: np.ndarray, axes: np.ndarray) -> np.ndarray:
    out = np.full(len(normal), -1)
    for i in range(len(normal)):
        angles = []
        for d in axes:
            across = np.dot(normal[i], d)
            flat = d - np.dot(d, middle[i]) * middle[i]
            angles.append(np.arcsin(min(abs(across) / max(np.linalg.norm(flat), 1e-3), 1.0)))
        allowed = np.deg2rad(3.0) + np.arctan(1.0 / max(length[i], 1.0))
        if min(angles) < allowed:
            out[i] = int(np.argmin(angles))
    return out


def room_sums(
    index: np.ndarray, count: int, inverse: np.ndarray, R: np.ndarray, camera: CameraIntrinsics
) -> np.ndarray:
    """(count, 4) number and sums of X, Y, Z over every `STRIDE`-th pixel with depth."""
    out = np.zeros((count, 4))
    rays = camera.rays().astype(np.float64)
    for y in range(0, index.shape[0] - ps.STRIDE + 1, ps.STRIDE):
        for x in range(0, index.shape[1] - ps.STRIDE + 1, ps.STRIDE):
            if inverse[y, x] > 0:
                out[index[y, x], 0] += 1
                out[index[y, x], 1:] += R @ rays[y, x] / inverse[y, x]
    return out


def neighbour_means(values: np.ndarray, edges: np.ndarray, length: np.ndarray) -> np.ndarray:
    out = np.full(values.shape, np.nan)
    for i in range(len(values)):
        touching = [(int(b if a == i else a), float(w)) for (a, b), w in zip(edges, length, strict=True) if i in (a, b)]
        for k in range(values.shape[1]):
            known = [(values[j, k], w) for j, w in touching if not np.isnan(values[j, k])]
            if known:
                out[i, k] = np.average([v for v, _ in known], weights=[w for _, w in known])
    return out
