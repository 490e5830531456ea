"""The joint problem of a frame under one naming of the axes, gathered from its evidence (docs/method.md, section 6)."""

from __future__ import annotations

from dataclasses import dataclass
from typing import NamedTuple

import numpy as np
from numba import njit
from numpy.typing import NDArray

from .cell_counts import CellCounts, count_samples, lattice_shear, sample_lattice
from .config import EstimatorConfig
from .depth import CELL_PX, DepthGeometry
from .depth_cells import DepthCells, gather_depth_cells
from .depth_profiles import DepthProfiles, compute_depth_profiles
from .frame import CameraIntrinsics
from .frame_evidence import SAME_NAMES, FrameEvidence
from .labels import N_FACES, N_LABELS
from .plane_fit import PlaneFit, compute_plane_fit
from .ray_grid import compute_ray_grid
from .superpixel_relations import compare_neighbours, compute_relations
from .superpixels import Superpixels

_N_ORIENTATIONS = N_FACES + 1
N_LAYOUT_FEATURES = N_FACES + N_LABELS + N_FACES
"""Of an atom: orientation map, geometric context, layout by the scene network."""
_MAX_CUE_M = 3.0
"""The distances of the depth cues are cut here: the energy is linear in them, and corridors are long."""


@dataclass(frozen=True, slots=True)
class JointProblem:
    """All evidence of one frame under one naming of the axes.

    Attributes
    ----------
    counts : CellCounts
        Of the atoms; an atom lies in one superpixel and all its pixels have one orientation.
    atom_superpixel : (A,) int32.
    atom_feature : (A, 16) float64, per pixel of the atom: orientation map (5, one-hot), geometric context (6), layout
        by the scene network (5; 0 without it).
    atom_region : (A,) uint8, the true face in learning, else 0.
    label_gc : (K, 6) float64 probabilities of geometric context.
    label_om : (K, 5) float64 share of each superpixel's pixels per orientation.
    label_depth : (K, 12) float64 six cosines and six distances, each in the order of the labels (paper 3.2); 0 without
        depth.
    edges : (E, 2) int32 touching superpixels i < j.
    contact : (E,) float64 length of the border times the mean side of a superpixel, share of the image.
    relation : (E, 6) float64 0..1: i is above, below, right of, left of, in front of (farther), behind j.
    smoothness : (E, 3) float64 0..1: 1, likeness of colour, likeness of plane.
    profiles : depth support and violation per plane offset, None without depth.
    fit : offsets of the superpixels along the normals, None without depth.
    front_axis : 0..1, how far the front wall's axis is turned away from the camera's.
    """

    counts: CellCounts
    atom_superpixel: NDArray[np.int32]
    atom_feature: NDArray[np.float64]
    atom_region: NDArray[np.uint8]
    label_gc: NDArray[np.float64]
    label_om: NDArray[np.float64]
    label_depth: NDArray[np.float64]
    edges: NDArray[np.int32]
    contact: NDArray[np.float64]
    relation: NDArray[np.float64]
    smoothness: NDArray[np.float64]
    profiles: DepthProfiles | None
    fit: PlaneFit | None
    front_axis: float = 0.0

    def __post_init__(self) -> None:
        atoms, nodes, edges = len(self.counts.pixels), len(self.label_gc), len(self.edges)
        expected = {
            "atom_superpixel": (atoms,),
            "atom_feature": (atoms, N_LAYOUT_FEATURES),
            "atom_region": (atoms,),
            "label_gc": (nodes, N_LABELS),
            "label_om": (nodes, N_FACES),
            "label_depth": (nodes, 12),
            "edges": (edges, 2),
            "contact": (edges,),
            "relation": (edges, 6),
            "smoothness": (edges, 3),
        }
        for name, shape in expected.items():
            array = getattr(self, name)
            if array.shape != shape:
                raise ValueError(f"{name} of the joint problem has shape {array.shape}; {shape} is needed")
            if array.dtype.kind == "f" and not np.isfinite(array).all():
                raise ValueError(f"{name} of the joint problem holds a value that is not finite")

    @property
    def pixels(self) -> float:
        """Number of pixels counted; the unit of all shares."""
        return float(self.counts.pixels.sum())

    @property
    def area(self) -> NDArray[np.float64]:
        """(K,) share of the image per superpixel."""
        return np.bincount(self.atom_superpixel, self.counts.pixels, len(self.label_gc)) / self.pixels

    @property
    def scales(self) -> NDArray[np.float64]:
        """(C,) candidate distances of the front wall in m; [1] where depth is not known."""
        return self.profiles.scales if self.profiles is not None else np.ones(1)

    def by_superpixel(self, per_atom: NDArray[np.float64]) -> NDArray[np.float64]:
        """Sum (A, n) values over the atoms of each superpixel: (K, n)."""
        return _sum_by(np.ascontiguousarray(per_atom), self.atom_superpixel, len(self.label_gc))


@njit(cache=True, nogil=True)
def _sum_by(values, group, groups):  # type: ignore[no-untyped-def]
    result = np.zeros((groups, values.shape[1]))
    for a in range(len(values)):
        for k in range(values.shape[1]):
            result[group[a], k] += values[a, k]
    return result


class AtomCounts(NamedTuple):
    """Pixels of each atom per cell of a ray grid, and the atoms' numbers.

    Attributes
    ----------
    counts : CellCounts. number : (A,) (superpixel x 6 + orientation) x 6 + region, of what divides the superpixels.
    """

    counts: CellCounts
    number: NDArray[np.intp]


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
        smoothness=compare_neighbours(superpixels, geometry is not None),
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
    feature = np.zeros((atoms, N_LAYOUT_FEATURES))
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
