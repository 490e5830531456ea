"""The dashboard's page runs in a browser: its script fills tables and pictures and draws the room."""

from __future__ import annotations

import json
import os
import re
import shutil
import signal
import subprocess
from dataclasses import dataclass
from html import unescape
from pathlib import Path
from typing import Any

import cv2
import numpy as np
import pytest
from numpy.typing import NDArray

from room_layout_ros.commands.dashboard import show_source
from room_layout_ros.commands.dashboard_server import HOST, Board, serve
from room_layout_ros.core.labels import FACES, LABEL_COLORS
from room_layout_ros.datasets.synthetic import SyntheticSource

BROWSERS = [path for name in ("chromium", "google-chrome") if (path := shutil.which(name))]
# A browser in a snap has a /tmp of its own: its screenshot would never be seen here.
BROWSER = next((path for path in BROWSERS if not os.path.realpath(path).startswith(("/snap/", "/usr/bin/snap"))), None)
QUIET = [
    "--headless=new",
    "--no-sandbox",  # tests run as root in containers; the page is our own
    "--disable-gpu",
    "--disable-dev-shm-usage",
    "--disable-quic",
    "--disable-background-networking",
    "--disable-component-update",
    "--disable-sync",
    "--disable-extensions",
    "--no-first-run",
    "--hide-scrollbars",
]
WINDOW = (1400, 1000)
CARD = np.array((0x1C, 0x21, 0x28))  # colour of the page below the canvas
PAGE_TIME_MS = 3000  # on the page's own clock, which waits for answers of the server
LONGEST_WAIT_S = 150.0
# A dumped page says neither whether its pictures were decoded nor what is on its canvas; this beside it does.
PROBE = b"""<pre id="probe"></pre><script>
const errors = [];
addEventListener("error", e => errors.push(e.message));
addEventListener("unhandledrejection", e => errors.push(String(e.reason)));
setInterval(() => {
  const canvas = document.getElementById("room"), size = i => [i.naturalWidth, i.naturalHeight];
  const drawn = canvas.getContext("2d").getImageData(0, 0, canvas.width, canvas.height).data;
  document.getElementById("probe").textContent = JSON.stringify({
    overlay: size(document.getElementById("overlay")), plan: size(document.getElementById("plan")),
    drawn: drawn.filter((v, i) => i % 4 == 3 && v > 0).length / (canvas.width * canvas.height), errors: errors});
}, 200);
</script><main>"""

pytestmark = pytest.mark.skipif(BROWSER is None, reason="neither chromium nor google-chrome is on this machine")


@dataclass(frozen=True)
class Seen:
    """What the browser made of the page: its document, what the probe found, and its pixels."""

    document: str
    probe: dict[str, Any]
    pixels: NDArray[np.uint8]

    def cells(self, table: str) -> dict[str, str]:
        body = re.search(rf'<table id="{table}">(.*?)</table>', self.document, re.S)
        assert body is not None
        rows = re.findall(r"<tr><td>(?:<span[^>]*></span>)?(.*?)</td><td>(.*?)</td></tr>", body[1], re.S)
        return {unescape(name): unescape(value) for name, value in rows}

    def age(self) -> str:
        found = re.search(r'<span id="age"[^>]*>(.*?)</span>', self.document)
        assert found is not None
        return found[1]


def browse(url: str, folder: Path, *options: str) -> str:
    """Let the browser open the page; return what it prints. It ends with all of its processes."""
    assert BROWSER is not None
    profile = [f"--user-data-dir={folder / 'profile'}", f"--window-size={WINDOW[0]},{WINDOW[1]}"]
    process = subprocess.Popen(
        [BROWSER, *QUIET, *profile, f"--virtual-time-budget={PAGE_TIME_MS}", *options, url],
        env={**os.environ, "HOME": str(folder)},
        stdout=subprocess.PIPE,
        stderr=subprocess.DEVNULL,
        text=True,
        start_new_session=True,
    )
    try:
        return process.communicate(timeout=LONGEST_WAIT_S)[0]
    finally:
        if process.poll() is None:
            os.killpg(process.pid, signal.SIGKILL)
            process.communicate()


def open_page(board: Board, folder: Path) -> Seen:
    board.page = board.page.replace(b"<main>", PROBE, 1)
    server = serve(board, 0)
    picture = folder / "page.png"
    try:
        url = f"http://{HOST}:{server.server_address[1]}/"
        document = browse(url, folder, "--dump-dom")
        browse(url, folder, f"--screenshot={picture}")
    finally:
        server.shutdown()
        server.server_close()
    probe = re.search(r'<pre id="probe">(.+?)</pre>', document, re.S)
    assert probe is not None, document[-2000:]
    pixels = cv2.imread(str(picture), cv2.IMREAD_COLOR)
    assert pixels is not None
    return Seen(document, json.loads(unescape(probe[1])), np.asarray(pixels[:, :, ::-1], np.uint8))


def share_of_color(pixels: NDArray[np.uint8], color: NDArray[np.uint8]) -> float:
    """Share of pixels that are the card with a good part of this colour over it: faces are half transparent."""
    above, full = pixels.astype(float) - CARD, color.astype(float) - CARD
    part = above @ full / (full @ full)
    off = np.linalg.norm(above - part[:, :, None] * full, axis=2)
    return float(np.mean((part > 0.4) & (part < 1.1) & (off < 15)))


def canvas_card(seen: Seen) -> NDArray[np.uint8]:
    third = WINDOW[0] // 3  # the window is three cards wide; the canvas is in the second
    return seen.pixels[:, third : 2 * third]


@pytest.fixture(scope="module")
def board() -> Board:
    board = Board("two rendered frames")
    show_source(board, SyntheticSource(frames=2, seed=4), end=float("inf"))
    return board


@pytest.fixture(scope="module")
def seen(board: Board, tmp_path_factory: pytest.TempPathFactory) -> Seen:
    return open_page(board, tmp_path_factory.mktemp("browser"))


def test_the_script_runs_without_an_error(seen: Seen, board: Board) -> None:
    assert seen.probe["errors"] == []
    assert seen.age().startswith(f"frame {board.look()[1].name}, ")


def test_numbers_and_timings_are_those_of_the_estimate(seen: Seen, board: Board) -> None:
    _, room = board.look()
    assert room.numbers["status"] == "ok"
    assert seen.cells("numbers") == room.numbers
    shown = {stage: float(text) for stage, text in seen.cells("stages").items()}
    assert shown == pytest.approx(dict(room.stages), abs=0.051)


def test_both_pictures_are_decoded_at_their_size(seen: Seen, board: Board) -> None:
    _, room = board.look()
    for name, content in (("overlay", room.overlay), ("plan", room.plan)):
        image = cv2.imdecode(np.frombuffer(content, np.uint8), cv2.IMREAD_COLOR)
        assert image is not None
        assert seen.probe[name] == [image.shape[1], image.shape[0]]


def test_the_room_is_drawn_in_the_colors_of_its_faces(seen: Seen, board: Board) -> None:
    assert seen.probe["drawn"] > 0.2
    assert seen.pixels.shape[:2] == WINDOW[::-1]
    middle = canvas_card(seen)
    for face, _ in board.look()[1].polygons:  # one may be hidden but for its edges; an empty page has none at all
        assert share_of_color(middle, LABEL_COLORS[face]) > 2e-4, face


def test_a_page_without_a_room_waits_and_draws_nothing(tmp_path: Path) -> None:
    board = Board("nothing yet")
    seen = open_page(board, tmp_path)
    assert seen.probe == {"overlay": [0, 0], "plan": [0, 0], "drawn": 0, "errors": []}
    assert seen.age() == "waiting for the first room"
    assert seen.cells("numbers") == {}
    assert all(share_of_color(canvas_card(seen), LABEL_COLORS[face]) == 0 for face in FACES)
