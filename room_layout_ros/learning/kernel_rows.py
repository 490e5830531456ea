"""What furniture by kernel descriptors is learned from: visual words, and described superpixels of labelled frames."""

from __future__ import annotations

from collections.abc import Iterable
from dataclasses import dataclass, replace

import numpy as np
from numpy.typing import NDArray

from ..core.config import EstimatorConfig
from ..core.depth import compute_depth_geometry
from ..core.evidence.color_patches import patch_centers
from ..core.evidence.kernel_descriptors import DESCRIPTORS, DescriptorModel, describe_patches
from ..core.evidence.match_kernels import CompactBasis, Floats, compact_basis, standard_kernels
from ..core.frame import RgbdFrame
from ..core.kernel_furniture import describe_clutter
from ..core.labels import FURNITURE_IDS, STRUCTURE_NYU40
from ..core.superpixels import Superpixels, compute_superpixels
from ..datasets.sample import Sample
from .degradation import degrade_depth
from .superpixel_truth import class_histogram
from .working_sample import at_working_size

_LEAST_PX = 50
"""Labelled pixels of a superpixel that is learned from."""


@dataclass(frozen=True, slots=True)
class WordSettings:
    """How visual words are made.

    Attributes
    ----------
    words, components : clusters of each descriptor, and components kept of the kernel between them.
    sharpness : of that kernel, exp(-sharpness d^2 / mean d^2). patches : of each frame, at most. seed : of the choice.
    """

    words: int = 100
    components: int = 60
    sharpness: float = 3.0
    patches: int = 150
    seed: int = 0


def learn_words(samples: Iterable[Sample], settings: WordSettings) -> DescriptorModel:
    """Cluster the descriptors of random patches of clutter.

    Raises
    ------
    ValueError
        When there are fewer patches with a descriptor than words.
    """
    kernels, rng = standard_kernels(), np.random.default_rng(settings.seed)
    found: dict[str, list[Floats]] = {name: [] for name in DESCRIPTORS}
    for sample in (at_working_size(one, EstimatorConfig()) for one in samples):
        if sample.frame.color is None or sample.truth is None or sample.truth.labels40 is None:
            continue
        centers = patch_centers(*sample.frame.color.shape[:2])
        labels = sample.truth.labels40[centers[:, 0], centers[:, 1]]
        centers = centers[(labels > 0) & ~np.isin(labels, list(STRUCTURE_NYU40))]
        chosen = np.sort(rng.permutation(len(centers))[: settings.patches])
        geometry = compute_depth_geometry(sample.frame, EstimatorConfig())
        for name, rows in describe_patches(sample.frame.color, geometry, centers[chosen], kernels).items():
            found[name].append(rows[np.isfinite(rows[:, 0])])
    return DescriptorModel(kernels, {name: _cluster(name, found[name], settings) for name in DESCRIPTORS})


def _cluster(name: str, parts: list[Floats], settings: WordSettings) -> CompactBasis:
    from sklearn.cluster import KMeans
    from threadpoolctl import threadpool_limits

    rows = np.concatenate(parts) if parts else np.zeros((0, 1), np.float32)
    if len(rows) < settings.words:
        raise ValueError(f"{len(rows)} patches of clutter have {name}; {settings.words} words need as many at least")
    with threadpool_limits(1):  # the order in which threads add up would show in the last digits
        clusters = KMeans(settings.words, n_init=1, max_iter=30, random_state=settings.seed).fit(rows)
    mean_squared = 2.0 * float(rows.var(axis=0, dtype=np.float64).sum())
    return compact_basis(clusters.cluster_centers_, settings.sharpness / mean_squared, settings.components)


@dataclass(frozen=True, slots=True)
class ClutterRows:
    """The clutter superpixels of one frame.

    Attributes
    ----------
    name : of the frame. degraded : whether its depth was. superpixels : without their index.
    clutter : (K,) bool, by the truth. features : (K, n D) float32, NaN for the others.
    counts : (K, 7) float32 pixels of each furniture class and of other clutter, 0 for the others.
    """

    name: str
    degraded: bool
    superpixels: Superpixels
    clutter: NDArray[np.bool_]
    features: Floats
    counts: Floats


def collect_rows(
    samples: Iterable[Sample], model: DescriptorModel, config: EstimatorConfig, degraded_every: int, seed: int
) -> list[ClutterRows]:
    """Describe the clutter of labelled frames with colour; others are left out.

    Parameters
    ----------
    config : `use_depth` False describes frames, and cuts them into superpixels, without depth.
    degraded_every : every how many-th frame comes a second time with degraded depth (`degrade_depth`); 0 for none.
    """
    rows = []
    for k, sample in enumerate(at_working_size(one, config) for one in samples):
        if sample.frame.color is None or sample.truth is None or sample.truth.labels40 is None:
            continue
        rows.append(_frame_rows(sample.frame, sample.truth.labels40, model, config, degraded=False))
        depth_m = sample.frame.depth_m
        if config.use_depth and depth_m is not None and degraded_every > 0 and k % degraded_every == 0:
            frame = replace(sample.frame, depth_m=degrade_depth(depth_m, np.random.default_rng((seed, k))))
            rows.append(_frame_rows(frame, sample.truth.labels40, model, config, degraded=True))
    return rows


def _frame_rows(
    frame: RgbdFrame, labels40: NDArray[np.uint8], model: DescriptorModel, config: EstimatorConfig, degraded: bool
) -> ClutterRows:
    geometry = compute_depth_geometry(frame, config)
    inverse_depth = None if geometry is None else geometry.inverse_depth
    superpixels = compute_superpixels(frame.color, inverse_depth, config)
    classes = class_histogram(superpixels.index, superpixels.count, labels40)
    pixels, structure = classes[:, 1:].sum(axis=1), classes[:, list(STRUCTURE_NYU40)].sum(axis=1)
    clutter = (structure < 0.5 * pixels) & (pixels > _LEAST_PX)
    named = classes[:, list(FURNITURE_IDS)]
    other = np.maximum(pixels - structure - named.sum(axis=1), 0.0)
    counts = np.where(clutter[:, None], np.column_stack([named, other]), 0.0).astype(np.float32)
    features = describe_clutter(frame.color, geometry, superpixels, clutter, model)
    bare = replace(superpixels, index=np.zeros((0, 0), np.int32))
    return ClutterRows(frame.name, degraded, bare, clutter, features, counts)
