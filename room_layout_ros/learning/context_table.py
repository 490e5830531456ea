"""The training table of the geometric context: features and true labels of the superpixels of many frames."""

from __future__ import annotations

from collections.abc import Iterable, Mapping, Sequence
from dataclasses import dataclass, replace
from typing import NamedTuple

import numpy as np
from numpy.typing import NDArray

from ..core.config import EstimatorConfig
from ..core.estimate import Status
from ..core.evidence.features import SuperpixelFeatures
from ..core.frame import RgbdFrame
from ..core.labels import STRUCTURE_NYU40
from ..core.layout import RoomCuboid
from ..core.observation import Observation, no_scene, observe
from ..datasets.sample import Sample
from .degradation import degrade_depth
from .folds import SYNTHETIC_FIRST, frame_number
from .scene_folds import SceneFolds
from .superpixel_truth import class_histogram, label_histogram, true_labels
from .working_sample import at_working_size


@dataclass(frozen=True, slots=True)
class ContextTable:
    """Rows are superpixels.

    Attributes
    ----------
    features : (n, F) float32 and names. labels : (n, 7) float32 pixels per label id; walls (3..5) only where the
        room of the frame is known, otherwise structure stands under 0. structure : (n,) float32 structural pixels.
    classes : (n, 41) float32 pixels per NYU40 id. frame : (n,) int64 number of the frame (blocks and margins
        of cross-validation are in it). variant : (n,) int8, 0 as recorded, 1.. degraded, -1 synthetic.
    """

    features: NDArray[np.float32]
    names: tuple[str, ...]
    labels: NDArray[np.float32]
    structure: NDArray[np.float32]
    classes: NDArray[np.float32]
    frame: NDArray[np.int64]
    variant: NDArray[np.int8]

    @property
    def pixels(self) -> NDArray[np.float32]:
        """(n,) labelled pixels of each superpixel."""
        return self.classes[:, 1:].sum(axis=1)


class TablePart(NamedTuple):
    """The rows of one frame, and its columns `frame` and `variant`."""

    features: SuperpixelFeatures
    labels: NDArray[np.float32]
    classes: NDArray[np.float32]
    frame: int
    variant: int = 0


def stack(parts: Sequence[TablePart]) -> ContextTable:
    """Put the rows of frames with the same features one below the other.

    Raises
    ------
    ValueError
        When there is no frame.
    """
    if not parts:
        raise ValueError("no frame with class labels and usable axes is among the samples; at least one is needed")
    structural = np.zeros(41, np.float32)
    structural[list(STRUCTURE_NYU40)] = 1.0
    classes = np.concatenate([part.classes for part in parts])
    sizes = [len(part.labels) for part in parts]
    return ContextTable(
        features=np.concatenate([part.features.values for part in parts]),
        names=parts[0].features.names,
        labels=np.concatenate([part.labels for part in parts]),
        structure=classes @ structural,
        classes=classes,
        frame=np.repeat(np.array([part.frame for part in parts], np.int64), sizes),
        variant=np.repeat(np.array([part.variant for part in parts], np.int8), sizes),
    )


def join_tables(tables: Sequence[ContextTable]) -> ContextTable:
    """Put tables of the same features one below the other.

    Raises
    ------
    ValueError
        When their features differ.
    """
    if len({table.names for table in tables}) != 1:
        raise ValueError(f"{len(tables)} tables have different features; one set of names is needed")
    fields = (name for name in ContextTable.__slots__ if name != "names")
    arrays = {name: np.concatenate([getattr(table, name) for table in tables]) for name in fields}
    return ContextTable(names=tables[0].names, **arrays)


def collect_table(
    samples: Iterable[Sample],
    rooms: Mapping[str, RoomCuboid],
    config: EstimatorConfig,
    degraded_every: int = 1,
    seed: int = 0,
    synthetic: bool = False,
    networks: SceneFolds | None = None,
) -> ContextTable:
    """Compute features and truth of labelled frames; `config.use_depth` decides between RGB-D and RGB.

    Parameters
    ----------
    samples : with NYU40 labels; others are left out. The frame's number is `folds.frame_number`.
    rooms : fitted rooms by frame name; a frame without one teaches structure against clutter only.
    degraded_every : every how many-th labelled frame, the first among them, comes a second time with degraded depth
        (`degrade_depth`), if there is depth; 0 for none. By its place, not its number: a video may hold every second
        number alone. The number seeds the noise, so that it stays the frame's whatever frames are beside it.
    synthetic : the samples are synthetic: their rooms are known, their numbers start at `SYNTHETIC_FIRST`.
    networks : scene networks whose features to add.
    """
    parts = []
    place = -1
    for ordinal, sample in enumerate(at_working_size(one, config) for one in samples):
        if sample.truth is None or sample.truth.labels40 is None:
            continue
        place += 1
        number = ordinal + SYNTHETIC_FIRST if synthetic else frame_number(sample.name, ordinal)
        room = sample.truth.cuboid if synthetic else rooms.get(sample.name)
        twice = config.use_depth and degraded_every > 0 and place % degraded_every == 0
        for variant in range(1 + twice):
            frame = sample.frame
            if variant and frame.depth_m is not None:
                rng = np.random.default_rng((seed, number, variant))
                frame = replace(frame, depth_m=degrade_depth(frame.depth_m, rng))
            seen = look_at(frame, config, networks)
            if seen is None:
                continue
            superpixels = seen.superpixels
            classes = class_histogram(superpixels.index, superpixels.count, sample.truth.labels40)
            labels = np.zeros((superpixels.count, 7), np.float32)
            if room is not None:
                truth = true_labels(room, room.raster(frame.camera), sample.truth.labels40, seen.axes.R_room_camera)
                labels = label_histogram(superpixels.index, superpixels.count, truth)
            parts.append(TablePart(seen.features, labels, classes, number, -1 if synthetic else variant))
    return stack(parts)


def look_at(frame: RgbdFrame, config: EstimatorConfig, networks: SceneFolds | None = None) -> Observation | None:
    """Run the stages before the learned parts; None where the estimator would give up or wanted depth is missing."""
    seen = observe(frame, config, no_scene if networks is None else networks.look)
    return None if isinstance(seen, Status) or (config.use_depth and seen.geometry is None) else seen
