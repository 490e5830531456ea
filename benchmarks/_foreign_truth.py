"""Views of the rooms of `_foreign_rooms`, and what is true of them: faces, labels, cells of the floor, things."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from benchmarks import _ray_caster as rc
from benchmarks._foreign_rooms import KINDS
from benchmarks._foreign_things import Scene
from benchmarks._free_space import MARGIN_M, MOUNTS
from room_layout_ros.core.config import EstimatorConfig
from room_layout_ros.core.frame import RgbdFrame
from room_layout_ros.core.labels import CEILING, CLUTTER, FLOOR, FRONT_WALL, LEFT_WALL, RIGHT_WALL, UNKNOWN
from room_layout_ros.datasets.synthetic import NOISES, camera_pose
from room_layout_ros.datasets.synthetic.noise import sense_color, sense_depth
from room_layout_ros.datasets.synthetic.shapes import GLASS, MATTE

NEAR_M = 4.0
"""Cells are looked at up to this distance from the camera's foot."""

_ACROSS = 5
_TAKEN_PLACES = 3
_BEYOND = 4
"""State of floor outside the room, beside those of `what_stands`."""

_LABEL_OF_ROLE = {rc.FLOOR: FLOOR, rc.RAMP: UNKNOWN, rc.WALL: FRONT_WALL, rc.CEILING: CEILING, rc.THING: CLUTTER}


@dataclass(frozen=True, slots=True)
class View:
    """A frame of a scene. `pose` : (4, 4) T_world_camera. `thing_of` : (H, W) index of the thing in sight, -1: none."""

    scene: Scene
    solids: rc.Solids
    pose: NDArray[np.float64]
    frame: RgbdFrame
    picture: rc.Picture
    thing_of: NDArray[np.int64]


def take(kind: str, seed: int) -> View:
    """Build a scene and look at it. Noises and mounts of the camera take turns over the seeds."""
    number = list(KINDS).index(kind)
    rng = np.random.default_rng([seed, number])
    noise = list(NOISES.values())[seed % len(NOISES)]
    mount = list(MOUNTS.values())[(seed + seed // len(NOISES) + number) % len(MOUNTS)]
    camera, height_m = mount.camera, rng.uniform(*mount.height_m)
    pitch, roll = np.deg2rad([rng.uniform(*mount.pitch_deg), rng.uniform(-3.0, 3.0)])
    half_view = float(np.arctan(0.5 * camera.width / camera.fx))
    lowest = np.arctan(0.5 * camera.height / camera.fy) - pitch
    scene = Scene(rng, half_view, floor_from_m=float(height_m / np.tan(lowest)))
    KINDS[kind](scene)
    pose = camera_pose(scene.eye[0], scene.eye[1], height_m, scene.yaw, pitch, roll)
    solids = scene.solids()
    picture = rc.look(solids, camera, pose, scene.lamp())
    color = sense_color(picture.radiance, noise, rng)
    optics = np.where(picture.solid < 0, rc.MATTE, solids.optics[picture.solid])
    sensing = np.where(optics == rc.GLASS, GLASS, MATTE).astype(np.uint8)
    depth_m = sense_depth(picture.depth_m, picture.normal, sensing, color, camera, noise, rng)
    depth_m[optics == rc.BLACK] = np.nan
    thing_of = np.where(picture.solid < 0, -1, solids.thing[picture.solid])
    return View(scene, solids, pose, RgbdFrame(camera, color, depth_m, name=kind), picture, thing_of)


def true_layout(view: View) -> NDArray[np.uint8]:
    """(H, W) face ids of the empty room: the nearest plane of the box that a ray meets."""
    s, eye = view.scene, view.pose[:3, 3]
    rays = view.frame.camera.rays().astype(np.float64) @ view.pose[:3, :3].T
    ends = {
        CEILING: (2, s.height_m),
        FLOOR: (2, 0.0),
        LEFT_WALL: (1, s.width_m),
        FRONT_WALL: (0, s.length_m),
        RIGHT_WALL: (1, 0.0),
    }
    with np.errstate(divide="ignore"):
        reach = np.stack([(end - eye[axis]) / rays[..., axis] for axis, end in ends.values()], axis=-1)
    faces = np.array(list(ends), np.uint8)
    return np.asarray(faces[np.argmin(np.where(reach > 0, reach, np.inf), axis=-1)])


def true_labels(view: View) -> NDArray[np.uint8]:
    """(H, W) label ids, all walls FRONT_WALL; 0 beyond the room, below its floor, and on floor of another level."""
    s, picture = view.scene, view.picture
    role = view.solids.role[picture.solid]
    labels = np.array([_LABEL_OF_ROLE[k] for k in range(len(_LABEL_OF_ROLE))], np.uint8)[role]
    points = view.frame.camera.rays() * np.where(picture.solid < 0, 0.0, picture.surface_m)[..., None]
    x, y, z = np.moveaxis(points @ view.pose[:3, :3].T + view.pose[:3, 3], -1, 0)
    beyond = (x < -0.1) | (y < -0.1) | (x > s.length_m + 0.1) | (y > s.width_m + 0.1)
    other_level = (z <= -rc.STEP_M) | ((role == rc.FLOOR) & (z >= rc.STEP_M))
    return np.where((picture.solid < 0) | beyond | other_level, UNKNOWN, labels)


@dataclass(frozen=True, slots=True)
class Cells:
    """What is true of the cells of a grid: `FreeSpace.grid`, flattened, those ahead and within `NEAR_M`.

    Attributes
    ----------
    grid_shape, index : rows and columns; (n,) the cells' place in the flattened grid. range_m : (n,) of the middle.
    things : (n, k) index of the thing at each place looked at in a cell, -1: none.
    on_thing, on_unseen : (n,) bool, a thing or wall is in the cell; the same, not a pixel of it is in the picture.
    before_thing : (n,) bool, one that is in sight lies within `MARGIN_M` behind the middle.
    off_floor : (n,) bool, the floor there is of another level, or there is none.
    free, measured : (n,) bool, floor that is to be called free; of which the sensor measured half.
    judged : (n,) bool, all others are neither right nor wrong: ramps, and floor behind open doors.
    """

    grid_shape: tuple[int, int]
    index: NDArray[np.int64]
    range_m: NDArray[np.float64]
    things: NDArray[np.int64]
    on_thing: NDArray[np.bool_]
    on_unseen: NDArray[np.bool_]
    before_thing: NDArray[np.bool_]
    off_floor: NDArray[np.bool_]
    free: NDArray[np.bool_]
    measured: NDArray[np.bool_]
    judged: NDArray[np.bool_]


def true_cells(view: View, config: EstimatorConfig) -> Cells:
    """Look up from 25 places of every cell, and from 11 on the way to `MARGIN_M` behind its middle.

    Something is in a cell where it takes three places (cells that it touches with a corner are not judged by it), and
    behind it where it takes two. A cell is free where nothing of that is so, and half of its floor is in sight.
    """
    size, side_m = config.free_space_resolution_m, config.free_space_side_m
    columns = np.arange(round(config.free_space_forward_m / size))
    rows = np.arange(round(2 * side_m / size))
    x, y = (m.ravel() for m in np.meshgrid((columns + 0.5) * size, (rows + 0.5) * size - side_m))
    index = np.flatnonzero(np.hypot(x, y) <= NEAR_M)
    middle = np.column_stack([x, y])[index]
    range_m = np.linalg.norm(middle, axis=1)
    offsets = ((np.arange(_ACROSS) + 0.5) / _ACROSS - 0.5) * size
    inside = middle[:, None] + np.stack(np.meshgrid(offsets, offsets), axis=-1).reshape(-1, 2)
    behind = middle[:, None] * (1.0 + np.linspace(0.0, MARGIN_M, 11)[:, None] / range_m[:, None, None])
    state, things, pixel = _places(view, inside, config.robot_height_m)
    state_behind, things_behind, _ = _places(view, behind, config.robot_height_m)
    seen = np.isin(things, np.unique(view.thing_of))
    taken, other = state == rc.TAKEN, state == rc.OTHER_LEVEL
    on_thing = (taken & seen).sum(axis=1) >= _TAKEN_PLACES
    on_unseen = ~on_thing & (taken.sum(axis=1) >= _TAKEN_PLACES)
    off_floor = ~on_thing & ~on_unseen & (other.sum(axis=1) >= _TAKEN_PLACES)
    hazard_behind = np.isin(state_behind, (rc.TAKEN, rc.OTHER_LEVEL)).sum(axis=1) >= 2
    before = np.isin(things_behind, np.unique(view.thing_of)) & (state_behind == rc.TAKEN)
    in_sight = (pixel >= 0) & (state == rc.CLEAR)
    has_depth = in_sight & np.isfinite(view.frame.depth_m.ravel())[pixel]  # type: ignore[union-attr]
    judged = np.asarray(~np.isin(state, (rc.SLOPE, _BEYOND)).any(axis=1))
    occupied = on_thing | on_unseen | off_floor | hazard_behind
    free = judged & ~occupied & (in_sight.mean(axis=1) >= 0.5)
    return Cells(
        grid_shape=(len(rows), len(columns)),
        index=index,
        range_m=range_m,
        things=np.where(taken, things, -1),
        on_thing=on_thing,
        on_unseen=on_unseen,
        before_thing=before.sum(axis=1) >= 2,
        off_floor=off_floor,
        free=free,
        measured=free & (has_depth.mean(axis=1) >= 0.5),
        judged=judged,
    )


def _places(
    view: View, on_floor: NDArray[np.float64], height_m: float
) -> tuple[NDArray[np.uint8], NDArray[np.int64], NDArray[np.int64]]:
    """State, thing and pixel of (n, k, 2) places ahead and to the left of the camera's foot."""
    s, ahead = view.scene, view.pose[:2, 2] / np.linalg.norm(view.pose[:2, 2])
    world = on_floor @ np.array([ahead, [-ahead[1], ahead[0]]]) + view.pose[:2, 3]
    x, y = world.reshape(-1, 2).T.copy()
    state, solid, ground_m = rc.what_stands(view.solids, x, y, height_m)
    outside = (x < 0) | (y < 0) | (x > s.length_m) | (y > s.width_m)
    state[outside & (state == rc.CLEAR)] = _BEYOND
    points = np.column_stack([x, y, np.where(np.abs(ground_m) < rc.STEP_M, ground_m, 0.0)])
    pixel = rc.pixels_of(view.solids, view.frame.camera, view.pose, points)
    thing = np.where(solid < 0, -1, view.solids.thing[solid])
    shape = on_floor.shape[:2]
    return state.reshape(shape), thing.reshape(shape), pixel.reshape(shape)
