"""From the evidence of one frame to the joint problem under one naming of the axes (docs/method.md, section 6)."""

from __future__ import annotations

from dataclasses import dataclass, field
from typing import NamedTuple

import numpy as np
from numba import njit
from numpy.typing import NDArray

from .cell_counts import CellCounts, count_samples, lattice_shear, sample_lattice
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
SAME_NAMES = np.arange(_N_ORIENTATIONS, dtype=np.uint8)
"""Of the ids of an orientation map: each keeps its own."""
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


class AtomCounts(NamedTuple):
    """Pixels of each atom per cell of a ray grid, and the atoms' numbers.

    Attributes
    ----------
    counts : CellCounts. number : (A,) (superpixel x 6 + orientation) x 6 + region, of what divides the superpixels.
    """

    counts: CellCounts
    number: NDArray[np.intp]


@dataclass(frozen=True, slots=True)
class FrameEvidence:
    """What the earlier stages found under one naming of the axes; what is None is not known.

    Attributes
    ----------
    R_room_camera : (3, 3) float64.
    orientation : (H, W) uint8 orientation map, 0 or face id 1..5, under some naming of the axes.
    orientation_names : (6,) uint8 what the ids 0..5 of that map are called under this one.
    context : (K, 6) probabilities of geometric context, in the order of the labels.
    depth_cues : (K, 12) six cosines and six distances, each in the order of the labels.
    scene_layout : (K, 5) probabilities of the faces of the empty room, by the scene network.
    """

    R_room_camera: NDArray[np.float64]
    orientation: NDArray[np.uint8] | None = None
    context: NDArray[np.float64] | None = None
    depth_cues: NDArray[np.float64] | None = None
    scene_layout: NDArray[np.float64] | None = None
    orientation_names: NDArray[np.uint8] = field(default_factory=lambda: SAME_NAMES)


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


class FirstParts(NamedTuple):
    """What of the joint problem is known before the scene network has answered: to be gathered beside it.

    Attributes
    ----------
    shared : SharedParts. atoms : AtomCounts under the first naming of the axes.
    """

    shared: SharedParts
    atoms: AtomCounts


def gather_first_parts(
    camera: CameraIntrinsics,
    superpixels: Superpixels,
    geometry: DepthGeometry | None,
    R_room_camera: NDArray[np.float64],
    orientation: NDArray[np.uint8] | None,
    config: EstimatorConfig,
) -> FirstParts:
    """Gather what asks for no more than axes, superpixels and orientation map, (H, W) uint8."""
    shared = gather_parts(superpixels, geometry, config)
    evidence = FrameEvidence(R_room_camera, orientation)
    return FirstParts(shared, count_atoms(camera, superpixels, shared, evidence, config))


def build_joint_problem(
    camera: CameraIntrinsics,
    superpixels: Superpixels,
    evidence: FrameEvidence,
    geometry: DepthGeometry | None,
    config: EstimatorConfig,
    regions: NDArray[np.uint8] | None = None,
    parts: SharedParts | None = None,
    atoms: AtomCounts | None = None,
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
    atoms : AtomCounts, optional
        Of the same evidence and regions, to save counting again.

    Raises
    ------
    ValueError
        When an array does not fit the image or the superpixels.
    """
    K, R = superpixels.count, evidence.R_room_camera
    parts = parts or gather_parts(superpixels, geometry, config)
    counts, number = atoms or count_atoms(camera, superpixels, parts, evidence, config, regions)
    context = (
        np.full((K, N_LABELS), 1.0 / N_LABELS) if evidence.context is None else np.asarray(evidence.context, np.float64)
    )
    behind = np.zeros((K, N_FACES)) if evidence.scene_layout is None else np.asarray(evidence.scene_layout, np.float64)
    divisions = (evidence.orientation is not None, regions is not None)
    superpixel, feature, region, shares = _describe_atoms(number, counts.pixels, context, behind, *divisions)
    cues = np.zeros((K, 12)) if evidence.depth_cues is None else np.asarray(evidence.depth_cues, np.float64)
    return JointProblem(
        counts=counts,
        atom_superpixel=superpixel,
        atom_feature=feature,
        atom_region=region,
        label_gc=context,
        label_om=shares,
        label_depth=np.minimum(cues, _MAX_CUE_M) if geometry is not None else np.zeros((K, 12)),  # cosines are below it
        edges=superpixels.edges,
        contact=parts.contact,
        relation=compute_relations(camera, superpixels, R, geometry is not None),
        smoothness=parts.smoothness,
        profiles=None if parts.cells is None else _profiles(parts.cells, R, context, parts.cell_superpixel, config),
        fit=None if geometry is None else compute_plane_fit(camera, superpixels, R),
        front_axis=float(1.0 - R[2, 2]),
    )


@njit(cache=True, nogil=True)
def _describe_atoms(number, pixels, context, behind, by_orientation, by_region):  # type: ignore[no-untyped-def]
    """(A,) superpixel, (A, 16) features and (A,) region of the atoms with these numbers; (K, 5) share of each
    superpixel's pixels per orientation.
    """
    atoms = len(number)
    superpixel, region = np.empty(atoms, np.int32), np.zeros(atoms, np.uint8)
    feature = np.zeros((atoms, N_FACES + N_LABELS + N_FACES))
    shares, whole = np.zeros((len(context), N_FACES)), np.zeros(len(context))
    for a in range(atoms):
        k, orientation = number[a], 0
        if by_region:
            region[a] = k % _N_ORIENTATIONS
            k //= _N_ORIENTATIONS
        if by_orientation:
            orientation = k % _N_ORIENTATIONS
            k //= _N_ORIENTATIONS
        superpixel[a] = k
        whole[k] += pixels[a]
        if orientation > 0:
            feature[a, orientation - 1] = 1.0
            shares[k, orientation - 1] += pixels[a]
        for c in range(N_LABELS):
            feature[a, N_FACES + c] = context[k, c]
        for c in range(N_FACES):
            feature[a, N_FACES + N_LABELS + c] = behind[k, c]
    for k in range(len(whole)):
        for f in range(N_FACES):
            shares[k, f] /= max(whole[k], 1.0)
    return superpixel, feature, region, shares


def count_atoms(
    camera: CameraIntrinsics,
    superpixels: Superpixels,
    parts: SharedParts,
    evidence: FrameEvidence,
    config: EstimatorConfig,
    regions: NDArray[np.uint8] | None = None,
) -> AtomCounts:
    """Count the pixels of every atom that has one; asks of the evidence for axes and orientation map alone.

    Parameters
    ----------
    parts : SharedParts of these superpixels. regions : of `build_joint_problem`.

    Raises
    ------
    ValueError
        When an image does not fit the superpixels.
    """
    atoms, per_superpixel = parts.index, 1
    for image, names in ((evidence.orientation, evidence.orientation_names), (regions, SAME_NAMES)):
        if image is not None:
            if image.shape != superpixels.index.shape or image.dtype != np.uint8:
                raise ValueError(
                    f"evidence image is {image.dtype} {image.shape}; uint8 {superpixels.index.shape} is needed"
                )
            atoms = _divide(atoms, image, names, config.layout_pixel_step, lattice_shear(config.layout_pixel_step))
            per_superpixel *= _N_ORIENTATIONS
    grid = compute_ray_grid(camera, evidence.R_room_camera, config.layout_rays, config.layout_angle_bins)
    held = _held(atoms, superpixels.count * per_superpixel)
    return AtomCounts(count_samples(grid, atoms, held, config.layout_pixel_step), np.flatnonzero(held))


@njit(cache=True, nogil=True, error_model="numpy")
def _divide(atoms, image, names, step, shear):  # type: ignore[no-untyped-def]
    """(H, n) int32: the atoms of a lattice's pixels divided by the names 0..5 of the ids of an image."""
    divided = np.empty_like(atoms)
    for y in range(atoms.shape[0]):
        first = (-shear * y) % step
        for k in range(atoms.shape[1]):
            x = first + k * step
            divided[y, k] = atoms[y, k] * _N_ORIENTATIONS + names[image[y, x]] if atoms[y, k] >= 0 else -1
    return divided


@njit(cache=True, nogil=True)
def _held(atoms, count):  # type: ignore[no-untyped-def]
    """(count,) bool: atoms that have a pixel."""
    held = np.zeros(count, np.bool_)
    for y in range(atoms.shape[0]):
        for k in range(atoms.shape[1]):
            if atoms[y, k] >= 0:
                held[atoms[y, k]] = True
    return held


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
    return np.asarray(
        _likeness(superpixels.edges, superpixels.mean_lab, superpixels.center_px, superpixels.plane, with_depth)
    )


@njit(cache=True, nogil=True, error_model="numpy")
def _likeness(edges, lab, centre, plane, with_depth):  # type: ignore[no-untyped-def]
    result = np.ones((len(edges), 3))
    for e in range(len(edges)):
        i, j = edges[e, 0], edges[e, 1]
        square = 0.0
        for c in range(3):
            square += (float(lab[i, c]) - float(lab[j, c])) ** 2
        result[e, 1] = np.exp(-0.5 * square / _COLOR_SCALE**2)
        gap = max(_plane_gap(plane[i], plane[j], centre[j]), _plane_gap(plane[j], plane[i], centre[i]))
        like = np.exp(-0.5 * (gap / _PLANE_SCALE) ** 2) if with_depth else 0.0
        result[e, 2] = like if like == like else 0.0
    return result


@njit(cache=True, nogil=True, error_model="numpy")
def _plane_gap(plane, other, centre):  # type: ignore[no-untyped-def]
    """Relative difference of inverse depth between a plane and another at the other's centre; NaN where one is none."""
    x, y = float(centre[0]), float(centre[1])
    mine = plane[0] * x + plane[1] * y + plane[2]
    others = other[0] * x + other[1] * y + other[2]
    return abs(mine - others) / abs(others)


def _profiles(
    cells: DepthCells,
    R: NDArray[np.float64],
    context: NDArray[np.float64],
    cell_superpixel: NDArray[np.int32],
    config: EstimatorConfig,
) -> DepthProfiles:
    """Profiles of the cells; a cell counts for a face as far as the context lets its superpixel be structure."""
    structure = _structure(context, cell_superpixel)
    return compute_depth_profiles(*cells.turned(R), structure, cells.sigma, config.layout_scales)


@njit(cache=True, nogil=True)
def _structure(context, owner):  # type: ignore[no-untyped-def]
    """(n, 5) 0..1 per cell and face; 1 where the context says the same of everything: it knows nothing."""
    known = context.max() > context.min()
    result = np.ones((len(owner), N_FACES))
    for c in range(len(owner)):
        for f in range(N_FACES):
            if known:
                result[c, f] = min(2.0 * context[owner[c], f], 1.0)
    return result


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
