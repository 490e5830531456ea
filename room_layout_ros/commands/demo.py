"""See the whole thing work: frames are played into the live node, and what it publishes becomes a page.

Without --input a short walk through a furnished room is rendered, with known truth. With --input the frames come
from a frames folder or a bag. Player, estimator node and recorder are three processes that talk over DDS.
The folder gets index.html, contact-sheet.png, free-space.png, overlay.webp, the input as a bag and the node's results
as an MCAP.
The next demo in the same folder replaces these files; others there are kept.
Where ROS is not installed the same bag runs through the same estimator without the node.
"""

from __future__ import annotations

import argparse
import importlib.util
import sys
from collections import Counter
from collections.abc import Mapping
from dataclasses import dataclass
from itertools import islice
from pathlib import Path

import numpy as np

from room_layout_ros.commands.camera_pose import add_pose_arguments, given_angles, pose_of, refuse_pose
from room_layout_ros.commands.counts import count, real, seed
from room_layout_ros.commands.demo_live import node_words, played_topics, run_live
from room_layout_ros.commands.demo_offline import run_offline
from room_layout_ros.commands.demo_page import PAIR, DemoFacts, demo_html
from room_layout_ros.commands.demo_pictures import (
    ANIMATION_TILE,
    Image,
    shrink,
    side_by_side,
    write_animation,
    write_floors,
    write_sheets,
)
from room_layout_ros.commands.demo_results import Recording, read_recording
from room_layout_ros.commands.depth_doubts import DepthDoubts, DepthSeen, see_depth
from room_layout_ros.commands.frame_words import count_of_frames, without_room
from room_layout_ros.commands.output_folder import make_folder, remove_files
from room_layout_ros.commands.progress import progress_bar
from room_layout_ros.commands.topics import add_topic_arguments, open_with_topics, refuse_bag_options
from room_layout_ros.core.config import EstimatorConfig
from room_layout_ros.core.frame import RgbdFrame
from room_layout_ros.datasets import BadFrame, DataError, FrameSource, Sample, open_source
from room_layout_ros.datasets.bag_topics import COLOR_TOPIC, DEPTH_TOPIC
from room_layout_ros.datasets.images import write_atomically
from room_layout_ros.datasets.usable import usable_samples
from room_layout_ros.datasets.writers import BagWriter
from room_layout_ros.evaluation.floor_picture import draw_floor, known_box
from room_layout_ros.evaluation.measures import score_pixels
from room_layout_ros.evaluation.pictures import base_image
from room_layout_ros.extras import install_hint

MADE_BY_US = ".room-layout-demo"
"""A folder with this file was made by the demo; what it wrote there is replaced by the next one."""

_BAG = ("metadata.yaml", "*.mcap")
_WRITTEN = (
    *("index.html", "contact-sheet.png", "contact-sheet-all-*.jpg", "free-space.png", "overlay.webp"),
    *(f"{folder}/{pattern}" for folder in ("input", "results") for pattern in _BAG),
    *("log/*.txt", "log/ros/*"),
)
"""Patterns of all files that a demo writes."""

_FOLDERS = ("input", "results", "log/ros", "log")

_NO_ROS = "No ROS 2 wheels are installed here (they exist for Linux on x86-64)"
_FIRST_TIME = "the first run on a machine compiles for one to four minutes"

RENDERED_FRAMES = 60
RENDERED_SEED = 4


def add_arguments(parser: argparse.ArgumentParser) -> None:
    """Add the options of `demo`."""
    parser.add_argument("--input", type=Path, metavar="X", help="frames folder or rosbag2 (default: a rendered room)")
    parser.add_argument("--out", type=Path, default=Path("out/demo"), metavar="DIR", help="default %(default)s")
    parser.add_argument(
        "--frames", type=count, metavar="N", help=f"at most N frames (default all; rendered {RENDERED_FRAMES})"
    )
    parser.add_argument("--seed", type=seed, default=RENDERED_SEED, help="of the rendered room")
    parser.add_argument(
        "--rate",
        type=real(0.01, 10),
        metavar="X",
        help="play at this multiple of real time (default: as fast as all are estimated)",
    )
    parser.add_argument("--no-node", action="store_true", help="leave out ROS: no node, no DDS")
    add_pose_arguments(parser)
    add_topic_arguments(parser)


def run(arguments: argparse.Namespace) -> int:
    """Run the demo and print the paths of what it made."""
    _check(arguments)
    live = not arguments.no_node and ros_is_here()
    if not live and not arguments.no_node:
        print(f"{_NO_ROS}: running without the node.", file=sys.stderr)
    source = _source(arguments)
    out: Path = arguments.out
    if arguments.input is not None:
        _refuse_inside(arguments.input, out)
        # Before an earlier demo is removed for it: refuse an input without a usable frame.
        next(usable_samples(source.title, islice(source, arguments.frames)))
    _make_folder(out)
    bag = out / "input"
    _say(f"{'render a room' if arguments.input is None else 'read the frames'}, write a bag")
    doubts, no_room = DepthDoubts(EstimatorConfig()), Counter[str]()
    look, depths, left_out = _write_bag(source, bag, arguments.frames, doubts.config)
    pose = given_angles(arguments)
    words = node_words(bag, pose)
    if live:
        _say(f"play {count_of_frames(len(look))} into the node and record what it publishes ({_FIRST_TIME})")
        mcap, notes = run_live(bag, out, sorted(look), arguments.rate, words)
    else:
        _say(f"estimate {count_of_frames(len(look))} ({_FIRST_TIME})")
        with progress_bar("estimate", len(look)) as progress:
            mcap, no_room = run_offline(open_source(bag), out / "results", progress, doubts, pose_of(arguments))
        notes = ()
    _say("draw the pictures and write the page")
    recording = read_recording(mcap)
    rooms = recording.rooms.intersection(look)
    for stamp, depth in depths.items():
        doubts.add(depth._replace(room=stamp in rooms))
    roomless = _without_room({**no_room, **recording.no_room}, len(look), len(rooms))
    without = "" if live else "--no-node was given" if arguments.no_node else _NO_ROS
    odd = (*left_out, *roomless, *doubts.sentences(), *recording.doubts)
    commands = _by_hand(bag, words, pose)
    made = _show(out, source, look, recording, mcap, bag, without, (*odd, *notes), commands)
    for sentence in odd:
        _say(sentence)
    print("\n".join(str(path) for path in made))
    return 0


def _say(step: str) -> None:
    """Tell what begins now, beside the paths on stdout."""
    print(f"demo: {step}", file=sys.stderr, flush=True)


def ros_is_here() -> bool:
    """Whether rclpy can be imported."""
    return importlib.util.find_spec("rclpy") is not None


def _check(arguments: argparse.Namespace) -> None:
    if arguments.input is None:
        refuse_bag_options(arguments, "and without --input a room is rendered")
        refuse_pose(arguments, "and without --input a room is rendered")
    for module, extra in (("rosbags", "playback"), ("PIL", "viz")):
        if importlib.util.find_spec(module) is None:
            raise DataError(f"the demo needs {module}: {install_hint(extra)}")


def _source(arguments: argparse.Namespace) -> FrameSource:
    if arguments.input is not None:
        return open_with_topics(arguments.input, arguments)
    from room_layout_ros.datasets.synthetic import SyntheticSource

    return SyntheticSource(frames=arguments.frames or RENDERED_FRAMES, seed=arguments.seed)


def _make_folder(out: Path) -> None:
    make_folder("--out", out)
    if any(out.iterdir()):
        if not (out / MADE_BY_US).exists():
            raise DataError(f"{out} is not empty and not of an earlier demo; choose another folder by --out")
        _remove_earlier(out)
    (out / MADE_BY_US).touch()


def _refuse_inside(source: Path, out: Path) -> None:
    if source.resolve().is_relative_to(out.resolve()):
        raise DataError(f"--input {source} lies in --out {out}, where it would be replaced; choose another by --out")


def _remove_earlier(out: Path) -> None:
    """Remove what an earlier demo wrote; refuse before anything is gone where a bag's folder holds more."""
    files = {path for pattern in _WRITTEN for path in out.glob(pattern) if path.is_file()}
    for folder in ("input", "results"):
        others = sorted(set((out / folder).glob("*")) - files)
        if others:
            raise DataError(f"{others[0]} is not of the demo, which makes {folder}/ anew; choose another by --out")
    remove_files(files, (out / folder for folder in _FOLDERS))


@dataclass(frozen=True, slots=True)
class _Seen:
    """What is kept of an input frame: a small picture, and the true layout where it is known."""

    name: str
    picture: np.ndarray[tuple[int, ...], np.dtype[np.uint8]]
    layout: np.ndarray[tuple[int, ...], np.dtype[np.uint8]] | None
    labels: np.ndarray[tuple[int, ...], np.dtype[np.uint8]] | None


def _write_bag(
    source: FrameSource, bag: Path, limit: int | None, config: EstimatorConfig
) -> tuple[dict[int, _Seen], dict[int, DepthSeen], tuple[str, ...]]:
    """Write the frames as a rosbag2; return by stamp what is needed of them and their depth, and what was left out."""
    seen: dict[int, _Seen] = {}
    depths: dict[int, DepthSeen] = {}
    bad: list[BadFrame] = []
    what = "render and write bag" if source.title.startswith("synthetic") else "write bag"
    with progress_bar(what, source.length if limit is None else limit) as progress, BagWriter(bag) as writer:
        for item in islice(source, limit):
            if isinstance(item, BadFrame):
                bad.append(item)
                continue
            writer.write(item)
            seen[item.frame.stamp_ns] = _seen(item)
            depths[item.frame.stamp_ns] = see_depth(item.frame, config)
            progress(len(seen))
    if not bad:
        return seen, depths, ()
    words = f"{count_of_frames(len(bad))} of the input could not be used; the first is {bad[0].name}: {bad[0].error}"
    return seen, depths, (words,)


def _without_room(reasons: Mapping[str, int], frames: int, rooms: int) -> tuple[str, ...]:
    """Say how many of the frames have no room, and why, as far as that is known."""
    rest = max(0, frames - rooms - sum(reasons.values()))
    sentence = without_room({**reasons, "the node does not say why": rest}, frames)
    return (sentence,) if sentence else ()


def _seen(sample: Sample) -> _Seen:
    frame: RgbdFrame = sample.frame
    truth = sample.truth
    layout, labels = (truth.layout, truth.labels) if truth else (None, None)
    return _Seen(sample.name, shrink(base_image(frame)), layout, labels)


def _show(
    out: Path, source: FrameSource, look: dict[int, _Seen], recording: Recording, mcap: Path, bag: Path, without: str,
    notes: tuple[str, ...], commands: list[str],
) -> list[Path]:  # fmt: skip
    """Write pictures and page; return the paths, the page last."""
    stamps = [stamp for stamp in sorted(look) if stamp in recording.overlay]
    if not stamps:
        raise DataError("no result carries the stamp of a played frame; this is a bug of the demo")
    overlays = [(look[stamp].name, recording.overlay[stamp]) for stamp in stamps]
    sheets = write_sheets(out / "contact-sheet.png", overlays)
    animation = out / "overlay.webp"
    floors = _floors(recording, stamps)
    if floors:
        write_floors(out / "free-space.png", [(look[stamp].name, floors[stamp]) for stamp in stamps])
    shown = [(look[stamp].picture, recording.overlay[stamp]) + ((floors[stamp],) if floors else ()) for stamp in stamps]
    write_animation(animation, [side_by_side(*pictures) for pictures in shown], max(stamps[-1] - stamps[0], 1) * 1e-9)
    facts = DemoFacts(
        title="Room layout" if without else "Room layout, live",
        source=f"{source.title}, {count_of_frames(len(look))}",
        estimated=_what_is_estimated(bag),
        without_node=without,
        cards=_cards(look, recording, stamps, _what_is_estimated(bag)),
        topics=recording.topics,
        animation=animation.relative_to(out),
        sheet=sheets[0].relative_to(out),
        sheets=[sheet.relative_to(out) for sheet in sheets],
        floors=Path("free-space.png") if floors else None,
        mcap=mcap.relative_to(out),
        bag=bag.relative_to(out),
        commands=commands,
        notes=notes,
    )
    page = out / "index.html"
    write_atomically(page, demo_html(facts).encode())
    return [*sheets, *([out / "free-space.png"] if floors else []), animation, mcap, page]


def _floors(recording: Recording, stamps: list[int]) -> dict[int, Image]:
    """Return the free space by stamp as pictures of the same part of the floor; none where no frame has any."""
    grids = {stamp: recording.free_space.get(stamp) for stamp in stamps}
    if not any(grids.values()):
        return {}
    box = known_box(grid for grid in grids.values() if grid is not None)
    return {stamp: draw_floor(grid, box, ANIMATION_TILE) for stamp, grid in grids.items()}


def _what_is_estimated(bag: Path) -> str:
    """Return what a room is made of: images of both streams, or of the one that the bag has."""
    topics = played_topics(bag)
    if COLOR_TOPIC in topics and DEPTH_TOPIC in topics:
        return PAIR
    return "colour image" if COLOR_TOPIC in topics else "depth image"


def _cards(
    look: dict[int, _Seen], recording: Recording, stamps: list[int], estimated: str
) -> list[tuple[str, str, str]]:
    rooms = len(recording.rooms.intersection(look))
    what = "frame came back as a room" if len(look) == 1 else "frames came back as rooms"
    stamp_of = "paired by the stamp of the depth image" if estimated == PAIR else f"by the stamp of the {estimated}"
    cards = [(f"{rooms} of {len(look)}", what, stamp_of)]
    if "latency_p50_ms" in recording.health:
        usual, slow = recording.health["latency_p50_ms"], recording.health.get("latency_p99_ms", "-")
        cards.append((f"{usual} ms", f"{estimated} received to room published", f"median; p99 {slow} ms"))
    errors = []
    for stamp in stamps:
        truth, layout = look[stamp].layout, recording.layout.get(stamp)
        if truth is not None and layout is not None:
            errors.append(score_pixels(truth, layout, look[stamp].labels, recording.labels.get(stamp)))
    if errors:
        layout_error = float(np.nanmean([e.layout_error for e in errors]))
        known = f"mean over {count_of_frames(len(errors))} with a known truth"
        cards.append((f"{100 * layout_error:.2f} %", "layout error", known))
        labelling = [e.labelling_error for e in errors if np.isfinite(e.labelling_error)]
        if labelling:
            cards.append(
                (f"{100 * float(np.mean(labelling)):.2f} %", "labelling error", "faces and clutter, per pixel")
            )
    return cards


def _by_hand(bag: Path, words: list[str], pose: Mapping[str, float]) -> list[str]:
    node = " ".join(["estimator", *words])
    options = "".join(f" --{name.replace('_', '-')} {value:g}" for name, value in pose.items())
    return [
        f"ros2 run room_layout_ros {node}        # or: {node}",
        f"room-layout play {bag}",
        f"room-layout estimate {bag} --out estimates --overlay{options}",
    ]
