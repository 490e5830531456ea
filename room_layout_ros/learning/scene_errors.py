"""How often a scene network is wrong in frames it has not seen."""

from __future__ import annotations

import cv2
import numpy as np
from numpy.typing import NDArray

from ..core.labels import CLUTTER
from ..core.network.scene_layers import COLUMNS, ROWS
from ..core.network.scene_network import SceneNetwork
from .scene_examples import SOME_WALL, SceneExamples


def scene_errors(network: SceneNetwork, examples: SceneExamples) -> dict[str, float]:
    """Return mean shares of wrong cells in percent, over the frames that have the truth in question.

    Returns
    -------
    dict
        `frames`; `structure`: structure for clutter or the other way round; `labels` and `layout`: wrong label, wrong
        face of the empty room, walls by their names (frames with a known room only).
    """
    wrong: dict[str, list[float]] = {"structure": [], "labels": [], "layout": []}
    for color, labels, layout in zip(examples.color, examples.labels, examples.layout, strict=True):
        scores = network(color)
        label, face = (part.argmax(axis=2) + 1 for part in (scores.labels, scores.layout))
        true_label, true_face = _coarse(labels), _coarse(layout)
        known = (true_label > 0) & (true_label != SOME_WALL)
        if (true_label > 0).any():
            wrong["structure"].append(float(((label == CLUTTER) != (true_label == CLUTTER))[true_label > 0].mean()))
        if (true_face > 0).any():
            wrong["layout"].append(float((face != true_face)[true_face > 0].mean()))
            wrong["labels"].append(float((label != true_label)[known].mean()))
    errors = {name: round(100.0 * float(np.mean(shares)), 2) for name, shares in wrong.items() if shares}
    return {"frames": len(examples.number), **errors}


def _coarse(image: NDArray[np.uint8]) -> NDArray[np.uint8]:
    return np.asarray(cv2.resize(image, (COLUMNS, ROWS), interpolation=cv2.INTER_NEAREST), np.uint8)
