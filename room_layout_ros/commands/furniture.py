"""Learn furniture by kernel descriptors (furniture_features: kernel) from a frames folder with NYU40 classes.

FILE gets visual words and linear classifiers for superpixels with colour and depth, with colour alone and with depth
alone, chosen by cross-validation over blocks of frames. Copy it into config/ as furniture_kernels.npz to make it the
default. The forest of furniture_features: context is learned by `room-layout train`. 800 frames take some 10 minutes of
one core.
"""

from __future__ import annotations

import argparse
import dataclasses
import sys
from pathlib import Path

from room_layout_ros.commands.counts import count, whole
from room_layout_ros.commands.frame_choice import add_hold_out_argument, open_frames_folder, subset_names
from room_layout_ros.commands.output_folder import make_folder
from room_layout_ros.core.models import KERNEL_FURNITURE_FILE
from room_layout_ros.learning.kernel_furniture import KernelSettings, train_kernel_furniture
from room_layout_ros.learning.origin import origin


def add_arguments(parser: argparse.ArgumentParser) -> None:
    """Add the options of `furniture`."""
    add, usual = parser.add_argument, KernelSettings()
    add("input", type=Path, metavar="FOLDER", help="frames folder with rgb/, depth/ and labels40/")
    add("--out", type=Path, required=True, metavar="DIR", help=f"folder for {KERNEL_FURNITURE_FILE}, made if missing")
    add_hold_out_argument(parser)
    add("--words", type=count, default=usual.words.words, metavar="N", help="of each descriptor (default %(default)s)")
    add("--folds", type=whole(2), default=usual.folds, metavar="K", help="of cross-validation (default %(default)s)")


def run(arguments: argparse.Namespace) -> int:
    """Train and write the model."""
    source = open_frames_folder(arguments.input, "training needs one with labels40/")
    held_out = subset_names(source, arguments.hold_out)
    make_folder("--out", arguments.out)
    words = dataclasses.replace(KernelSettings().words, words=arguments.words)
    settings = dataclasses.replace(KernelSettings(), words=words, folds=arguments.folds)
    path = arguments.out / KERNEL_FURNITURE_FILE
    train_kernel_furniture(source, path, held_out, settings, origin(), _say)
    print(path)
    return 0


def _say(text: str) -> None:
    print(text, file=sys.stderr, flush=True)
