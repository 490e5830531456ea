"""The dashboard's page runs in a browser: its plots hold the room, and what a person set in them stays."""

from __future__ import annotations

import re
import time
from collections.abc import Iterator
from dataclasses import replace
from http.server import ThreadingHTTPServer
from pathlib import Path
from typing import Any

import cv2
import numpy as np
import pytest
from browser import BROWSER, Browser
from numpy.typing import NDArray

from room_layout_ros.commands.dashboard import room_of
from room_layout_ros.commands.dashboard_room import Room
from room_layout_ros.commands.dashboard_server import HOST, Board, serve
from room_layout_ros.commands.view import find_frame
from room_layout_ros.core.estimator import LayoutEstimator
from room_layout_ros.core.freespace import FREE_CELL
from room_layout_ros.core.labels import LABEL_COLORS, LABEL_NAMES
from room_layout_ros.datasets import good_samples, open_source
from room_layout_ros.datasets.synthetic import SyntheticSource

WINDOW = (1400, 1300)
CARD = np.array((0x1C, 0x21, 0x28))  # colour of the page behind the plots
PLAN_RANGE = "document.getElementById('plan')._fullLayout.xaxis.range"

pytestmark = pytest.mark.skipif(BROWSER is None, reason="neither chromium nor google-chrome is on this machine")
pytest.importorskip("plotly", reason="plotly is not installed (extra viz)")


class Page:
    """The dashboard open in a browser."""

    def __init__(self, board: Board, server: ThreadingHTTPServer, browser: Browser) -> None:
        self.board, self.server, self.browser = board, server, browser

    def wait(self) -> None:
        """Wait until the newest room is drawn, and its picture decoded."""
        number, frames, _ = self.board.look()
        self.browser.wait_for(f"drawn === {number} && charted === newest")
        self.browser.wait_for("document.getElementById('overlay').naturalWidth > 0")
        assert self.browser.value("seen.at(-1)[1]") == frames

    def traces(self, plot: str, fields: str) -> list[Any]:
        """Return the fields of each trace that Plotly drew."""
        expression = f"document.getElementById('{plot}')._fullData.map(t => {fields})"
        traces: list[Any] = self.browser.value(expression)
        return traces

    def eye(self) -> dict[str, float]:
        """Return where the person looks from."""
        eye: dict[str, float] = self.browser.value(
            "document.getElementById('room')._fullLayout.scene._scene.getCamera().eye"
        )
        return eye

    def eye_after(self, before: dict[str, float]) -> dict[str, float]:
        """Return where from once that is another place and at rest: Plotly turns and zooms when it comes to it."""
        last, end = before, time.monotonic() + 20.0
        while time.monotonic() < end:
            time.sleep(0.3)
            now = self.eye()
            if now == pytest.approx(last) and now != pytest.approx(before):
                return now
            last = now
        raise AssertionError(f"the view stays at {last} or does not come to rest")

    def drag(self, x: float, y: float) -> None:
        """Move the mouse with its left button down, and let the page follow."""
        self.browser.mouse("mouseMoved", x, y, button="left", buttons=1)
        self.wait_for_picture()

    def wait_for_picture(self) -> None:
        """Wait until what was done is drawn."""
        self.browser.value("new Promise(done => requestAnimationFrame(() => requestAnimationFrame(done)))")

    def middle(self, plot: str) -> tuple[float, float]:
        x, y = self.browser.value(
            f"(b => [b.x + b.width / 2, b.y + b.height / 2])(document.getElementById('{plot}').getBoundingClientRect())"
        )
        return x, y

    def pixels(self, plot: str) -> NDArray[np.uint8]:
        """Return the (h, w, 3) RGB pixels of one plot."""
        image = cv2.imdecode(np.frombuffer(self.browser.screenshot(), np.uint8), cv2.IMREAD_COLOR)
        assert image is not None
        box = self.browser.value(f"document.getElementById('{plot}').getBoundingClientRect().toJSON()")
        x, y, width, height = (int(box[key]) for key in ("x", "y", "width", "height"))
        return np.asarray(image[y : y + height, x : x + width, ::-1], np.uint8)


def open_page(board: Board, browser: Browser) -> Iterator[Page]:
    server = serve(board, 0)
    browser.errors.clear()
    try:
        browser.open(f"http://{HOST}:{server.server_address[1]}/")
        browser.wait_for("typeof drawn !== 'undefined'")
        yield Page(board, server, browser)
    finally:
        browser.open("about:blank")  # asks nothing of a server that has ended
        browser.wait_for("location.href === 'about:blank'")
        server.shutdown()
        server.server_close()


def open_browser(folder: Path) -> Iterator[Browser]:
    browser = Browser(folder, WINDOW)
    try:
        yield browser
    finally:
        browser.close()


def share_of_color(pixels: NDArray[np.uint8], color: NDArray[np.uint8]) -> float:
    """Share of pixels that are the card with a good part of this colour over it: faces are half transparent."""
    above, full = pixels.astype(float) - CARD, color.astype(float) - CARD
    part = above @ full / (full @ full)
    off = np.linalg.norm(above - part[:, :, None] * full, axis=2)
    return float(np.mean((part > 0.4) & (part < 1.1) & (off < 15)))


@pytest.fixture(scope="module")
def rooms() -> list[Room]:
    estimator = LayoutEstimator()
    frames = [sample.frame for sample in good_samples(SyntheticSource(frames=3, seed=4))]
    return [room_of(frame, estimator.estimate(frame), estimator.config) for frame in frames]


@pytest.fixture(scope="module")
def page(rooms: list[Room], tmp_path_factory: pytest.TempPathFactory) -> Iterator[Page]:
    """The page of most tests."""
    board = Board("rendered frames")
    board.show(rooms[0])
    for browser in open_browser(tmp_path_factory.mktemp("browser")):
        yield from open_page(board, browser)


@pytest.fixture(scope="module")
def other(tmp_path_factory: pytest.TempPathFactory) -> Iterator[Browser]:
    """A browser for tests that open a page of their own."""
    yield from open_browser(tmp_path_factory.mktemp("other"))


@pytest.fixture
def room(page: Page) -> Room:
    page.wait()
    return page.board.look()[2]


def test_the_room_in_3d_has_its_faces_and_the_points(page: Page, room: Room) -> None:
    shown = page.traces("room", "[t.type, t.name, t.visible, t.x ? t.x.length : 0]")
    meshes = {name: count for kind, name, visible, count in shown if kind == "mesh3d" and visible and count}
    assert meshes == {LABEL_NAMES[face]: len(points) for face, points in room.polygons}
    assert ["scatter3d", "points", True, points_of(room)] in shown
    assert any(name == "camera" and visible for kind, name, visible, _ in shown)


def test_the_room_is_drawn_in_the_colors_of_its_faces(page: Page, room: Room) -> None:
    pixels = page.pixels("room")
    for face, _ in room.polygons:
        assert share_of_color(pixels, LABEL_COLORS[face]) > 2e-4, LABEL_NAMES[face]


def test_free_space_is_in_metres_around_the_floor_below_the_camera(page: Page, room: Room) -> None:
    (plan,) = page.traces("plan", "t.type === 'heatmap' ? {z: t.z, x0: t.x0, dx: t.dx, y0: t.y0, dy: t.dy} : null")[:1]
    assert room.grid is not None
    grid = room.grid
    assert np.array_equal(np.array(plan["z"]).T, np.where(grid.cells < 0, 0, np.where(grid.cells < 50, 1, 2)))
    half = grid.resolution_m / 2
    assert (plan["y0"], plan["x0"]) == pytest.approx((grid.origin_m[0] + half, grid.origin_m[1] + half))
    assert (plan["dx"], plan["dy"]) == pytest.approx((grid.resolution_m, grid.resolution_m))
    marks = page.traces("plan", "t.type === 'scatter' ? [t.x, t.y, t.text] : null")
    assert [[0], [0], ["camera"]] in marks, "where the robot's frame lies is not known here"


def test_hovering_over_the_free_space_says_what_is_there(page: Page, room: Room) -> None:
    assert room.grid is not None
    free = np.argwhere(room.grid.cells == FREE_CELL)
    row, column = free[len(free) // 2]
    ahead = room.grid.origin_m[0] + (column + 0.5) * room.grid.resolution_m
    left = room.grid.origin_m[1] + (row + 0.5) * room.grid.resolution_m
    x, y = page.browser.value(f"""(() => {{
        const plot = document.getElementById('plan'), l = plot._fullLayout, box = plot.getBoundingClientRect();
        return [box.x + l.xaxis._offset + l.xaxis.d2p({left}), box.y + l.yaxis._offset + l.yaxis.d2p({ahead})] }})()""")
    page.browser.mouse("mouseMoved", x, y)
    page.browser.wait_for("!!document.querySelector('#plan .hoverlayer .hovertext')")
    text = page.browser.value("document.querySelector('#plan .hoverlayer').textContent").replace("\u2212", "-")
    found = re.fullmatch(r"ahead (.+) mleft (.+) mfree", text)
    assert found is not None, text
    assert [float(found[1]), float(found[2])] == pytest.approx([ahead, left], abs=0.011)


def test_timings_and_numbers_are_those_of_the_estimate(page: Page, room: Room) -> None:
    (bars,) = page.traces("stages", "[t.orientation, t.y, t.x]")
    assert bars[0] == "h"
    assert dict(zip(bars[1], bars[2], strict=True)) == room.stages
    rows = "[...document.querySelectorAll('#numbers tr')].map(r => [...r.cells].map(c => c.textContent))"
    assert dict(page.browser.value(rows)) == room.numbers
    assert room.numbers["status"] == "ok"


def test_the_overlay_is_the_estimates(page: Page, room: Room) -> None:
    image = cv2.imdecode(np.frombuffer(room.overlay, np.uint8), cv2.IMREAD_COLOR)
    assert image is not None
    size = page.browser.value("(i => [i.naturalWidth, i.naturalHeight])(document.getElementById('overlay'))")
    assert size == [image.shape[1], image.shape[0]]


def test_the_view_of_a_person_stays_when_the_next_frame_comes(page: Page, rooms: list[Room]) -> None:
    page.wait()
    start, (x, y) = page.eye(), page.middle("room")
    page.browser.mouse("mouseMoved", x, y)
    page.browser.mouse("mousePressed", x, y, button="left", clickCount=1)
    page.drag(x + 60, y + 10)
    page.board.show(rooms[1])  # in the midst of the turn
    page.wait()
    page.drag(x + 140, y + 20)
    page.browser.mouse("mouseReleased", x + 140, y + 20, button="left", clickCount=1)
    page.browser.wait_for("waiting === null")
    turned = page.eye_after(start)
    page.browser.mouse("mouseWheel", x, y, deltaX=0, deltaY=-100)
    page.browser.mouse("mouseWheel", *page.middle("plan"), deltaX=0, deltaY=-200)
    nearer = page.eye_after(turned)
    assert abs(nearer["x"] - start["x"]) > 0.02
    assert points_shown(page) == points_of(rooms[1])  # had waited for the end of the turn
    page.browser.wait_for(f"Math.abs({PLAN_RANGE}[0] - {PLAN_RANGE}[1]) < 7.9")  # zoomed in: the grid is 8 m wide
    zoomed = page.browser.value(PLAN_RANGE)
    page.board.show(rooms[2])
    page.wait()
    assert points_shown(page) == points_of(rooms[2])
    assert page.eye() == pytest.approx(nearer)
    assert page.browser.value(PLAN_RANGE) == pytest.approx(zoomed)


def points_shown(page: Page) -> int:
    (count,) = page.traces("room", "t.name === 'points' ? t.x.length : -1")[-1:]
    return int(count)


def points_of(room: Room) -> int:
    assert room.cloud is not None
    return len(room.cloud.points_m)


def test_a_name_that_was_switched_off_stays_off(page: Page, rooms: list[Room]) -> None:
    page.wait()
    x, y = page.browser.value("""(() => {
        const rows = [...document.querySelectorAll('#room .legend .traces')];
        const box = rows.find(r => r.textContent === 'points').getBoundingClientRect();
        return [box.x + box.width / 2, box.y + box.height / 2] })()""")
    page.browser.mouse("mousePressed", x, y, button="left", clickCount=1)
    page.browser.mouse("mouseReleased", x, y, button="left", clickCount=1)
    off = "document.getElementById('room')._fullData.at(-1).visible === 'legendonly'"
    page.browser.wait_for(off)
    page.board.show(rooms[0])
    page.wait()
    assert page.browser.value(off)


def test_frames_per_second_are_counted(page: Page, rooms: list[Room]) -> None:
    page.wait()
    page.board.show(rooms[1])
    page.wait()
    (rates,) = page.traces("rate", "t.y")
    assert rates[-1] > 0


RATE = "document.getElementById('rate')._fullData"


def test_the_rate_falls_when_frames_stop_and_the_chart_goes_on(rooms: list[Room], other: Browser) -> None:
    board = Board("ten a second")
    board.show(replace(rooms[0], name="before"))
    for page in open_page(board, other):
        page.wait()
        feed(board, rooms[0], seconds=4.0)
        time.sleep(4.0)
        ages, heights = page.browser.value(f"[{RATE}[0].x, {RATE}[0].y]")
        assert 8.0 < max(heights) < 11.5, "that of the frames, not of the drawing"
        assert heights[-1] < 0.5
        assert -3.0 < ages[-1] <= 0.0
        assert ages[heights.index(max(heights))] < -2.5
        assert page.browser.errors == []


def feed(board: Board, room: Room, seconds: float) -> None:
    """Show ten rooms a second."""
    begun = time.monotonic()
    for k in range(round(10 * seconds)):
        time.sleep(max(0.0, begun + k / 10 - time.monotonic()))
        board.show(replace(room, name=f"{k} tenths"))


@pytest.mark.parametrize(("gap_s", "expected"), [(0.1, 10.0), (1.0, 1.0), (4.0, 0.25)])
def test_the_rate_is_that_of_frames_however_slow(page: Page, gap_s: float, expected: float) -> None:
    """By times of our own: an answer each tenth of a second, a frame each `gap_s`."""
    page.wait()
    rates = page.browser.value(f"""(() => {{
        const kept = seen.splice(0), rates = [];
        for (let k = 0; k < 200; k++) {{
            count(k / 10, Math.floor(k / 10 / {gap_s} + 1e-9));
            if (k > 100) rates.push(framesPerSecond());
        }}
        seen.splice(0, Infinity, ...kept);
        return rates }})()""")
    assert rates == pytest.approx([expected] * len(rates), rel=0.05)


def test_a_dashboard_that_is_started_anew_counts_anew(page: Page) -> None:
    page.wait()
    rate = page.browser.value("""(() => {
        const kept = seen.splice(0);
        for (let k = 0; k < 50; k++) count(k / 10, 100 + k);
        count(5.0, 1);
        for (let k = 1; k < 30; k++) count(5.0 + k / 10, 1 + k);
        const rate = framesPerSecond();
        count(8.0, 1);
        const anew = seen.length;
        seen.splice(0, Infinity, ...kept);
        return [rate, anew] })()""")
    assert rate == [pytest.approx(10.0, rel=0.05), 1]


@pytest.mark.parametrize(
    ("metric", "unit"), [(True, " [m]"), (False, " [front wall = 1]"), (None, "")], ids=["depth", "color", "not_told"]
)
def test_axes_name_the_unit_of_the_room(page: Page, rooms: list[Room], metric: bool | None, unit: str) -> None:
    page.board.show(replace(rooms[0], name=f"metric {metric}", metric=metric))
    page.wait()
    titles = page.browser.value(
        "['xaxis', 'yaxis', 'zaxis'].map(a => document.getElementById('room')._fullLayout.scene[a].title.text)"
    )
    assert titles == [f"right{unit}", f"ahead{unit}", f"up{unit}"]


def test_a_frame_without_floor_says_so(page: Page, rooms: list[Room]) -> None:
    page.board.show(Room("no floor", overlay=rooms[0].overlay, polygons=rooms[0].polygons))
    page.wait()
    assert page.traces("plan", "t.type") == ["scatter"]
    assert "no free space" in page.browser.value("document.getElementById('plan').textContent")


def test_at_eight_frames_a_second_the_page_keeps_up_with_the_newest(page: Page, rooms: list[Room]) -> None:
    for k in range(24):
        page.board.show(replace(rooms[k % 3], name=f"quick {k}"))
        time.sleep(0.125)
    end = time.monotonic()
    page.wait()
    assert time.monotonic() - end < 3.0  # draws in 0.1 s on two shared cores; 24 in a queue would take longer
    assert page.browser.value("name") == "quick 23"


def test_the_table_is_that_of_the_frame_in_the_picture(page: Page, rooms: list[Room]) -> None:
    page.wait()
    for name in ("one", "two"):  # charts wait for each other, half a second; the table does not
        page.board.show(replace(rooms[0], name=name, numbers={"frame": name}))
        number, frames, _ = page.board.look()
        page.browser.wait_for(f"drawn === {number}")
        assert page.browser.value("document.getElementById('overlay').src").endswith(f"frame={frames}")
        assert page.browser.value("document.getElementById('numbers').rows[0].cells[1].textContent") == name


@pytest.mark.parametrize(
    ("took", "said"), [(42.0, "ms: frame 42.0, sum 60.0"), (None, "ms: sum 60.0")], ids=["frames", "node"]
)
def test_the_sum_of_the_stages_is_called_so(page: Page, rooms: list[Room], took: float | None, said: str) -> None:
    stages = {"joint": 40.0, "lines": 20.0}
    page.board.show(replace(rooms[0], name=f"took {took}", stages=stages, milliseconds=took))
    page.wait()
    title = page.browser.value("document.getElementById('stages')._fullLayout.xaxis.title.text")
    assert title == f"{said}<br>(stages run beside each other)"


@pytest.mark.parametrize("width", [1500, 1120])
def test_the_title_of_the_stages_is_seen_whole(page: Page, rooms: list[Room], width: int) -> None:
    page.browser.call("Emulation.setDeviceMetricsOverride", width=width, height=1400, deviceScaleFactor=1, mobile=False)
    try:
        page.browser.wait_for(f"innerWidth === {width}")
        stages = {"superpixels": 123.4, "orientation": 20.0}
        page.board.show(replace(rooms[0], name=f"at {width}", stages=stages, milliseconds=1234.5))
        page.wait()
        plot, title = (
            page.browser.value(f"document.querySelector('{which}').getBoundingClientRect().toJSON()")
            for which in ("#stages", "#stages .xtitle")
        )
    finally:
        page.browser.call("Emulation.clearDeviceMetricsOverride")
    assert plot["left"] <= title["left"] < title["right"] <= plot["right"]
    assert plot["top"] <= title["top"] < title["bottom"] <= plot["bottom"]


def test_nothing_of_all_this_was_an_error(page: Page) -> None:
    page.wait()
    assert page.browser.errors == []
    assert page.browser.value("document.getElementById('age').textContent").startswith("frame ")


def test_the_picture_is_asked_for_before_the_room_is_drawn(page: Page, rooms: list[Room]) -> None:
    """Drawing may take longer than the server keeps the picture."""
    page.wait()
    page.browser.value("""(() => {
        const react = Plotly.react;
        performance.clearResourceTimings();  // no more than 250 are noted
        Plotly.react = (plot, ...rest) => {
            if (plot === "room") globalThis.drawingAt = performance.now();
            const end = performance.now() + (plot === "room" ? 1000 : 0);
            while (performance.now() < end);
            return react(plot, ...rest);
        };
        globalThis.restore = () => { Plotly.react = react; };
    })()""")
    page.board.show(replace(rooms[0], name="slowly drawn"))
    page.wait()
    frame = page.board.look()[1]
    requests = "performance.getEntriesByType('resource')"
    asked = page.browser.value(f"{requests}.find(e => e.name.endsWith('frame={frame}')).startTime")
    assert asked <= page.browser.value("restore() || drawingAt")


AGE, NUMBERS = "document.getElementById('age')", "document.getElementById('numbers')"


def test_why_no_other_room_comes_is_said_when_the_last_is_old(rooms: list[Room], other: Browser) -> None:
    board, why = Board("node /estimator"), "no colour for 13 s on </rgb>"
    board.reason = lambda: why
    board.show(replace(rooms[0], name="at 1 s"))
    for page in open_page(board, other):
        page.wait()
        page.browser.wait_for(f"{NUMBERS}.className === 'old'")  # they are no longer true
        assert page.browser.value(f"{AGE}.className") == "bad"
        match = re.fullmatch(r"frame at 1 s, (\d+\.\d) s ago: (.*)", page.browser.value(f"{AGE}.textContent"))
        assert match is not None
        assert float(match[1]) > 3.0
        assert match[2] == why
        page.board.show(replace(rooms[1], name="at 2 s"))
        page.browser.wait_for(f"{AGE}.textContent.startsWith('frame at 2 s, ')")
        page.browser.wait_for(f"/^frame at 2 s, [0-2].. s ago$/.test({AGE}.textContent) && {AGE}.className === ''")
        assert page.browser.value(f"{NUMBERS}.className") == ""
        assert page.browser.errors == []


def test_the_end_of_the_input_is_said_and_is_no_fault(rooms: list[Room], other: Browser) -> None:
    board = Board("a bag")
    board.show(replace(rooms[0], name="000007"))
    for page in open_page(board, other):
        page.wait()
        board.ended = "the input has ended; with <--loop> it starts again"
        said = f"frame 000007, the last: {board.ended}"
        page.browser.wait_for(f"{AGE}.textContent === '{said}'")
        page.browser.wait_for("performance.now() - drawnAt > 3500")
        page.browser.open(page.browser.value("location.href"))  # a page that is opened late
        page.browser.wait_for("typeof drawn !== 'undefined' && drawn >= 0")
        page.browser.wait_for(f"{AGE}.textContent !== 'waiting for the first room'")
        assert page.browser.value(f"[{AGE}.textContent, {AGE}.className, {NUMBERS}.className]") == [said, "", ""]
        assert page.browser.errors == []


def test_a_page_without_a_room_waits_and_says_when_the_dashboard_ends(other: Browser) -> None:
    for page in open_page(Board("nothing yet"), other):
        page.browser.wait_for("performance.now() > 1000")
        assert page.browser.value("document.getElementById('age').textContent") == "waiting for the first room"
        page.board.reason = lambda: "no depth on </nothing>"
        page.browser.wait_for(
            "document.getElementById('age').textContent === 'waiting for the first room: no depth on </nothing>'"
        )
        assert page.browser.value("document.querySelectorAll('.main-svg').length") == 0
        assert page.browser.errors == []
        page.server.shutdown()
        page.server.server_close()
        page.browser.wait_for("document.getElementById('age').textContent === 'the dashboard has ended'")


@pytest.mark.data
def test_a_corridor_is_shown_up_to_where_it_is_of_use(data_root: Path, other: Browser) -> None:
    board = Board("corridor")
    frame, estimator = find_frame(open_source(data_root / "corridor"), "0040"), LayoutEstimator()
    board.show(room_of(frame, estimator.estimate(frame), estimator.config))
    for page in open_page(board, other):
        page.wait()
        ranges = page.browser.value(
            "['xaxis', 'yaxis', 'zaxis'].map(a => document.getElementById('room')._fullLayout.scene[a].range)"
        )
        assert max(abs(v) for low_high in ranges for v in low_high) <= 12
        assert page.browser.errors == []
