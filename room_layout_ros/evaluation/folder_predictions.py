"""Predictions read from the folder that `room-layout estimate` wrote (docs/data.md)."""

from __future__ import annotations

import json
from collections.abc import Mapping
from dataclasses import dataclass
from pathlib import Path
from typing import Any

import numpy as np
from numpy.typing import NDArray

from room_layout_ros.core.labels import CLUTTER, FACES, LABEL_NAMES, N_FACES
from room_layout_ros.core.layout import RoomCuboid
from room_layout_ros.datasets import DataError, Sample
from room_layout_ros.datasets.images import read_index

from .prediction import Prediction

NO_FILES = "no files"
"""Status of a frame that the folder does not know."""


@dataclass(frozen=True, slots=True)
class FolderPredictions:
    """The method "what these files say"; a frame without files is an empty prediction, so wrong everywhere.

    That goes for furniture too where the folder has `furniture/`; without it, nothing is said of furniture.
    """

    path: Path
    lines: dict[str, dict[str, Any]]

    def __call__(self, sample: Sample) -> Prediction:
        """Return what the folder holds of this frame.

        Raises
        ------
        DataError
            When one of its images is damaged or of another size than the frame's, or its room is none.
        """
        camera, line = sample.frame.camera, self.lines.get(sample.name, {})
        layout = self._image("layout", sample.name, N_FACES)
        labels = self._image("labels", sample.name, CLUTTER)
        furniture = self._image("furniture", sample.name, 255)
        if layout is None or labels is None:
            status = str(line.get("error", NO_FILES))
            return Prediction.nothing(camera, status, _number(None), self._names_furniture)
        if furniture is None and self._names_furniture:
            furniture = np.zeros((camera.height, camera.width), np.uint8)
        for kind, image in (("layout", layout), ("labels", labels), ("furniture", furniture)):
            if image is not None and image.shape != (camera.height, camera.width):
                raise DataError(
                    f"{self.path / kind / sample.name}.png has shape {image.shape}; "
                    f"the frame's is {(camera.height, camera.width)}"
                )
        by_face = line.get("face_confidence", {})
        faces = np.array([_number(by_face.get(LABEL_NAMES[face])) for face in FACES])
        return Prediction(
            layout=layout,
            labels=labels,
            furniture=furniture,
            cuboid=_cuboid(line),
            metric=bool(line.get("metric", True)),
            confidence=_number(line.get("confidence")),
            face_confidence=faces,
            status=str(line.get("status", "ok")).lower(),
            milliseconds=_number(line.get("milliseconds")),
        )

    @property
    def _names_furniture(self) -> bool:
        """Whether these files say what furniture there is: where one frame's are missing, its furniture is missed."""
        return (self.path / "furniture").is_dir()

    def _image(self, kind: str, name: str, highest: int) -> NDArray[np.uint8] | None:
        path = self.path / kind / f"{name}.png"
        return read_index(path, highest) if path.exists() else None


def _cuboid(line: Mapping[str, Any]) -> RoomCuboid | None:
    """Return the room of a line, None where it names no plane.

    Raises
    ------
    DataError
        When its axes or distances are none of a room.
    """
    by_face = line.get("plane_distances_m") or {}
    if not any(by_face.get(LABEL_NAMES[face]) for face in FACES):
        return None
    try:
        U, _, Vt = np.linalg.svd(np.array(line["axes"], np.float64))  # the digits of the file are rounded
        found = [by_face.get(LABEL_NAMES[face]) for face in FACES]
        return RoomCuboid(U @ Vt, np.array([np.inf if d is None else d for d in found], np.float64))
    except (ValueError, KeyError, TypeError, np.linalg.LinAlgError) as error:
        raise DataError(f"estimate {line['name']} has no room in axes and plane_distances_m: {error}") from None


def _number(value: float | None) -> float:
    return float("nan") if value is None else float(value)


def read_folder(path: Path) -> FolderPredictions:
    """Open the output folder of `room-layout estimate`.

    Raises
    ------
    DataError
        When it holds no layouts or no labels, or its estimates.jsonl is damaged.
    """
    if not (path / "layout").is_dir():
        raise DataError(f"{path} has no layout/; give the --out folder of `room-layout estimate`")
    if not (path / "labels").is_dir():
        raise DataError(f"{path} has layout/, but labels/ is missing, without which every frame would count as wrong")
    lines: dict[str, dict[str, Any]] = {}
    listing = path / "estimates.jsonl"
    for number, text in enumerate(listing.read_text("utf-8").splitlines() if listing.exists() else [], 1):
        try:
            line = json.loads(text)
            lines[str(line["name"])] = line
        except (ValueError, KeyError, TypeError):
            raise DataError(f"{listing} line {number} is no estimate; it must be a JSON object with a name") from None
    return FolderPredictions(path, lines)
