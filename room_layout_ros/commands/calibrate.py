"""Calibrate the confidences of the estimates on frames with known layouts.

FITS is a folder of `room-layout fit` (or any folder with layout/NAME.png); frames whose layout is all 0 are left out.
The estimates are by the models that ship, or by those of --models. Writes confidence_rgbd.npz, or confidence_rgb.npz
(with --rgb-only), to --out; `config/` holds the shipped ones.
"""

from __future__ import annotations

import argparse
import sys
from functools import lru_cache, partial
from pathlib import Path

import cv2

from room_layout_ros.commands.counts import add_jobs_argument, count
from room_layout_ros.commands.frame_choice import add_hold_out_argument, open_frames_folder, subset_names
from room_layout_ros.commands.models_folder import add_models_argument, usable_models
from room_layout_ros.commands.output_folder import make_folder, named_when_full
from room_layout_ros.commands.progress import progress_bar
from room_layout_ros.core.confidence import save_confidence
from room_layout_ros.core.config import EstimatorConfig
from room_layout_ros.core.estimator import LayoutEstimator
from room_layout_ros.core.frame import RgbdFrame
from room_layout_ros.core.labels import N_FACES
from room_layout_ros.core.models import model_file
from room_layout_ros.core.network.scene_network import SceneScores
from room_layout_ros.datasets import BadFrame, DataError, Sample
from room_layout_ros.datasets.images import read_index
from room_layout_ros.evaluation.confidence_fit import LEAST_FRAMES, JudgedSigns, fit_confidence, judge_signs
from room_layout_ros.learning.origin import origin
from room_layout_ros.learning.scene_folds import SceneFolds, read_folds
from room_layout_ros.learning.train_run import choose_names
from room_layout_ros.parallel import map_ordered


def add_arguments(parser: argparse.ArgumentParser) -> None:
    """Add the options of `calibrate`."""
    parser.add_argument("input", type=Path, metavar="FOLDER", help="frames folder")
    parser.add_argument("--fits", type=Path, required=True, metavar="FITS", help="folder with layout/NAME.png")
    parser.add_argument(
        "--out", type=Path, required=True, metavar="DIR", help="folder for the coefficients, made if missing"
    )
    parser.add_argument("--rgb-only", action="store_true", help="for operation without depth")
    parser.add_argument("--scene", type=Path, metavar="DIR", help="output of room-layout scene: honest networks")
    parser.add_argument("--plain", action="store_true", help="for operation without the scene network")
    add_hold_out_argument(parser)
    parser.add_argument("--frames", type=count, metavar="N", help="use at most so many frames, evenly spread")
    add_models_argument(parser)
    add_jobs_argument(parser)


def run(arguments: argparse.Namespace) -> int:
    """Estimate, compare, fit, write."""
    source = open_frames_folder(arguments.input, "calibrate needs one")
    if arguments.plain and arguments.scene is not None:
        raise DataError(f"--scene {arguments.scene} and --plain exclude each other: one is with networks, one without")
    held_out = subset_names(source, arguments.hold_out)
    fitted = [n for n in source.names if _layout_file(arguments.fits, n).is_file()]
    names = _annotated(arguments.fits, choose_names(fitted, held_out, arguments.frames))
    if len(names) < LEAST_FRAMES:
        raise DataError(f"{arguments.fits} has layouts for {len(names)} frames; at least {LEAST_FRAMES} are needed")
    config = EstimatorConfig(use_depth=not arguments.rgb_only, scene_network=not arguments.plain)
    models = usable_models(arguments.models, config, plain_by="--plain")
    make_folder("--out", arguments.out)  # before minutes of work
    networks = None if arguments.scene is None else read_folds(arguments.scene.absolute())
    work = partial(_judge, arguments.fits, config, networks, models)
    with progress_bar("calibrate", len(names)) as progress:
        found = list(map_ordered(work, source.subset(tuple(names)), arguments.jobs, None, progress, None))
    judged = [j for j in found if j is not None]
    if len(judged) < len(found):
        print(f"{len(found) - len(judged)} of {len(found)} frames could not be used", file=sys.stderr)
    card = {
        "frames": len(judged),
        "source": f"frames folder {source.path.name}",
        "held out": arguments.hold_out or "",
        **origin(),
    }
    path = arguments.out / model_file("confidence", not arguments.rgb_only, not arguments.plain)
    with named_when_full(arguments.out):
        save_confidence(fit_confidence(judged, card), path)
    print(f"{path} from {len(judged)} frames", file=sys.stderr)
    return 0


def _annotated(fits: Path, names: list[str]) -> list[str]:
    """Return the names whose layout has an annotated pixel, and say how many have none: nothing is right or wrong."""
    found = [name for name in names if read_index(_layout_file(fits, name), N_FACES).any()]
    if len(found) < len(names):
        print(f"{len(names) - len(found)} of {len(names)} frames have no true layout and are left out", file=sys.stderr)
    return found


def _layout_file(fits: Path, name: str) -> Path:
    return fits / "layout" / f"{name}.png"


def _judge(
    fits: Path, config: EstimatorConfig, networks: SceneFolds | None, models: Path | None, item: Sample | BadFrame
) -> JudgedSigns | None:
    if isinstance(item, BadFrame):
        return None
    file, size = _layout_file(fits, item.name), (item.frame.camera.height, item.frame.camera.width)
    layout = read_index(file, N_FACES)
    if layout.shape != size:
        raise DataError(f"{file} has shape {layout.shape}; the frame's is {size}")
    return judge_signs(_estimator(config, networks, models).estimate(item.frame), layout)


@lru_cache(maxsize=1)
def _estimator(
    config: EstimatorConfig, networks: SceneFolds | None = None, models: Path | None = None
) -> LayoutEstimator:
    cv2.setNumThreads(1)
    return LayoutEstimator(config, models) if networks is None else _HonestEstimator(config, networks, models)


class _HonestEstimator(LayoutEstimator):
    """The estimator, looking at each frame with a scene network that has seen neither it nor a neighbour."""

    def __init__(self, config: EstimatorConfig, networks: SceneFolds, models: Path | None = None) -> None:
        super().__init__(config, models)
        self._networks = networks

    def look(self, frame: RgbdFrame) -> SceneScores | None:
        """Ask the network that is honest about the frame."""
        return self._networks.look(frame)
