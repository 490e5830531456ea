"""Fit room cuboids to frames with NYU40 class labels and depth: layouts to learn from.

DIR gets, for every frame NAME:
  layout/NAME.png     the fitted room where it explains the labels well: 1 ceiling, 2 floor, 3 left, 4 front, 5 right
  rejected/NAME.png   the same where it does not (no cuboid, or too little of it in view)
  overlay/NAME.jpg    a picture for people (with --overlay)
  fits.jsonl          a line a frame: accepted, quality, cost, axes, plane distances, or why there is no fit
"""

from __future__ import annotations

import argparse
import json
import sys
from functools import partial
from pathlib import Path

from room_layout_ros.commands.counts import add_work_arguments, real
from room_layout_ros.commands.output_folder import make_folder, refuse_frames
from room_layout_ros.commands.progress import progress_bar
from room_layout_ros.commands.topics import open_and_tell
from room_layout_ros.datasets import DataError, FramesFolder, FrameSource
from room_layout_ros.datasets.images import write_atomically
from room_layout_ros.learning.fit_frame import FITS_FILE, MAX_COST, MIN_QUALITY, FitJob, fit_item, lost_result
from room_layout_ros.learning.frames_apart import frames_apart
from room_layout_ros.parallel import map_ordered


def add_arguments(parser: argparse.ArgumentParser) -> None:
    """Add the options of `fit`."""
    parser.add_argument("input", type=Path, metavar="FOLDER", help="frames with depth and classes (labels40/)")
    parser.add_argument("--out", type=Path, required=True, metavar="DIR", help="folder for the fits, made if missing")
    parser.add_argument("--overlay", action="store_true", help="write overlay pictures too")
    parser.add_argument("--min-quality", type=real(0, 1), default=MIN_QUALITY, metavar="Q", help=_HELP_QUALITY)
    parser.add_argument("--max-cost", type=real(0), default=MAX_COST, metavar="C", help=_HELP_COST)
    add_work_arguments(parser)


_HELP_QUALITY = (
    "accept fits with this share of structural pixels on a face of their kind, or more (default %(default)s)"
)
_HELP_COST = "accept fits with at most this mean cost per pixel (default %(default)s)"


def run(arguments: argparse.Namespace) -> int:
    """Fit every frame of the input."""
    job = FitJob(arguments.min_quality, arguments.max_cost, arguments.overlay)
    source = open_and_tell(arguments.input)
    if isinstance(source, FramesFolder) and not (source.path / "labels40").is_dir():
        raise DataError(f"{source.path / 'labels40'} is missing; the fits are made of the classes there")
    refuse_frames("--out", arguments.out, arguments.input)
    for kind in ("layout", "rejected", *(["overlay"] if job.overlay else [])):
        make_folder("--out", arguments.out / kind)
    lines = []
    with progress_bar("fit", source.length) as progress:
        work = partial(fit_item, job)
        for result in map_ordered(
            work, frames_apart(source), arguments.jobs, arguments.scheduler, progress, lost_result
        ):
            for file, content in result.files.items():
                write_atomically(arguments.out / file, content)
            lines.append(dict(result.line))
    if not lines:
        raise DataError(f"{source.title} holds no frame")
    write_atomically(arguments.out / FITS_FILE, "".join(f"{json.dumps(line)}\n" for line in lines).encode())
    print(_summary(source, lines, arguments.out), file=sys.stderr)
    return 0


def _summary(source: FrameSource, lines: list[dict[str, object]], out: Path) -> str:
    good = sum(bool(line["accepted"]) for line in lines)
    none = sum("error" in line for line in lines)
    counts = f"{good} fits accepted, {len(lines) - good - none} rejected, {none} without a fit"
    return f"{source.title}: {len(lines)} frames, {counts}; in {out}"
