"""Kernel descriptors: equal to slow twins, near the match kernels they stand for, honest where depth is missing."""

from __future__ import annotations

from dataclasses import replace

import naive_kernel_descriptors as naive
import numpy as np
import pytest
from numpy.typing import NDArray

from room_layout_ros.core.config import EstimatorConfig
from room_layout_ros.core.depth import DepthGeometry
from room_layout_ros.core.evidence import color_patches, depth_patches, depth_samples
from room_layout_ros.core.evidence.kernel_descriptors import (
    COLOR,
    DEPTH,
    DESCRIPTORS,
    DescriptorModel,
    describe_patches,
    describe_superpixels,
    pool_means,
)
from room_layout_ros.core.evidence.match_kernels import (
    CompactBasis,
    MatchKernel,
    circle,
    compact_basis,
    make_match_kernel,
    standard_kernels,
)
from room_layout_ros.core.evidence.surrounding_means import REACHES, with_surroundings
from room_layout_ros.core.frame import CameraIntrinsics
from room_layout_ros.core.superpixels import Superpixels, compute_superpixels

CAMERA = CameraIntrinsics(96, 72, 80.0, 80.0, 47.5, 35.5)
KERNELS = standard_kernels()


def rng() -> np.random.Generator:
    return np.random.default_rng(5)


def picture() -> NDArray[np.uint8]:
    """Blobs of colour with some grain."""
    y, x = np.mgrid[:72, :96]
    waves = [128 + 90 * np.sin(x / a + y / b) for a, b in ((7.0, 9.0), (15.0, 5.0), (4.0, 30.0))]
    return np.clip(np.stack(waves, axis=-1) + rng().normal(0, 8, (72, 96, 3)), 0, 255).astype(np.uint8)


def inverse_depth(holes: bool = False) -> NDArray[np.float32]:
    """A floor that meets a wall with a ball before it, 1/m."""
    y, x = np.mgrid[:72, :96]
    w = np.maximum(0.4 + 0.0 * x, 0.1 + 0.012 * y)
    w = np.where((y - 40) ** 2 + (x - 50) ** 2 < 200, 0.8 - 0.0005 * ((y - 40) ** 2 + (x - 50) ** 2), w)
    if holes:
        w = np.where(rng().random((72, 96)) < 0.2, 0.0, w)
        w[:, :30] = 0.0
    return w.astype(np.float32)


def model(words: int = 6) -> DescriptorModel:
    """Words taken from patches of the test picture."""
    geometry = DepthGeometry(CAMERA, inverse_depth(), 1.0)
    patches = describe_patches(picture(), geometry, color_patches.patch_centers(72, 96), KERNELS)
    chosen = {n: p[np.isfinite(p[:, 0])][:: max(1, len(p) // words)][:words] for n, p in patches.items()}
    return DescriptorModel(KERNELS, {n: compact_basis(p, 0.5, words) for n, p in chosen.items()})


def segments() -> Superpixels:
    return compute_superpixels(picture(), inverse_depth(), EstimatorConfig(superpixel_count=16))


def test_a_compact_basis_is_the_kernel_on_its_grid_and_near_it_between() -> None:
    basis = compact_basis(circle(np.arange(25) * (2 * np.pi / 25)), 5.0, 25)
    angles = circle(rng().uniform(0, 2 * np.pi, 40))
    own = np.array([naive.embed(value, basis.points, basis.projection, basis.gamma) for value in angles])
    np.testing.assert_allclose(basis.embed(angles), own, atol=2e-4)
    exact = np.array([[naive.gaussian(a, b, 5.0) for b in angles] for a in angles])
    np.testing.assert_allclose(basis.embed(angles) @ basis.embed(angles).T, exact, atol=0.01)


def test_a_descriptor_s_scalar_product_is_near_the_match_kernel() -> None:
    """Every sample of a patch against every one of the other, as the papers define it."""
    kernel = make_match_kernel(KERNELS["gradient"].attribute.points, 5.0, KERNELS["gradient"].position.points, 3.0, 600)
    gray = picture()[:16, :16, 0].astype(np.float32) / 255
    direction, length = color_patches.gradient_samples(gray)
    corners = np.array([[0, 0], [8, 8]], np.int32)
    place = color_patches.place_basis(kernel, 8)
    flat = kernel.attribute.embed(direction.reshape(-1, 2)).reshape(16, 16, -1)
    sums = color_patches.sum_patches(flat, length, corners, 8, place, 0.2)
    described = sums[:, kernel.pairs[:, 0], kernel.pairs[:, 1]]
    at = (np.arange(8) + 0.5) / 8
    places = np.stack(np.meshgrid(at, at, indexing="ij"), axis=-1).reshape(-1, 2)
    one, two = (slice(0, 8),) * 2, (slice(8, 16),) * 2
    m, n = (length[s].ravel() / np.sqrt(0.2 + (length[s] ** 2).sum()) for s in (one, two))
    exact = sum(
        m[i] * n[j]
        * naive.gaussian(direction[one].reshape(-1, 2)[i], direction[two].reshape(-1, 2)[j], 5.0)
        * naive.gaussian(places[i], places[j], 3.0)
        for i in range(64) for j in range(64)
    )  # fmt: skip
    assert described[0] @ described[1] == pytest.approx(exact, rel=0.02)


@pytest.mark.parametrize("shape", [(13, 17), (1, 5), (2, 2)])
def test_gradients_and_patterns_are_the_twins(shape: tuple[int, int]) -> None:
    gray = rng().integers(0, 6, shape).astype(np.float32) / 8
    for fast, slow in zip(color_patches.gradient_samples(gray), naive.gradient_samples(gray), strict=True):
        np.testing.assert_allclose(fast, slow, atol=1e-6)
    codes, contrast = color_patches.pattern_samples(gray)
    twin_codes, twin_contrast = naive.pattern_samples(gray)
    np.testing.assert_array_equal(codes, twin_codes)
    np.testing.assert_allclose(contrast, twin_contrast, atol=1e-4)


def test_sums_over_patches_are_the_twins() -> None:
    attributes, weight = rng().random((30, 40, 4), np.float32), rng().random((30, 40), np.float32)
    place = rng().random((25, 3), np.float32)
    corners = np.array([[0, 0], [25, 35], [7, 11]], np.int32)
    cut = [(slice(y, y + 5), slice(x, x + 5)) for y, x in corners]
    slow = [naive.sum_patch(attributes[at], weight[at], place, 0.3) for at in cut]
    np.testing.assert_allclose(color_patches.sum_patches(attributes, weight, corners, 5, place, 0.3), slow, rtol=1e-4)
    weight[rng().random((30, 40)) < 0.4] = np.nan
    middles = np.array([[0, 0], [29, 20], [10, 10]], np.int32)
    around = np.pad(weight, 2, constant_values=np.nan)
    wide = np.pad(attributes, ((2, 2), (2, 2), (0, 0)))
    slow = [naive.sum_patch(wide[y : y + 5, x : x + 5], around[y : y + 5, x : x + 5], place, 0.3) for y, x in middles]
    np.testing.assert_allclose(depth_patches.sum_measured(attributes, weight, middles, 2, place, 0.3), slow, rtol=1e-4)


def test_planes_of_windows_are_the_twins() -> None:
    image = inverse_depth(holes=True)
    points, normals = depth_samples.plane_samples(image, CAMERA.fx, CAMERA.fy, CAMERA.cx, CAMERA.cy)
    for row in range(0, len(points), 3):
        for column in range(0, points.shape[1], 3):
            point, normal = naive.plane_sample(image, 4 * row, 4 * column, CAMERA)
            np.testing.assert_allclose(points[row, column], point, rtol=1e-3, atol=1e-4)
            np.testing.assert_allclose(normals[row, column], normal, atol=1e-3)
    assert 0.1 < np.isnan(points[..., 0]).mean() < 0.9


def test_spin_is_its_twin() -> None:
    image, kernel = inverse_depth(holes=True), KERNELS["spin"]
    points, normals = depth_samples.plane_samples(image, CAMERA.fx, CAMERA.fy, CAMERA.cx, CAMERA.cy)
    middle = np.array([[9, 13]], np.int32)
    a, b = kernel.attribute, kernel.position
    fast = depth_patches.sum_spin(
        points, normals, middle, 4, 0.15, a.points, a.projection, a.gamma, b.points, b.projection, b.gamma
    )
    rows = []
    for y in range(5, 14, 2):
        for x in range(9, 18, 2):
            if np.isfinite(points[y, x, 0]):
                angle, place = naive.spin_coordinates(points[9, 13], normals[9, 13], points[y, x], normals[y, x])
                own_a = naive.embed(angle, a.points, a.projection, a.gamma)
                rows.append(np.outer(own_a, naive.embed(place / 0.15, b.points, b.projection, b.gamma)))
    np.testing.assert_allclose(fast[0], np.mean(rows, axis=0), atol=2e-3)


def turned(seed: int) -> NDArray[np.float32]:
    """A rotation matrix."""
    q = np.linalg.qr(np.random.default_rng(seed).normal(size=(3, 3)))[0]
    return (q * np.sign(np.linalg.det(q))).astype(np.float32)


def test_spin_and_self_similarity_do_not_change_when_the_scene_is_moved() -> None:
    points, normals = depth_samples.plane_samples(inverse_depth(), CAMERA.fx, CAMERA.fy, CAMERA.cx, CAMERA.cy)
    points -= np.array([0.0, 0.0, 2.0], np.float32)  # so that the turned points stay before the camera
    R = turned(3)
    moved = points @ R.T + np.array([0.3, -0.2, 9.0], np.float32)
    points[..., 2] += 20.0
    middles = np.array([[9, 13], [6, 7]], np.int32)
    a, b = KERNELS["spin"].attribute, KERNELS["spin"].position
    bases = (a.points, a.projection, a.gamma, b.points, b.projection, b.gamma)
    still = depth_patches.sum_spin(points, normals, middles, 4, 0.15, *bases)
    np.testing.assert_allclose(depth_patches.sum_spin(moved, normals @ R.T, middles, 4, 0.15, *bases), still, atol=5e-3)
    np.testing.assert_allclose(
        depth_patches.self_similarity(moved, middles), depth_patches.self_similarity(points, middles), atol=1e-4
    )


def test_self_similarity_knows_only_measured_points() -> None:
    points, _ = depth_samples.plane_samples(inverse_depth(holes=True), CAMERA.fx, CAMERA.fy, CAMERA.cx, CAMERA.cy)
    middles = np.array([[9, 13], [2, 11], [17, 22]], np.int32)
    padded = np.pad(points, ((4, 4), (4, 4), (0, 0)), constant_values=np.nan)
    slow = [naive.self_similarity(padded[y : y + 9 : 2, x : x + 9 : 2].reshape(-1, 3), 50.0, 10) for y, x in middles]
    np.testing.assert_allclose(depth_patches.self_similarity(points, middles), slow, atol=1e-5)


def test_contrast_and_brightness_move_gradient_and_pattern_little() -> None:
    """Both are weighted by contrast over that of their patch; a brighter, flatter picture has the same edges."""
    centers = color_patches.patch_centers(72, 96)
    image = picture()
    paler = (image.astype(np.float64) * 0.8 + 40).astype(np.uint8)
    before = color_patches.compute_color_descriptors(image, centers, KERNELS)
    after = color_patches.compute_color_descriptors(paler, centers, KERNELS)
    for name in ("gradient", "pattern"):
        likeness = (before[name] * after[name]).sum(axis=1)
        likeness /= np.linalg.norm(before[name], axis=1) * np.linalg.norm(after[name], axis=1)
        assert np.median(likeness) > 0.95, name


def test_a_patch_without_depth_has_no_depth_descriptor_and_its_colour_all_the_same() -> None:
    centers = color_patches.patch_centers(72, 96)
    geometry = DepthGeometry(CAMERA, inverse_depth(holes=True), 0.5)
    found = describe_patches(picture(), geometry, centers, KERNELS)
    alone = describe_patches(picture(), None, centers, KERNELS)
    assert set(alone) == set(COLOR)
    for name in COLOR:
        np.testing.assert_array_equal(found[name], alone[name])
    blind = centers[:, 1] < 16
    for name in DEPTH:
        assert np.isnan(found[name][blind]).all()
        known = np.isfinite(found[name][:, 0])
        assert known.any()
        assert (np.isfinite(found[name]).all(axis=1) == known).all(), "all of a descriptor or nothing"


def test_holes_elsewhere_change_nothing() -> None:
    centers = color_patches.patch_centers(72, 96)
    whole, cut = inverse_depth(), inverse_depth()
    cut[:, :20] = 0.0
    far = centers[:, 1] >= 20 + 16 + 12
    for name in DEPTH:
        before = describe_patches(None, DepthGeometry(CAMERA, whole, 1.0), centers, KERNELS)[name]
        after = describe_patches(None, DepthGeometry(CAMERA, cut, 0.8), centers, KERNELS)[name]
        np.testing.assert_array_equal(before[far], after[far])


def test_pooling_is_its_twin() -> None:
    rows = rng().random((50, 4), np.float32)
    rows[::7] = np.nan
    owner = rng().integers(0, 9, 50).astype(np.int32)
    owner[owner == 3] = 4
    np.testing.assert_allclose(pool_means(rows, owner, 9), naive.pool_means(rows, owner, 9), rtol=1e-5)


def test_means_over_surroundings_are_the_twins() -> None:
    superpixels = segments()
    count = superpixels.count
    wanted = np.arange(count) % 4 > 0
    features = np.where(wanted[:, None], rng().random((count, 3)), np.nan).astype(np.float32)
    features[::5, 2] = np.nan
    whole = with_surroundings(superpixels, wanted, features)
    np.testing.assert_array_equal(whole[:, :3], features)
    area = superpixels.pixels.astype(np.float64)
    for part, reach in enumerate(REACHES, 1):
        found = whole[:, 3 * part : 3 * part + 3]
        assert np.isnan(found[~wanted]).all()
        for k in np.flatnonzero(wanted):
            slow = naive.region_mean(int(k), superpixels.edges, wanted, area, features, reach)
            np.testing.assert_allclose(found[k], slow, rtol=1e-5)


def test_superpixels_have_what_is_known_of_them() -> None:
    superpixels, learned = segments(), model()
    wanted = np.arange(superpixels.count) % 3 > 0
    holes = DepthGeometry(CAMERA, inverse_depth(holes=True), 0.5)
    features = describe_superpixels(picture(), holes, superpixels, wanted, learned)
    assert features.dtype == np.float32
    assert features.shape == (superpixels.count, len(learned.columns(DESCRIPTORS)))
    assert np.isnan(features[~wanted]).all()
    colored, deep = (
        int(np.isfinite(features[:, learned.columns(names)]).all(axis=1).sum()) for names in (COLOR, DEPTH)
    )
    assert colored > deep > 0, "some have colour alone: their depth is a hole"
    without = describe_superpixels(picture(), None, superpixels, wanted, learned)
    np.testing.assert_array_equal(without[:, learned.columns(COLOR)], features[:, learned.columns(COLOR)])
    assert np.isnan(without[:, learned.columns(DEPTH)]).all()


def test_of_a_picture_smaller_than_a_patch_and_of_no_clutter_nothing_is_known() -> None:
    tiny = compute_superpixels(picture()[:12, :12], None, EstimatorConfig(superpixel_count=16))
    assert np.isnan(describe_superpixels(picture()[:12, :12], None, tiny, np.ones(tiny.count, bool), model())).all()
    none = np.zeros(segments().count, bool)
    geometry = DepthGeometry(CAMERA, inverse_depth(), 1.0)
    assert np.isnan(describe_superpixels(picture(), geometry, segments(), none, model())).all()


def test_bad_bases_are_refused_in_a_sentence() -> None:
    basis = compact_basis(np.eye(3), 1.0, 2)
    with pytest.raises(ValueError, match="both must be 2-D"):
        CompactBasis(basis.points, basis.projection[:2], 1.0)
    with pytest.raises(ValueError, match="components below"):
        MatchKernel(basis, basis, np.array([[0, 2]], np.int16))
    words = dict(model().words)
    with pytest.raises(ValueError, match="words of"):
        DescriptorModel(KERNELS, {name: words[name] for name in COLOR})
    with pytest.raises(ValueError, match="words of spin have"):
        DescriptorModel(KERNELS, {**words, "spin": replace(words["spin"], points=words["spin"].points[:, :4])})
