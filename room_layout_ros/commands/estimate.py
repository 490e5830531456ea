"""Estimate room layouts offline: a frames folder, a rosbag2 or an NYU .mat file in, label images out.

DIR gets, for every frame NAME:
  layout/NAME.png     the empty room: 1 ceiling, 2 floor, 3 left, 4 front, 5 right wall
  labels/NAME.png     what is seen: the same, 6 clutter, 0 unknown
  furniture/NAME.png  NYU40 class on clutter, 0 elsewhere
  overlay/NAME.jpg    a picture for people (with --overlay)
  estimates.jsonl     a line a frame: status, confidences, axes, planes, polygons, milliseconds
A frame that cannot be used gets a line with its error. Exit code 0 when every frame has its line, 2 on bad input.
"""

from __future__ import annotations

import argparse
import json
import sys
from collections.abc import Iterator
from functools import partial
from pathlib import Path

from room_layout_ros.commands.estimate_frame import (
    FrameJob,
    FrameResult,
    estimate_item,
    lost_result,
    parse_settings,
)
from room_layout_ros.commands.progress import progress_bar
from room_layout_ros.commands.topics import add_topic_arguments, open_with_topics
from room_layout_ros.datasets import DataError, FrameSource
from room_layout_ros.datasets.images import write_atomically
from room_layout_ros.parallel import map_ordered

KINDS = ("layout", "labels", "furniture")


def add_arguments(parser: argparse.ArgumentParser) -> None:
    """Add the options of `estimate`."""
    parser.add_argument("input", type=Path, metavar="INPUT", help="frames folder, rosbag2 (sqlite3, mcap) or NYU .mat")
    parser.add_argument(
        "--out", type=Path, required=True, metavar="DIR", help="folder for the results, made if missing"
    )
    parser.add_argument("--rgb-only", action="store_true", help="leave the depth unused")
    parser.add_argument("--overlay", action="store_true", help="write overlay pictures too")
    parser.add_argument("--jobs", type=int, default=1, metavar="N", help="local processes (default 1)")
    parser.add_argument("--scheduler", metavar="ADDRESS", help="Dask scheduler, tcp://host:port, instead of --jobs")
    parser.add_argument(
        "--set", action="append", default=[], metavar="NAME=VALUE", help="set a parameter of the estimator (repeatable)"
    )
    add_topic_arguments(parser)


def run(arguments: argparse.Namespace) -> int:
    """Estimate every frame of the input."""
    if arguments.jobs < 1:
        raise DataError(f"--jobs is {arguments.jobs}; it must be 1 or more")
    job = FrameJob(parse_settings(arguments.set), arguments.rgb_only, arguments.overlay)
    source = open_with_topics(arguments.input, arguments)
    _make_folders(arguments.out, (*KINDS, "overlay") if arguments.overlay else KINDS)
    work = partial(estimate_item, job)
    with progress_bar("estimate", source.length) as progress:
        results = map_ordered(work, source, arguments.jobs, arguments.scheduler, progress, lost_result)
        done, failed = _write(arguments.out, results)
    if not done:
        raise DataError(f"{source.title} holds no frame")
    print(_summary(source, done, failed, arguments.out), file=sys.stderr)
    return 0


def _make_folders(out: Path, kinds: tuple[str, ...]) -> None:
    if out.exists() and not out.is_dir():
        raise DataError(f"{out} is a file; --out needs a folder")
    for kind in kinds:
        (out / kind).mkdir(parents=True, exist_ok=True)


def _write(out: Path, results: Iterator[FrameResult]) -> tuple[int, int]:
    """Write images as they come; the list of estimates appears whole at the end."""
    lines: list[str] = []
    failed = 0
    for result in results:
        for file, content in result.files.items():
            write_atomically(out / file, content)
        failed += "error" in result.line
        lines.append(json.dumps(result.line, allow_nan=False))
    if lines:
        write_atomically(out / "estimates.jsonl", "".join(f"{line}\n" for line in lines).encode())
    return len(lines), failed


def _summary(source: FrameSource, done: int, failed: int, out: Path) -> str:
    problems = f", {failed} of them could not be used (see their lines)" if failed else ""
    return f"{source.title}: {done} frames{problems}; results in {out}"
