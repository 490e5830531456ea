"""The dashboard's server: the newest room, to this machine's browsers only."""

from __future__ import annotations

import json
import re
import sys
import threading
import time
from collections import OrderedDict
from collections.abc import Callable
from http import HTTPStatus
from http.server import BaseHTTPRequestHandler, ThreadingHTTPServer
from importlib import resources
from typing import Any
from urllib.parse import parse_qs, urlsplit

from room_layout_ros.datasets import DataError
from room_layout_ros.extras import install_hint

from .dashboard_page import dashboard_html
from .dashboard_room import Room, state_of

_KEPT = 16
"""Pictures of so many frames are kept: the page asks for the picture after it has the numbers."""

HOST = "127.0.0.1"
"""No other address: the page shows the inside of somebody's room."""

# A page from elsewhere can give its own name our address (DNS rebinding), and read what we answer to that name.
_OWN_NAME = re.compile(rf"(localhost|{re.escape(HOST)}|\[::1\])(:[0-9]+)?", re.IGNORECASE)


class Board:
    """Holds the newest room; any thread may show one, any may look.

    Parameters
    ----------
    source : title on the page.
    settle_s : how long the parts of a frame may come one after another; until then the frame before it is shown.
    """

    def __init__(self, source: str, settle_s: float = 0.0) -> None:
        self.page = dashboard_html(source).encode()
        self._settle_s = settle_s
        self._lock = threading.Lock()
        self._begun = self._came = 0.0
        self._newest = self._before = (-1, 0, Room(""))
        self._overlays: OrderedDict[int, bytes] = OrderedDict()
        self.reason: Callable[[], str] = str
        """Says in words why no room comes, "" where nothing is to say; it is called by any thread."""
        self.ended = ""
        """Says in words that no other room will come: what is shown is the last."""

    def show(self, room: Room) -> None:
        """Replace what is shown; a room of the same name is the same frame with more of its parts."""
        with self._lock:
            number, frames, newest = self._newest
            self._came = time.monotonic()
            if frames == 0 or room.name != newest.name:
                self._before, self._begun, frames = self._newest, self._came, frames + 1
            self._newest = number + 1, frames, room
            self._overlays[frames] = room.overlay
            while len(self._overlays) > _KEPT:
                self._overlays.popitem(last=False)

    def look(self) -> tuple[int, int, Room]:
        """Return the running number (-1: nothing yet), the count of frames up to this one, and the room."""
        with self._lock:
            settled = time.monotonic() - self._begun >= self._settle_s
            return self._newest if settled else self._before

    def age_s(self) -> float:
        """Return the seconds since anything was shown."""
        return time.monotonic() - self._came

    def overlay(self, frame: int) -> bytes:
        """Return the overlay of a frame, which is the first, second ... that was shown; none where it is not kept."""
        with self._lock:
            return self._overlays.get(frame, b"")


def plotly_script() -> bytes:
    """Return plotly.js, which the Python package brings, so that the page needs no internet.

    Raises
    ------
    DataError
        When Plotly is not installed.
    """
    try:
        import plotly

        return (resources.files(plotly) / "package_data" / "plotly.min.js").read_bytes()
    except (ImportError, FileNotFoundError):
        raise DataError(f"the dashboard needs Plotly: {install_hint('viz')}") from None


def serve(board: Board, port: int) -> ThreadingHTTPServer:
    """Start to serve in a thread of its own; `shutdown` and `server_close` end it.

    Raises
    ------
    DataError
        When the port is taken, or Plotly is not installed.
    """

    class Handler(_Handler):
        shown, plotly = board, plotly_script()

    try:
        server = _Server((HOST, port), Handler)
    except OSError as error:
        raise DataError(f"port {port} cannot be used: {error.strerror}; choose another by --port") from None
    server.daemon_threads = True
    threading.Thread(target=server.serve_forever, name="dashboard", daemon=True).start()
    return server


class _Server(ThreadingHTTPServer):
    def handle_error(self, request: Any, client_address: Any) -> None:
        """Pass over a browser that is gone in the middle of an answer."""
        if not isinstance(sys.exc_info()[1], ConnectionError):
            super().handle_error(request, client_address)


class _Handler(BaseHTTPRequestHandler):
    shown: Board
    plotly: bytes

    def do_GET(self) -> None:
        """Answer one request, if it is to this machine by name."""
        host = ", ".join(self.headers.get_all("Host", []))
        if _OWN_NAME.fullmatch(host) is None:
            allowed = f"localhost, {HOST} or [::1], with any port"
            refusal = f"Host is {host!r}; allowed is {allowed}: the page is for this machine alone\n"
            self._answer(refusal.encode(), "text/plain; charset=utf-8", HTTPStatus.FORBIDDEN)
        else:
            self._answer_this_machine()

    def _answer_this_machine(self) -> None:
        url = urlsplit(self.path)
        if url.path == "/":
            self._answer(self.shown.page, "text/html; charset=utf-8")
        elif url.path == "/plotly.min.js":
            self._answer(self.plotly, "text/javascript; charset=utf-8")
        elif url.path == "/state.json":
            self._answer(json.dumps(self._state(url.query)).encode(), "application/json")
        elif url.path == "/overlay.jpg" and (overlay := self._overlay(url.query)):
            self._answer(overlay, "image/jpeg")
        else:
            self.send_error(404)

    def _state(self, query: str) -> dict[str, Any] | None:
        """Return the newest room; where the page has it, or there is none, why no other comes; None: nothing to say."""
        number, frames, room = self.shown.look()
        reason, ended = self.shown.reason(), self.shown.ended
        if number < 0:
            return {"waiting": reason}
        if parse_qs(query).get("after") == [str(number)]:
            said = {"waiting": reason, "ended": ended}
            return {what: words for what, words in said.items() if words} or None
        return {**state_of(number, frames, room), "age_s": self.shown.age_s(), "ended": ended}

    def _overlay(self, query: str) -> bytes:
        """Return the picture of the frame that the page has numbers of, else of the newest."""
        asked = parse_qs(query).get("frame", [str(self.shown.look()[1])])[0]
        return self.shown.overlay(int(asked)) if asked.isascii() and asked.isdecimal() and len(asked) < 12 else b""

    def _answer(self, content: bytes, kind: str, status: HTTPStatus = HTTPStatus.OK) -> None:
        self.send_response(status)
        self.send_header("Content-Type", kind)
        self.send_header("Content-Length", str(len(content)))
        self.send_header("Cache-Control", "no-store")
        # Nothing but this server: what a bag or a topic says can load and send nothing elsewhere.
        self.send_header("Content-Security-Policy", "default-src 'self' 'unsafe-inline'; img-src 'self' data: blob:")
        self.end_headers()
        self.wfile.write(content)

    def log_message(self, format: str, *args: Any) -> None:  # noqa: A002 - the name is the base class's
        """Say nothing: ten requests a second are no news."""
