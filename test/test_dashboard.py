"""The dashboard serves what was estimated, to this machine, and ends."""

from __future__ import annotations

import json
import socket
import urllib.error
import urllib.request
from collections.abc import Iterator
from http.server import ThreadingHTTPServer
from types import SimpleNamespace
from typing import Any

import cv2
import numpy as np
import pytest

from room_layout_ros.cli import main as room_layout
from room_layout_ros.commands.dashboard import room_of, show_source
from room_layout_ros.commands.dashboard_ears import Ears
from room_layout_ros.commands.dashboard_page import dashboard_html
from room_layout_ros.commands.dashboard_server import HOST, Board, Room, serve
from room_layout_ros.core.estimator import LayoutEstimator
from room_layout_ros.core.freespace import FREE_CELL, OCCUPIED_CELL, UNKNOWN_CELL
from room_layout_ros.core.tracking import TemporalPrior, next_prior
from room_layout_ros.datasets import good_samples
from room_layout_ros.datasets.synthetic import SyntheticSource
from room_layout_ros.listening import listen
from room_layout_ros.node_config import NodeConfig
from room_layout_ros.scene import Scene


@pytest.fixture
def board() -> Board:
    return Board("a <room>")


@pytest.fixture
def server(board: Board) -> Iterator[ThreadingHTTPServer]:
    server = serve(board, 0)
    yield server
    server.shutdown()
    server.server_close()


def get(server: ThreadingHTTPServer, path: str) -> bytes:
    with urllib.request.urlopen(f"http://{HOST}:{server.server_address[1]}/{path}", timeout=5) as answer:
        content: bytes = answer.read()
    return content


def test_page_loads_nothing_from_elsewhere_and_escapes_the_source() -> None:
    page = dashboard_html("<script>alert(1)</script>")
    assert "<script>alert(1)" not in page
    assert "http" not in page.replace("http-equiv", "")


def test_nothing_is_shown_before_the_first_room(server: ThreadingHTTPServer) -> None:
    assert json.loads(get(server, "state.json"))["number"] == -1
    with pytest.raises(urllib.error.HTTPError, match="404"):
        get(server, "overlay.jpg")


def test_shown_rooms_are_the_estimators(board: Board, server: ThreadingHTTPServer) -> None:
    source = SyntheticSource(frames=2, seed=4)
    show_source(board, source, end=float("inf"))
    estimator, prior = LayoutEstimator(), TemporalPrior()
    for sample in good_samples(source):
        estimate = estimator.estimate(sample.frame, prior)
        prior = next_prior(estimate)
    state = json.loads(get(server, "state.json"))
    assert state["number"] == 1
    assert state["name"] == sample.name
    assert {p["face"]: p["points"] for p in state["polygons"]} == {
        p.face: p.points_m.round(4).tolist() for p in estimate.polygons
    }
    assert set(state["stages"]) == set(estimate.timings_ms)
    image = cv2.imdecode(np.frombuffer(get(server, "overlay.jpg"), np.uint8), cv2.IMREAD_COLOR)
    assert image is not None
    assert image.shape == (480, 640, 3)
    assert get(server, "plan.jpg") == board.look()[1].plan


def test_a_bag_and_the_running_node_show_the_same_free_space(board: Board) -> None:
    (sample,) = good_samples(SyntheticSource(frames=1, seed=4))
    frame, estimator = sample.frame, LayoutEstimator()
    estimate = estimator.estimate(frame)
    space = Scene(frame, estimate, NodeConfig(), estimator.config).free_space
    assert space is not None
    assert {FREE_CELL, OCCUPIED_CELL, UNKNOWN_CELL} <= set(space.grid.ravel().tolist())
    ears = Ears(board)
    rows, columns = space.grid.shape
    ears.on_free_space(SimpleNamespace(info=SimpleNamespace(width=columns, height=rows), data=space.grid.ravel()))
    ears.on_overlay(overlay(stamp=1))
    assert room_of(frame, estimate, estimator.config).plan == board.look()[1].plan != b""


def test_a_room_without_depth_has_no_plan() -> None:
    (sample,) = good_samples(SyntheticSource(frames=1, seed=4))
    frame, estimator = sample.frame.without_depth(), LayoutEstimator()
    assert room_of(frame, estimator.estimate(frame), estimator.config).plan == b""


def test_polygons_of_a_node_are_shown_with_the_overlay_of_the_same_stamp(board: Board) -> None:
    ears = Ears(board)
    ears.on_polygon(polygon(stamp=1, face=2))
    ears.on_overlay(overlay(stamp=2))
    assert board.look()[1].polygons == []  # those of stamp 1 belong to another frame
    ears.on_polygon(polygon(stamp=2, face=3))
    assert [face for face, _ in board.look()[1].polygons] == [3]


def test_free_space_is_drawn_upright_free_bright_and_unknown_between(board: Board) -> None:
    ears = Ears(board)
    info = SimpleNamespace(width=2, height=2)
    ears.on_free_space(SimpleNamespace(info=info, data=[0, 100, -1, 0]))  # lower row: free, occupied
    ears.on_overlay(overlay(stamp=1))
    image = cv2.imdecode(np.frombuffer(board.look()[1].plan, np.uint8), cv2.IMREAD_GRAYSCALE)
    assert image is not None
    upper_left, upper_right, lower_left, lower_right = (int(image[y, x]) for y in (60, -60) for x in (60, -60))
    assert lower_right < 60 < upper_left < 180 < min(upper_right, lower_left)


def test_a_grid_that_does_not_fit_its_size_is_left_out(board: Board) -> None:
    ears = Ears(board)
    ears.on_free_space(SimpleNamespace(info=SimpleNamespace(width=3, height=2), data=[0, 100, -1, 0]))
    ears.on_overlay(overlay(stamp=1))
    assert board.look()[1].plan == b""


def test_memory_of_the_ears_is_bounded(board: Board) -> None:
    ears = Ears(board)
    for stamp in range(200):
        ears.on_polygon(polygon(stamp, 2))
        ears.on_overlay(overlay(stamp))
    assert len(ears._polygons) <= 8
    assert len(ears._overlays) <= 8


def header(stamp: int) -> Any:
    return SimpleNamespace(stamp=SimpleNamespace(sec=stamp, nanosec=0))


def polygon(stamp: int, face: int) -> Any:
    points = [SimpleNamespace(x=float(i), y=0.0, z=1.0) for i in range(3)]
    return SimpleNamespace(
        header=header(stamp), polygon=SimpleNamespace(id=face, polygon=SimpleNamespace(points=points))
    )


def overlay(stamp: int) -> Any:
    pixels = bytes(4 * 6 * 3)
    return SimpleNamespace(header=header(stamp), encoding="rgb8", height=4, width=6, step=18, data=pixels)


def test_port_in_use_and_bad_input_are_one_sentence(capsys: pytest.CaptureFixture[str]) -> None:
    with socket.socket() as taken:
        taken.bind((HOST, 0))
        taken.listen()
        port = taken.getsockname()[1]
        assert room_layout(["dashboard", "--port", str(port), "--seconds", "1"]) == 2
        assert f"port {port} cannot be used" in capsys.readouterr().err
    assert room_layout(["dashboard", "/no/such/bag", "--port", "0"]) == 2
    assert room_layout(["dashboard", "--port", "99999"]) == 2


@pytest.mark.dds
def test_a_node_name_that_is_none_is_one_sentence(capsys: pytest.CaptureFixture[str]) -> None:
    assert room_layout(["dashboard", "--port", "0", "--seconds", "1", "--node", "/no good"]) == 2
    assert "no good" in capsys.readouterr().err


def test_server_is_not_reachable_from_other_machines(server: ThreadingHTTPServer) -> None:
    assert server.server_address[0] == "127.0.0.1"


@pytest.mark.dds
def test_listening_ends_in_time(board: Board) -> None:
    listen("room_layout_dashboard", Ears(board).listeners("/estimator"), end=0.0)
    assert board.look() == (-1, Room(""))
