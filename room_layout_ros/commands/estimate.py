"""Estimate room layouts offline: a frames folder, a rosbag2 or an NYU .mat file in, label images out.

DIR gets, for every frame NAME:
  layout/NAME.png     the empty room: 1 ceiling, 2 floor, 3 left, 4 front, 5 right wall
  labels/NAME.png     what is seen: the same, 6 clutter, 0 unknown
  furniture/NAME.png  NYU40 class on clutter, 0 elsewhere
  overlay/NAME.jpg    a picture for people (with --overlay)
  free_space/NAME.png, NAME.yaml   where a robot can drive, as a map for Nav2 (with --free-space); none without floor
  estimates.jsonl     a line a frame: status, confidences, axes, planes, polygons, milliseconds
A frame that cannot be used gets a line with its error. Lines come as the frames are done, each after its images, so
a run that ends early leaves what it has done. Exit code 0 when every frame has its line, 2 on bad input: also where
no frame could be used, and where a bag turns out damaged on the way, unless --recover asks for what can be read.
An earlier estimate in DIR is replaced as soon as a frame can be used: the images that its estimates.jsonl names go.
Other files there are kept; where
one lies among the images, DIR is a frames folder, or another run is writing there, that is refused.
"""

from __future__ import annotations

import argparse
import json
import sys
from collections import Counter
from collections.abc import Callable, Iterator
from dataclasses import dataclass, field
from functools import partial
from itertools import chain, islice
from pathlib import Path

from room_layout_ros.commands.camera_pose import add_pose_arguments, pose_of
from room_layout_ros.commands.compiling import told_first
from room_layout_ros.commands.counts import add_work_arguments, count
from room_layout_ros.commands.depth_doubts import DepthDoubts
from room_layout_ros.commands.earlier_estimates import LINES, SUFFIXES, earlier_files, replace_earlier, until_usable
from room_layout_ros.commands.estimate_frame import FrameJob, FrameResult, estimate_item, lost_result
from room_layout_ros.commands.estimator_options import add_estimator_options, parse_settings
from room_layout_ros.commands.frame_words import count_of_frames, without_room
from room_layout_ros.commands.interrupts import interrupts_between_items
from room_layout_ros.commands.models_folder import add_models_argument, usable_models
from room_layout_ros.commands.output_folder import held_alone, refuse_frames
from room_layout_ros.commands.progress import progress_bar
from room_layout_ros.commands.topics import add_recover_argument, add_topic_arguments, open_with_topics
from room_layout_ros.core.estimate import Status
from room_layout_ros.datasets import BadFrame, DataError, FrameSource, Sample
from room_layout_ros.datasets.images import write_atomically
from room_layout_ros.datasets.readable import ReadablePart
from room_layout_ros.parallel import map_ordered


def add_arguments(parser: argparse.ArgumentParser) -> None:
    """Add the options of `estimate`."""
    parser.add_argument("input", type=Path, metavar="INPUT", help="frames folder, rosbag2 (sqlite3, mcap) or NYU .mat")
    parser.add_argument(
        "--out",
        type=Path,
        required=True,
        metavar="DIR",
        help="folder for the results, made if missing; an earlier estimate there is replaced",
    )
    parser.add_argument("--limit", type=count, metavar="N", help="no more than the first N frames")
    add_estimator_options(parser)
    parser.add_argument("--overlay", action="store_true", help="write overlay pictures too")
    parser.add_argument("--free-space", action="store_true", help="write where a robot can drive, as maps for Nav2")
    add_work_arguments(parser)
    add_models_argument(parser)
    add_recover_argument(parser)
    add_pose_arguments(parser)
    add_topic_arguments(parser)


def run(arguments: argparse.Namespace) -> int:
    """Estimate every frame of the input."""
    config = parse_settings(arguments.set, arguments.rgb_only, joint_bound=True)  # nobody waits: it may be proved, too
    models = usable_models(arguments.models, config)
    if arguments.free_space and (arguments.rgb_only or not config.use_depth):
        raise DataError("--free-space needs depth, and it is left unused (--rgb-only, or use_depth is false)")
    job = FrameJob(config, arguments.rgb_only, arguments.overlay, models, pose_of(arguments), arguments.free_space)
    source = open_with_topics(arguments.input, arguments, arguments.recover)
    refuse_frames("--out", arguments.out, arguments.input)
    with held_alone("--out", arguments.out):
        return _estimate(arguments, job, source)


def _estimate(arguments: argparse.Namespace, job: FrameJob, source: FrameSource) -> int:
    earlier = earlier_files(arguments.out)
    wanted = dict.fromkeys(SUFFIXES, True) | {"overlay": job.overlay, "free_space": job.free_space}
    begin = partial(replace_earlier, arguments.out, earlier, wanted)
    doubts = DepthDoubts(job.config, job.rgb_only)
    work, items, written = partial(estimate_item, job), ReadablePart(source), _Written(arguments.out, doubts)
    length = source.length
    first: Iterator[Sample | BadFrame] = islice(items, arguments.limit)
    if arguments.scheduler is None:  # others compile by themselves
        first = told_first(first, job.config, job.rgb_only)
    expected = length if arguments.limit is None else min(arguments.limit, length or arguments.limit)
    with interrupts_between_items() as check, progress_bar("estimate", expected) as progress:
        results = map_ordered(work, first, arguments.jobs, arguments.scheduler, progress, lost_result)
        written.write(results, begin, check)
    if items.damage is not None and not (arguments.recover and written.frames):
        raise DataError(f"{items.damage}; {written.frames} frames estimated before the damage")
    if not written.frames:
        raise DataError(f"{source.title} holds no frame")
    if items.damage is not None:
        print(items.damage, file=sys.stderr)
    if written.failed == written.frames:
        raise DataError(f"{source.title}: none of {written.frames} frames could be used; {written.first_error}")
    print(f"{source.title}: {written}", file=sys.stderr)
    if written.no_room:
        print(without_room(written.no_room, written.frames), file=sys.stderr)
    doubts.tell()
    return 0


@dataclass(slots=True)
class _Written:
    """What is in the folder so far.

    `first_error` is of the first frame that could not be used; `no_room` counts frames without a room by the reason.
    """

    out: Path
    doubts: DepthDoubts
    frames: int = 0
    failed: int = 0
    first_error: str = ""
    no_room: Counter[str] = field(default_factory=Counter)

    def write(self, results: Iterator[FrameResult], begin: Callable[[], None], check: Callable[[], None]) -> None:
        """Write images and lines as they come, `check` after each; no line of an earlier run stays beside them.

        `begin` makes the place for them once a frame is usable; where none is, nothing is written.
        """
        first, usable = until_usable(results, check)
        for result in first:
            self._count(result)
        if not usable:
            return
        begin()
        with (self.out / LINES).open("w", encoding="utf-8") as lines:
            for result in chain(first, map(self._count, results)):
                for file, content in result.files.items():
                    write_atomically(self.out / file, content)
                lines.write(f"{json.dumps(result.line, allow_nan=False)}\n")
                lines.flush()
                check()

    def _count(self, result: FrameResult) -> FrameResult:
        self.frames += 1
        if result.depth is not None:
            self.doubts.add(result.depth)
            if not result.depth.room:
                self.no_room[Status[result.line["status"]].value] += 1
        if "error" in result.line:
            self.failed += 1
            self.first_error = self.first_error or f"the first is {result.line['name']}: {result.line['error']}"
        return result

    def __str__(self) -> str:
        problems = f", {self.failed} of them could not be used ({self.first_error})" if self.failed else ""
        return f"{count_of_frames(self.frames)}{problems}; results in {self.out}"
