"""Orientation maps, depth cues, features and the context model against truth and naive twins."""

from __future__ import annotations

import json
from pathlib import Path

import naive_evidence as naive
import numpy as np
import pytest

from room_layout_ros.core.config import EstimatorConfig
from room_layout_ros.core.evidence import pictures
from room_layout_ros.core.evidence.depth_cues import compute_depth_cues, superpixel_planes
from room_layout_ros.core.evidence.features import SuperpixelFeatures, compute_superpixel_features
from room_layout_ros.core.evidence.geometric_context import (
    ContextModel,
    compute_geometric_context,
    load_context,
    save_context,
)
from room_layout_ros.core.evidence.orientation_map import compute_orientation_map
from room_layout_ros.core.evidence.pixel_statistics import MEASURED, ORIENTATION, X, Z, sum_pixels
from room_layout_ros.core.evidence.surroundings import _neighbour_means, look_around
from room_layout_ros.core.forest import Forest
from room_layout_ros.core.frame import MAX_SIDE_PX, CameraIntrinsics
from room_layout_ros.core.layout import RoomCuboid
from room_layout_ros.core.lines import LineSegments, classify_segments
from room_layout_ros.core.model_file import WeightsError
from room_layout_ros.core.models import config_folder, model_file
from room_layout_ros.core.superpixels import Superpixels, compute_superpixels
from room_layout_ros.core.vanishing_points import _rotation
from room_layout_ros.datasets.folder import open_folder
from room_layout_ros.learning.context_table import look_at
from room_layout_ros.learning.scene_folds import SceneFolds

CAMERA = CameraIntrinsics(160, 120, 130.0, 130.0, 80.0, 60.0)
CONFIG = EstimatorConfig(superpixel_count=60)
R = _rotation(0.12, 0.02, 0.35)
Scene = tuple[np.ndarray, np.ndarray, np.ndarray, Superpixels]
ROOM = RoomCuboid(R, np.array([1.1, 0.8, 1.6, 2.8, 2.1]))


def _room_lines() -> LineSegments:
    """The twelve edges of the room, cut to the view."""
    c, f, left, front, right = ROOM.distances
    corners = np.array([[x, y, z] for x in (-left, right) for y in (-c, f) for z in (-1.0, front)])
    points = []
    for i in range(8):
        for j in range(i + 1, 8):
            if (corners[i] != corners[j]).sum() != 1:
                continue
            line = corners[i] + np.linspace(0, 1, 400)[:, None] * (corners[j] - corners[i])
            p = line @ R
            p = p[p[:, 2] > 0.05]
            q = p[:, :2] / p[:, 2:] * [CAMERA.fx, CAMERA.fy] + [CAMERA.cx, CAMERA.cy]
            q = q[(q >= 0).all(axis=1) & (q[:, 0] <= 159) & (q[:, 1] <= 119)]
            if len(q) > 3:
                points.append([*q[0], *q[-1]])
    return LineSegments(np.array(points, np.float32))


@pytest.fixture(scope="module")
def scene() -> Scene:
    faces, depth = ROOM.raster(CAMERA), ROOM.depth(CAMERA)
    inverse = (1.0 / depth).astype(np.float32)
    grain = np.random.default_rng(1).integers(0, 8, (120, 160, 1))
    color = (np.stack([faces * 40] * 3, axis=-1) + grain).astype(np.uint8)
    return faces, inverse, color, compute_superpixels(color, inverse, CONFIG)


def test_edges_of_an_empty_room_give_its_faces() -> None:
    lines = _room_lines()
    orientation = compute_orientation_map(lines, classify_segments(lines, R, CAMERA), R, CAMERA)
    named = orientation > 0
    assert named.mean() > 0.4
    assert (orientation == ROOM.raster(CAMERA))[named].mean() > 0.97


def test_sweeps_agree_with_looking_at_exact_segments(rng: np.random.Generator) -> None:
    ends = rng.uniform(5, [155, 115], (40, 2))
    kind = rng.integers(0, 3, 40).astype(np.int8)
    points = []
    for p, k in zip(ends, kind, strict=True):
        v = CAMERA.matrix @ R[k]
        direction = v[:2] - v[2] * p
        points.append([*p, *(p + direction / np.linalg.norm(direction) * rng.uniform(8, 30))])
    lines = LineSegments(np.array(points, np.float32))
    orientation = compute_orientation_map(lines, kind, R, CAMERA)
    pixels = rng.integers(4, [156, 116], (400, 2))
    exact = [naive.orientation_at(p.astype(float) + 0.01, lines.points, kind, R, CAMERA) for p in pixels]
    agree = orientation[pixels[:, 1], pixels[:, 0]] == np.array(exact)
    assert agree.mean() > 0.88  # the rest lies within a pixel of a segment or its shadow


def test_no_lines_leave_the_map_open_and_wrong_counts_are_refused() -> None:
    empty = LineSegments(np.empty((0, 4), np.float32))
    assert not compute_orientation_map(empty, np.empty(0, np.int8), R, CAMERA).any()
    with pytest.raises(ValueError, match="1 line classes"):
        compute_orientation_map(empty, np.zeros(1, np.int8), R, CAMERA)


def test_depth_cues_of_an_empty_room_are_exact(scene: Scene) -> None:
    faces, _, _, superpixels = scene
    cues = compute_depth_cues(superpixels, R, CAMERA)
    assert cues.shape == (superpixels.count, 12)
    assert (cues[:, 6:] >= 0).all()
    for i in range(superpixels.count):
        inside = np.unique(faces[superpixels.index == i])
        if len(inside) == 1 and superpixels.pixels[i] > 100:
            k = int(inside[0]) - 1
            assert cues[i, k] > np.cos(np.deg2rad(3.0))
            assert cues[i, 6 + k] < 0.1


def test_planes_of_superpixels_are_metric(scene: Scene) -> None:
    faces, _, _, superpixels = scene
    normal, distance, centroid = superpixel_planes(superpixels, CAMERA)
    x, y = np.rint(superpixels.center_px).astype(int).T
    for i in np.flatnonzero(superpixels.pixels > 100):
        if len(np.unique(faces[superpixels.index == i])) == 1:
            assert distance[i] == pytest.approx(ROOM.distances[faces[y[i], x[i]] - 1], rel=0.02)
            assert normal[i] @ centroid[i] == pytest.approx(distance[i], rel=1e-6)


def test_sums_over_pixels_equal_the_naive_ones(scene: Scene) -> None:
    _, inverse, color, superpixels = scene
    sums, bounds = sum_pixels(superpixels.index, superpixels.count, color, inverse, None, R, CAMERA)
    truth = naive.room_sums(superpixels.index, superpixels.count, inverse, R, CAMERA)
    assert np.array_equal(sums[:, MEASURED], truth[:, 0])
    assert np.allclose(sums[:, X : Z + 1], truth[:, 1:], rtol=1e-4, atol=2e-2)
    seen = sums[:, 0] > 0
    assert (bounds[seen, 1] >= bounds[seen, 0]).all()
    assert np.isnan(bounds[~seen]).all()


def test_orientations_are_counted_in_the_widest_image() -> None:
    """A run of 4096 pixels is more than its packed sums hold at once."""
    camera = CameraIntrinsics(MAX_SIDE_PX, 2, 500.0, 500.0, 4000.0, 1.0)
    index, faces = np.zeros((2, MAX_SIDE_PX), np.int32), np.full((2, MAX_SIDE_PX), 3, np.uint8)
    sums, _ = sum_pixels(index, 1, None, None, faces, np.eye(3), camera)
    assert sums[0, ORIENTATION : ORIENTATION + 6].tolist() == [0, 0, 0, MAX_SIDE_PX // 2, 0, 0]


def test_features_know_where_a_face_is(scene: Scene) -> None:
    faces, inverse, color, superpixels = scene
    features = compute_superpixel_features(superpixels, color, inverse, R, CAMERA)
    table = dict(zip(features.names, features.values.T, strict=True))
    of = np.array([np.bincount(faces[superpixels.index == i], minlength=6).argmax() for i in range(superpixels.count)])
    floor = of == 2
    assert floor.any()
    assert np.nanmedian(table["to_floor"][floor]) < 0.05
    assert np.nanmedian(table["cos_y"][floor]) > 0.99
    assert np.nanmax(table["behind_plane"]) < 0.05  # nothing lies behind the walls of an empty room


def test_columns_depend_on_depth_only_and_missing_colour_is_nan(scene: Scene) -> None:
    _, inverse, color, superpixels = scene
    both = compute_superpixel_features(superpixels, color, inverse, R, CAMERA)
    no_color = compute_superpixel_features(superpixels, None, inverse, R, CAMERA)
    rgb = compute_superpixel_features(superpixels, color, None, R, CAMERA)
    assert both.names == no_color.names
    assert set(rgb.names) < set(both.names)
    assert np.isnan(no_color.values[:, no_color.names.index("L")]).all()
    assert len(set(both.names)) == len(both.names)


def test_means_over_neighbours_equal_the_naive_ones(scene: Scene, rng: np.random.Generator) -> None:
    superpixels = scene[3]
    values = rng.normal(size=(superpixels.count, 4))
    values[rng.random(values.shape) < 0.3] = np.nan
    values[:, 3] = np.nan
    fast = _neighbour_means(values, superpixels.edges, superpixels.edge_length)
    truth = naive.neighbour_means(values, superpixels.edges, superpixels.edge_length)
    assert np.allclose(fast, truth, equal_nan=True)
    assert np.isnan(fast[:, 3]).all()


def test_looking_around_finds_the_superpixel_at_the_offset() -> None:
    x, y = (grid.ravel() for grid in np.meshgrid(np.arange(0.05, 1, 0.1), np.arange(0.05, 0.7, 0.1) / 0.75))
    columns = {"x": x, "y": y, "L": 10 * x, "a": np.zeros_like(x), "b": np.zeros_like(x), "gradient": y}
    found = look_around(columns, 0.75)
    right = found["right_L"][x < 0.8]
    assert np.allclose(right, 1.0)  # 0.12 widths away is the next superpixel, whose L is 1 more
    assert np.isnan(found["right_L"][x > 0.9]).all()
    inside = ~np.isnan(found["above_gradient"])
    assert np.allclose((y - found["above_gradient"])[inside], 0.1 / 0.75)


@pytest.mark.parametrize(
    ("scene", "depth", "limit"), [(True, True, 0.10), (True, False, 0.15), (False, True, 0.13), (False, False, 0.28)]
)
def test_shipped_context_tells_structure_from_clutter_on_frames_never_trained_on(
    data_root: Path, scene: bool, depth: bool, limit: float
) -> None:
    context_model = load_context(config_folder() / model_file("context", depth, scene))
    networks = SceneFolds(config_folder()) if scene else None
    names = json.loads((data_root / "nyuv2" / "splits.json").read_text())["layout_dev"][::4]
    folder = open_folder(data_root / "nyuv2")
    errors = []
    for name in names:
        sample = folder.read(f"{name:04d}")
        assert sample.truth is not None
        assert sample.truth.labels is not None
        seen = look_at(sample.frame, EstimatorConfig(use_depth=depth), networks)
        assert seen is not None
        clutter = compute_geometric_context(seen.features, context_model).argmax(axis=1)[seen.superpixels.index] == 5
        known = sample.truth.labels > 0
        errors.append((clutter != (sample.truth.labels == 6))[known].mean())
    assert np.mean(errors) < limit, np.mean(errors)


def _model(names: tuple[str, ...]) -> ContextModel:
    def stump(feature: int, values: tuple[float, float], outputs: int, output: int) -> Forest:
        return Forest(
            np.array([feature, -1, -1], np.int16),
            np.array([0.5, *values], np.float32),
            np.array([True, False, False]),
            np.array([1, 0, 0], np.int16),
            np.array([2, 0, 0], np.int16),
            np.array([0], np.int32),
            np.array([output], np.int16),
            np.zeros(outputs, np.float32),
        )

    return ContextModel(names, stump(0, (-4.0, 4.0), 1, 0), stump(1, (3.0, -3.0), 5, 1), {"note": "stumps"})


def test_context_is_a_distribution_with_columns_found_by_name(tmp_path: Path) -> None:
    model = _model(("a", "b"))
    values = np.array([[0.0, 0.0], [0.0, 1.0], [1.0, 0.0], [np.nan, np.nan]], np.float32)
    context = compute_geometric_context(SuperpixelFeatures(values, ("a", "b")), model)
    swapped = compute_geometric_context(SuperpixelFeatures(values[:, ::-1].copy(), ("b", "a")), model)
    assert np.array_equal(context, swapped)
    assert np.allclose(context.sum(axis=1), 1.0)
    assert context[0, 5] > 0.9
    assert context[2, 1] > 0.7
    save_context(model, tmp_path / "c.npz")
    again = load_context(tmp_path / "c.npz")
    assert again.card["note"] == "stumps"
    assert np.array_equal(compute_geometric_context(SuperpixelFeatures(values, ("a", "b")), again), context)


def test_damaged_or_foreign_context_files_are_refused(tmp_path: Path) -> None:
    path = tmp_path / "c.npz"
    with pytest.raises(WeightsError):
        load_context(path)
    save_context(_model(("a", "b")), path)
    content = path.read_bytes()
    path.write_bytes(content[: len(content) // 2])
    with pytest.raises(WeightsError):
        load_context(path)
    with pytest.raises(ValueError, match="feature b"):
        compute_geometric_context(SuperpixelFeatures(np.zeros((2, 1), np.float32), ("a",)), _model(("a", "b")))


def test_pictures_have_the_size_of_the_image(scene: Scene) -> None:
    _, _, color, superpixels = scene
    lines = _room_lines()
    context = np.eye(6)[np.arange(superpixels.count) % 6]
    classes = classify_segments(lines, R, CAMERA)
    drawn = pictures.draw_lines(color, lines, classes, R, CAMERA)
    assert drawn.shape == color.shape
    assert not np.array_equal(drawn, pictures.draw_pencils(color // 2, R, CAMERA)), "segments besides the pencils"
    assert pictures.draw_orientation(None, np.full((120, 160), 2, np.uint8))[0, 0].tolist() == [90, 200, 90]
    assert pictures.draw_context(color, superpixels, context).shape == color.shape
    assert pictures.draw_depth_cues(superpixels, np.zeros((superpixels.count, 12))).shape == (240, 960, 3)
