"""Look at a frame: colour, depth, superpixels, lines, evidence, labels, layout, and the room from above.

Writes a PNG, of all stages or of one (--stage), or opens the Rerun viewer on all frames (--interactive),
or writes a recording for it (--rrd FILE). Frames of a camera that hangs on its side or upside down (--camera-roll-deg)
are drawn upright.
"""

from __future__ import annotations

import argparse
import time
from collections.abc import Iterator
from itertools import chain, islice
from pathlib import Path

from room_layout_ros.commands.camera_pose import add_pose_arguments, pose_of
from room_layout_ros.commands.compiling import tell_if_compiling
from room_layout_ros.commands.counts import count
from room_layout_ros.commands.depth_doubts import DepthDoubts, see_depth
from room_layout_ros.commands.estimator_options import add_estimator_options, parse_settings, prepared
from room_layout_ros.commands.frame_words import count_of_frames
from room_layout_ros.commands.output_folder import make_folder
from room_layout_ros.commands.progress import progress_bar
from room_layout_ros.commands.topics import add_topic_arguments, open_with_topics
from room_layout_ros.core.config import EstimatorConfig
from room_layout_ros.core.estimator import LayoutEstimator
from room_layout_ros.core.frame import RgbdFrame
from room_layout_ros.datasets import BadFrame, DataError, FramesFolder, FrameSource, Sample
from room_layout_ros.datasets.frame_names import find_name, there_are
from room_layout_ros.datasets.images import write_image
from room_layout_ros.datasets.usable import usable_samples
from room_layout_ros.evaluation.stages import STAGES, draw_all, draw_stage, look_at


def add_arguments(parser: argparse.ArgumentParser) -> None:
    """Add the options of `view`."""
    parser.add_argument("input", type=Path, metavar="INPUT", help="frames folder, rosbag2 or NYU .mat")
    parser.add_argument("--frame", metavar="NAME", help="name of the frame (default: the first that can be used)")
    parser.add_argument("--stage", choices=list(STAGES), help="one stage at full size instead of all")
    parser.add_argument(
        "--out",
        type=Path,
        metavar="PNG",
        help="picture to write in a folder made if missing (default: view-NAME[-STAGE].png)",
    )
    add_estimator_options(parser)
    parser.add_argument("--interactive", action="store_true", help="open the Rerun viewer (extra viz)")
    parser.add_argument("--rrd", type=Path, metavar="FILE", help="write a recording for the Rerun viewer")
    parser.add_argument(
        "--limit", type=count, default=300, metavar="N", help="most frames for the viewer (default %(default)s)"
    )
    add_pose_arguments(parser, pitch=False)
    add_topic_arguments(parser)


def run(arguments: argparse.Namespace) -> int:
    """Write the picture, or show the frames."""
    _refuse_two_ways(arguments)
    config = parse_settings(arguments.set, arguments.rgb_only)
    source = open_with_topics(arguments.input, arguments)
    if arguments.interactive or arguments.rrd is not None:
        _to_viewer(arguments, source, config)
        return 0
    if arguments.out is not None and arguments.out.suffix.lower() not in (".png", ".jpg"):
        raise DataError(f"--out {arguments.out}: the picture must be a .png or .jpg")
    frame = find_frame(source, arguments.frame)
    if arguments.out is not None:
        make_folder("--out", arguments.out.parent)
    tell_if_compiling(config, arguments.rgb_only)
    look = look_at(_upright(frame, arguments), LayoutEstimator(config))
    doubts = DepthDoubts(config, arguments.rgb_only)
    doubts.add(see_depth(look.frame, config, look.estimate))
    image = draw_all(look) if arguments.stage is None else draw_stage(arguments.stage, look)
    if image is None:
        raise DataError(f"frame {frame.name} has nothing to show at the stage {arguments.stage}")
    stage = "" if arguments.stage is None else f"-{arguments.stage}"
    out: Path = arguments.out or Path(f"view-{frame.name}{stage}.png")
    write_image(out, image)
    estimate = look.estimate
    print(f"{source.title}, frame {frame.name}: {estimate.status.value}, confidence {estimate.confidence:.2f}")
    print(out)
    doubts.tell()
    return 0


def _upright(frame: RgbdFrame, arguments: argparse.Namespace) -> RgbdFrame:
    """Return the frame as it is estimated and drawn: turned by quarters where the camera is said to hang so."""
    return pose_of(arguments).turn.frame(prepared(frame, arguments.rgb_only))


def _refuse_two_ways(arguments: argparse.Namespace) -> None:
    """Refuse options of which one would be left out without a word."""
    picture = {"--stage": arguments.stage, "--out": arguments.out}
    given = [name for name, value in picture.items() if value is not None]
    if arguments.interactive and arguments.rrd is not None:
        raise DataError("--interactive and --rrd exclude each other: one opens the viewer, one writes a file for it")
    if given and (arguments.interactive or arguments.rrd is not None):
        viewer = "--interactive" if arguments.interactive else "--rrd"
        raise DataError(f"{given[0]} is of a picture, and {viewer} shows all stages in the viewer; leave one out")


def find_frame(source: FrameSource, name: str | None) -> RgbdFrame:
    """Return the named frame, or the first that can be used.

    Raises
    ------
    DataError
        When there is no such frame, or it cannot be used.
    """
    if name is None:
        return next(usable_samples(source.title, source)).frame
    item = _named(source, name)
    if isinstance(item, BadFrame):
        raise DataError(f"frame {item.name} cannot be used: {item.error}")
    return item.frame


def _named(source: FrameSource, name: str) -> Sample | BadFrame:
    """Return the frame of that name.

    Raises
    ------
    DataError
        When there is none, after all have been looked at.
    """
    if isinstance(source, FramesFolder):
        return next(iter(source.subset((find_name(name, source.names),))))  # straight to its files
    others = []
    for item in source:
        if item.name == name:
            return item
        others.append(item.name)
    meant = find_name(name, others)
    hint = there_are(others) if meant == name else f"did you mean {meant!r}?"
    raise DataError(f"{source.title} has no frame {name!r}; {hint}")


def _frames(source: FrameSource, arguments: argparse.Namespace) -> Iterator[RgbdFrame]:
    """Yield what the viewer shows: the named frame, or all that can be used."""
    if arguments.frame is not None:
        yield _upright(find_frame(source, arguments.frame), arguments)
        return
    for sample in usable_samples(source.title, source):
        yield _upright(sample.frame, arguments)


def _to_viewer(arguments: argparse.Namespace, source: FrameSource, config: EstimatorConfig) -> None:
    from room_layout_ros.evaluation.rerun_log import RerunLog

    estimator, doubts, count = LayoutEstimator(config), DepthDoubts(config, arguments.rgb_only), 0
    frames = _frames(source, arguments)
    first = next(frames)  # nothing is made or opened where there is none
    if arguments.rrd is not None:
        make_folder("--rrd", arguments.rrd.parent)
    log = RerunLog.to_viewer() if arguments.rrd is None else RerunLog.to_file(arguments.rrd)
    tell_if_compiling(config, arguments.rgb_only)
    most = min(arguments.limit, source.length or arguments.limit) if arguments.frame is None else 1
    with progress_bar("view", most) as progress:
        for count, frame in enumerate(islice(chain([first], frames), arguments.limit), 1):
            start = time.perf_counter()
            estimate = estimator.estimate(frame)
            log.add(frame, estimate, 1e3 * (time.perf_counter() - start))
            doubts.add(see_depth(frame, config, estimate))
            progress(count)
    log.close()
    print(arguments.rrd if arguments.rrd is not None else f"in the viewer: {count_of_frames(count)}")
    doubts.tell()
