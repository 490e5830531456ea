"""Which camera a frame was taken with: the newest CameraInfo that is not from after the frame."""

from __future__ import annotations

from collections import deque
from typing import Generic, TypeVar

Camera = TypeVar("Camera")

_KEPT = 8


class CameraHistory(Generic[Camera]):
    """The last distinct cameras with the stamp from which each holds. Not thread-safe."""

    def __init__(self) -> None:
        self._cameras: deque[tuple[int, Camera]] = deque(maxlen=_KEPT)

    def add(self, stamp_ns: int, camera: Camera) -> bool:
        """Take a reading; return True if it differs from the one before. Stamp 0 means "always held"."""
        if self._cameras and self._cameras[-1][1] == camera:
            if stamp_ns < self._cameras[-1][0]:
                self._cameras[-1] = (stamp_ns, camera)
            return False
        self._cameras.append((stamp_ns, camera))
        return True

    def at(self, stamp_ns: int) -> Camera | None:
        """Return the camera that held at `stamp_ns`; the newest where all are from later, None without any."""
        for start_ns, camera in reversed(self._cameras):
            if start_ns <= stamp_ns:
                return camera
        return self.newest

    @property
    def newest(self) -> Camera | None:
        """The camera that came last; None before the first."""
        return self._cameras[-1][1] if self._cameras else None

    def reset(self) -> None:
        """Forget the stamps, not the newest camera: a latched CameraInfo comes only once."""
        if self._cameras:
            camera = self._cameras[-1][1]
            self._cameras.clear()
            self._cameras.append((0, camera))
