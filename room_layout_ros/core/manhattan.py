"""The Manhattan frame of a room: three orthogonal axes from surface normals (docs/method.md, section 4).

Hypothesise, score, refine [N12]: a first axis from the modes of the cell normals, the rotation about it from the
azimuths of the others modulo 90 degrees; the triple that explains most normals wins. It is then refined on whole
planes: cells that agree with an axis are grown into connected planes whose summed moments give normals far more
precise than a cell's, and the rotation that fits these best follows from Gauss-Newton steps (axes_refinement.py).
"""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np
from numba import njit
from numpy.typing import NDArray

from .axes_refinement import refine_on_planes
from .config import EstimatorConfig
from .depth import DepthGeometry, fit_cell_planes
from .frame import CameraIntrinsics
from .lines import LineSegments, segment_planes
from .room_axes import angle_between_axes, cross, name_axes, other_front
from .tracking import TemporalPrior
from .vanishing_points import estimate_axes_from_lines

_KERNEL_RAD = np.deg2rad(5.0)
_MIN_NORMALS = 12
_LARGE_CELLS = 16
"""Rows and columns of cells from which windows of 5 x 5 cells leave enough normals; on smaller images 3 x 3."""
_BANDWIDTH = _KERNEL_RAD**2
"""1 - cos of two directions over this is the exponent of the kernel, which is Gaussian in their angle."""
_SAME_FRAME_RAD = np.deg2rad(8.0)
_SCATTERED = 0.5
"""Share of pixels with depth up to which no plane may be found on a wall."""
_BETTER = 0.01
"""Share of the normals by which another turn has to explain more before what the previous frame knew is forgotten."""
_MODES = 4
_AZIMUTH_BINS = 45
_MODES_APART_RAD = np.deg2rad(12.0)
_MODE_SEEDS = 120
_MIN_MODE = 0.01
_MIN_LINES, _LONGEST_PX, _SHARED_RAD, _LEAST_SHARED = 6, 100.0, np.deg2rad(3.0), 0.4
"""On one plane so many lines tell its axes, if the last of their length, each counted up to the second, lies as near to
them as the third. By chance a fifteenth lies there."""
_UPRIGHT_RAD = np.deg2rad(25.0)
"""On a plane no farther from upright lines that are farther from level tell of its pattern, not of a camera's roll."""


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


def find_axes(
    geometry: DepthGeometry | None,
    segments: LineSegments | None,
    camera: CameraIntrinsics,
    config: EstimatorConfig,
    prior: TemporalPrior,
) -> ManhattanFrame | None:
    """Estimate the room's axes from whatever there is: depth and lines, depth alone, or lines alone.

    Lines alone also where the depth is so scattered that no part of it makes a plane.

    Returns
    -------
    ManhattanFrame or None
        None where there is too little to see.
    """
    if geometry is not None:
        by_depth = estimate_manhattan_frame(geometry, segments, prior.R_room_camera, prior.gravity)
        if by_depth is not None or geometry.measured > _SCATTERED:
            return by_depth
    if segments is None or len(segments) == 0:
        return None
    found = estimate_axes_from_lines(segments, camera, config, prior.gravity)
    names = [name_axes(R, prior.gravity) for R in found.hypotheses]
    hypotheses = tuple(turned for R in names for turned in (R, other_front(R)))
    return ManhattanFrame(hypotheses[0], found.confidence, hypotheses)


def estimate_manhattan_frame(
    geometry: DepthGeometry,
    segments: LineSegments | None = None,
    prior: NDArray[np.float64] | None = None,
    gravity: NDArray[np.float64] | None = None,
) -> ManhattanFrame | None:
    """Estimate the room's axes from depth, and from line segments where there are any.

    Parameters
    ----------
    geometry : DepthGeometry
    segments : LineSegments, optional
        Of the colour image; they make the axes more precise.
    prior : (3, 3) array, optional
        Axes of the previous frame; used as the only start while they explain the normals (warm start).
    gravity : (3,) array, optional
        Direction of gravity in the camera frame (TF, IMU); decides which axis is vertical.

    Returns
    -------
    ManhattanFrame or None
        None where too few cells are planar.
    """
    cells = fit_cell_planes(geometry, radius=2 if min(geometry.moments.shape[:2]) >= _LARGE_CELLS else 1)
    if len(cells.sigma) < _MIN_NORMALS:
        return None
    weight = 1.0 / (cells.sigma**2 + _KERNEL_RAD**2)
    weight /= weight.sum()
    lines, lengths = (None, None) if segments is None else _interpretation(segments, geometry)
    starts = _candidates(cells.normal, weight, gravity, lines, lengths) if prior is None else [prior]
    scored = sorted(((_score(R, cells.normal, weight, _BANDWIDTH), i) for i, R in enumerate(starts)), reverse=True)
    if prior is not None and (scored[0][0] < 0.5 or _is_left(prior, scored[0][0], cells.normal, weight)):
        return estimate_manhattan_frame(geometry, segments, None, gravity)
    refined: list[tuple[float, NDArray[np.float64]]] = []
    small = fit_cell_planes(geometry, radius=1)
    for _, i in scored[:3]:
        R = refine_on_planes(geometry, starts[i], lines, lengths, cells=small)
        if all(angle_between_axes(R, other) > _SAME_FRAME_RAD for _, other in refined):
            refined.append((_score(R, cells.normal, weight, _BANDWIDTH), name_axes(R, gravity)))
    refined.sort(key=lambda item: -item[0])
    hypotheses = [turned for _, R in refined for turned in (R, other_front(R))]
    return ManhattanFrame(refined[0][1], float(refined[0][0]), tuple(hypotheses))


def _is_left(
    prior: NDArray[np.float64], score: float, normals: NDArray[np.float64], weight: NDArray[np.float64]
) -> bool:
    """Whether the normals speak for another turn about the axis of the prior that they hold best.

    Floor and ceiling alone explain half of them whatever the turn: it would stay wrong for many frames. `score` : the
    prior's.
    """
    on_axis = weight @ (np.abs(normals @ prior.T) > np.cos(_KERNEL_RAD))
    basis = _complete(prior[int(np.argmax(on_axis))])
    turned = (_turned(basis, angle) for angle in _azimuths(normals, weight, basis))
    return any(
        angle_between_axes(R, prior) > _SAME_FRAME_RAD and _score(R, normals, weight, _BANDWIDTH) > score + _BETTER
        for R in turned
    )


def _turned(basis: NDArray[np.float64], angle: float) -> NDArray[np.float64]:
    """(3, 3) the basis turned about its last row."""
    c, s = np.cos(angle), np.sin(angle)
    return np.array([c * basis[0] + s * basis[1], -s * basis[0] + c * basis[1], basis[2]])


def _interpretation(segments: LineSegments, geometry: DepthGeometry) -> tuple[NDArray[np.float64], NDArray[np.float64]]:
    normals, _ = segment_planes(segments, geometry.camera)
    return normals, segments.length_px.astype(np.float64)


def _candidates(
    normals: NDArray[np.float64],
    weight: NDArray[np.float64],
    gravity: NDArray[np.float64] | None = None,
    lines: NDArray[np.float64] | None = None,
    lengths: NDArray[np.float64] | None = None,
) -> list[NDArray[np.float64]]:
    """Triples from the strongest normal modes and the azimuths around each."""
    triples = []
    for axis in _modes(normals, weight, _MODES, _BANDWIDTH, _MODES_APART_RAD):
        basis = _complete(axis)
        for angle in _azimuths(normals, weight, basis) or [_azimuth_of_one_plane(basis, gravity, lines, lengths)]:
            triples.append(_turned(basis, angle))
    return triples


@njit(cache=True, nogil=True)
def _modes(normals, weight, count, bandwidth, apart):  # type: ignore[no-untyped-def]
    """Greedy modes (k, 3) of axial directions: densest normal, mean of its neighbourhood, suppress, repeat."""
    n = len(normals)
    x, y, z = normals[:, 0].astype(np.float32), normals[:, 1].astype(np.float32), normals[:, 2].astype(np.float32)
    mass = weight.astype(np.float32)
    sharpness = np.float32(1.0 / bandwidth)
    seeds = normals[:: max(1, n // _MODE_SEEDS)]
    density = np.zeros(len(seeds))
    for i in range(len(seeds)):
        density[i] = _mean_shift(x, y, z, mass, sharpness, seeds[i])[0]
    modes = np.zeros((count, 3))
    found = 0
    while found < count:
        k = np.argmax(density)
        if found > 0 and density[k] <= _MIN_MODE:
            break
        mode = seeds[k].copy()
        for _ in range(3):
            total = np.array(_mean_shift(x, y, z, mass, sharpness, mode)[1:]).astype(np.float64)
            length = np.sqrt((total**2).sum())
            if length > 0.0:
                mode = total / length
        modes[found] = mode
        found += 1
        for i in range(len(seeds)):
            if abs(seeds[i, 0] * mode[0] + seeds[i, 1] * mode[1] + seeds[i, 2] * mode[2]) > np.cos(apart):
                density[i] = 0.0
    return modes[:found]


@njit(cache=True, nogil=True, fastmath={"nnan", "nsz", "reassoc", "contract"})
def _mean_shift(x, y, z, weight, sharpness, direction):  # type: ignore[no-untyped-def]
    """Kernel density of axial unit vectors at a direction, and their weighted sum there.

    The kernel is (1 - t / 8)^8 for exp(-t), t = (1 - cos) / bandwidth: it ends, and runs in vector registers.
    """
    a, b, c = np.float32(direction[0]), np.float32(direction[1]), np.float32(direction[2])
    zero, one, slope = np.float32(0.0), np.float32(1.0), np.float32(0.125) * sharpness
    density, sx, sy, sz = zero, zero, zero, zero
    for j in range(len(x)):
        cosine = a * x[j] + b * y[j] + c * z[j]
        near = one - (one - abs(cosine)) * slope
        near = near if near > zero else zero
        near *= near
        near *= near
        near *= near * weight[j]
        density += near
        signed = near if cosine > zero else -near
        sx += signed * x[j]
        sy += signed * y[j]
        sz += signed * z[j]
    return density, sx, sy, sz


def _complete(axis: NDArray[np.float64]) -> NDArray[np.float64]:
    """Rows (u, v, axis): a right-handed basis with `axis` last."""
    helper = np.eye(3)[int(np.argmin(np.abs(axis)))]
    u = np.array(cross(helper, axis))
    u /= np.sqrt(u @ u)
    return np.array([u, cross(axis, u), axis])


def _azimuths(normals: NDArray[np.float64], weight: NDArray[np.float64], basis: NDArray[np.float64]) -> list[float]:
    """Peaks of the azimuth modulo 90 degrees of the normals across `basis[2]`; none where too few are across."""
    return [float(angle) for angle in _azimuth_peaks(normals, weight, basis)]


@njit(cache=True, nogil=True)
def _azimuth_peaks(normals, weight, basis):  # type: ignore[no-untyped-def]
    """Up to two peaks (rad) of a histogram in steps of 2 degrees, each refined to the mean within 5 degrees."""
    azimuth, mass = np.empty(len(normals)), np.empty(len(normals))
    histogram = np.zeros(_AZIMUTH_BINS)
    n, limit = 0, np.sin(np.deg2rad(20.0))
    for i in range(len(normals)):
        u = v = up = 0.0
        for k in range(3):
            u += normals[i, k] * basis[0, k]
            v += normals[i, k] * basis[1, k]
            up += normals[i, k] * basis[2, k]
        if abs(up) < limit:
            azimuth[n] = np.rad2deg(np.arctan2(v, u)) % 90.0
            mass[n] = weight[i]
            histogram[int(azimuth[n] / 2.0) % _AZIMUTH_BINS] += mass[n]
            n += 1
    peaks = np.empty(2)
    found = 0
    if histogram.sum() < 0.02:
        return peaks[:0]
    smooth = histogram.copy()
    for k in range(_AZIMUTH_BINS):
        smooth[k] += 0.7 * (histogram[k - 1] + histogram[(k + 1) % _AZIMUTH_BINS])
    while found < 2:
        k = int(np.argmax(smooth))
        if found > 0 and smooth[k] <= 0.02:
            break
        total = turned_total = 0.0
        for i in range(n):
            turned = (azimuth[i] - (2.0 * k + 1.0) + 45.0) % 90.0 - 45.0
            if abs(turned) < 5.0:
                total += mass[i]
                turned_total += mass[i] * turned
        peaks[found] = np.deg2rad(2.0 * k + 1.0 + (turned_total / total if total > 0.0 else 0.0))
        found += 1
        for step in range(-4, 5):
            smooth[(k + step) % _AZIMUTH_BINS] = 0.0
    return peaks[:found]


def _azimuth_of_one_plane(
    basis: NDArray[np.float64],
    gravity: NDArray[np.float64] | None,
    lines: NDArray[np.float64] | None,
    lengths: NDArray[np.float64] | None,
) -> float:
    """Azimuth where one plane is all there is: by gravity beside a wall, by the lines on it, or guessed.

    The guess is level beside a wall and along the view above a floor.
    """
    down = np.array([0.0, 1.0, 0.0]) if gravity is None else gravity / np.linalg.norm(gravity)
    level = abs(basis[2] @ down) < np.sqrt(0.5)
    u, v, _ = basis @ (down if level else np.array([0.0, 0.0, 1.0]))
    guess = float(np.arctan2(v, u))
    if lines is None or lengths is None or (level and gravity is not None):
        return guess
    told = _azimuth_of_lines(basis, lines, np.minimum(lengths, _LONGEST_PX))
    if told is None:
        return guess
    rolled = abs((told - guess + np.pi / 4) % (np.pi / 2) - np.pi / 4)
    is_pattern = abs(basis[2] @ down) < np.sin(_UPRIGHT_RAD) and rolled > _UPRIGHT_RAD
    return guess if is_pattern else told


def _azimuth_of_lines(
    basis: NDArray[np.float64], lines: NDArray[np.float64], lengths: NDArray[np.float64]
) -> float | None:
    """Azimuth modulo 90 degrees that most of the lines on the plane across `basis[2]` share; None where few do."""
    along = np.cross(lines, basis[2])
    length = np.linalg.norm(along, axis=1)
    along, weight = along[length > 0.0] / length[length > 0.0, None], lengths[length > 0.0]
    if len(along) < _MIN_LINES:
        return None
    weight = weight / weight.sum()
    peaks = _azimuth_peaks(along, weight, basis)
    off = np.arctan2(along @ basis[1], along @ basis[0]) - peaks[0]
    near = np.abs((off + np.pi / 4) % (np.pi / 2) - np.pi / 4) < _SHARED_RAD
    return float(peaks[0]) if weight[near].sum() >= _LEAST_SHARED else None


@njit(cache=True, nogil=True)
def _score(R, normals, weight, bandwidth):  # type: ignore[no-untyped-def]
    """Share of the weight whose normal lies on an axis, with a Gaussian kernel."""
    total = 0.0
    for j in range(len(normals)):
        best = 0.0
        for k in range(3):
            c = abs(R[k, 0] * normals[j, 0] + R[k, 1] * normals[j, 1] + R[k, 2] * normals[j, 2])
            best = max(best, c)
        total += weight[j] * np.exp(-(1.0 - best) / bandwidth)
    return total
