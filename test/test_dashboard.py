"""The dashboard serves what was estimated, to this machine, and ends."""

from __future__ import annotations

import json
import socket
import sys
import time
import urllib.error
import urllib.request
from base64 import b64decode
from collections.abc import Iterator
from dataclasses import replace
from http.client import HTTPConnection
from http.server import ThreadingHTTPServer
from types import SimpleNamespace
from typing import Any

import cv2
import numpy as np
import pytest
from numpy.typing import NDArray

from room_layout_ros.cli import main as room_layout
from room_layout_ros.commands import dashboard
from room_layout_ros.commands.dashboard import room_of, show_source, stay
from room_layout_ros.commands.dashboard_ears import Ears
from room_layout_ros.commands.dashboard_page import dashboard_html
from room_layout_ros.commands.dashboard_room import MOST_POINTS, Cloud, Room, state_of
from room_layout_ros.commands.dashboard_server import HOST, Board, serve
from room_layout_ros.core.estimator import LayoutEstimator
from room_layout_ros.core.freespace import FREE_CELL, OCCUPIED_CELL, UNKNOWN_CELL
from room_layout_ros.core.labels import CLUTTER, FLOOR, LABEL_COLORS
from room_layout_ros.core.tracking import TemporalPrior, next_prior
from room_layout_ros.datasets import good_samples
from room_layout_ros.datasets.synthetic import SyntheticSource
from room_layout_ros.evaluation.floor_picture import FloorGrid
from room_layout_ros.listening import listen
from room_layout_ros.node_config import NodeConfig
from room_layout_ros.runtime.diagnosis import Finding, Level
from room_layout_ros.scene import Scene


@pytest.fixture
def board() -> Board:
    return Board("a <room>")


@pytest.fixture
def server(board: Board) -> Iterator[ThreadingHTTPServer]:
    pytest.importorskip("plotly", reason="plotly is not installed (extra viz)")
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
    assert json.loads(get(server, "state.json?after=-1")) == {"waiting": ""}
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
    assert state["polygons"] == {str(p.face): p.points_m.round(4).tolist() for p in estimate.polygons}
    assert set(state["stages"]) == set(estimate.timings_ms)
    image = cv2.imdecode(np.frombuffer(get(server, "overlay.jpg"), np.uint8), cv2.IMREAD_COLOR)
    assert image is not None
    assert image.shape == (480, 640, 3)


def test_what_the_page_has_is_not_sent_again(board: Board, server: ThreadingHTTPServer) -> None:
    board.show(Room("first"))
    assert get(server, "state.json?after=0") == b"null"
    board.reason = lambda: "no colour for 6 s"
    assert json.loads(get(server, "state.json?after=0")) == {"waiting": "no colour for 6 s"}
    board.show(Room("second"))
    assert json.loads(get(server, "state.json?after=0"))["name"] == "second"


def test_arrays_reach_the_page_as_they_are() -> None:
    grid = FloorGrid(np.array([[0, 100, -1], [-1, 0, 100]], np.int8), 0.05, (1.0, -2.0))
    points = np.arange(6, dtype=np.float32).reshape(2, 3)
    cloud = Cloud(points, np.array([[1, 2, 3], [4, 5, 6]], np.uint8))
    state = json.loads(json.dumps(state_of(0, 1, Room("a frame", grid=grid, cloud=cloud))))
    sent = state["grid"]
    cells = np.frombuffer(b64decode(sent["cells"]), np.int8).reshape(sent["ahead"], sent["left"])
    assert cells.tolist() == [[0, -1], [100, 0], [-1, 100]]
    assert (sent["resolution"], sent["origin"]) == (0.05, [1.0, -2.0])
    assert np.frombuffer(b64decode(state["cloud"]["points"]), "<f4").tolist() == points.ravel().tolist()
    assert list(b64decode(state["cloud"]["colors"])) == [1, 2, 3, 4, 5, 6]


def test_points_are_the_depths_in_the_colors_of_the_picture() -> None:
    (sample,) = good_samples(SyntheticSource(frames=1, seed=4))
    frame, estimator = sample.frame, LayoutEstimator()
    assert frame.color is not None
    assert frame.depth_m is not None
    cloud = room_of(frame, estimator.estimate(frame), estimator.config).cloud
    assert cloud is not None
    assert MOST_POINTS / 2 < len(cloud.points_m) <= MOST_POINTS
    x, y, z = cloud.points_m.T
    u = np.rint(x / z * frame.camera.fx + frame.camera.cx).astype(int)
    v = np.rint(y / z * frame.camera.fy + frame.camera.cy).astype(int)
    assert z == pytest.approx(frame.depth_m[v, u])
    assert (cloud.colors == frame.color[v, u]).all()


def test_a_bag_and_the_running_node_show_the_same_free_space(board: Board) -> None:
    (sample,) = good_samples(SyntheticSource(frames=1, seed=4))
    frame, estimator = sample.frame, LayoutEstimator()
    estimate = estimator.estimate(frame)
    space = Scene(frame, estimate, NodeConfig(), estimator.config).free_space
    assert space is not None
    assert {FREE_CELL, OCCUPIED_CELL, UNKNOWN_CELL} <= set(space.grid.ravel().tolist())
    ears = Ears(board, "/estimator")
    ears.on_overlay(overlay(stamp=1))
    ears.on_free_space(grid(1, space.grid, space.resolution_m, space.origin_m))
    heard, estimated = board.look()[2], room_of(frame, estimate, estimator.config)
    assert state_of(0, 1, heard)["grid"] == state_of(0, 1, estimated)["grid"] is not None


def test_a_room_without_depth_has_no_plan_and_no_points() -> None:
    (sample,) = good_samples(SyntheticSource(frames=1, seed=4))
    frame, estimator = sample.frame.without_depth(), LayoutEstimator()
    room = room_of(frame, estimator.estimate(frame), estimator.config)
    assert (room.grid, room.cloud, room.metric) == (None, None, False)


def test_polygons_of_a_node_are_shown_with_the_overlay_of_the_same_stamp(board: Board) -> None:
    ears = Ears(board, "/estimator")
    ears.on_polygon(polygon(stamp=1, face=2))
    ears.on_overlay(overlay(stamp=2))
    assert board.look()[2].polygons == []  # those of stamp 1 belong to another frame
    ears.on_polygon(polygon(stamp=2, face=3))
    assert [face for face, _ in board.look()[2].polygons] == [3]


def test_a_grid_that_does_not_fit_its_size_is_left_out(board: Board) -> None:
    ears = Ears(board, "/estimator")
    wrong = grid(1, np.zeros((2, 2), np.int8), 0.05, (0.0, 0.0))
    wrong.info.width = 3
    ears.on_free_space(wrong)
    ears.on_overlay(overlay(stamp=1))
    assert board.look()[2].grid is None


def test_obstacles_and_floor_of_a_node_are_points_in_the_colors_of_their_labels(board: Board) -> None:
    ears = Ears(board, "/estimator")
    ears.on_overlay(overlay(stamp=1))
    ears.on_obstacles(cloud(1, [(1, 2, 3)]))
    ears.on_floor(cloud(1, [(4, 5, 6), (7, 8, 9)]))
    ears.on_floor(cloud(2, [(0, 0, 1)]))  # of another frame
    shown = board.look()[2].cloud
    assert shown is not None
    assert shown.points_m.tolist() == [[1, 2, 3], [4, 5, 6], [7, 8, 9]]
    assert shown.colors.tolist() == LABEL_COLORS[[CLUTTER, FLOOR, FLOOR]].tolist()


@pytest.mark.parametrize("fault", [{"is_bigendian": True}, {"point_step": 8}, {"fields": []}, {"data": bytes(15)}])
def test_points_of_another_form_are_left_out(board: Board, fault: dict[str, Any]) -> None:
    ears = Ears(board, "/estimator")
    message = cloud(1, [(1, 2, 3)])
    vars(message).update(fault)
    ears.on_obstacles(message)
    ears.on_overlay(overlay(stamp=1))
    assert board.look()[2].cloud is None


def test_many_points_are_thinned() -> None:
    many = Cloud(np.zeros((3 * MOST_POINTS + 1, 3), np.float32), np.zeros((3 * MOST_POINTS + 1, 3), np.uint8))
    thinned = many.thinned()
    assert MOST_POINTS / 2 < len(thinned.points_m) == len(thinned.colors) <= MOST_POINTS


def test_the_frame_before_stays_until_the_parts_of_the_new_one_are_there() -> None:
    board = Board("a node", settle_s=0.2)
    board.show(Room("first"))
    time.sleep(0.25)
    board.show(Room("second"))
    board.show(Room("second", overlay=b"more of it"))
    assert board.look()[1:] == (1, Room("first"))
    time.sleep(0.25)
    assert board.look() == (2, 2, Room("second", overlay=b"more of it"))


def test_numbers_are_those_of_the_chosen_node_alone(board: Board) -> None:
    ears = Ears(board, "/left/estimator")
    for node, ms in (("left/estimator", "21.0"), ("right/estimator", "99.0"), ("estimator", "98.0")):
        values = {"latency_p50_ms": ms, "stage_ms: joint": ms, f"stage_ms: of {node}": "1"}
        ears.on_diagnostics(diagnostics((f"{node}: estimates", f"of {node}", values), ("motor", "hot", {})))
    ears.on_diagnostics(diagnostics(("left/estimator: floor", "floor from tf", {}), ("left/estimator", "x", {})))
    ears.on_overlay(overlay(stamp=1))
    room = board.look()[2]
    assert room.numbers == {"estimates": "of left/estimator", "latency_p50_ms": "21.0", "floor": "floor from tf"}
    assert room.stages == {"joint": 21.0, "of left/estimator": 1.0}


def test_while_there_is_no_room_the_node_says_why(board: Board, server: ThreadingHTTPServer) -> None:
    ears = Ears(board, "/left/estimator")
    assert json.loads(get(server, "state.json"))["waiting"] == "nothing is heard of a node /left/estimator"
    ears.on_diagnostics(diagnostics(("motor: estimates", "hot", {}), level=b"\x02"))
    assert board.reason() == "nothing is heard of a node /left/estimator"
    ears.on_diagnostics(diagnostics(("left/estimator: estimates", "warming up", {})))
    assert board.reason() == "warming up"
    own = "left/estimator"
    ears.on_diagnostics(
        diagnostics((f"{own}: input colour", "colour at 8 Hz", {}), (f"{own}: estimates", "waiting for frames", {}))
    )
    assert board.reason() == "waiting for frames"
    ears.on_diagnostics(diagnostics(("left/estimator: pairing", "no depth for 6 s on /nothing", {}), level=b"\x01"))
    assert json.loads(get(server, "state.json?after=-1")) == {"waiting": "no depth for 6 s on /nothing"}
    ears.on_overlay(overlay(stamp=1))
    assert "number" in json.loads(get(server, "state.json?after=-1"))


def test_a_fault_after_the_first_room_reaches_the_page(board: Board, server: ThreadingHTTPServer) -> None:
    now_s = 100.0
    ears = Ears(board, "/estimator", lambda: now_s)
    ears.on_diagnostics(diagnostics(("estimator: input colour", "colour at 30.1 Hz", {})))
    ears.on_overlay(overlay(stamp=1))
    number = json.loads(get(server, "state.json?after=-1"))["number"]
    gone = "no colour for 6 s on /rgb; nobody publishes it"
    ears.on_diagnostics(diagnostics(("estimator: input colour", gone, {}), level=b"\x02"))
    now_s += 2.0
    assert json.loads(get(server, f"state.json?after={number}")) == {"waiting": gone}
    now_s += 3.0
    ears.on_diagnostics(diagnostics(("motor: estimates", "hot", {})))  # another's word is not the node's
    said = json.loads(get(server, f"state.json?after={number}"))
    assert said == {"waiting": "nothing is heard of /estimator for 5 s"}
    ears.on_diagnostics(diagnostics(("estimator: input colour", "colour at 8.0 Hz", {})))
    assert json.loads(get(server, f"state.json?after={number}")) == {"waiting": "colour at 8.0 Hz"}


ENDED = "the input has ended; with --loop it starts again"


def test_the_end_of_the_input_is_told_to_every_page(board: Board, server: ThreadingHTTPServer) -> None:
    board.show(Room("000007"))
    assert json.loads(get(server, "state.json"))["ended"] == ""
    stay(board, time.monotonic() + 0.1)
    assert json.loads(get(server, "state.json"))["ended"] == ENDED
    assert json.loads(get(server, "state.json?after=0")) == {"ended": ENDED}


@pytest.mark.parametrize(
    ("lasts_s", "said"), [(0.0, f"{ENDED}; its last frame stays on the page\n"), (0.3, "")], ids=["ended", "cut_off"]
)
def test_the_end_of_the_input_is_told_in_the_terminal(
    monkeypatch: pytest.MonkeyPatch, capsys: pytest.CaptureFixture[str], lasts_s: float, said: str
) -> None:
    pytest.importorskip("plotly", reason="plotly is not installed (extra viz)")
    monkeypatch.setattr(dashboard, "open_with_topics", lambda *_: SyntheticSource(frames=1, seed=4))
    monkeypatch.setattr(dashboard, "show_source", lambda *_: time.sleep(lasts_s))
    assert room_layout(["dashboard", "my_bag", "--port", "0", "--seconds", "0.2"]) == 0
    assert capsys.readouterr().err == said


def test_a_page_that_is_opened_late_is_told_how_old_the_room_is(board: Board, server: ThreadingHTTPServer) -> None:
    board.show(Room("first"))
    assert json.loads(get(server, "state.json"))["age_s"] < 0.3
    time.sleep(0.3)
    assert 0.3 <= json.loads(get(server, "state.json"))["age_s"] < 5
    board.show(Room("first", overlay=b"more of it"))
    assert json.loads(get(server, "state.json"))["age_s"] < 0.3


def test_the_names_of_the_statuses_are_those_that_the_node_sends(board: Board) -> None:
    pytest.importorskip("diagnostic_msgs", reason="ROS is not installed (extra ros)")
    from msg_adapters.encode_diagnostics import encode_diagnostics

    ears = Ears(board, "/left/estimator")
    ears.on_diagnostics(encode_diagnostics([Finding("estimates", Level.OK, "8 per second")], "left/estimator", 0))
    ears.on_overlay(overlay(stamp=1))
    assert board.look()[2].numbers == {"estimates": "8 per second"}


def test_stages_that_the_node_no_longer_runs_are_gone(board: Board) -> None:
    ears = Ears(board, "/estimator")
    ears.on_diagnostics(diagnostics(("estimator: estimates", "", {"stage_ms: joint": "20", "stage_ms: edges": "1"})))
    ears.on_diagnostics(
        diagnostics(("estimator: estimates", "", {"stage_ms: layout": "3"}), ("estimator: floor", "", {}))
    )
    ears.on_overlay(overlay(stamp=1))
    assert board.look()[2].stages == {"layout": 3.0}


@pytest.mark.parametrize("metric", [True, False])
def test_a_running_node_tells_whether_the_room_is_in_metres(board: Board, metric: bool) -> None:
    pytest.importorskip("visualization_msgs", reason="ROS is not installed (extra ros)")
    from msg_adapters.encode_room import encode_markers

    (sample,) = good_samples(SyntheticSource(frames=1, seed=4))
    frame = sample.frame if metric else sample.frame.without_depth()
    frame = replace(frame, stamp_ns=1_000_000_000)
    estimate = LayoutEstimator().estimate(frame)
    assert estimate.polygons
    ears = Ears(board, "/estimator")
    ears.on_overlay(overlay(stamp=1))
    assert board.look()[2].metric is None
    ears.on_markers(encode_markers(estimate, 1.0))
    assert board.look()[2].metric is estimate.metric is metric
    ears.on_overlay(overlay(stamp=2))
    assert board.look()[2].metric is None, "another frame may have had no depth"


def test_markers_of_no_room_tell_nothing(board: Board) -> None:
    ears = Ears(board, "/estimator")
    ears.on_overlay(overlay(stamp=1))
    ears.on_markers(SimpleNamespace(markers=[]))
    assert board.look()[2].metric is None


def test_names_of_another_form_tell_no_unit(board: Board) -> None:
    """Another node's markers, or a later version's, are no word about metres."""
    ears = Ears(board, "/estimator")
    ears.on_overlay(overlay(stamp=1))
    ears.on_markers(SimpleNamespace(markers=[SimpleNamespace(ns="names", text="wall of 3 m", header=header(1))]))
    assert board.look()[2].metric is None


def test_the_picture_is_that_of_the_numbers_the_page_has(board: Board, server: ThreadingHTTPServer) -> None:
    board.show(Room("first", overlay=b"first"))
    frame = json.loads(get(server, "state.json"))["frames"]
    board.show(Room("second", overlay=b"second"))
    assert get(server, f"overlay.jpg?frame={frame}") == b"first"
    assert get(server, f"overlay.jpg?frame={frame + 1}") == get(server, "overlay.jpg") == b"second"
    for query in ("frame=99", "frame=x", "frame=-1", "frame="):
        status, _ = ask(server, "localhost", path=f"/overlay.jpg?{query}")
        assert status == (200 if query == "frame=" else 404)


def test_a_picture_is_kept_for_16_frames_of_however_many_parts_and_no_longer(
    board: Board, server: ThreadingHTTPServer
) -> None:
    """A node's frame comes in some eight parts, and the page asks for the picture a while after it has the numbers."""
    ears = Ears(board, "/estimator")
    pictures: dict[int, bytes] = {}
    for stamp in range(100):
        ears.on_overlay(overlay(stamp, shade=2 * stamp))
        for face in (1, 2, 3, 4, 5, 1, 2):
            ears.on_polygon(polygon(stamp, face))
        pictures[json.loads(get(server, "state.json"))["frames"]] = get(server, "overlay.jpg")
    assert len(set(pictures.values())) == len(pictures) == 100
    kept = {frame: board.overlay(frame) for frame in pictures if board.overlay(frame)}
    assert kept == {frame: pictures[frame] for frame in range(85, 101)}
    assert get(server, "overlay.jpg?frame=85") == pictures[85]
    assert len(board._overlays) == 16


def test_the_time_of_a_frame_is_its_wall_time_and_of_a_node_only_the_stages_are_known(
    board: Board, monkeypatch: pytest.MonkeyPatch
) -> None:
    """Stages run beside each other: their sum is no time of a frame."""
    estimator = LayoutEstimator()
    (sample,) = good_samples(SyntheticSource(frames=1, seed=4))
    estimate = estimator.estimate(sample.frame)
    slow = replace(estimate, timings_ms=dict.fromkeys(estimate.timings_ms, 1e6))

    def wait_a_little(self: LayoutEstimator, *_: object) -> Any:
        time.sleep(0.02)
        return slow

    monkeypatch.setattr(LayoutEstimator, "estimate", wait_a_little)
    show_source(board, SyntheticSource(frames=1, seed=4), end=float("inf"))
    took = state_of(0, 1, board.look()[2])["milliseconds"]
    assert 20 <= took < 1e6
    ears = Ears(board, "/estimator")
    ears.on_overlay(overlay(stamp=1))
    assert state_of(0, 1, board.look()[2])["milliseconds"] is None


@pytest.mark.parametrize("kept", [True, False])
def test_that_the_first_start_compiles_is_told_once(
    board: Board, capsys: pytest.CaptureFixture[str], monkeypatch: pytest.MonkeyPatch, kept: bool
) -> None:
    monkeypatch.setattr("room_layout_ros.commands.compiling.is_compiled", lambda _: kept)
    show_source(board, SyntheticSource(frames=2, seed=4), float("inf"))
    assert capsys.readouterr().err.count("compiling the estimator, ") == (not kept)


def test_memory_of_the_ears_is_bounded(board: Board) -> None:
    ears = Ears(board, "/estimator")
    for stamp in range(200):
        ears.on_polygon(polygon(stamp, 2))
        ears.on_overlay(overlay(stamp))
    assert len(ears._heard) <= 8


def header(stamp: int) -> Any:
    return SimpleNamespace(stamp=SimpleNamespace(sec=stamp, nanosec=0))


def diagnostics(*statuses: tuple[str, str, dict[str, str]], level: bytes = b"\x00") -> Any:
    return SimpleNamespace(
        status=[
            SimpleNamespace(
                level=level,
                name=name,
                message=message,
                hardware_id="",
                values=[SimpleNamespace(key=key, value=value) for key, value in values.items()],
            )
            for name, message, values in statuses
        ]
    )


def polygon(stamp: int, face: int) -> Any:
    points = [SimpleNamespace(x=float(i), y=0.0, z=1.0) for i in range(3)]
    return SimpleNamespace(
        header=header(stamp), polygon=SimpleNamespace(id=face, polygon=SimpleNamespace(points=points))
    )


def grid(stamp: int, cells: NDArray[np.int8], resolution: float, origin: tuple[float, float]) -> Any:
    corner = SimpleNamespace(position=SimpleNamespace(x=origin[0], y=origin[1]))
    info = SimpleNamespace(width=cells.shape[1], height=cells.shape[0], resolution=resolution, origin=corner)
    return SimpleNamespace(header=header(stamp), info=info, data=cells.ravel())


def cloud(stamp: int, points: list[tuple[float, float, float]]) -> Any:
    """Return a PointCloud2 that has another field between the coordinates."""
    offsets = {"x": 0, "intensity": 4, "y": 8, "z": 12}
    rows = np.array([(x, 0, y, z) for x, y, z in points], "<f4")
    return SimpleNamespace(
        header=header(stamp),
        fields=[SimpleNamespace(name=name, offset=offset, datatype=7) for name, offset in offsets.items()],
        is_bigendian=False,
        point_step=16,
        height=1,
        width=len(points),
        data=rows.tobytes(),
    )


def overlay(stamp: int, shade: int = 0) -> Any:
    pixels = bytes([shade]) * (4 * 6 * 3)
    return SimpleNamespace(header=header(stamp), encoding="rgb8", height=4, width=6, step=18, data=pixels)


def test_port_in_use_and_bad_input_are_one_sentence(capsys: pytest.CaptureFixture[str]) -> None:
    pytest.importorskip("plotly", reason="plotly is not installed (extra viz)")
    with socket.socket() as taken:
        taken.bind((HOST, 0))
        taken.listen()
        port = taken.getsockname()[1]
        assert room_layout(["dashboard", "--port", str(port), "--seconds", "1"]) == 2
        assert f"port {port} cannot be used" in capsys.readouterr().err
    assert room_layout(["dashboard", "/no/such/bag", "--port", "0"]) == 2
    assert room_layout(["dashboard", "--port", "99999"]) == 2
    capsys.readouterr()
    assert room_layout(["dashboard", "my_bag", "--node", "/estimator", "--port", "0"]) == 2
    assert "--node /estimator is for the page without INPUT, and my_bag is given" in capsys.readouterr().err


@pytest.mark.dds
def test_a_node_name_that_is_none_is_one_sentence(capsys: pytest.CaptureFixture[str]) -> None:
    pytest.importorskip("plotly", reason="plotly is not installed (extra viz)")
    assert room_layout(["dashboard", "--port", "0", "--seconds", "1", "--node", "/no good"]) == 2
    assert "no good" in capsys.readouterr().err


def test_without_plotly_the_extra_is_named(capsys: pytest.CaptureFixture[str], monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setitem(sys.modules, "plotly", None)
    assert room_layout(["dashboard", "--port", "0", "--seconds", "1"]) == 2
    assert "the dashboard needs Plotly: pip install '.[viz]' in the clone" in capsys.readouterr().err


def test_server_is_not_reachable_from_other_machines(server: ThreadingHTTPServer) -> None:
    assert server.server_address[0] == "127.0.0.1"


def ask(server: ThreadingHTTPServer, *hosts: str, path: str = "/state.json") -> tuple[int, str]:
    """Return status and content of the answer to a request with these Host headers."""
    connection = HTTPConnection(HOST, server.server_address[1], timeout=5)
    connection.putrequest("GET", path, skip_host=True)
    for host in hosts:
        connection.putheader("Host", host)
    connection.endheaders()
    answer = connection.getresponse()
    content = answer.read().decode()
    connection.close()
    return answer.status, content


@pytest.mark.parametrize("host", ["localhost", "LOCALHOST:80", "127.0.0.1", "127.0.0.1:8641", "[::1]", "[::1]:8641"])
def test_names_of_this_machine_are_answered(server: ThreadingHTTPServer, host: str) -> None:
    assert ask(server, host)[0] == 200


@pytest.mark.parametrize("path", ["/", "/state.json", "/overlay.jpg", "/plotly.min.js", "/none"])
def test_a_page_elsewhere_that_gives_its_name_our_address_gets_nothing(
    board: Board, server: ThreadingHTTPServer, path: str
) -> None:
    """DNS rebinding: the browser takes it for one server with that page, and would let it read the answers."""
    board.show(Room("a bedroom", overlay=b"jpeg"))
    status, content = ask(server, "rebound.example:8641", path=path)
    assert status == 403
    assert content == (
        "Host is 'rebound.example:8641'; allowed is localhost, 127.0.0.1 or [::1], with any port: "
        "the page is for this machine alone\n"
    )


@pytest.mark.parametrize(
    "hosts",
    [
        (),
        ("",),
        ("localhost.rebound.example",),
        ("rebound.example@localhost",),
        ("127.0.0.1.rebound.example:80",),
        ("127x0x0x1",),
        ("[::1",),
        ("::1",),
        ("localhost:",),
        ("localhost:80:80",),
        ("localhost", "rebound.example"),
        ("local\xe9host",),
    ],
)
def test_what_is_not_exactly_one_name_of_this_machine_is_refused(
    server: ThreadingHTTPServer, hosts: tuple[str, ...]
) -> None:
    status, content = ask(server, *hosts)
    assert status == 403
    assert content.startswith(f"Host is {', '.join(hosts)!r}; allowed is ")


@pytest.mark.dds
def test_listening_ends_in_time(board: Board) -> None:
    listen("room_layout_dashboard", Ears(board, "/estimator").listeners(), end=0.0)
    assert board.look() == (-1, 0, Room(""))


def test_a_browser_that_goes_during_an_answer_is_no_traceback(
    board: Board, capfd: pytest.CaptureFixture[str], monkeypatch: pytest.MonkeyPatch
) -> None:
    pytest.importorskip("plotly", reason="plotly is not installed (extra viz)")
    board.page = b"x" * 50_000_000  # more than the sockets hold
    server = serve(board, 0)
    monkeypatch.setattr(server, "daemon_threads", False)  # server_close waits for the answers
    for _ in range(3):
        with socket.create_connection((HOST, server.server_address[1])) as browser:
            browser.sendall(f"GET / HTTP/1.1\r\nHost: {HOST}\r\n\r\n".encode())
            browser.recv(100)
    server.shutdown()
    server.server_close()
    assert capfd.readouterr().err == ""
