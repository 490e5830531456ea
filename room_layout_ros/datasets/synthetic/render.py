"""A frame of a synthetic room with everything that is true of it."""

from __future__ import annotations

import numpy as np
from numpy.typing import NDArray

from room_layout_ros.core.frame import CameraIntrinsics, RgbdFrame
from room_layout_ros.datasets.sample import FrameTruth, Sample

from .floor import floor_map
from .noise import CLEAN, SensorNoise, sense_color, sense_depth
from .raster import camera_rectangles, cast
from .room import SyntheticRoom
from .shading import shade
from .truth import cast_shell, true_cuboid

KINECT = CameraIntrinsics(640, 480, 525.0, 525.0, 319.5, 239.5)


def render(
    room: SyntheticRoom,
    camera: CameraIntrinsics,
    T_world_camera: NDArray[np.float64],
    noise: SensorNoise = CLEAN,
    rng: np.random.Generator | None = None,
    stamp_ns: int = 0,
    name: str = "",
    frame_id: str = "camera",
) -> Sample:
    """Render one view.

    Parameters
    ----------
    room : SyntheticRoom
    camera : CameraIntrinsics
    T_world_camera : (4, 4) float64 array
        Pose of the optical frame; the camera must be inside the room.
    noise : SensorNoise
        What the sensor does to depth and colour; `CLEAN` gives exact depth.
    rng : Generator or None
        Needed unless the noise is `CLEAN`.

    Returns
    -------
    Sample
        With all of `FrameTruth`.

    Raises
    ------
    ValueError
        When there is noise but no `rng`.
    """
    if rng is None and noise is not CLEAN:
        raise ValueError("noise needs an rng; pass np.random.default_rng(seed)")
    surfaces = room.surfaces
    rectangles = camera_rectangles(surfaces, T_world_camera)
    index, depth_m = cast(rectangles, camera)
    radiance = shade(surfaces, room.solids, rectangles, room.light, camera, T_world_camera, index, depth_m)
    layout, layout_depth_m, R_room_camera = cast_shell(room, camera, T_world_camera)
    classes = np.array([*(s.nyu40 for s in surfaces), 0], np.uint8)
    normals = _normals(surfaces_normals(rectangles), index, camera)
    sensing = np.array([*(s.material.sensing for s in surfaces), 0], np.uint8)
    color = sense_color(radiance, noise, rng)
    sensed_m = sense_depth(depth_m, normals, sensing[index], color, camera, noise, rng)
    truth = FrameTruth(
        layout=layout,
        labels40=classes[index],
        cuboid=true_cuboid(room, layout, R_room_camera, T_world_camera),
        depth_m=depth_m,
        layout_depth_m=layout_depth_m,
        normal=normals,
        floor_map=floor_map(room, T_world_camera),
        down_camera=np.array([0.0, 0.0, -1.0]) @ T_world_camera[:3, :3],
        camera_height_m=float(T_world_camera[2, 3]),
    )
    return Sample(RgbdFrame(camera, color, sensed_m, stamp_ns, frame_id, name), truth, T_world_camera)


def surfaces_normals(rectangles: NDArray[np.float64]) -> NDArray[np.float64]:
    """Return (n + 1, 3) unit normals of rectangles in the camera frame; the last row is for rays that hit nothing."""
    normals = np.cross(rectangles[:, 3:6], rectangles[:, 6:9])
    normals /= np.linalg.norm(normals, axis=1, keepdims=True)
    # Towards the camera, which is at the origin of this frame.
    normals *= -np.sign(np.einsum("ij,ij->i", normals, rectangles[:, 0:3]))[:, None]
    return np.vstack([normals, np.zeros(3)])


def _normals(table: NDArray[np.float64], index: NDArray[np.int32], camera: CameraIntrinsics) -> NDArray[np.float32]:
    assert index.shape == (camera.height, camera.width)
    return np.asarray(table.astype(np.float32)[index])
