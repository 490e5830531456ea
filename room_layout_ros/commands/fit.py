"""Fit room cuboids to frames with NYU40 class labels and depth: layouts to learn from.

DIR gets, for every frame NAME:
  layout/NAME.png     the fitted room where it explains the labels well: 1 ceiling, 2 floor, 3 left, 4 front, 5 right
  rejected/NAME.png   the same where it does not (no cuboid, or too little of it in view)
  overlay/NAME.jpg    a picture for people (with --overlay)
  fits.jsonl          a line a frame: accepted, quality, cost, axes, plane distances, or why there is no fit
Lines come as the frames are done, each after its images. Exit code 2 on bad input, also where no frame could be fitted.
An earlier fit in DIR is replaced as soon as a frame can be used: the images that its fits.jsonl names go. Where other
images lie beside them, DIR is a frames folder, or another run is writing there, that is refused.
"""

from __future__ import annotations

import argparse
import json
import sys
from collections.abc import Callable, Iterator
from functools import partial
from itertools import chain
from pathlib import Path

from room_layout_ros.commands.counts import add_work_arguments, real
from room_layout_ros.commands.earlier_estimates import earlier_files, replace_earlier, until_usable
from room_layout_ros.commands.output_folder import held_alone, refuse_frames
from room_layout_ros.commands.progress import progress_bar
from room_layout_ros.commands.topics import open_and_tell
from room_layout_ros.datasets import DataError, FramesFolder, FrameSource
from room_layout_ros.datasets.images import write_atomically
from room_layout_ros.learning.fit_frame import (
    FITS_FILE,
    MAX_COST,
    MIN_QUALITY,
    FitJob,
    FitResult,
    fit_item,
    lost_result,
)
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


SUFFIXES = {"layout": (".png",), "rejected": (".png",), "overlay": (".jpg",)}
"""Folders of images and how their files end."""

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
    with held_alone("--out", arguments.out):
        return _fit(arguments, job, source)


def _fit(arguments: argparse.Namespace, job: FitJob, source: FrameSource) -> int:
    out: Path = arguments.out
    earlier = earlier_files(out, FITS_FILE, SUFFIXES, "fit")
    with progress_bar("fit", source.length) as progress:
        work, items = partial(fit_item, job), frames_apart(source)
        results = map_ordered(work, items, arguments.jobs, arguments.scheduler, progress, lost_result)
        lines = _write(
            out,
            results,
            partial(replace_earlier, out, earlier, dict.fromkeys(SUFFIXES, True) | {"overlay": job.overlay}),
        )
    if not lines:
        raise DataError(f"{source.title} holds no frame")
    if all("error" in line for line in lines):
        raise DataError(f"{source.title}: none of {len(lines)} frames could be fitted; {_first_error(lines)}")
    print(_summary(source, lines, out), file=sys.stderr)
    return 0


def _write(out: Path, results: Iterator[FitResult], begin: Callable[[], None]) -> list[dict[str, object]]:
    """Write images and lines as they come; no line of an earlier fit stays beside them.

    `begin` makes the place for them once a frame is usable; where none is, nothing is written.
    """
    first, usable = until_usable(results)
    if not usable:
        return [dict(result.line) for result in first]
    begin()
    written = []
    with (out / FITS_FILE).open("w", encoding="utf-8") as lines:
        for result in chain(first, results):
            for file, content in result.files.items():
                write_atomically(out / file, content)
            lines.write(f"{json.dumps(result.line)}\n")
            lines.flush()
            written.append(dict(result.line))
    return written


def _first_error(lines: list[dict[str, object]]) -> str:
    first = next((line for line in lines if "error" in line), None)
    return "" if first is None else f"the first is {first['name']}: {first['error']}"


def _summary(source: FrameSource, lines: list[dict[str, object]], out: Path) -> str:
    good = sum(bool(line["accepted"]) for line in lines)
    none = sum("error" in line for line in lines)
    why = f" ({_first_error(lines)})" if none else ""
    counts = f"{good} fits accepted, {len(lines) - good - none} rejected, {none} without a fit{why}"
    return f"{source.title}: {len(lines)} frames, {counts}; in {out}"
