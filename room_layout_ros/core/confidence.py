"""How far to trust an estimate: the share of the layout's pixels expected right, and the IoU expected of each face.

Logistic in a few signs of a good or bad estimate, fitted on frames with known layouts (`room-layout calibrate`), with
and without depth apart. A face that is not in view, or that nothing speaks for, has confidence 0: not observed.
Where depth is used, a face with next to none on it has half: its place in the picture may be right, but its distance
follows from where it meets the others. (The frames of the fit have their holes filled and cannot tell.)
"""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass, field
from pathlib import Path
from typing import Any

import numpy as np
from numpy.typing import NDArray

from .labels import N_FACES
from .layout import FACE_AXIS
from .model_file import WeightsError, read_arrays, write_arrays

_KIND = "room_layout confidence"

FRAME_SIGNS = ("fit cost", "axes", "certainty of the context", "belief of the rays", "share measured")
_AXES, _MEASURED = FRAME_SIGNS.index("axes"), FRAME_SIGNS.index("share measured")
FACE_SIGNS = ("support", "violation", "area", "belief of the rays", "frame")


_AXES_RAMP = (0.05, 0.15)
_STRUCTURE_RAMP = (0.02, 0.10)
_SECOND_AXIS_RAMP = (0.0, 0.01)
"""Nothing below the first value, all from the second on. The least of the 37 frames of NYU v2 with a hand-made layout:
0.23, 0.21, 0.05 (`plausibility`)."""

_LEAST_FACTOR = 0.2

_SUPPORT_RAMP, _WITHOUT_SUPPORT = (0.0, 0.05), 0.5
"""Between these shares of a face with depth on its plane its confidence rises from so much of its value to all."""


@dataclass(frozen=True, slots=True)
class ConfidenceModel:
    """Coefficients of the two logistic functions.

    Attributes
    ----------
    frame : (len(FRAME_SIGNS) + 1,) float64, the constant last. face : (len(FACE_SIGNS) + 1,) float64 likewise.
    card : what the fit says about itself; JSON values.
    """

    frame: NDArray[np.float64]
    face: NDArray[np.float64]
    card: Mapping[str, Any] = field(default_factory=dict)

    def __post_init__(self) -> None:
        if self.frame.shape != (len(FRAME_SIGNS) + 1,) or self.face.shape != (len(FACE_SIGNS) + 1,):
            raise ValueError(
                f"confidence coefficients have shapes {self.frame.shape} and {self.face.shape}; "
                f"({len(FRAME_SIGNS) + 1},) and ({len(FACE_SIGNS) + 1},) are needed"
            )


@dataclass(frozen=True, slots=True)
class Signs:
    """What speaks for and against one estimate.

    Attributes
    ----------
    frame : (len(FRAME_SIGNS),) float64.
    face : (5, len(FACE_SIGNS) - 1) float64; the frame's confidence is added when the faces' are computed.
    """

    frame: NDArray[np.float64]
    face: NDArray[np.float64]


def state_confidence(
    signs: Signs, seen: NDArray[np.bool_], model: ConfidenceModel
) -> tuple[float, NDArray[np.float64]]:
    """Return the confidence of the frame and of each face (5,), 0 for faces that are not `seen`."""
    frame, factor = float(logistic(signs.frame[None], model.frame)[0]), plausibility(signs)
    of_faces = _measured_share(signs) * logistic(face_rows(signs, frame), model.face)
    return factor * frame, np.where(seen, factor * of_faces, 0.0)


def plausibility(signs: Signs) -> float:
    """Return 0.2 to 1: whether the estimate is of a room at all; 1 for every real room seen so far.

    The normals (or lines) must agree on axes; with depth, some of the image must be structure on its planes, and planes
    of two axes must be among it: one plane alone leaves the turn about its normal open.
    """
    factor = _ramp(float(signs.frame[_AXES]), _AXES_RAMP)
    if signs.frame[_MEASURED] > 0:
        on_plane = signs.face[:, FACE_SIGNS.index("support")] * signs.face[:, FACE_SIGNS.index("area")]
        of_axes = np.bincount(FACE_AXIS, on_plane, 3)
        factor *= _ramp(float(on_plane.sum()), _STRUCTURE_RAMP) * _ramp(float(np.sort(of_axes)[1]), _SECOND_AXIS_RAMP)
    return max(factor, _LEAST_FACTOR)


def _measured_share(signs: Signs) -> NDArray[np.float64]:
    """(5,) factors of the faces' confidences for the depth on their planes; 1 without depth."""
    if signs.frame[_MEASURED] <= 0:
        return np.ones(N_FACES)
    low, high = _SUPPORT_RAMP
    share = np.clip((signs.face[:, FACE_SIGNS.index("support")] - low) / (high - low), 0.0, 1.0)
    return _WITHOUT_SUPPORT + (1.0 - _WITHOUT_SUPPORT) * share


def _ramp(value: float, ends: tuple[float, float]) -> float:
    return float(np.clip((value - ends[0]) / (ends[1] - ends[0]), 0.0, 1.0))


def face_rows(signs: Signs, frame_confidence: float) -> NDArray[np.float64]:
    """(5, len(FACE_SIGNS)) float64: the faces' signs and the frame's confidence."""
    return np.column_stack([signs.face, np.full(N_FACES, frame_confidence)])


def logistic(rows: NDArray[np.float64], coefficients: NDArray[np.float64]) -> NDArray[np.float64]:
    """1 / (1 + exp(-(rows . w + constant)))."""
    return np.asarray(1.0 / (1.0 + np.exp(-(rows @ coefficients[:-1] + coefficients[-1]))))


def save_confidence(model: ConfidenceModel, path: Path) -> None:
    """Write the coefficients."""
    write_arrays(path, _KIND, {"frame": model.frame, "face": model.face}, model.card)


def load_confidence(path: Path) -> ConfidenceModel:
    """Read the coefficients.

    Raises
    ------
    WeightsError
        When the file is missing, damaged or of another kind; one sentence.
    """
    arrays, card = read_arrays(path, _KIND)
    try:
        return ConfidenceModel(arrays["frame"], arrays["face"], card)
    except (KeyError, ValueError) as error:
        raise WeightsError(f"{path} is no confidence model of this version: {error}") from error
