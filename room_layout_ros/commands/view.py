"""Look at a frame: colour, depth, superpixels, lines, evidence, labels, layout, and the room from above.

Writes a PNG, of all stages or of one (--stage), or opens the Rerun viewer on all frames (--interactive),
or writes a recording for it (--rrd FILE).
"""

from __future__ import annotations

import argparse
from itertools import islice
from pathlib import Path

from room_layout_ros.commands.estimate_frame import parse_settings
from room_layout_ros.commands.progress import progress_bar
from room_layout_ros.commands.topics import add_topic_arguments, open_with_topics
from room_layout_ros.core.config import EstimatorConfig
from room_layout_ros.core.estimator import LayoutEstimator
from room_layout_ros.core.frame import RgbdFrame
from room_layout_ros.datasets import BadFrame, DataError, FramesFolder, FrameSource, good_samples
from room_layout_ros.datasets.frame_names import did_you_mean
from room_layout_ros.datasets.images import write_image
from room_layout_ros.evaluation.stages import STAGES, Look, draw_all, draw_stage, look_at


def add_arguments(parser: argparse.ArgumentParser) -> None:
    """Add the options of `view`."""
    parser.add_argument("input", type=Path, metavar="INPUT", help="frames folder, rosbag2 or NYU .mat")
    parser.add_argument("--frame", metavar="NAME", help="name of the frame (default: the first)")
    parser.add_argument("--stage", choices=list(STAGES), help="one stage at full size instead of all")
    parser.add_argument("--out", type=Path, metavar="PNG", help="picture to write (default: view-NAME[-STAGE].png)")
    parser.add_argument("--rgb-only", action="store_true", help="leave the depth unused")
    parser.add_argument("--interactive", action="store_true", help="open the Rerun viewer (extra viz)")
    parser.add_argument("--rrd", type=Path, metavar="FILE", help="write a recording for the Rerun viewer")
    parser.add_argument("--limit", type=int, default=300, metavar="N", help="most frames for the viewer (default 300)")
    parser.add_argument(
        "--set", action="append", default=[], metavar="NAME=VALUE", help="set a parameter of the estimator (repeatable)"
    )
    add_topic_arguments(parser)


def run(arguments: argparse.Namespace) -> int:
    """Write the picture, or show the frames."""
    config = parse_settings(arguments.set)
    source = open_with_topics(arguments.input, arguments)
    if arguments.interactive or arguments.rrd is not None:
        _to_viewer(arguments, source, config)
        return 0
    frame = find_frame(source, arguments.frame)
    look = _look(frame, config, arguments.rgb_only)
    image = draw_all(look) if arguments.stage is None else draw_stage(arguments.stage, look)
    if image is None:
        raise DataError(f"frame {frame.name} has nothing to show at the stage {arguments.stage}")
    stage = "" if arguments.stage is None else f"-{arguments.stage}"
    out: Path = arguments.out or Path(f"view-{frame.name}{stage}.png")
    if out.suffix.lower() not in (".png", ".jpg"):
        raise DataError(f"--out {out}: the picture must be a .png or .jpg")
    out.parent.mkdir(parents=True, exist_ok=True)
    write_image(out, image)
    estimate = look.estimate
    print(f"{source.title}, frame {frame.name}: {estimate.status.value}, confidence {estimate.confidence:.2f}")
    print(out)
    return 0


def find_frame(source: FrameSource, name: str | None) -> RgbdFrame:
    """Return the named frame, or the first that can be used.

    Raises
    ------
    DataError
        When there is no such frame, or it cannot be used.
    """
    if name is not None and isinstance(source, FramesFolder):
        source = source.subset((name,))  # straight to its files
    others = []
    for item in source:
        others.append(item.name)
        if name is None or item.name == name:
            if isinstance(item, BadFrame):
                raise DataError(f"frame {item.name} cannot be used: {item.error}")
            return item.frame
    if name is None:
        raise DataError(f"{source.title} holds no frame")
    raise DataError(f"{source.title} holds no frame {name!r}{did_you_mean(name, others)}")


def _look(frame: RgbdFrame, config: EstimatorConfig, rgb_only: bool) -> Look:
    if rgb_only and frame.color is None:
        raise DataError(f"frame {frame.name} has no colour, and --rgb-only leaves the depth unused")
    frame = frame.without_depth() if rgb_only else frame
    return look_at(frame, LayoutEstimator(config))


def _to_viewer(arguments: argparse.Namespace, source: FrameSource, config: EstimatorConfig) -> None:
    if arguments.limit < 1:
        raise DataError(f"--limit is {arguments.limit}; it must be 1 or more")
    from room_layout_ros.evaluation.rerun_log import RerunLog

    log = RerunLog.to_file(arguments.rrd) if arguments.rrd is not None else RerunLog.to_viewer()
    estimator = LayoutEstimator(config)
    count, others = 0, []
    with progress_bar("view", min(arguments.limit, source.length or arguments.limit)) as progress:
        for sample in islice(good_samples(source), arguments.limit):
            others.append(sample.name)
            if arguments.frame is not None and sample.name != arguments.frame:
                continue
            frame = sample.frame.without_depth() if arguments.rgb_only else sample.frame
            log.add(frame, estimator.estimate(frame))
            count += 1
            progress(count)
    log.close()
    if not count:
        wanted = arguments.frame
        meant = "" if wanted is None else f" {wanted!r}{did_you_mean(wanted, others)}"
        raise DataError(f"{source.title} holds no usable frame{meant}")
    print(arguments.rrd if arguments.rrd is not None else f"{count} frames are in the viewer")
