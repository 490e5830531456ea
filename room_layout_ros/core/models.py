"""The learned models an estimator uses, and where an installation keeps them."""

from __future__ import annotations

from dataclasses import dataclass, fields
from functools import cache
from pathlib import Path

from .confidence import ConfidenceModel, load_confidence
from .config import JOINT, KERNEL, EstimatorConfig
from .evidence.geometric_context import ContextModel, load_context
from .furniture import FurnitureModel, load_furniture
from .model_file import WeightsError
from .network.scene_network import SceneNetwork, load_network
from .weights import ModelWeights, load_weights, uses

SCENE_FILE = "scene.npz"
"""The scene network; it sees colour only, so there is one."""

KERNEL_FURNITURE_FILE = "furniture_kernels.npz"
"""The classifier of furniture by kernel descriptors; one for all ways of operation."""


@dataclass(frozen=True, slots=True)
class Models:
    """What was learned for one way of operation.

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


def model_file(kind: str, with_depth: bool, with_scene: bool = True) -> str:
    """Return the name of a file of `Models` for a way of operation.

    Parameters
    ----------
    kind : name of a field of `Models`. with_depth : RGB-D or RGB. with_scene : with the scene network, or without.
    """
    return f"{kind}_{'rgbd' if with_depth else 'rgb'}{'' if with_scene else '_plain'}.npz"


def looks_at_scene(config: EstimatorConfig) -> bool:
    """Whether an estimator of this configuration asks the scene network about colour images."""
    return config.method == JOINT and config.scene_network and uses(config.joint_variant, "layout_scene")


def used_files(config: EstimatorConfig, also_rgb: bool = False) -> set[str]:
    """Return the names of the files that estimates of frames with colour and depth come from.

    Parameters
    ----------
    config : EstimatorConfig
    also_rgb : bool
        Frames are estimated a second time, without their depth.
    """
    if config.method != JOINT:
        return set()
    with_scene = looks_at_scene(config) and config.use_color
    depths = {config.use_depth, config.use_depth and not also_rgb}
    files = {model_file(field.name, depth, with_scene) for field in fields(Models) for depth in depths}
    files |= {SCENE_FILE} if with_scene else set()
    return files | ({KERNEL_FURNITURE_FILE} if config.furniture_features == KERNEL else set())


def load_models(with_depth: bool, with_scene: bool = True, folder: Path | None = None) -> Models:
    """Load the models for a way of operation from a folder, the installation's own by default.

    Raises
    ------
    WeightsError
        When a file is missing or damaged; one sentence.
    """
    return _load(with_depth, with_scene, folder or config_folder())


def load_scene_network(folder: Path | None = None) -> SceneNetwork:
    """Load the scene network from a folder, the installation's own by default.

    Raises
    ------
    WeightsError
        When the file is missing or damaged; one sentence.
    """
    return _load_network((folder or config_folder()) / SCENE_FILE)


def config_folder() -> Path:
    """Return the folder that holds the shipped models: `config/` of the source tree or `share/room_layout_ros/config`.

    Raises
    ------
    WeightsError
        When there is none.
    """
    needed = model_file("context", with_depth=True, with_scene=False)
    for parent in Path(__file__).resolve().parents:
        for folder in (parent / "config", parent / "share" / "room_layout_ros" / "config"):
            if (folder / needed).is_file():
                return folder
    raise WeightsError(f"no folder with {needed} above {Path(__file__).parent}; install the package again")


@cache
def _load(with_depth: bool, with_scene: bool, folder: Path) -> Models:
    def path(kind: str) -> Path:
        return folder / model_file(kind, with_depth, with_scene)

    return Models(
        load_weights(path("joint")),
        load_context(path("context")),
        load_furniture(path("furniture")),
        load_confidence(path("confidence")),
    )


@cache
def _load_network(path: Path) -> SceneNetwork:
    return load_network(path)
