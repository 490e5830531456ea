"""The picture of the free space has each cell where it is: ahead is up, left is left."""

from __future__ import annotations

import numpy as np
import pytest

from room_layout_ros.evaluation.floor_picture import (
    FREE_COLOR,
    OCCUPIED_COLOR,
    UNKNOWN_COLOR,
    FloorGrid,
    draw_floor,
    known_box,
)

BOX = (-1.0, 5.0, -3.0, 3.0)


def grid() -> FloorGrid:
    """2 m to 3 m ahead free, from 1 m to 2 m on the left of it occupied; nothing else known."""
    cells = np.full((60, 60), -1, np.int8)
    cells[25:35, 30:40] = 0
    cells[40:50, 30:40] = 100
    return FloorGrid(cells, 0.1, (-1.0, -3.0))


def at(picture: np.ndarray, x: float, y: float) -> tuple[int, ...]:
    """Return the colour at x ahead and y left, of a picture of BOX 60 pixels a metre."""
    return tuple(picture[round(60 * (5.0 - x)), round(60 * (3.0 - y))].tolist())


def test_cells_are_where_they_are_in_their_colours() -> None:
    picture = draw_floor(grid(), BOX, (360, 360))
    assert at(picture, 2.6, 0.2) == FREE_COLOR
    assert at(picture, 2.6, 1.6) == OCCUPIED_COLOR
    assert at(picture, 2.6, -1.6) == at(picture, 4.4, 0.4) == UNKNOWN_COLOR
    free = (picture == FREE_COLOR).all(axis=2).sum()
    assert free == pytest.approx(60 * 60, rel=0.06), "a square metre, less its lines"
    assert at(picture, 0.0, 0.0) == (20, 90, 220), "the camera"


def test_the_box_holds_all_that_is_known_and_the_camera() -> None:
    np.testing.assert_allclose(known_box([grid()]), (-0.3, 3.3, -0.8, 2.3), atol=1e-9)
    np.testing.assert_allclose(known_box([]), (-0.3, 0.3, -0.3, 0.3))


def test_a_frame_without_free_space_is_not_known_everywhere_and_says_why() -> None:
    nothing_known = draw_floor(FloorGrid(np.full((2, 2), -1, np.int8), 0.1, (0.0, 0.0)), BOX, (360, 360))
    picture = draw_floor(None, BOX, (360, 360))
    assert (picture != nothing_known).any(axis=2).sum() > 100, "words"
    assert not (picture == FREE_COLOR).all(axis=2).any()
    assert at(picture, 2.6, 0.2) == UNKNOWN_COLOR
