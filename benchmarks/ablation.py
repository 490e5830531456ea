"""What each part of the method gives: the estimator without it, on the frames with hand-made layouts.

ROOM_LAYOUT_EVERY=n with ROOM_LAYOUT_FITS=DIR takes instead every n-th other frame that has a fit in DIR
(`room-layout fit`). Those were in training, so what they say about learned parts is too good, but for the frames within
`folds.MARGIN` numbers of a hand-made one: they were left out of training; ROOM_LAYOUT_UNTRAINED=1 takes only those.
ROOM_LAYOUT_ROWS=A,B leaves the full model and the rows whose titles begin with A or B.

Stages before the joint model are computed once per frame and set of settings that they depend on; the time of a row
is the median of all its stages, shared ones included; on a quiet machine it means something.
"""

from __future__ import annotations

import os
import sys
import time
from collections.abc import Iterator
from dataclasses import dataclass, replace
from pathlib import Path

import cv2
import numpy as np
from numpy.typing import NDArray

from benchmarks._frames import DATA
from room_layout_ros.core.config import DEPTH, JOINT_VARIANTS, EstimatorConfig
from room_layout_ros.core.cuboid_refinement import refine_cuboid
from room_layout_ros.core.depth import compute_depth_geometry
from room_layout_ros.core.depth_estimator import estimate_from_depth
from room_layout_ros.core.estimate import Status
from room_layout_ros.core.frame import RgbdFrame
from room_layout_ros.core.hypotheses import classify_superpixels, gather_hypotheses
from room_layout_ros.core.joint import estimate_joint
from room_layout_ros.core.labels import CLUTTER
from room_layout_ros.core.layout import RoomCuboid
from room_layout_ros.core.manhattan import find_axes
from room_layout_ros.core.models import Models, load_models, load_scene_network, looks_at_scene
from room_layout_ros.core.network.scene_network import compute_scene_scores
from room_layout_ros.core.observation import Observation, observe
from room_layout_ros.core.superpixels import Superpixels
from room_layout_ros.core.tracking import TemporalPrior
from room_layout_ros.core.weights import BLOCKS, ModelWeights, start_weights, uses
from room_layout_ros.datasets import FramesFolder, FrameTruth, Sample, good_samples, open_folder
from room_layout_ros.evaluation.baselines import percentile_walls
from room_layout_ros.evaluation.measures import score_pixels
from room_layout_ros.learning.fit_frame import read_fits
from room_layout_ros.learning.folds import is_near

Image = NDArray[np.uint8]


@dataclass(frozen=True, slots=True)
class Variant:
    """One row: the estimator with something else.

    `off` are blocks of the weights set to 0, `by_hand` takes the weights it was started with.
    """

    title: str
    config: EstimatorConfig = EstimatorConfig()
    off: tuple[str, ...] = ()
    by_hand: bool = False
    refined: bool = True
    lines_in_axes: bool = True

    def weights(self, models: Models) -> ModelWeights:
        return (start_weights() if self.by_hand else models.joint).without(*self.off)


@dataclass(frozen=True, slots=True)
class Stages:
    """What comes before the joint model; `milliseconds` it took."""

    seen: Observation
    context: NDArray[np.float64] | None
    milliseconds: float


@dataclass(frozen=True, slots=True)
class Row:
    """Layout and labels of a frame by one variant; `discrete` is the layout before the refinement."""

    layout: Image
    labels: Image
    discrete: Image | None
    milliseconds: float


def variants() -> list[Variant]:
    """Rows of the table but for the two plain solutions."""
    plain = EstimatorConfig()
    rgb = replace(plain, use_depth=False)
    return [
        Variant("full model"),
        Variant("no scene network (own learned models)", replace(plain, scene_network=False)),
        Variant("RGB only (own learned weights)", rgb),
        Variant("RGB only, no scene network (own learned models)", replace(rgb, scene_network=False)),
        Variant("RGB only, weights set by hand", rgb, by_hand=True),
        Variant("RGB only, no refinement", rgb, refined=False),
        Variant("RGB only, by hand, no refinement", rgb, by_hand=True, refined=False),
        Variant("RGB only, two namings", replace(rgb, axes_hypotheses_rgb=2)),
        *(Variant(f"variant {name}", replace(plain, joint_variant=name)) for name in JOINT_VARIANTS if name != "full"),
        *(Variant(f"without block {name}", off=(name,)) for name in BLOCKS),
        Variant("weights set by hand", by_hand=True),
        Variant("weights by hand, no refinement", by_hand=True, refined=False),
        Variant("no refinement", refined=False),
        Variant("refinement by depth alone", replace(plain, refinement=DEPTH)),
        Variant("superpixels without depth", replace(plain, superpixel_lambda_depth=0.0)),
        Variant("axes without lines", lines_in_axes=False),
        Variant("one naming of the axes", replace(plain, axes_hypotheses=1)),
        Variant("two namings of the axes", replace(plain, axes_hypotheses=2)),
        Variant("one alternation from one start", replace(plain, joint_alternations=1, joint_starts=1)),
    ]


def main() -> int:
    if not (DATA / "nyuv2" / "splits.json").exists():
        print(f"{DATA / 'nyuv2'} is not here: nothing to measure")
        return 0
    cv2.setNumThreads(1)
    folder = open_folder(DATA / "nyuv2")
    dev = tuple(p.stem for p in sorted((DATA / "nyuv2" / "layout").glob("*.png")))
    every, fits = int(os.environ.get("ROOM_LAYOUT_EVERY", "0")), os.environ.get("ROOM_LAYOUT_FITS")
    if every > 0 and fits:
        untrained = os.environ.get("ROOM_LAYOUT_UNTRAINED") == "1"
        kind = "left out of training" if untrained else "most of them of the training"
        _table(f"every {every}th fitted layout, {kind}", _fitted(folder, dev, Path(fits), every, untrained))
    else:
        _table("hand-made layouts", good_samples(folder.subset(dev)))
    return 0


def _fitted(folder: FramesFolder, dev: tuple[str, ...], fits: Path, every: int, untrained: bool) -> Iterator[Sample]:
    rooms = read_fits(fits)
    names = [name for name in sorted(rooms) if name not in dev]
    if untrained:
        names = [name for name, near in zip(names, is_near(names, dev), strict=True) if near]
    for sample in good_samples(folder.subset(tuple(names[::every]))):
        layout = rooms[sample.name].raster(sample.frame.camera)
        labels40 = None if sample.truth is None else sample.truth.labels40
        yield replace(sample, truth=FrameTruth(layout=layout, labels40=labels40))


def _table(title: str, samples: Iterator[Sample]) -> None:
    wanted = tuple(os.environ.get("ROOM_LAYOUT_ROWS", "").split(","))
    rows = [row for row in variants() if row.title.startswith(("full model", *wanted))]
    errors: dict[str, list[tuple[float, float, float, float]]] = {}
    count = 0
    for sample in samples:
        if not count:
            for variant in rows[:2]:  # the first call compiles or loads the kernels
                _apply(variant, sample.frame, {})
        count += 1
        cache: dict[object, Stages | None] = {}
        for variant in rows:
            errors.setdefault(variant.title, []).append(_score(sample, _apply(variant, sample.frame, cache)))
        errors.setdefault("simple depth estimator", []).append(_score(sample, _simple(sample.frame)))
        errors.setdefault("walls at the 98th percentile", []).append(_score(sample, _percentile(sample)))
    _show(title, count, {name: np.array(values) for name, values in errors.items()})


def _show(title: str, count: int, errors: dict[str, NDArray[np.float64]]) -> None:
    full = errors["full model"]
    print(f"\n{title}: {count} frames; percent, wall names permuted; ± is the standard error of the mean difference")
    print("| | layout | median | to full | before refinement | labelling | to full | ms |")
    print("|---|---|---|---|---|---|---|---|")
    for name, table in errors.items():
        layout, labelling, discrete, _ = np.mean(table, axis=0)
        milliseconds = np.median(table[:, 3])
        before = "" if np.isnan(discrete) else f"{100 * discrete:.1f}"
        print(
            f"| {name} | {100 * layout:.1f} | {100 * np.median(table[:, 0]):.1f} | {_difference(table, full, 0)} "
            f"| {before} | {100 * labelling:.1f} | {_difference(table, full, 1)} | {milliseconds:.0f} |"
        )


def _difference(table: NDArray[np.float64], full: NDArray[np.float64], column: int) -> str:
    if table is full:
        return ""
    apart = 100 * (table[:, column] - full[:, column])
    return f"{apart.mean():+.1f} ± {apart.std(ddof=1) / np.sqrt(len(apart)):.1f}"


def _score(sample: Sample, row: Row | None) -> tuple[float, float, float, float]:
    truth = sample.truth
    assert truth is not None
    assert truth.layout is not None
    if row is None:  # no answer is wrong in every pixel
        return 1.0, 1.0, 1.0, np.nan
    whole = score_pixels(truth.layout, row.layout, truth.labels, row.labels)
    before = np.nan if row.discrete is None else score_pixels(truth.layout, row.discrete).layout_error
    return whole.layout_error, whole.labelling_error, before, row.milliseconds


def _apply(variant: Variant, frame: RgbdFrame, cache: dict[object, Stages | None]) -> Row | None:
    config = variant.config
    evidence_of = tuple(uses(config.joint_variant, f"layout_{kind}") for kind in ("om", "gc", "scene"))
    key = (config.use_depth, config.superpixel_lambda_depth, config.scene_network, variant.lines_in_axes, evidence_of)
    if key not in cache:
        cache[key] = _prepare(frame, config, variant.lines_in_axes)
    stages = cache[key]
    if stages is None:
        return None
    start = time.perf_counter()
    seen, context, camera = stages.seen, stages.context, frame.camera
    evidence = gather_hypotheses(seen, context, camera, config.namings(seen.geometry is not None))
    weights = variant.weights(load_models(*seen.way))
    joint = estimate_joint(camera, seen.superpixels, evidence, seen.geometry, weights, config, first=seen.parts)
    room = joint.cuboid
    if variant.refined:
        room = refine_cuboid(joint, seen, context, frame, config.refinement).cuboid
    layout, labels = _paint(room, joint.labels, seen.superpixels, frame)
    milliseconds = stages.milliseconds + 1e3 * (time.perf_counter() - start)
    return Row(layout, labels, joint.cuboid.raster(camera), milliseconds)


def _paint(
    room: RoomCuboid, labels: NDArray[np.uint8], superpixels: Superpixels, frame: RgbdFrame
) -> tuple[Image, Image]:
    """Return layout and label image as `conclude` makes them, but for the names of the walls (scores permute them)."""
    layout = room.raster(frame.camera)
    return layout, np.where((labels == CLUTTER)[superpixels.index], np.uint8(CLUTTER), layout)


def _prepare(frame: RgbdFrame, config: EstimatorConfig, lines_in_axes: bool) -> Stages | None:
    """Run the stages of `LayoutEstimator.estimate` up to the geometric context."""
    start = time.perf_counter()
    axes = None
    if not lines_in_axes:
        axes = find_axes(compute_depth_geometry(frame, config), None, frame.camera, config, TemporalPrior())
    network = load_scene_network() if looks_at_scene(config) else None
    seen = observe(frame, config, lambda one: compute_scene_scores(one.color, network), axes=axes)
    if isinstance(seen, Status):
        return None
    forest = load_models(*seen.way).context
    context = classify_superpixels(seen.features, forest, config.joint_variant)
    return Stages(seen, context, 1e3 * (time.perf_counter() - start))


def _simple(frame: RgbdFrame) -> Row | None:
    start, config = time.perf_counter(), EstimatorConfig()
    seen = observe(frame, config)
    if isinstance(seen, Status) or seen.geometry is None:
        return None
    found = estimate_from_depth(frame, seen.geometry, seen.axes, seen.superpixels, {})
    return Row(found.layout, found.labels, None, 1e3 * (time.perf_counter() - start))


def _percentile(sample: Sample) -> Row:
    start = time.perf_counter()
    found = percentile_walls(sample)
    return Row(found.layout, found.labels, None, 1e3 * (time.perf_counter() - start))


if __name__ == "__main__":
    sys.exit(main())
