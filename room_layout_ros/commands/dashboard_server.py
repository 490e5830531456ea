"""The dashboard's server: the newest room, to this machine's browsers only."""

from __future__ import annotations

import json
import threading
from collections.abc import Mapping, Sequence
from dataclasses import dataclass, field
from http.server import BaseHTTPRequestHandler, ThreadingHTTPServer
from typing import Any
from urllib.parse import urlsplit

from room_layout_ros.datasets import DataError

from .dashboard_page import dashboard_html

HOST = "127.0.0.1"
"""No other address: the page shows the inside of somebody's room."""


@dataclass(frozen=True, slots=True)
class Room:
    """What the page shows of one frame.

    Attributes
    ----------
    name : of the frame. overlay, plan : JPEG bytes, empty where there is none.
    polygons : (face id, corners in metres) of the visible faces. numbers : shown as they are. stages : milliseconds.
    """

    name: str
    overlay: bytes = b""
    plan: bytes = b""
    polygons: Sequence[tuple[int, Sequence[Sequence[float]]]] = ()
    numbers: Mapping[str, str] = field(default_factory=dict)
    stages: Mapping[str, float] = field(default_factory=dict)


class Board:
    """Holds the newest room; any thread may show one, any may look."""

    def __init__(self, source: str) -> None:
        self.page = dashboard_html(source).encode()
        self._lock = threading.Lock()
        self._number, self._room = -1, Room("")

    def show(self, room: Room) -> None:
        """Replace what is shown."""
        with self._lock:
            self._number, self._room = self._number + 1, room

    def look(self) -> tuple[int, Room]:
        """Return the running number (-1: nothing yet) and the room."""
        with self._lock:
            return self._number, self._room


def serve(board: Board, port: int) -> ThreadingHTTPServer:
    """Start to serve in a thread of its own; `shutdown` and `server_close` end it.

    Raises
    ------
    DataError
        When the port is taken.
    """

    class Handler(_Handler):
        shown = board

    try:
        server = ThreadingHTTPServer((HOST, port), Handler)
    except OSError as error:
        raise DataError(f"port {port} cannot be used: {error.strerror}; choose another by --port") from None
    server.daemon_threads = True
    threading.Thread(target=server.serve_forever, name="dashboard", daemon=True).start()
    return server


class _Handler(BaseHTTPRequestHandler):
    shown: Board

    def do_GET(self) -> None:
        """Answer one request."""
        number, room = self.shown.look()
        path = urlsplit(self.path).path
        if path == "/":
            self._answer(self.shown.page, "text/html; charset=utf-8")
        elif path == "/state.json":
            self._answer(json.dumps(_state(number, room)).encode(), "application/json")
        elif path == "/overlay.jpg" and room.overlay:
            self._answer(room.overlay, "image/jpeg")
        elif path == "/plan.jpg" and room.plan:
            self._answer(room.plan, "image/jpeg")
        else:
            self.send_error(404)

    def _answer(self, content: bytes, kind: str) -> None:
        self.send_response(200)
        self.send_header("Content-Type", kind)
        self.send_header("Content-Length", str(len(content)))
        self.send_header("Cache-Control", "no-store")
        # Nothing but this server: what a bag or a topic says can load and send nothing elsewhere.
        self.send_header("Content-Security-Policy", "default-src 'self' 'unsafe-inline'")
        self.end_headers()
        self.wfile.write(content)

    def log_message(self, format: str, *args: Any) -> None:  # noqa: A002 - the name is the base class's
        """Say nothing: ten requests a second are no news."""


def _state(number: int, room: Room) -> dict[str, Any]:
    return {
        "number": number,
        "name": room.name,
        "plan": bool(room.plan),
        "polygons": [{"face": face, "points": points} for face, points in room.polygons],
        "numbers": dict(room.numbers),
        "stages": dict(room.stages),
    }
