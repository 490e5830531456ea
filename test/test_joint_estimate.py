"""The joint model on rooms whose truth is known."""

from __future__ import annotations

from dataclasses import replace

import numpy as np
import pytest

from room_layout_ros.core.config import EstimatorConfig
from room_layout_ros.core.depth import DepthGeometry, compute_depth_geometry
from room_layout_ros.core.frame import RgbdFrame
from room_layout_ros.core.frame_evidence import FrameEvidence
from room_layout_ros.core.joint import JointEstimate, estimate_joint
from room_layout_ros.core.joint_problem import build_joint_problem, gather_first_parts
from room_layout_ros.core.labels import CLUTTER
from room_layout_ros.core.superpixel_relations import compute_relations
from room_layout_ros.core.superpixels import Superpixels, compute_superpixels
from room_layout_ros.core.weights import start_weights
from room_layout_ros.datasets import good_samples
from room_layout_ros.datasets.sample import Sample
from room_layout_ros.datasets.synthetic import SyntheticSource

CONFIG = EstimatorConfig(joint_bound=True)


@pytest.fixture(scope="module")
def samples() -> list[Sample]:
    return list(good_samples(SyntheticSource(frames=6, seed=3, walk=False, noise="clean")))


def parts(frame: RgbdFrame) -> tuple[DepthGeometry, Superpixels]:
    geometry = compute_depth_geometry(frame, CONFIG)
    assert geometry is not None
    return geometry, compute_superpixels(frame.color, geometry.inverse_depth, CONFIG)


def solve(sample: Sample, config: EstimatorConfig = CONFIG) -> JointEstimate:
    assert sample.truth is not None
    assert sample.truth.cuboid is not None
    geometry, superpixels = parts(sample.frame)
    evidence = FrameEvidence(sample.truth.cuboid.R_room_camera)
    return estimate_joint(sample.frame.camera, superpixels, (evidence,), geometry, start_weights(), config)


def test_rooms_without_noise_and_with_true_axes_are_found_within_a_percent(samples: list[Sample]) -> None:
    errors = []
    for sample in samples:
        assert sample.truth is not None
        assert sample.truth.layout is not None
        layout = solve(sample).cuboid.raster(sample.frame.camera)
        errors.append(float((layout != sample.truth.layout).mean()))
    assert np.median(errors) < 0.01, errors
    assert max(errors) < 0.03, errors


def test_most_superpixels_get_the_true_label_from_geometry_alone(samples: list[Sample]) -> None:
    """No classifier is asked: context is flat, so labels come from the planes and the layout."""
    wrong, labelled, clutter = 0, 0, 0
    for sample in samples:
        assert sample.truth is not None
        assert sample.truth.labels is not None
        _, superpixels = parts(sample.frame)
        labels = solve(sample).labels[superpixels.index]
        known = sample.truth.labels > 0
        wrong += int((labels != sample.truth.labels)[known].sum())
        clutter += int((labels == CLUTTER).sum())
        labelled += int(known.sum())
    assert wrong < 0.15 * labelled
    assert clutter > 0


def test_energy_falls_and_the_bound_holds_on_rendered_frames(samples: list[Sample]) -> None:
    for sample in samples[:3]:
        found = solve(sample).solution
        assert all(b <= a + 1e-9 for a, b in zip(found.energies, found.energies[1:], strict=False))
        assert found.bound <= found.energy
        assert found.energy - found.bound < 0.5  # of the image


def test_the_same_frame_gives_the_same_bytes(samples: list[Sample]) -> None:
    a, b = solve(samples[0]), solve(samples[0])
    assert a.cuboid.distances.tobytes() == b.cuboid.distances.tobytes()
    assert a.labels.tobytes() == b.labels.tobytes()
    assert a.solution.energies == b.solution.energies


def test_without_depth_the_room_has_no_metric_scale(samples: list[Sample]) -> None:
    sample = samples[0]
    assert sample.truth is not None
    assert sample.truth.cuboid is not None
    assert sample.truth.layout is not None
    superpixels = compute_superpixels(sample.frame.color, None, CONFIG)
    evidence = FrameEvidence(sample.truth.cuboid.R_room_camera, orientation=sample.truth.layout)
    found = estimate_joint(sample.frame.camera, superpixels, (evidence,), None, start_weights(), CONFIG)
    assert found.solution.scale == 1.0
    assert found.cuboid.distances[3] == 1.0
    # an orientation map as good as the truth must give the true layout, up to the spacing of the rays
    assert (found.cuboid.raster(sample.frame.camera) != sample.truth.layout).mean() < 0.02


def test_the_hypothesis_of_least_energy_wins_and_ties_go_to_the_first(samples: list[Sample]) -> None:
    sample = samples[0]
    assert sample.truth is not None
    assert sample.truth.cuboid is not None
    R = sample.truth.cuboid.R_room_camera
    tilted = R @ np.array([[0.9, -0.435, 0], [0.435, 0.9, 0], [0, 0, 1]])
    u, _, v = np.linalg.svd(tilted)
    geometry, superpixels = parts(sample.frame)
    wrong, right = FrameEvidence(u @ v), FrameEvidence(R)
    camera, weights = sample.frame.camera, start_weights()
    found, worse, best = (
        estimate_joint(camera, superpixels, evidence, geometry, weights, CONFIG)
        for evidence in ((wrong, right), (wrong,), (right,))
    )
    np.testing.assert_array_equal(found.cuboid.R_room_camera, R)
    assert found.solution.energy == best.solution.energy < worse.solution.energy
    same = FrameEvidence(R + 1e-9)  # as good, and told apart
    tied = estimate_joint(camera, superpixels, (same, right), geometry, weights, CONFIG)
    np.testing.assert_array_equal(tied.cuboid.R_room_camera, same.R_room_camera)


def test_parts_gathered_before_change_nothing_and_are_of_the_first_hypothesis(samples: list[Sample]) -> None:
    sample = samples[0]
    assert sample.truth is not None
    assert sample.truth.cuboid is not None
    geometry, superpixels = parts(sample.frame)
    R, camera, weights = sample.truth.cuboid.R_room_camera, sample.frame.camera, start_weights()
    turned = R[[2, 1, 0]] * np.array([[1.0], [1.0], [-1.0]])
    orientation = (np.arange(superpixels.index.size).reshape(superpixels.index.shape) // 5000 % 6).astype(np.uint8)
    evidence = FrameEvidence(R, orientation), FrameEvidence(turned, orientation)
    first = gather_first_parts(camera, superpixels, geometry, R, orientation, CONFIG)
    found = estimate_joint(camera, superpixels, evidence, geometry, weights, CONFIG, first=first)
    alone = estimate_joint(camera, superpixels, evidence, geometry, weights, CONFIG)
    assert found.solution.energies == alone.solution.energies
    np.testing.assert_array_equal(found.labels, alone.labels)
    with pytest.raises(ValueError, match="counted under other axes"):
        estimate_joint(camera, superpixels, evidence[::-1], geometry, weights, CONFIG, first=first)


def test_a_passed_deadline_still_gives_one_answer(samples: list[Sample]) -> None:
    sample = samples[0]
    assert sample.truth is not None
    assert sample.truth.cuboid is not None
    geometry, superpixels = parts(sample.frame)
    R = sample.truth.cuboid.R_room_camera
    evidence, untried = FrameEvidence(R), FrameEvidence(R, context=np.zeros((1, 6)))  # which would be refused
    found = estimate_joint(
        sample.frame.camera, superpixels, (evidence, untried), geometry, start_weights(), CONFIG, expired=lambda: True
    )
    assert len(found.solution.energies) == 1
    assert not found.solution.finished


def test_relations_of_neighbours_are_opposite_from_the_other_side(samples: list[Sample]) -> None:
    sample = samples[0]
    _, superpixels = parts(sample.frame)
    R = np.eye(3)
    forward = compute_relations(sample.frame.camera, superpixels, R, with_depth=True)
    turned = replace(superpixels, edges=superpixels.edges[:, ::-1].copy())
    backward = compute_relations(sample.frame.camera, turned, R, with_depth=True)
    np.testing.assert_allclose(backward, forward[:, [1, 0, 3, 2, 5, 4]], atol=1e-12)
    assert (forward[:, ::2] * forward[:, 1::2] == 0).all()  # never above and below at once
    flat = compute_relations(sample.frame.camera, superpixels, R, with_depth=False)
    assert not flat[:, 4:].any()
    i, j = superpixels.edges.T
    higher = superpixels.center_px[i, 1] < superpixels.center_px[j, 1]
    assert (flat[~higher, 0] == 0).all()


def test_evidence_that_does_not_fit_is_refused(samples: list[Sample]) -> None:
    geometry, superpixels = parts(samples[0].frame)
    evidence = FrameEvidence(np.eye(3), orientation=np.zeros((3, 3), np.uint8))
    with pytest.raises(ValueError, match=r"evidence image is uint8 \(3, 3\)"):
        build_joint_problem(samples[0].frame.camera, superpixels, evidence, geometry, CONFIG)
    with pytest.raises(ValueError, match="no hypothesis of the axes is given"):
        estimate_joint(samples[0].frame.camera, superpixels, (), geometry, start_weights(), CONFIG)
