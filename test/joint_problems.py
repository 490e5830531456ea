"""Random joint problems of any size, with every kind of evidence in them."""

from __future__ import annotations

import numpy as np
from scipy.spatial.transform import Rotation

from room_layout_ros.core.cell_counts import count_cells
from room_layout_ros.core.depth_profiles import compute_depth_profiles
from room_layout_ros.core.frame import CameraIntrinsics
from room_layout_ros.core.joint_problem import JointProblem
from room_layout_ros.core.plane_fit import PlaneFit
from room_layout_ros.core.ray_grid import compute_ray_grid
from room_layout_ros.core.weights import N_FEATURES, ModelWeights

CAMERA = CameraIntrinsics(64, 48, 52.0, 52.0, 31.5, 23.5)


def random_problem(
    rng: np.random.Generator,
    columns: int = 8,
    rows: int = 6,
    rays: int = 8,
    with_depth: bool = True,
    turned_deg: tuple[float, float, float] = (40.0, 20.0, 5.0),
) -> JointProblem:
    """Blocks as superpixels, each cut into atoms of random orientation and true face; random features.

    The camera is turned by at most `turned_deg` in yaw, pitch and roll.
    """
    most = np.array(turned_deg)
    R = np.asarray(Rotation.from_euler("yxz", rng.uniform(-most, most), degrees=True).as_matrix())
    x, y = np.arange(64) * columns // 64, np.arange(48) * rows // 48
    index = (y[:, None] * columns + x).astype(np.int32)
    nodes = columns * rows
    code = (
        rng.integers(0, 36, (12, 16)).repeat(4, axis=0).repeat(4, axis=1)
    )  # orientation and true face of patches of 4 x 4
    atoms = (index * 36 + code).astype(np.int32)
    number = np.arange(nodes * 36)
    counts = count_cells(compute_ray_grid(CAMERA, R, rays, 64), atoms, len(number))
    context = rng.dirichlet(np.full(6, 0.5), nodes)
    scene = rng.dirichlet(np.full(5, 0.5), nodes)
    atom_superpixel = (number // 36).astype(np.int32)
    orientation = np.eye(6)[number // 6 % 6, 1:]
    right = [(i, i + 1) for i in range(nodes) if (i + 1) % columns]
    below = [(i, i + columns) for i in range(nodes - columns)]
    edges = np.array(right + below, dtype=np.int32).reshape(-1, 2)
    sign = rng.uniform(-1, 1, (len(edges), 3))
    relation = np.column_stack([sign[:, 0], -sign[:, 0], sign[:, 1], -sign[:, 1], sign[:, 2], -sign[:, 2]]).clip(
        0.0, 1.0
    )
    points = rng.uniform((-2, -1.2, 0.5), (2, 1.4, 4), (400, 3))
    profiles = compute_depth_profiles(
        points, rng.uniform(size=(400, 3)), rng.uniform(size=(400, 5)), np.full(400, 0.02), scale_count=5
    )
    return JointProblem(
        counts=counts,
        atom_superpixel=atom_superpixel,
        atom_feature=np.concatenate([orientation, context[atom_superpixel], scene[atom_superpixel]], axis=1),
        atom_region=(number % 6).astype(np.uint8),
        label_gc=context,
        label_om=rng.dirichlet(np.ones(5), nodes),
        label_depth=rng.uniform(size=(nodes, 12)) * with_depth,
        edges=edges,
        contact=rng.uniform(0.005, 0.02, len(edges)),
        relation=relation,
        smoothness=np.column_stack([np.ones(len(edges)), rng.uniform(size=(len(edges), 2))]),
        profiles=profiles if with_depth else None,
        fit=PlaneFit(
            np.where(rng.uniform(size=(nodes, 1)) < 0.2, np.nan, rng.uniform(-0.5, 4.0, (nodes, 5))),
            rng.uniform(size=(nodes, 5)),
            np.full(nodes, 0.1),
        )
        if with_depth
        else None,
        front_axis=0.2,
    )


def random_weights(rng: np.random.Generator, size: float = 1.0) -> ModelWeights:
    """Weights of every sign in every block."""
    return ModelWeights(rng.normal(0.0, size, N_FEATURES))
