"""Superpixels against analytic scenes, naive twins and real frames."""

from __future__ import annotations

import dataclasses
import re
from pathlib import Path

import cv2
import naive_superpixels as naive
import numpy as np
import pytest
from numpy.typing import NDArray

from room_layout_ros.core.color import blank_border, compute_lab
from room_layout_ros.core.config import EstimatorConfig
from room_layout_ros.core.superpixel_assignment import CAP, KW, N_CENTER, assign, candidates_of_tiles
from room_layout_ros.core.superpixel_connectivity import connect, expand, moments_of_frame, regroup_edges
from room_layout_ros.core.superpixel_merging import merge_superpixels
from room_layout_ros.core.superpixel_sums import N_SUMS, accumulate, plane_of_sums, plane_sse
from room_layout_ros.core.superpixels import Superpixels, _merge_weights, compute_superpixels
from room_layout_ros.evaluation.segmentation import segmentation_scores

SMALL = EstimatorConfig(superpixel_count=24)
NO_GRADIENT = np.zeros((2, 1, 1), np.float32)


def three_walls(rng: np.random.Generator, height: int = 120, width: int = 160) -> tuple[NDArray[np.float32], ...]:
    """Return inverse depth and face (1..3) of a corner: the nearest of three planes, with a sensor's noise."""
    y, x = np.mgrid[:height, :width].astype(np.float32)
    planes = [0.45 - 0.0025 * x, 0.15 + 0.0022 * x, 0.05 + 0.0034 * y]
    w = np.max(planes, axis=0) + rng.normal(0, 0.001, (height, width))
    return w.astype(np.float32), (np.argmax(planes, axis=0) + 1).astype(np.float32)


def noise_image(rng: np.random.Generator, height: int, width: int) -> NDArray[np.uint8]:
    coarse = rng.integers(0, 256, (height // 8 + 1, width // 8 + 1, 3), dtype=np.uint8)
    return np.asarray(cv2.resize(coarse, (width, height), interpolation=cv2.INTER_CUBIC), np.uint8)


def check_partition(s: Superpixels, height: int, width: int) -> None:
    """Every promise of `Superpixels` that can be counted."""
    assert s.index.shape == (height, width)
    assert s.index.dtype == np.int32
    np.testing.assert_array_equal(np.unique(s.index), np.arange(s.count))
    assert naive.connected_pieces(s.index).max() + 1 == s.count, "a superpixel is in pieces"
    np.testing.assert_array_equal(s.pixels, np.bincount(s.index.ravel()))
    y, x = np.mgrid[:height, :width]
    for axis, grid in enumerate((x, y)):
        mean = np.bincount(s.index.ravel(), grid.ravel()) / s.pixels
        np.testing.assert_allclose(s.center_px[:, axis], mean, atol=1e-3)
    expected = naive.borders(s.index)
    np.testing.assert_array_equal(s.edges, np.array(list(expected), np.int32).reshape(-1, 2))
    np.testing.assert_array_equal(s.edge_length, list(expected.values()))


# --- the kernels and their twins -------------------------------------------------------------------------------------


@pytest.mark.parametrize(("step", "row_px"), [(1, 1), (2, 1), (4, 1), (1, 2), (2, 2)])
def test_every_pixel_goes_to_the_candidate_of_least_energy(rng: np.random.Generator, step: int, row_px: int) -> None:
    height, width = 45, 70  # no multiples of the tile
    lab = rng.integers(90, 160, (3, height, width), dtype=np.uint8)
    w = rng.uniform(0.2, 0.6, (height, width)).astype(np.float32)
    w[rng.random(w.shape) < 0.2] = 0
    centers = np.zeros((30, N_CENTER), np.float32)
    centers[:, :2] = rng.uniform((0, 0), (width, height * row_px), (30, 2))
    centers[:, 2:5] = rng.uniform((35, -30, -30), (60, 30, 30), (30, 3))
    centers[:, 5:7] = rng.normal(0, 0.002, (30, 2))
    centers[:, 7] = rng.uniform(0.2, 0.6, 30)
    centers[:, KW], centers[:, CAP] = 400.0, 5.0
    weights = (1 / 15.0**2, 0.02, 1.0, 0.0)
    lists, count = candidates_of_tiles(centers, 25.0, height, width, step, row_px)
    index = np.full((height, width), -1, np.int32)
    phase = step // 2
    assign(lab, w, NO_GRADIENT, centers, lists, count, step, row_px, weights, index)

    real = np.stack([lab[0] * (100 / 255), lab[1] - 128.0, lab[2] - 128.0])
    table = naive.energies(real, w.astype(float), centers.astype(float), weights, row_px)
    across = -(-width // 16)
    for y in range(height):
        for x in range(width):
            if y % step != phase:
                assert index[y, x] == -1, "a row left out was written"
                continue
            tile = (y // (8 * step)) * across + x // 16
            best = table[lists[tile, : count[tile]], y, x].min()
            assert table[index[y, x], y, x] <= best + 2e-4  # steps of 2^-14 and float32


def test_candidates_are_the_centres_within_reach_and_never_none(rng: np.random.Generator) -> None:
    centers = np.zeros((12, N_CENTER), np.float32)
    centers[:, :2] = rng.uniform((0, 0), (60, 60), (12, 2))
    lists, count = candidates_of_tiles(centers, 20.0, 64, 160, 1, 1)
    for tile in range(len(lists)):
        left, top = tile % 10 * 16, tile // 10 * 8
        dx = np.maximum(0, np.maximum(left - centers[:, 0], centers[:, 0] - left - 16))
        dy = np.maximum(0, np.maximum(top - centers[:, 1], centers[:, 1] - top - 8))
        near = np.flatnonzero(np.hypot(dx, dy) <= 20.0)
        if len(near):
            np.testing.assert_array_equal(lists[tile, : count[tile]], near)
        else:
            far = np.hypot(centers[:, 0] - left - 8, centers[:, 1] - top - 4)
            np.testing.assert_array_equal(lists[tile, : count[tile]], [np.argmin(far)])


def test_sums_and_planes_are_those_of_the_pixels(rng: np.random.Generator) -> None:
    index = connect(rng.integers(0, 3, (40, 64)).astype(np.int32), 60, 0, 1, 40)[0]
    count = int(index.max()) + 1
    lab = rng.integers(0, 256, (3, 40, 64), dtype=np.uint8)
    w = rng.uniform(0.2, 0.5, index.shape).astype(np.float32)
    w[rng.random(w.shape) < 0.3] = 0
    nobody = np.zeros((count, N_CENTER), np.float32)
    sums = accumulate(lab, w, NO_GRADIENT, nobody, index, 1, 1, False)
    for k in range(count):
        mask = index == k
        assert sums[k, 0] == mask.sum()
        assert sums[k, 6] == (mask & (w > 0)).sum()
        expected = [lab[0][mask].mean() / 2.55, lab[1][mask].mean() - 128, lab[2][mask].mean() - 128]
        np.testing.assert_allclose(sums[k, 3:6] / sums[k, 0], expected, rtol=1e-5, atol=1e-4)
        plane, sse = naive.plane(w, mask)
        np.testing.assert_allclose(plane_of_sums(sums[k], 0.0, 0.0), plane, atol=2e-3)  # the ridge
        assert plane_sse(sums[k]) == pytest.approx(sse, rel=1e-2)


def test_pieces_become_labels_and_small_ones_join_the_longest_border(rng: np.random.Generator) -> None:
    for min_pixels in (1, 4, 30):
        index = np.kron(rng.integers(0, 4, (10, 12)), np.ones((2, 3))).astype(np.int32)
        index[rng.random(index.shape) < 0.1] = 5
        connected, edges, length = connect(index, min_pixels, 0, 1, len(index))
        expected = naive.connected_pieces(naive.join_small(naive.connected_pieces(index), min_pixels).astype(np.int32))
        np.testing.assert_array_equal(naive.connected_pieces(connected), expected)
        assert np.bincount(connected.ravel()).min() >= min(min_pixels, index.size)
        borders = naive.borders(connected)
        np.testing.assert_array_equal(edges, np.array(list(borders)).reshape(-1, 2))
        np.testing.assert_array_equal(length, list(borders.values()))


def test_edges_of_regrouped_labels_are_those_of_the_regrouped_image(rng: np.random.Generator) -> None:
    index, edges, length = connect(rng.integers(0, 5, (20, 30)).astype(np.int32), 3, 0, 1, 20)
    ids = rng.permutation(np.arange(index.max() + 1) % 7).astype(np.int32)
    grouped, grouped_length = regroup_edges(edges, length, ids, 7)
    expected = naive.borders(ids[index])
    np.testing.assert_array_equal(grouped, np.array(list(expected)))
    np.testing.assert_array_equal(grouped_length, list(expected.values()))


def test_a_row_that_stands_for_two_gives_the_borders_of_the_full_image(rng: np.random.Generator) -> None:
    for height in (40, 39):
        rows = np.kron(rng.integers(0, 4, (10, 12)), np.ones((2, 3))).astype(np.int32)
        pieces, edges, length = connect(rows, 20, 0, 2, height)
        ids = np.arange(pieces.max() + 1, dtype=np.int32)
        full = expand(pieces, ids, 2, height)
        np.testing.assert_array_equal(full, np.repeat(pieces, 2, axis=0)[:height])
        borders = naive.borders(full)
        np.testing.assert_array_equal(edges, np.array(list(borders)))
        np.testing.assert_array_equal(length, list(borders.values()))
        images = np.zeros((3, *pieces.shape), np.uint8), np.zeros(pieces.shape, np.float32), NO_GRADIENT
        sums = accumulate(*images, np.zeros((len(ids), N_CENTER), np.float32), pieces, 1, 2, False)
        moments = moments_of_frame(sums, pieces, ids, 2, height)
        y, x = np.mgrid[:height, :36]
        for column, values in enumerate((np.ones_like(x), x, y)):
            np.testing.assert_allclose(moments[:, column], np.bincount(full.ravel(), values.ravel()))


def test_grain_of_a_pixel_between_a_label_and_itself_is_taken_out() -> None:
    row = np.array([[0, 0, 1, 0, 0, 1, 1, 0, 1, 1, 1, 2]], np.int32)
    pieces, _, _ = connect(row, 1, 1, 1, 1)
    np.testing.assert_array_equal(pieces, [[0, 0, 0, 0, 0, 1, 1, 1, 1, 1, 1, 2]])


def test_merging_joins_the_cheapest_pair_first() -> None:
    sums = np.zeros((4, N_SUMS))
    sums[:, 0] = 100  # four regions in a row, of lightness 10, 11, 30, 33
    sums[:, 3] = np.array([10, 11, 30, 33]) * 100.0
    edges = np.array([[0, 1], [1, 2], [2, 3]], np.int32)
    for wanted, expected in ((4, [0, 1, 2, 3]), (3, [0, 0, 1, 2]), (2, [0, 0, 1, 1]), (1, [0, 0, 0, 0])):
        ids, merged = merge_superpixels(sums, edges, wanted, 0.01, 0.0, 0.004, 0.02, 1.5)
        np.testing.assert_array_equal(ids, expected)
        np.testing.assert_allclose(merged[:, 0], np.bincount(expected) * 100.0)


def test_merging_respects_planes_that_meet_at_an_edge(rng: np.random.Generator) -> None:
    x = np.arange(90, dtype=np.float32)
    fold = np.where(x < 60, 0.3 + 0.002 * x, 0.42 - 0.004 * (x - 60))
    w = np.repeat((fold + rng.normal(0, 5e-4, 90))[None], 30, axis=0).astype(np.float32)
    index = np.repeat((np.arange(90, dtype=np.int32) // 30)[None], 30, axis=0)
    nobody = np.zeros((3, N_CENTER), np.float32)
    lab = np.full((3, 30, 90), 128, np.uint8)
    sums = accumulate(lab, w, NO_GRADIENT, nobody, index, 1, 1, False)
    ids, _ = merge_superpixels(sums, np.array([[0, 1], [1, 2]], np.int32), 2, 0.01, 1.0, 0.004, 0.0, 1.5)
    np.testing.assert_array_equal(ids, [0, 0, 1])


# --- the stage -------------------------------------------------------------------------------------------------------


@pytest.mark.parametrize(("height", "width"), [(96, 128), (61, 97), (30, 200), (17, 15), (1, 40)])
def test_the_partition_keeps_its_promises_at_any_size(rng: np.random.Generator, height: int, width: int) -> None:
    w = rng.uniform(0.2, 0.6, (height, width)).astype(np.float32)
    check_partition(compute_superpixels(noise_image(rng, height, width), w, SMALL), height, width)


def test_count_is_as_wanted(rng: np.random.Generator) -> None:
    color = noise_image(rng, 240, 320)
    w, _ = three_walls(rng, 240, 320)
    for count in (16, 100, 400):
        assert compute_superpixels(color, w, EstimatorConfig(superpixel_count=count)).count == count


def test_depth_alone_finds_the_corner_of_a_room(rng: np.random.Generator) -> None:
    w, face = three_walls(rng)
    s = compute_superpixels(None, w, SMALL)
    scores = segmentation_scores(s.index, face.astype(np.uint8))
    assert scores.mean_error < 0.01
    assert (s.mean_lab == 0).all()
    fitted = s.plane[s.index]
    y, x = np.mgrid[: w.shape[0], : w.shape[1]]
    error = np.abs(fitted[..., 0] * x + fitted[..., 1] * y + fitted[..., 2] - w)
    assert np.median(error) < 0.001
    assert np.nanmedian(s.plane_rms) == pytest.approx(0.001, rel=0.2)


def test_depth_finds_an_edge_that_colour_does_not_show(rng: np.random.Generator) -> None:
    w, face = three_walls(rng)
    grey = np.full((*w.shape, 3), 140, np.uint8)
    with_depth = segmentation_scores(compute_superpixels(grey, w, SMALL).index, face.astype(np.uint8))
    flat = dataclasses.replace(SMALL, superpixel_lambda_depth=0.0)
    without = segmentation_scores(compute_superpixels(grey, w, flat).index, face.astype(np.uint8))
    assert with_depth.mean_error < 0.01 < 0.03 < without.mean_error


def test_the_papers_gradient_term_finds_the_corner_too(rng: np.random.Generator) -> None:
    w, face = three_walls(rng)
    paper = dataclasses.replace(SMALL, superpixel_lambda_depth=0.0, superpixel_lambda_gradient=1.0)
    flat = dataclasses.replace(SMALL, superpixel_lambda_depth=0.0)
    grey = np.full((*w.shape, 3), 140, np.uint8)
    by_gradient = segmentation_scores(compute_superpixels(grey, w, paper).index, face.astype(np.uint8))
    without = segmentation_scores(compute_superpixels(grey, w, flat).index, face.astype(np.uint8))
    assert by_gradient.mean_error < 0.6 * without.mean_error


@pytest.mark.parametrize("oversegmentation", (1.0, 2.0, 4.0))
def test_an_image_of_weight_0_does_not_matter(rng: np.random.Generator, oversegmentation: float) -> None:
    setting = dataclasses.replace(SMALL, superpixel_oversegmentation=oversegmentation)
    pictures = noise_image(rng, 120, 160), np.full((120, 160, 3), 128, np.uint8)
    depths = three_walls(rng)[0], np.full((120, 160), 0.4, np.float32), None
    blind = dataclasses.replace(setting, superpixel_lambda_color=0.0)
    for w in depths[:2]:
        first, second = (compute_superpixels(color, w, blind).index for color in pictures)
        np.testing.assert_array_equal(first, second)
    flat = dataclasses.replace(setting, superpixel_lambda_depth=0.0)
    first, second, without = (compute_superpixels(pictures[0], w, flat).index for w in depths)
    np.testing.assert_array_equal(first, second)
    np.testing.assert_array_equal(first, without)


def test_merging_weighs_colour_and_depth_as_the_assignment_does() -> None:
    default = EstimatorConfig()
    color, depth = _merge_weights(default)[:2]
    assert (color, depth) == (1 / 10.0**2, 0.3)
    less = dataclasses.replace(default, superpixel_lambda_color=5.0, superpixel_lambda_depth=0.5)
    assert _merge_weights(less)[:2] == pytest.approx((color / 2, depth / 4))
    papers = dataclasses.replace(default, superpixel_lambda_depth=0.0, superpixel_lambda_gradient=1.0)
    assert _merge_weights(papers)[:2] == pytest.approx((color, depth / 2))


def test_colour_alone_equals_no_depth_measured(rng: np.random.Generator) -> None:
    color = noise_image(rng, 96, 128)
    without = compute_superpixels(color, None, SMALL)
    unmeasured = compute_superpixels(color, np.zeros((96, 128), np.float32), SMALL)
    np.testing.assert_array_equal(without.index, unmeasured.index)
    for s in (without, unmeasured):
        assert np.isnan(s.plane).all()
        assert np.isnan(s.plane_rms).all()
        assert (s.measured == 0).all()


def test_holes_in_depth_do_not_draw_borders(rng: np.random.Generator) -> None:
    w, face = three_walls(rng)
    grey = np.full((*w.shape, 3), 140, np.uint8)
    block = np.kron(rng.random((15, 20)) < 0.2, np.ones((8, 8))) > 0
    s = compute_superpixels(grey, np.where(block, 0, w).astype(np.float32), SMALL)
    seen = np.where(block, 0, face).astype(np.uint8)
    assert segmentation_scores(s.index, seen).mean_error < 0.02
    measured = np.bincount(s.index.ravel(), ~block.ravel()) / s.pixels
    np.testing.assert_allclose(s.measured, measured, atol=1e-5)


def test_outliers_do_not_bend_a_plane(rng: np.random.Generator) -> None:
    y, x = np.mgrid[:96, :128].astype(np.float32)
    truth = 0.3 + 0.001 * x + 0.0005 * y
    w = (truth + rng.normal(0, 0.001, truth.shape)).astype(np.float32)
    w[rng.random(w.shape) < 0.03] = 0.9
    s = compute_superpixels(None, w, SMALL)
    fitted = s.plane[s.index]
    error = np.abs(fitted[..., 0] * x + fitted[..., 1] * y + fitted[..., 2] - truth)
    assert np.percentile(error, 95) < 0.002


def test_same_input_same_bytes(rng: np.random.Generator) -> None:
    color = noise_image(rng, 120, 160)
    w, _ = three_walls(rng)
    first, second = (compute_superpixels(color, w, SMALL) for _ in range(2))
    for field in dataclasses.fields(Superpixels):
        assert np.asarray(getattr(first, field.name)).tobytes() == np.asarray(getattr(second, field.name)).tobytes()


@pytest.mark.parametrize("value", [0, 128, 255])
def test_constant_images_give_a_partition(value: int) -> None:
    color = np.full((96, 128, 3), value, np.uint8)
    check_partition(compute_superpixels(color, None, SMALL), 96, 128)
    check_partition(compute_superpixels(color, np.full((96, 128), 0.5, np.float32), SMALL), 96, 128)


@pytest.mark.parametrize(
    ("color", "w", "sentence"),
    [
        (None, None, "neither colour nor inverse depth"),
        (np.zeros((8, 8), np.uint8), None, "colour image is uint8 (8, 8)"),
        (np.zeros((8, 8, 3), np.float32), None, "colour image is float32"),
        (None, np.zeros((8, 8)), "inverse depth is float64"),
        (np.zeros((8, 8, 3), np.uint8), np.zeros((8, 9), np.float32), "they must agree"),
    ],
)
def test_broken_images_are_refused_in_a_sentence(
    color: NDArray[np.uint8] | None, w: NDArray[np.float32] | None, sentence: str
) -> None:
    with pytest.raises(ValueError, match=re.escape(sentence)):
        compute_superpixels(color, w, SMALL)


# --- colour ----------------------------------------------------------------------------------------------------------


def test_lab_is_that_of_opencv_within_the_tables_step(rng: np.random.Generator) -> None:
    color = noise_image(rng, 90, 120)
    expected = cv2.cvtColor(cv2.blur(color, (3, 3), borderType=cv2.BORDER_REPLICATE), cv2.COLOR_RGB2LAB)
    difference = np.abs(np.moveaxis(compute_lab(color), 0, 2).astype(int) - expected)
    assert difference.mean() < 1.0
    assert np.percentile(difference, 99) <= 4


def test_a_white_border_is_found_and_overwritten(rng: np.random.Generator) -> None:
    color = rng.integers(20, 200, (120, 160, 3), dtype=np.uint8)
    framed = color.copy()
    framed[:6], framed[-7:], framed[:, :8], framed[:, -9:] = 255, 255, 255, 255
    assert blank_border(color) == (0, 0, 0, 0)
    assert blank_border(framed) == (7, 8, 9, 10)
    lab = compute_lab(framed)
    np.testing.assert_array_equal(lab[:, 0, 9:-10], lab[:, 7, 9:-10])
    np.testing.assert_array_equal(lab[:, 7:-8, 0], lab[:, 7:-8, 9])


# --- real frames -----------------------------------------------------------------------------------------------------

FRAMES = ("0020", "0200", "0400", "0600", "0800", "1000", "1200", "1400")


def nyu_frame(data_root: Path, name: str) -> tuple[NDArray[np.uint8], NDArray[np.float32], NDArray[np.uint8]]:
    folder = data_root / "nyuv2"
    color = np.asarray(cv2.imread(str(folder / "rgb" / f"{name}.jpg")), np.uint8)[..., ::-1]
    depth_m = np.asarray(cv2.imread(str(folder / "depth" / f"{name}.png"), cv2.IMREAD_UNCHANGED), np.float32) / 1000
    w = np.divide(1, depth_m, out=np.zeros_like(depth_m), where=depth_m > 0)
    labels = np.asarray(cv2.imread(str(folder / "labels40" / f"{name}.png"), cv2.IMREAD_UNCHANGED), np.uint8)
    return np.ascontiguousarray(color), w, labels


def test_depth_makes_fewer_errors_than_colour_on_nyu(data_root: Path) -> None:
    names = [n for n in FRAMES if (data_root / "nyuv2" / "rgb" / f"{n}.jpg").is_file()]
    assert len(names) >= 4
    errors: dict[float, list[float]] = {0.0: [], EstimatorConfig().superpixel_lambda_depth: []}
    for name in names:
        color, w, labels = nyu_frame(data_root, name)
        for weight, found in errors.items():
            config = EstimatorConfig(superpixel_lambda_depth=weight)
            s = compute_superpixels(color, w, config)
            assert s.count == 200
            found.append(segmentation_scores(s.index, labels).mean_error)
    flat, ours = (float(np.mean(found)) for found in errors.values())
    assert ours < 0.9 * flat
    assert ours < 0.05


@pytest.mark.parametrize("side", range(1, 12))
def test_of_a_white_picture_something_is_left(side: int) -> None:
    white = np.full((side, side + 3, 3), 255, np.uint8)
    top, bottom, left, right = blank_border(white)
    assert top + bottom < side
    assert left + right < side + 3
    assert (compute_lab(white)[0] >= 253).all()
