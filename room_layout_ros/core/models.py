"""The learned models an estimator uses, and where an installation keeps them."""

from __future__ import annotations

from dataclasses import dataclass
from functools import cache
from pathlib import Path

from .confidence import ConfidenceModel, load_confidence
from .evidence.geometric_context import ContextModel, load_context
from .furniture import FurnitureModel, load_furniture
from .weights import ModelWeights, WeightsError, load_weights

JOINT_FILE = {True: "joint_rgbd.npz", False: "joint_rgb.npz"}
CONTEXT_FILE = {True: "context_rgbd.npz", False: "context_rgb.npz"}
FURNITURE_FILE = {True: "furniture_rgbd.npz", False: "furniture_rgb.npz"}
CONFIDENCE_FILE = {True: "confidence_rgbd.npz", False: "confidence_rgb.npz"}
"""Files per operation: with depth, without."""


@dataclass(frozen=True, slots=True)
class Models:
    """What was learned for one way of operation (with depth or without).

    Attributes
    ----------
    joint : ModelWeights of the joint energy.
    context : ContextModel, the classifier of superpixels behind geometric context.
    furniture : FurnitureModel of clutter.
    confidence : ConfidenceModel, from signs of a good estimate to probabilities.
    """

    joint: ModelWeights
    context: ContextModel
    furniture: FurnitureModel
    confidence: ConfidenceModel


def load_models(with_depth: bool, folder: Path | None = None) -> Models:
    """Load the models from a folder, the installation's own by default.

    Raises
    ------
    WeightsError
        When a file is missing or damaged; one sentence.
    """
    return _load(with_depth, folder or config_folder())


def config_folder() -> Path:
    """Return the folder that holds the shipped models: `config/` of the source tree or `share/room_layout_ros/config`.

    Raises
    ------
    WeightsError
        When there is none.
    """
    for parent in Path(__file__).resolve().parents:
        for folder in (parent / "config", parent / "share" / "room_layout_ros" / "config"):
            if (folder / CONTEXT_FILE[True]).is_file():
                return folder
    raise WeightsError(f"no folder with {CONTEXT_FILE[True]} above {Path(__file__).parent}; install the package again")


@cache
def _load(with_depth: bool, folder: Path) -> Models:
    return Models(
        load_weights(folder / JOINT_FILE[with_depth]),
        load_context(folder / CONTEXT_FILE[with_depth]),
        load_furniture(folder / FURNITURE_FILE[with_depth]),
        load_confidence(folder / CONFIDENCE_FILE[with_depth]),
    )
