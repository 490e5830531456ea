"""Measure against ground truth: layout and labelling error, IoU, beside the paper's numbers and plain baselines.

INPUT is a frames folder or any other input with true layouts (layout/NAME.png) and, for the labelling, NYU40
classes (labels40/NAME.png). DIR gets summary.json, frames.csv and report.html.
Which of two visible walls is called "front" is a guess of the annotators: errors are given with the wall names
permuted to the best fit; "fixed" is with the names as they are.
"""

from __future__ import annotations

import argparse
import importlib.util
import json
from collections.abc import Iterable, Iterator
from dataclasses import dataclass, replace
from functools import partial
from pathlib import Path

from room_layout_ros.commands.estimate_frame import parse_settings
from room_layout_ros.commands.progress import progress_bar
from room_layout_ros.core.config import EstimatorConfig
from room_layout_ros.datasets import BadFrame, DataError, FramesFolder, FrameSource, Sample, open_source
from room_layout_ros.datasets.images import write_atomically
from room_layout_ros.evaluation import baselines, tables
from room_layout_ros.evaluation.compare import ComparedFrame, EstimatorMethod, compare
from room_layout_ros.evaluation.folder_predictions import read_folder
from room_layout_ros.evaluation.scores import Method, SetScore
from room_layout_ros.parallel import map_ordered

BASELINES = {
    "constant": "constant layout",
    "percentile": "walls at the 98th percentile",
    "depth": "our simple depth estimator",
}


def add_arguments(parser: argparse.ArgumentParser) -> None:
    """Add the options of `evaluate`."""
    parser.add_argument("input", type=Path, metavar="INPUT", help="frames folder or other input with truth")
    parser.add_argument("--out", type=Path, metavar="DIR", help="folder for summary.json, frames.csv, report.html")
    parser.add_argument(
        "--frames",
        metavar="SUBSET",
        help="a list of splits.json (layout_dev, official_test, ...), a text file of names, or names with commas; "
        "default: every frame with a true layout",
    )
    parser.add_argument("--rgb-only", action="store_true", help="our estimator without depth only")
    parser.add_argument("--estimates", type=Path, metavar="DIR", help="score this output of `room-layout estimate`")
    parser.add_argument(
        "--baseline",
        action="append",
        choices=[*BASELINES, "none"],
        help="plain solutions beside ours (repeatable; default all)",
    )
    parser.add_argument("--jobs", type=int, default=1, metavar="N", help="local processes (default 1)")
    parser.add_argument("--scheduler", metavar="ADDRESS", help="Dask scheduler, tcp://host:port, instead of --jobs")
    parser.add_argument(
        "--curve",
        type=Path,
        metavar="FILE",
        help='our percentages by C: {"1000": {"layout": ..., "labelling": ..., "mean_iou": ...}}',
    )
    parser.add_argument("--no-report", action="store_true", help="leave report.html out (it needs the extra viz)")
    parser.add_argument(
        "--set", action="append", default=[], metavar="NAME=VALUE", help="set a parameter of the estimator (repeatable)"
    )


def run(arguments: argparse.Namespace) -> int:
    """Score every frame with truth by every method and print the table."""
    if arguments.out is not None and not arguments.no_report and importlib.util.find_spec("matplotlib") is None:
        raise DataError("report.html needs matplotlib: pip install 'room_layout_ros[viz]', or give --no-report")
    source = choose_frames(open_source(arguments.input), arguments.frames)
    methods = _methods(arguments, source)
    samples = _samples(source)
    with progress_bar("evaluate", source.length) as progress:
        work = partial(compare, methods, _superpixel_config(arguments))
        frames = list(map_ordered(work, samples, arguments.jobs, arguments.scheduler, progress))
    if not frames:
        raise DataError(f"{source.title} holds no frame with a true layout; layout/NAME.png is needed")
    scores = [SetScore(title, tuple(frame.scores[title] for frame in frames)) for title in methods]
    # Files first: whoever reads the table through a pipe may close it early.
    written = [] if arguments.out is None else _write(arguments, source, scores, frames)
    print(f"{source.title}: {len(frames)} frames with a true layout; percent, 95 % bootstrap interval\n")
    print("\n".join([tables.text_table(scores), "", *map(str, written)]).rstrip())
    return 0


def choose_frames(source: FrameSource, subset: str | None) -> FrameSource:
    """Return the source restricted to a named subset; without one, to the frames of a folder with a true layout.

    Raises
    ------
    DataError
        When the subset is unknown, or the input cannot be restricted.
    """
    if not isinstance(source, FramesFolder):
        if subset is not None:
            raise DataError(f"--frames {subset} needs a frames folder; {source.title} is none")
        return source
    if subset is not None:
        return source.subset(_names(source, subset))
    with_layout = {path.stem for path in (source.path / "layout").glob("*.png")}
    return source.subset(tuple(name for name in source.names if name in with_layout))


def subset_names(source: FrameSource, subset: str | None) -> tuple[str, ...]:
    """Return the names of a subset as `choose_frames` has it; none without a subset."""
    chosen = None if subset is None else choose_frames(source, subset)
    return chosen.names if isinstance(chosen, FramesFolder) else ()


def _names(source: FramesFolder, subset: str) -> tuple[str, ...]:
    splits_path = source.path / "splits.json"
    splits = json.loads(splits_path.read_text("utf-8")) if splits_path.exists() else {}
    if subset in splits:
        # Lists hold the data set's own indices; files are named by them with leading zeros.
        return tuple(f"{entry:04d}" if isinstance(entry, int) else str(entry) for entry in splits[subset])
    if (listing := Path(subset)).is_file():
        return tuple(listing.read_text("utf-8").split())
    names = tuple(name for name in subset.split(",") if name)
    if not set(names) <= set(source.names):
        known = ", ".join(splits) or "none"
        raise DataError(f"--frames {subset}: neither a list of splits.json ({known}), nor a file, nor names of frames")
    return names


def _superpixel_config(arguments: argparse.Namespace) -> EstimatorConfig | None:
    wanted = arguments.out is not None and not arguments.no_report and arguments.estimates is None
    return parse_settings(arguments.set) if wanted and not arguments.rgb_only else None


def _methods(arguments: argparse.Namespace, source: FrameSource) -> dict[str, Method]:
    methods: dict[str, Method] = {}
    if arguments.estimates is not None:
        methods[f"ours, {arguments.estimates}"] = read_folder(arguments.estimates)
    else:
        config = parse_settings(arguments.set)
        if not arguments.rgb_only:
            methods["ours, RGB-D"] = EstimatorMethod(config)
        methods["ours, RGB"] = EstimatorMethod(config, rgb_only=True)
    wanted = arguments.baseline or list(BASELINES)
    if "none" in wanted:
        return methods
    if "constant" in wanted:
        layouts = {s.name: s.truth.layout for s in _samples(source) if s.truth and s.truth.layout is not None}
        methods[BASELINES["constant"]] = baselines.ConstantLayout.of(layouts)
    if "percentile" in wanted:
        methods[BASELINES["percentile"]] = baselines.percentile_walls
    if "depth" in wanted:
        methods[BASELINES["depth"]] = EstimatorMethod(replace(parse_settings(arguments.set), method="depth"))
    return methods


@dataclass(frozen=True, slots=True)
class _Samples:
    """The scorable frames of a source; a bad one ends the evaluation, since leaving it out would better the mean."""

    source: FrameSource

    def __iter__(self) -> Iterator[Sample]:
        for item in self.source:
            if isinstance(item, BadFrame):
                raise DataError(f"frame {item.name} cannot be used: {item.error}")
            if item.truth is not None and item.truth.layout is not None:
                yield item


def _samples(source: FrameSource) -> Iterable[Sample]:
    return _Samples(source)


def read_curve(path: Path) -> dict[float, dict[str, float]]:
    """Read the errors by C that were measured while learning (Figure 4 b-d).

    Raises
    ------
    DataError
        When it is not an object of objects with layout, labelling and mean_iou.
    """
    try:
        content = json.loads(path.read_text("utf-8"))
        keys = ("layout", "labelling", "mean_iou")
        return {float(c): {key: float(row[key]) for key in keys} for c, row in content.items()}
    except (ValueError, KeyError, TypeError, AttributeError):
        raise DataError(f"{path} is no curve; each C needs numbers for layout, labelling and mean_iou") from None


def _write(
    arguments: argparse.Namespace, source: FrameSource, scores: list[SetScore], frames: list[ComparedFrame]
) -> list[Path]:
    out: Path = arguments.out
    out.mkdir(parents=True, exist_ok=True)
    facts = {"input": source.title, "subset": arguments.frames or "every frame with a true layout"}
    write_atomically(out / "summary.json", tables.summary_json(scores, **facts).encode())
    write_atomically(out / "frames.csv", tables.frames_csv(scores).encode())
    written = [out / "summary.json", out / "frames.csv"]
    if not arguments.no_report:
        from room_layout_ros.evaluation.report import report_html

        curve = None if arguments.curve is None else read_curve(arguments.curve)
        write_atomically(out / "report.html", report_html(scores, frames, source.title, curve).encode())
        written.append(out / "report.html")
    return written
