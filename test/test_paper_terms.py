"""The paper's Table 1 and its twelve depth cues, as written and as they reach the energy of a frame."""

from __future__ import annotations

import numpy as np
import pytest
from numpy.typing import NDArray
from scenes import ROOM, SMALL, look

from room_layout_ros.core.config import EstimatorConfig
from room_layout_ros.core.depth import compute_depth_geometry
from room_layout_ros.core.energies import label_problem, pair_costs
from room_layout_ros.core.evidence.depth_cues import compute_depth_cues
from room_layout_ros.core.frame import RgbdFrame
from room_layout_ros.core.frame_evidence import FrameEvidence
from room_layout_ros.core.joint_problem import JointProblem, build_joint_problem
from room_layout_ros.core.superpixels import Superpixels
from room_layout_ros.core.weights import ModelWeights, pack_blocks, physical_table

CONFIG = EstimatorConfig(layout_pixel_step=1)
LABELS = ("ceiling", "floor", "left", "front", "right", "clutter")
OUTWARD = dict(
    zip(LABELS, np.array([[0, -1, 0], [0, 1, 0], [-1, 0, 0], [0, 0, 1], [1, 0, 0], [0, 0, -1]]), strict=True)
)
"""Directions of the faces in room axes (X right, Y down, Z front), and backwards in the place of clutter's."""

TABLE_1 = {
    # "a - b" of the paper, as printed; columns are b: ceiling, floor, left wall, front wall, right wall, clutter
    "ceiling": ("", "2", "2, 4", "2, 5", "2, 3", "2"),
    "floor": ("1", "", "1, 4", "1, 5", "1, 3", "1"),
    "left": ("1, 3", "2, 3", "", "3, 5", "3", "3"),
    "front": ("1, 6", "2, 6", "4, 6", "", "3, 6", "6"),
    "right": ("1, 4", "2, 4", "4", "4, 5", "", "4"),
    "clutter": ("1", "2", "4", "5", "3", ""),
}
RELATIONS = {
    # how superpixel a stands to b, and the printed number that says it cannot: (step from b to a in room axes, number)
    "up above": ((0.0, -1.0, 0.0), 1),
    "below": ((0.0, 1.0, 0.0), 2),
    "right": ((1.0, 0.0, 0.0), 3),
    "left": ((-1.0, 0.0, 0.0), 4),
    "in front of": ((0.0, 0.0, 1.0), 5),
    "behind": ((0.0, 0.0, -1.0), 6),
}


def printed(a: str, b: str) -> set[int]:
    return {int(number) for number in TABLE_1[a][LABELS.index(b)].split(",") if number}


def problem_of(R: NDArray[np.float64], points: NDArray[np.float64], normals: NDArray[np.float64]) -> JointProblem:
    """Vertical stripes as superpixels; the centre of each is said to be at a point of the room, on a plane through it.

    The paper's relations and cues ask for no more than that.
    """
    K, camera = len(points), SMALL
    in_camera, normal = points @ R, normals @ R
    center = in_camera[:, :2] / in_camera[:, 2:] * (camera.fx, camera.fy) + (camera.cx, camera.cy)
    slope = normal / (normals * points).sum(axis=1)[:, None]  # inverse depth is slope . ray
    a, b = slope[:, 0] / camera.fx, slope[:, 1] / camera.fy
    plane = np.stack([a, b, slope[:, 2] - a * camera.cx - b * camera.cy], axis=1)
    index = np.repeat(np.arange(camera.width)[None] * K // camera.width, camera.height, axis=0).astype(np.int32)
    superpixels = Superpixels(
        index=index,
        count=K,
        pixels=np.bincount(index.ravel()).astype(np.int32),
        center_px=center.astype(np.float32),
        mean_lab=np.zeros((K, 3), np.float32),
        plane=plane,
        plane_rms=np.full(K, 0.001, np.float32),
        measured=np.ones(K, np.float32),
        edges=np.array([(k, k + 1) for k in range(K - 1)], np.int32),
        edge_length=np.full(K - 1, camera.height, np.int32),
    )
    depth_m = np.full((camera.height, camera.width), 2.0, np.float32)
    geometry = compute_depth_geometry(RgbdFrame(camera, None, depth_m), CONFIG)
    evidence = FrameEvidence(R, depth_cues=compute_depth_cues(superpixels, R, camera))
    return build_joint_problem(camera, superpixels, evidence, geometry, CONFIG)


# --- Table 1 ----------------------------------------------------------------------------------------------------------


@pytest.mark.parametrize("b", LABELS)
@pytest.mark.parametrize("a", LABELS)
def test_the_physical_table_is_table_1_of_the_paper(a: str, b: str) -> None:
    ours = physical_table()[LABELS.index(a), LABELS.index(b)]
    assert {int(r) + 1 for r in np.flatnonzero(ours)} == printed(a, b)


def pair(R: NDArray[np.float64], step_m: NDArray[np.float64]) -> JointProblem:
    """Two superpixels that face the camera, the first a step in room axes away from the second."""
    second = R @ np.array([0.1, -0.1, 2.5])
    towards = np.tile(R @ np.array([0.0, 0.0, 1.0]), (2, 1))
    return problem_of(R, np.stack([second + step_m, second]), towards)


@pytest.mark.parametrize("R", (np.eye(3), look(30.0, 15.0, -10.0)), ids=("upright", "turned"))
@pytest.mark.parametrize("name", RELATIONS)
def test_a_superpixel_beside_another_in_3d_stands_in_that_relation_alone(name: str, R: NDArray[np.float64]) -> None:
    direction, number = np.array(RELATIONS[name][0]), RELATIONS[name][1]
    for step_m, share in ((0.02, 0.0), (0.18, 0.5), (0.33, 1.0), (0.8, 1.0)):
        expected = np.zeros((1, 6))
        expected[0, number - 1] = share
        np.testing.assert_allclose(pair(R, step_m * direction).relation, expected, atol=1e-4)


@pytest.mark.parametrize("name", RELATIONS)
def test_labels_that_table_1_forbids_a_pair_in_3d_cost_their_weight_and_others_nothing(name: str) -> None:
    direction, number = np.array(RELATIONS[name][0]), RELATIONS[name][1]
    opposite = number + 1 if number % 2 else number - 1
    problem = pair(look(30.0, 15.0, -10.0), 0.8 * direction)
    weight = 1.0 + np.arange(36.0).reshape(6, 6)
    cost = pair_costs(problem, ModelWeights(pack_blocks({"pair": weight})))[0] / problem.contact[0]
    for i, a in enumerate(LABELS):
        for j, b in enumerate(LABELS):
            expected = weight[i, j] * (number in printed(a, b)) + weight[j, i] * (opposite in printed(b, a))
            assert cost[i, j] == pytest.approx(expected, abs=1e-3), (a, name, b)


# --- depth cues -------------------------------------------------------------------------------------------------------

POINTS = np.array([(0.5, 1.3, 2.0), (0.0, 0.0, 6.0), (2.2, 0.2, 4.0), (-1.8, -0.6, 3.0), (0.4, -1.2, 2.5)])
"""On the floor, the front, the right and the left wall and the ceiling of a room."""
FACES = ("floor", "front", "right", "left", "ceiling")
DISTANCES = {
    # by hand: how far each of them is from the one of `POINTS` that is farthest that way, at most 3 m
    "ceiling": (2.5, 1.2, 1.4, 0.6, 0.0),
    "floor": (0.0, 1.3, 1.1, 1.9, 2.5),
    "left": (2.3, 1.8, 3.0, 0.0, 2.2),  # 4.0 for the right wall
    "front": (3.0, 0.0, 2.0, 3.0, 3.0),  # 4.0 for the floor, 3.5 for the ceiling
    "right": (1.7, 2.2, 0.0, 3.0, 1.8),  # 4.0 for the left wall
    "clutter": (0.0, 3.0, 2.0, 1.0, 0.5),  # backwards; 4.0 for the front wall
}


@pytest.fixture(params=((0.0, 0.0, 0.0), (10.0, 5.0, -8.0)), ids=("upright", "turned"))
def room(request: pytest.FixtureRequest) -> JointProblem:
    return problem_of(look(*request.param), POINTS, np.array([OUTWARD[face] for face in FACES], np.float64))


@pytest.mark.parametrize("label", LABELS)
def test_cosines_and_distances_of_a_label_are_those_of_its_direction(room: JointProblem, label: str) -> None:
    k = LABELS.index(label)
    cosines = [float(OUTWARD[face] @ OUTWARD[label]) for face in FACES]
    np.testing.assert_allclose(room.label_depth[:, k], cosines, atol=1e-5)
    np.testing.assert_allclose(room.label_depth[:, 6 + k], DISTANCES[label], atol=1e-4)


@pytest.mark.parametrize("label", LABELS)
def test_a_weight_of_a_cue_costs_its_own_label_and_no_other(room: JointProblem, label: str) -> None:
    k, area = LABELS.index(label), 1.0 / len(POINTS)
    for block, cue in ((k, [float(OUTWARD[face] @ OUTWARD[label]) for face in FACES]), (6 + k, DISTANCES[label])):
        weight = np.zeros(12)
        weight[block] = -0.7
        expected = np.zeros((len(POINTS), 6))
        expected[:, k] = -0.7 * area * np.array(cue)
        unary = label_problem(room, ModelWeights(pack_blocks({"label_depth": weight}))).unary
        np.testing.assert_allclose(unary, expected, atol=1e-4)


def test_a_superpixel_without_a_plane_has_no_cue() -> None:
    normals = np.array([OUTWARD["floor"], [np.nan] * 3], np.float64)
    cues = problem_of(np.eye(3), np.array([(0.0, ROOM[1], 2.0), (0.0, 0.0, 3.0)]), normals).label_depth
    assert (cues[1] == 0.0).all()
    assert cues[0, 1] == pytest.approx(1.0, abs=1e-6)
