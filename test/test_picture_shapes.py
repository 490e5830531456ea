"""Pictures for people keep the shape of the camera's: a disc is a disc in every sheet, page and moving picture."""

from __future__ import annotations

from pathlib import Path

import cv2
import numpy as np
import pytest
from numpy.typing import NDArray
from PIL import Image as Pillow

from room_layout_ros.commands import demo
from room_layout_ros.commands.demo_pictures import ANIMATION_TILE, side_by_side, write_animation, write_sheets
from room_layout_ros.core.estimate import RoomEstimate, Status
from room_layout_ros.core.frame import CameraIntrinsics, RgbdFrame
from room_layout_ros.core.layout import RoomCuboid
from room_layout_ros.datasets import Sample
from room_layout_ros.datasets.images import read_color
from room_layout_ros.evaluation import pictures
from room_layout_ros.evaluation.stages import STAGES, Look, draw_all

Image = NDArray[np.uint8]

PAPER, GROUND, INK = (255, 255, 255), (200, 220, 200), (200, 0, 0)
GAP = 6
TILES = {
    (640, 480): (480, 360),
    (1280, 720): (640, 360),
    (848, 480): (636, 360),
    (480, 640): (360, 480),
    (160, 120): (480, 360),
    (1200, 300): (640, 360),
}
"""The tile of pictures of each width and height."""

every_shape = pytest.mark.parametrize("shape", TILES, ids=lambda shape: "x".join(map(str, shape)))


def disc(shape: tuple[int, int]) -> Image:
    """Return a picture of (width, height) with a disc in its midst, two thirds of its shorter side across."""
    image = np.full((shape[1], shape[0], 3), GROUND, np.uint8)
    return np.asarray(cv2.circle(image, (shape[0] // 2, shape[1] // 2), min(shape) // 3, INK, -1), np.uint8)


def across_and_along(image: Image, color: tuple[int, int, int] = INK) -> tuple[int, int]:
    """Return the width and height of what has about this colour."""
    rows, columns = np.nonzero(np.abs(image.astype(int) - color).sum(axis=2) < 60)
    return int(np.ptp(columns)) + 1, int(np.ptp(rows)) + 1


def assert_a_disc(image: Image, across_px: float) -> None:
    across, along = across_and_along(image)
    assert across == pytest.approx(along, abs=2)
    assert across == pytest.approx(across_px, abs=4)


def shrunk_px(shape: tuple[int, int]) -> float:
    """Return the diameter of a disc in the tile of its picture."""
    return 2 / 3 * min(shape) * min(tile / side for tile, side in zip(TILES[shape], shape, strict=True))


@every_shape
def test_a_tile_has_the_shape_of_the_picture(shape: tuple[int, int]) -> None:
    assert pictures.tile_size(disc(shape), 360) == TILES[shape]


@every_shape
def test_all_stages_of_a_frame_have_its_shape(shape: tuple[int, int]) -> None:
    sheet = draw_all(look(shape))
    width, height = TILES[shape]
    assert sheet.shape == (3 * (pictures.CAPTION_PX + height + GAP), 3 * (width + GAP), 3)
    assert_a_disc(sheet[pictures.CAPTION_PX :][:height, :width], shrunk_px(shape))


@every_shape
def test_a_square_a_metre_is_square(shape: tuple[int, int]) -> None:
    width, height = TILES[shape]
    plan = draw_all(look(shape))[-GAP - height : -GAP, :width]
    assert STAGES["top-down"][0] == "from above, a square a metre"
    across, along = (metre_px(plan, axis) for axis in (0, 1))
    assert across == pytest.approx(along, abs=1.5)


def metre_px(plan: Image, axis: int) -> float:
    """Return the pixels between lines, which are darker than the paper from one side to the other, less margins."""
    line = np.quantile(plan[..., 0], 0.3, axis=axis) < PAPER[0] - 10
    begins = np.flatnonzero(np.diff(line.astype(int)) == 1)
    return float(np.median(np.diff(begins)))


def look(shape: tuple[int, int]) -> Look:
    """Return a frame of this width and height with a disc in its colour, and a room without side walls."""
    (width, height), focal = shape, 0.8 * min(shape)
    camera = CameraIntrinsics(width, height, focal, focal, (width - 1) / 2, (height - 1) / 2)
    room = RoomCuboid(np.eye(3), np.array([1.0, 1.0, np.inf, 6.0, np.inf]))
    layout = room.raster(camera)
    empty = np.zeros_like(layout)
    few = empty.copy()
    few[::10, ::10] = layout[::10, ::10]  # more points would hide the lines of the view from above
    estimate = RoomEstimate(
        Status.OK, layout, few, empty, empty.astype(np.int32), np.eye(3), 1.0, 1.0, np.ones(5), room, ()
    )
    return Look(RgbdFrame(camera, disc(shape), room.depth(camera)), estimate)


@every_shape
def test_contact_sheets_keep_the_shape(shape: tuple[int, int], tmp_path: Path) -> None:
    write_sheets(tmp_path / "sheet.png", [("0", disc(shape)), ("1", disc((640, 480)))])
    sheet, (width, height) = read_color(tmp_path / "sheet.png"), TILES[shape]
    assert sheet.shape == (pictures.CAPTION_PX + height + GAP, 2 * (width + GAP), 3)
    assert_a_disc(sheet[:, :width], shrunk_px(shape))
    other = 2 / 3 * 480 * min(width / 640, height / 480)
    assert_a_disc(sheet[:, width + GAP :], other)


@every_shape
def test_the_moving_picture_has_each_of_its_pictures_in_its_own_shape(shape: tuple[int, int], tmp_path: Path) -> None:
    floor = np.full((ANIMATION_TILE[1], ANIMATION_TILE[0], 3), GROUND, np.uint8)
    seen = demo._seen(Sample(look(shape).frame)).picture
    (width, height), (floor_px, _) = TILES[shape], ANIMATION_TILE
    beside = side_by_side(seen, disc(shape), floor)
    assert beside.shape == (height, 2 * width + floor_px, 3)
    assert_a_disc(beside[:, :width], shrunk_px(shape))
    assert_a_disc(beside[:, width : 2 * width], shrunk_px(shape))
    assert across_and_along(beside[:, 2 * width :], GROUND) == ANIMATION_TILE
    turned = side_by_side(*(np.ascontiguousarray(np.rot90(image)) for image in (seen, disc(shape), floor)))
    write_animation(tmp_path / "a.webp", [beside, turned], 1.0)  # a camera that was turned in between
    with Pillow.open(tmp_path / "a.webp") as moving:
        assert moving.size == (beside.shape[1], height)
