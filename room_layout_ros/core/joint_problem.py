"""From the evidence of one frame to the joint problem under one naming of the axes (docs/method.md, section 6)."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np
from numba import njit
from numpy.typing import NDArray

from .cell_counts import CellCounts, count_samples, keep_atoms, sample_lattice
from .config import EstimatorConfig
from .depth import CELL_PX, DepthGeometry
from .depth_cells import DepthCells, gather_depth_cells
from .depth_profiles import DepthProfiles, compute_depth_profiles
from .energies import ExtraCosts, JointProblem
from .frame import CameraIntrinsics
from .labels import N_FACES, N_LABELS
from .plane_fit import compute_plane_fit
from .ray_grid import compute_ray_grid
from .superpixels import Superpixels

_N_ORIENTATIONS = N_FACES + 1
_ONE_HOT = np.eye(_N_ORIENTATIONS)[:, 1:]
"""Rows: no orientation, then the faces."""
_TOLERANCE_M, _SPAN_M = 0.03, 0.30
"""A superpixel is fully above another when it is this much and more above it."""
_TOLERANCE_SLOPE, _SPAN_SLOPE = 0.02, 0.20
"""The same for directions |u|, |v| where nothing is known of depth."""
_RELATION_AXIS = ((0, 1, -1.0), (1, 1, 1.0), (2, 0, 1.0), (3, 0, -1.0), (4, 2, 1.0), (5, 2, -1.0))
"""Column, room axis (Y is down) and sign of each relation."""
_COLOR_SCALE = 10.0
_MAX_CUE_M = 3.0
_PLANE_SCALE = 0.03
"""Relative difference of depth at which two planes are no longer one."""


@dataclass(frozen=True, slots=True)
class FrameEvidence:
    """What the earlier stages found under one naming of the axes; what is None is not known.

    Attributes
    ----------
    R_room_camera : (3, 3) float64.
    orientation : (H, W) uint8 orientation map, 0 or face id 1..5.
    context : (K, 6) probabilities of geometric context, in the order of the labels.
    depth_cues : (K, 12) six cosines and six distances, each in the order of the labels.
    scene_layout : (K, 5) probabilities of the faces of the empty room, by the scene network.
    """

    R_room_camera: NDArray[np.float64]
    orientation: NDArray[np.uint8] | None = None
    context: NDArray[np.float64] | None = None
    depth_cues: NDArray[np.float64] | None = None
    scene_layout: NDArray[np.float64] | None = None


@dataclass(frozen=True, slots=True)
class SharedParts:
    """What is the same under every naming of the axes: gathered once per frame.

    Attributes
    ----------
    index : (H, n) int32 superpixel of the pixels that are counted, -1 beyond the image.
    contact, smoothness : of `JointProblem`.
    cells : DepthCells, None without depth. cell_superpixel : (cells,) int32.
    """

    index: NDArray[np.int32]
    contact: NDArray[np.float64]
    smoothness: NDArray[np.float64]
    cells: DepthCells | None
    cell_superpixel: NDArray[np.int32]


def gather_parts(superpixels: Superpixels, geometry: DepthGeometry | None, config: EstimatorConfig) -> SharedParts:
    """Gather what does not depend on the axes."""
    size, count = superpixels.index.size, superpixels.count
    rows, columns = (n // CELL_PX for n in superpixels.index.shape)
    centre = superpixels.index[CELL_PX // 2 :: CELL_PX, CELL_PX // 2 :: CELL_PX][:rows, :columns]
    return SharedParts(
        index=sample_lattice(superpixels.index, config.layout_pixel_step),
        contact=superpixels.edge_length * np.sqrt(size / count) / size,
        smoothness=_smoothness(superpixels, geometry is not None),
        cells=None if geometry is None else gather_depth_cells(geometry),
        cell_superpixel=centre.ravel(),
    )


def build_joint_problem(
    camera: CameraIntrinsics,
    superpixels: Superpixels,
    evidence: FrameEvidence,
    geometry: DepthGeometry | None,
    config: EstimatorConfig,
    regions: NDArray[np.uint8] | None = None,
    parts: SharedParts | None = None,
) -> JointProblem:
    """Collect all terms of the joint energy.

    Parameters
    ----------
    camera : CameraIntrinsics
    superpixels : Superpixels
    evidence : FrameEvidence
    geometry : DepthGeometry or None
        None drops every depth term.
    config : EstimatorConfig
        `layout_rays`, `layout_angle_bins`, `layout_pixel_step`, `layout_scales`.
    regions : (H, W) uint8, 0..5, optional
        A further division of the atoms, kept as `atom_region`: the true layout, for the loss in learning.
    parts : SharedParts, optional
        Of the same superpixels, geometry and settings, to save gathering them again.

    Raises
    ------
    ValueError
        When an array does not fit the image or the superpixels.
    """
    K, R = superpixels.count, evidence.R_room_camera
    parts = parts or gather_parts(superpixels, geometry, config)
    counts, number, per_superpixel = _count_atoms(camera, superpixels, evidence, parts, config, regions)
    region = number % _N_ORIENTATIONS if regions is not None else np.zeros_like(number)
    of_orientation = number // _N_ORIENTATIONS if regions is not None else number
    orientation = of_orientation % _N_ORIENTATIONS if evidence.orientation is not None else np.zeros_like(number)
    atom_superpixel = (number // per_superpixel).astype(np.int32)

    context = (
        np.full((K, N_LABELS), 1.0 / N_LABELS) if evidence.context is None else np.asarray(evidence.context, np.float64)
    )
    behind = np.zeros((K, N_FACES)) if evidence.scene_layout is None else np.asarray(evidence.scene_layout, np.float64)
    held = np.bincount(atom_superpixel * _N_ORIENTATIONS + orientation, counts.pixels, K * _N_ORIENTATIONS)
    held = held.reshape(K, _N_ORIENTATIONS)
    cues = np.zeros((K, 12)) if evidence.depth_cues is None else np.asarray(evidence.depth_cues, np.float64)
    return JointProblem(
        counts=counts,
        atom_superpixel=atom_superpixel,
        atom_feature=np.concatenate([_ONE_HOT[orientation], context[atom_superpixel], behind[atom_superpixel]], axis=1),
        atom_region=region.astype(np.uint8),
        label_gc=context,
        label_om=held[:, 1:] / np.maximum(held.sum(axis=1), 1.0)[:, None],
        label_depth=np.minimum(cues, _MAX_CUE_M) if geometry is not None else np.zeros((K, 12)),  # cosines are below it
        edges=superpixels.edges,
        contact=parts.contact,
        relation=compute_relations(camera, superpixels, R, geometry is not None),
        smoothness=parts.smoothness,
        profiles=None if parts.cells is None else _profiles(parts.cells, R, context, parts.cell_superpixel, config),
        fit=None if geometry is None else compute_plane_fit(camera, superpixels, R),
        front_axis=float(1.0 - R[2, 2]),
    )


def _count_atoms(
    camera: CameraIntrinsics,
    superpixels: Superpixels,
    evidence: FrameEvidence,
    parts: SharedParts,
    config: EstimatorConfig,
    regions: NDArray[np.uint8] | None,
) -> tuple[CellCounts, NDArray[np.intp], int]:
    """Counts of the atoms that have a pixel, their numbers, and how many numbers a superpixel has."""
    atoms, per_superpixel = parts.index, 1
    for image in (evidence.orientation, regions):
        if image is not None:
            if image.shape != superpixels.index.shape or image.dtype != np.uint8:
                raise ValueError(
                    f"evidence image is {image.dtype} {image.shape}; uint8 {superpixels.index.shape} is needed"
                )
            atoms = atoms * np.int32(_N_ORIENTATIONS) + sample_lattice(image, config.layout_pixel_step)
            per_superpixel *= _N_ORIENTATIONS
    grid = compute_ray_grid(camera, evidence.R_room_camera, config.layout_rays, config.layout_angle_bins)
    counts = count_samples(grid, atoms, superpixels.count * per_superpixel, config.layout_pixel_step)
    held = counts.pixels > 0
    return keep_atoms(counts, held), np.flatnonzero(held), per_superpixel


def compute_relations(
    camera: CameraIntrinsics, superpixels: Superpixels, R: NDArray[np.float64], with_depth: bool
) -> NDArray[np.float64]:
    """(E, 6) float64 0..1: i above, below, right of, left of, in front of (farther), behind j (paper, Table 1).

    Positions are the planes' points at the superpixels' centres, where both have one; without depth directions (u, v)
    tell what they can, and nothing is in front or behind.
    """
    camera_numbers = (camera.fx, camera.fy, camera.cx, camera.cy)
    return _relations(superpixels.center_px, superpixels.plane, superpixels.edges, R, camera_numbers, with_depth)


@njit(cache=True, nogil=True, error_model="numpy")
def _position(x, y, plane, R, camera, with_depth):  # type: ignore[no-untyped-def]
    """Point on the superpixel's plane (NaN where it has none), or with z = 0 its direction, in room axes."""
    fx, fy, cx, cy = camera
    u, v = (x - cx) / fx, (y - cy) / fy
    p = R[0, 0] * u + R[0, 1] * v + R[0, 2]
    q = R[1, 0] * u + R[1, 1] * v + R[1, 2]
    r = R[2, 0] * u + R[2, 1] * v + R[2, 2]
    if with_depth:
        w = plane[0] * x + plane[1] * y + plane[2]
        z = 1.0 / w if w > 0 else np.nan
        return p * z, q * z, r * z
    return (p / r, q / r, 0.0) if r > 0.1 else (np.nan, np.nan, np.nan)


@njit(cache=True, nogil=True, error_model="numpy")
def _relations(centre, plane, edges, R, camera, with_depth):  # type: ignore[no-untyped-def]
    tolerance, span = (_TOLERANCE_M, _SPAN_M) if with_depth else (_TOLERANCE_SLOPE, _SPAN_SLOPE)
    position = np.empty((len(centre), 3))
    for k in range(len(centre)):
        at = _position(float(centre[k, 0]), float(centre[k, 1]), plane[k], R, camera, with_depth)
        position[k, 0], position[k, 1], position[k, 2] = at
    relation = np.zeros((len(edges), 6))
    for e in range(len(edges)):
        for column, axis, sign in _RELATION_AXIS:
            step = sign * (position[edges[e, 0], axis] - position[edges[e, 1], axis])
            share = (step - tolerance) / span
            if share > 0.0:  # not where a position is NaN
                relation[e, column] = min(share, 1.0)
    return relation


def _smoothness(superpixels: Superpixels, with_depth: bool) -> NDArray[np.float64]:
    """(E, 3): 1, likeness of colour, likeness of plane."""
    i, j = superpixels.edges.T
    color = np.linalg.norm(superpixels.mean_lab[i] - superpixels.mean_lab[j], axis=1) / _COLOR_SCALE
    likeness = np.zeros(len(i))
    if with_depth:
        gap = np.maximum(_plane_gap(superpixels, i, j), _plane_gap(superpixels, j, i))
        likeness = np.nan_to_num(np.exp(-0.5 * (gap / _PLANE_SCALE) ** 2), nan=0.0)
    return np.column_stack([np.ones(len(i)), np.exp(-0.5 * color**2), likeness]).astype(np.float64)


def _plane_gap(superpixels: Superpixels, i: NDArray[np.int32], j: NDArray[np.int32]) -> NDArray[np.float64]:
    """Relative difference of inverse depth between the planes of i and j at the centre of j."""
    x, y = superpixels.center_px[j].T.astype(np.float64)
    of_i = superpixels.plane[i, 0] * x + superpixels.plane[i, 1] * y + superpixels.plane[i, 2]
    of_j = superpixels.plane[j, 0] * x + superpixels.plane[j, 1] * y + superpixels.plane[j, 2]
    with np.errstate(divide="ignore", invalid="ignore"):
        return np.abs(of_i - of_j) / np.abs(of_j)


def _profiles(
    cells: DepthCells,
    R: NDArray[np.float64],
    context: NDArray[np.float64],
    cell_superpixel: NDArray[np.int32],
    config: EstimatorConfig,
) -> DepthProfiles:
    """Profiles of the cells; a cell counts for a face as far as the context lets its superpixel be structure."""
    structure = np.clip(2.0 * context[:, :N_FACES], 0.0, 1.0)
    if np.ptp(context) == 0.0:  # nothing known
        structure = np.ones_like(structure)
    return compute_depth_profiles(*cells.turned(R), structure[cell_superpixel], cells.sigma, config.layout_scales)


def loss_costs(problem: JointProblem, label_truth: NDArray[np.float64], layout_share: float = 1.0) -> ExtraCosts:
    """Return the pixel-wise losses of labelling and layout as costs; their negatives augment inference in learning.

    Parameters
    ----------
    problem : JointProblem
        Built with the true layout as `regions`.
    label_truth : (K, 6) float64
        Share of the image that each superpixel has of each true label; pixels without truth in none.
    layout_share : float
        Weight of the layout loss against the labelling loss.
    """
    labelled = label_truth.sum(axis=1, keepdims=True)
    wrong = (problem.atom_region[:, None] != np.arange(1, N_FACES + 1)) & (problem.atom_region[:, None] > 0)
    return ExtraCosts(
        face=layout_share * wrong * (problem.counts.pixels / problem.pixels)[:, None],
        label=labelled - label_truth,
    )
