"""Measure against ground truth: layout and labelling error, IoU, beside the paper's numbers and plain baselines.

INPUT is a frames folder with true layouts (layout/NAME.png) and, for the labelling, NYU40 classes (labels40/NAME.png),
a bag with both, or the official NYU v2 .mat with the layouts that were published apart (--layouts, --classes40).
--rendered N measures on rendered rooms, whose truth is exact in metres too. DIR gets summary.json, frames.csv and
report.html, which replace those of an earlier evaluation there; with --no-report an earlier report.html goes.
Which of two visible walls is called "front" is a guess of the annotators: errors and IoU are given with the wall names
permuted to the best fit; "fixed" is with the names as they are, as the paper's numbers are.
"""

from __future__ import annotations

import argparse
import importlib.util
import math
import sys
from collections.abc import Iterator
from contextlib import nullcontext
from dataclasses import dataclass, replace
from functools import partial
from pathlib import Path

from room_layout_ros.commands.compiling import told_first
from room_layout_ros.commands.counts import add_work_arguments
from room_layout_ros.commands.depth_doubts import DepthDoubts
from room_layout_ros.commands.estimator_options import add_estimator_options, no_color, parse_settings
from room_layout_ros.commands.evaluate_input import add_input_arguments, open_input
from room_layout_ros.commands.models_folder import add_models_argument, usable_models
from room_layout_ros.commands.output_folder import held_alone, remove_files
from room_layout_ros.commands.progress import progress_bar
from room_layout_ros.core.config import SIMPLE, EstimatorConfig
from room_layout_ros.core.models import config_folder
from room_layout_ros.datasets import BadFrame, DataError, FrameSource, Sample
from room_layout_ros.datasets.images import write_atomically
from room_layout_ros.evaluation import baselines, tables
from room_layout_ros.evaluation.c_curve import C_CURVE_FILE, CCurve, read_c_curve
from room_layout_ros.evaluation.compare import ComparedFrame, CompareJob, EstimatorMethod, compare
from room_layout_ros.evaluation.folder_predictions import NO_FILES, read_folder
from room_layout_ros.evaluation.scores import Method, SetScore
from room_layout_ros.evaluation.superpixel_table import superpixel_figures
from room_layout_ros.extras import install_hint
from room_layout_ros.parallel import map_ordered

BASELINES = {
    "constant": "constant layout",
    "percentile": "walls at the 98th percentile",
    "depth": "our simple depth estimator",
}

WITH_DEPTH = "ours, RGB-D"
"""Title of our estimator with depth."""


def add_arguments(parser: argparse.ArgumentParser) -> None:
    """Add the options of `evaluate`."""
    add_input_arguments(parser)
    parser.add_argument(
        "--out", type=Path, metavar="DIR", help="folder for summary.json, frames.csv, report.html, made if missing"
    )
    add_estimator_options(parser, rgb_only="our estimator without depth only")
    parser.add_argument("--estimates", type=Path, metavar="DIR", help="score this output of `room-layout estimate`")
    parser.add_argument(
        "--baseline",
        action="append",
        choices=[*BASELINES, "none"],
        help="plain solutions beside ours (repeatable; default all)",
    )
    add_work_arguments(parser)
    parser.add_argument(
        "--curve",
        type=Path,
        metavar="FILE",
        help="our errors by C, written by room-layout train (default: c_curve.json beside the models, if there)",
    )
    add_models_argument(parser)
    parser.add_argument("--no-report", action="store_true", help="leave report.html out (it needs the extra viz)")


def run(arguments: argparse.Namespace) -> int:
    """Score every frame with truth by every method and print the table."""
    if _wants_report(arguments) and importlib.util.find_spec("matplotlib") is None:
        raise DataError(f"report.html needs matplotlib: {install_hint('viz')}, or give --no-report")
    asked = {"--rgb-only": arguments.rgb_only, "--set": arguments.set, "--models": arguments.models}
    if arguments.estimates is not None and any(asked.values()):
        ignored = next(option for option, value in asked.items() if value)
        raise DataError(f"--estimates {arguments.estimates} is scored as it was written; {ignored} cannot change it")
    source, curve = open_input(arguments), _curve(arguments)
    with nullcontext() if arguments.out is None else held_alone("--out", arguments.out):
        return _evaluate(arguments, source, curve)


def _evaluate(arguments: argparse.Namespace, source: FrameSource, curve: CCurve | None) -> int:
    methods, samples = _methods(arguments, source), _Samples(source)
    job = CompareJob(methods, _superpixel_config(arguments), _wants_report(arguments))
    doubts = DepthDoubts(parse_settings(arguments.set), WITH_DEPTH not in methods)
    with progress_bar("evaluate", source.length) as progress:
        watched = doubts.watch(samples)
        if arguments.scheduler is None and arguments.estimates is None:
            watched = told_first(watched, doubts.config, doubts.rgb_only)
        frames = list(map_ordered(partial(compare, job), watched, arguments.jobs, arguments.scheduler, progress))
    if not frames:
        raise DataError(f"{source.title} holds no frame with a true layout; layout/NAME.png is needed")
    if source.length is not None and len(frames) < source.length:
        left = source.length - len(frames)
        print(f"{left} of {source.length} frames have no true layout and are left out", file=sys.stderr)
    doubts.tell()
    _tell_classes(frames)
    scores = [SetScore(title, tuple(frame.scores[title] for frame in frames)) for title in methods]
    if arguments.estimates is not None and all(frame.status == NO_FILES for frame in scores[0].frames):
        raise DataError(
            f"--estimates {arguments.estimates} knows none of the {len(frames)} frames of {source.title}; "
            f"the first is {frames[0].name}"
        )
    # Files first: whoever reads the table through a pipe may close it early.
    written = [] if arguments.out is None else _write(arguments, source, scores, frames, curve)
    print(f"{source.title}: {len(frames)} frames with a true layout; percent, 95 % bootstrap interval\n")
    print("\n".join([tables.text_table(scores), "", *map(str, written)]).rstrip())
    return 0


def _tell_classes(frames: list[ComparedFrame]) -> None:
    """Say of how many frames the labelling figures are, where some have classes and some have not."""
    measured = [not math.isnan(next(iter(frame.scores.values())).pixels.labelling_error) for frame in frames]
    if 0 < sum(measured) < len(frames):
        print(
            f"labelling error and IoU are of {sum(measured)} of {len(frames)} frames: the others have no class labels "
            "(labels40/NAME.png)",
            file=sys.stderr,
        )


def _wants_report(arguments: argparse.Namespace) -> bool:
    return arguments.out is not None and not arguments.no_report


def _curve(arguments: argparse.Namespace) -> CCurve | None:
    if not _wants_report(arguments):
        return None
    beside: Path = (arguments.models or config_folder()) / C_CURVE_FILE
    if arguments.curve is None and not beside.exists():
        return None
    return read_c_curve(beside if arguments.curve is None else arguments.curve)


def _superpixel_config(arguments: argparse.Namespace) -> EstimatorConfig | None:
    wanted = arguments.out is not None and arguments.estimates is None and not arguments.rgb_only
    return parse_settings(arguments.set) if wanted else None


def _methods(arguments: argparse.Namespace, source: FrameSource) -> dict[str, Method]:
    methods: dict[str, Method] = {}
    first = next(iter(_Samples(source)), None)  # a source has a stream in every frame or in none
    has_depth = first is None or first.frame.depth_m is not None
    has_color = first is None or first.frame.color is not None
    if arguments.estimates is not None:
        methods[f"ours, {arguments.estimates}"] = read_folder(arguments.estimates)
    else:
        methods |= _ours(arguments, source, has_depth, has_color)
    wanted = _baselines(arguments, source, has_depth)
    if "constant" in wanted:
        layouts = {s.name: s.truth.layout for s in _Samples(source) if s.truth and s.truth.layout is not None}
        methods[BASELINES["constant"]] = baselines.ConstantLayout.of(layouts)
    if "percentile" in wanted:
        methods[BASELINES["percentile"]] = baselines.percentile_walls
    if "depth" in wanted:
        methods[BASELINES["depth"]] = EstimatorMethod(replace(parse_settings(arguments.set), method=SIMPLE))
    if not methods:
        raise DataError(f"{source.title} has nothing that the methods asked for could look at")
    return methods


def _ours(arguments: argparse.Namespace, source: FrameSource, has_depth: bool, has_color: bool) -> dict[str, Method]:
    """Return our estimator with depth and without, each where the frames have what it looks at; say what is left out.

    Raises
    ------
    DataError
        When the options ask for colour alone, and there is none.
    """
    config = parse_settings(arguments.set, arguments.rgb_only)
    if arguments.rgb_only and not has_color:
        raise no_color(source.title)
    models = usable_models(arguments.models, config, also_rgb=config.use_color and has_color)
    methods: dict[str, Method] = {}
    if not arguments.rgb_only and has_depth:
        methods[WITH_DEPTH] = EstimatorMethod(config, models=models)
    elif not arguments.rgb_only:
        print(f"{source.title} has no depth: our estimator with depth is left out", file=sys.stderr)
    if config.use_color and has_color:
        methods["ours, RGB"] = EstimatorMethod(config, rgb_only=True, models=models)
    elif config.use_color:
        print(f"{source.title} has no colour: our estimator without depth is left out", file=sys.stderr)
    return methods


def _baselines(arguments: argparse.Namespace, source: FrameSource, has_depth: bool) -> list[str]:
    """Return the plain solutions that are asked for; by default those that the frames have the depth for.

    Raises
    ------
    DataError
        When one is named that needs the depth, and there is none.
    """
    named: list[str] = arguments.baseline or []
    if "none" in named:
        return []
    by_depth = [name for name in named if name != "constant"]
    if by_depth and not has_depth:
        raise DataError(f"--baseline {by_depth[0]} needs depth, and {source.title} has none")
    return named or (list(BASELINES) if has_depth else ["constant"])


@dataclass(frozen=True, slots=True)
class _Samples:
    """The scorable frames of a source: with a true layout, of which a pixel at least is annotated.

    A bad one ends the evaluation, since leaving it out would better the mean.
    """

    source: FrameSource

    def __iter__(self) -> Iterator[Sample]:
        for item in self.source:
            if isinstance(item, BadFrame):
                raise DataError(f"frame {item.name} cannot be used: {item.error}")
            if item.truth is not None and item.truth.layout is not None and item.truth.layout.any():
                yield item


def _write(
    arguments: argparse.Namespace,
    source: FrameSource,
    scores: list[SetScore],
    frames: list[ComparedFrame],
    curve: CCurve | None,
) -> list[Path]:
    out: Path = arguments.out
    facts = {
        "input": source.title,
        "subset": arguments.frames or "every frame with a true layout",
        "command": "room-layout evaluate " + " ".join(sys.argv[2:]),
    }
    superpixels = superpixel_figures(frame.superpixels for frame in frames)
    write_atomically(out / "summary.json", tables.summary_json(scores, superpixels, **facts).encode())
    write_atomically(out / "frames.csv", tables.frames_csv(scores).encode())
    written = [out / "summary.json", out / "frames.csv"]
    if not _wants_report(arguments):
        remove_files((out / "report.html",), ())  # of other numbers than those beside it
    else:
        from room_layout_ros.evaluation.report import report_html

        write_atomically(out / "report.html", report_html(scores, frames, source.title, curve).encode())
        written.append(out / "report.html")
    return written
