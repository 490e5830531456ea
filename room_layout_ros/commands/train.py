"""Learn the models of the estimator from a frames folder with depth and NYU40 classes (labels40/).

DIR gets:
  context_rgbd.npz    classifier of superpixels (geometric context), of all frames, or of those that --frames leaves
  furniture_rgbd.npz  classifier of clutter superpixels, likewise
  joint_rgbd.npz      weights of the joint energy, by a structured SVM on out-of-fold context
  training_rgbd.json  settings, progress and cross-validated losses
  work/               examples and checkpoints: the same command goes on where it was stopped; may be deleted then
With --rgb-only the files end in _rgb, without --scene in _plain. Copy them into config/ to make them the default.
With --variant the weights of the other blocks are 0 and nothing else is learned around them; estimate so learned models
with --set joint_variant=NAME. --start zero learns without weights set by hand, as the paper (Eq. 2).
With --c-curve DIR gets c_curve.json alone: errors on one half of the frames after learning on the other, for each C.
"""

from __future__ import annotations

import argparse
import dataclasses
import json
import math
import sys
from pathlib import Path
from typing import Any

import numpy as np

from room_layout_ros.commands.counts import add_work_arguments, count, whole
from room_layout_ros.commands.frame_choice import add_hold_out_argument, open_frames_folder, subset_names
from room_layout_ros.commands.output_folder import held_alone
from room_layout_ros.commands.progress import progress_bar
from room_layout_ros.core.config import JOINT_VARIANTS, EstimatorConfig
from room_layout_ros.core.layout import RoomCuboid
from room_layout_ros.core.models import looks_at_scene, model_file
from room_layout_ros.core.weights import N_FEATURES, ModelWeights, save_weights, start_weights
from room_layout_ros.datasets import DataError, FramesFolder
from room_layout_ros.datasets.images import write_atomically
from room_layout_ros.evaluation.c_curve import C_CURVE_FILE, CPoint, update_c_curve
from room_layout_ros.learning import train
from room_layout_ros.learning.context import RGB_SETTINGS, ContextSettings, train_context
from room_layout_ros.learning.example_store import ExampleRef, ExampleStore
from room_layout_ros.learning.fit_frame import read_fits
from room_layout_ros.learning.folds import folds_of
from room_layout_ros.learning.furniture import train_furniture
from room_layout_ros.learning.origin import origin
from room_layout_ros.learning.scene_folds import read_folds
from room_layout_ros.learning.structured_svm import SvmConfig, SvmProgress, SvmResult
from room_layout_ros.learning.train_run import (
    Workplace,
    build_examples,
    choose_names,
    describe_frames,
    fit_rooms,
    make_separator,
    validate,
)
from room_layout_ros.parallel import open_workers

STARTS = {"hand": start_weights, "zero": lambda: ModelWeights(np.zeros(N_FEATURES))}
"""The weights that learning stays near, and begins at."""


def add_arguments(parser: argparse.ArgumentParser) -> None:
    """Add the options of `train`."""
    add = parser.add_argument
    add("input", type=Path, metavar="FOLDER", help="frames folder with depth/ and labels40/")
    add("--out", type=Path, required=True, metavar="DIR", help="folder for the models, made if missing")
    add("--fits", type=Path, metavar="DIR", help="output of room-layout fit (default: fit now)")
    add("--scene", type=Path, metavar="DIR", help="output of room-layout scene (default: learn without the network)")
    add("--rgb-only", action="store_true", help="learn the models for use without depth")
    add("--variant", choices=JOINT_VARIANTS, default="full", help="learn with the blocks of this variant of the model")
    add(
        "--start",
        choices=tuple(STARTS),
        default="hand",
        help="centre of the regulariser: weights set by hand, or 0 as in the paper (default %(default)s)",
    )
    add_hold_out_argument(parser)
    add("--frames", type=count, metavar="N", help="learn from at most so many frames, evenly spread")
    add("--c", type=float, default=200.0, metavar="C", help="weight of the slack (default %(default)s)")
    add("--epsilon", type=float, default=0.01, help="end when no constraint is violated by more (default %(default)s)")
    add(
        "--rounds",
        type=count,
        default=15,
        metavar="N",
        help="passes over the examples, or rounds, at most (default %(default)s)",
    )
    add("--algorithm", choices=("one-slack", "frank-wolfe"), default="frank-wolfe", help="(default %(default)s)")
    add("--folds", type=whole(2), default=4, help="folds of the out-of-fold context (default %(default)s)")
    add(
        "--validate",
        type=_folds_or_none,
        default=2,
        metavar="K",
        help="folds of cross-validation of the weights, 0: none",
    )
    add("--c-curve", type=_numbers, metavar="C,C,...", help="measure how the errors depend on C; no models are written")
    add("--trees", type=count, metavar="N", help="trees of the context classifier (default 120, RGB 150)")
    add(
        "--synthetic", type=whole(0), metavar="N", help="rendered rooms for the context classifier (default 480, RGB 0)"
    )
    add_work_arguments(parser)


def _folds_or_none(text: str) -> int:
    folds = whole(0)(text)
    if folds == 1:  # all frames would be judged, and none learned from
        raise argparse.ArgumentTypeError(f"{text!r} is given; it must be 0 for none, or a whole number, 2 or more")
    return folds


def _numbers(text: str) -> tuple[float, ...]:
    try:
        values = tuple(float(word) for word in text.split(","))
    except ValueError:
        values = ()
    if not values or not all(0 < value < math.inf for value in values):
        raise argparse.ArgumentTypeError(f"{text!r} is no list of numbers above 0 with commas between them")
    return values


def _settings(arguments: argparse.Namespace) -> ContextSettings:
    settings = RGB_SETTINGS if arguments.rgb_only else ContextSettings()
    if arguments.trees is not None:
        settings = dataclasses.replace(settings, trees=arguments.trees, face_trees=max(1, arguments.trees // 3))
    if arguments.synthetic is not None:
        settings = dataclasses.replace(settings, synthetic_frames=arguments.synthetic)
    return settings


def run(arguments: argparse.Namespace) -> int:
    """Train and write the models."""
    estimator = EstimatorConfig(
        use_depth=not arguments.rgb_only,
        scene_network=arguments.scene is not None,
        joint_variant=arguments.variant,
    )
    if arguments.scene is not None and not looks_at_scene(estimator):
        raise DataError(
            f"--variant {arguments.variant} asks no network, and --scene {arguments.scene} is given; drop one"
        )
    svm = SvmConfig(arguments.c, arguments.epsilon, arguments.rounds)
    source = open_frames_folder(arguments.input, "training needs one with labels40/")
    held_out = subset_names(source, arguments.hold_out)
    context = _settings(arguments)
    config = train.TrainConfig(svm=svm, folds=arguments.folds, algorithm=arguments.algorithm, context=context)
    networks = None if arguments.scene is None else read_folds(arguments.scene.absolute())
    store = ExampleStore((arguments.out / "work" / "examples").absolute())
    with held_alone("--out", arguments.out), open_workers(arguments.jobs, arguments.scheduler) as spread:
        place = Workplace(estimator, store, spread, networks)
        _Run(arguments, source, config, place).go(held_out)
    return 0


@dataclasses.dataclass(frozen=True, slots=True)
class _Run:
    arguments: argparse.Namespace
    source: FramesFolder
    config: train.TrainConfig
    place: Workplace

    def go(self, held_out: tuple[str, ...]) -> None:
        """Fit, describe, classify, learn, validate, write."""
        rooms = self.rooms()
        names = choose_names([n for n in self.source.names if n in rooms], held_out, self.arguments.frames)
        examples = self.examples({name: rooms[name] for name in names})
        if self.arguments.c_curve:
            print(self.c_curve(examples))
            return
        facts = {
            "data": self.source.path.name,
            "frames": len(examples),
            "first": examples[0].name if examples else "",
            "last": examples[-1].name if examples else "",
            "held_out": list(held_out),
            "depth": self.place.config.use_depth,
            **{name: value for name, value in self.unusual().items() if value},
            **origin(),
        }
        facts["cross_validation"] = self.cross_validate(examples)
        result = self.learn(examples, "all", self.config)
        self.write(ModelWeights(result.weights), train.card_of(self.config, result, facts), result)
        paths = self.classify({name: rooms[name] for name in names}, held_out, facts)
        print("\n".join(str(path) for path in (*paths, self.path("joint"))))

    def examples(self, rooms: dict[str, RoomCuboid]) -> list[ExampleRef]:
        """State the frames with these rooms as joint problems, with context from forests that saw none of them."""
        with progress_bar("describe", len(rooms)) as progress:
            frames = describe_frames(self.source, rooms, self.place, progress, _say)
        contexts = train.out_of_fold_context(frames, self.config, _say)
        with progress_bar("examples", len(frames)) as progress:
            examples = build_examples(self.source, rooms, contexts, self.place, progress)
        _say(f"{len(examples)} of {len(frames)} frames can be stated under the axes found")
        return examples

    def path(self, kind: str) -> Path:
        return self.arguments.out / model_file(kind, self.place.config.use_depth, self.place.networks is not None)

    def classify(self, rooms: dict[str, RoomCuboid], held_out: tuple[str, ...], facts: dict[str, Any]) -> list[Path]:
        """Grow the forests that ship: of the frames, degraded ones and rendered rooms."""
        paths = [self.path("context"), self.path("furniture")]
        about = {key: facts[key] for key in ("data", "command", "date")}
        settings, networks = self.config.context, self.place.networks
        # Without --frames those that no room was fitted to teach too: structure from clutter
        source = self.source if self.arguments.frames is None else self.source.subset(tuple(rooms))
        _, table = train_context(
            source, rooms, paths[0], self.place.config, held_out,
            settings=settings, folds=self.arguments.validate, facts=about, progress=_say, networks=networks,
        )  # fmt: skip
        train_furniture(table, paths[1], facts=about)
        return paths

    def rooms(self) -> dict[str, RoomCuboid]:
        if self.arguments.fits is not None:
            return dict(read_fits(self.arguments.fits))
        with progress_bar("fit", self.source.length) as progress:
            return fit_rooms(self.source, self.place.spread, progress)

    def learn(self, examples: list[ExampleRef], what: str, config: train.TrainConfig) -> SvmResult:
        separator = make_separator(examples, self.place)
        checkpoint = self.checkpoint(train.checkpoint_name(separator, config, self.start()), what)
        limit = config.svm.max_rounds

        def show(row: SvmProgress) -> None:
            left = row.seconds / row.round * (limit - row.round)
            measured = f"objective {row.objective:.4f}  gap {row.gap:.4f}" if row.gap < math.inf else "not measured yet"
            _say(
                f"{what}: round {row.round}/{limit}  dual {row.dual:.4f}  {measured}  constraints {row.constraints}  "
                f"{row.seconds:.0f} s, at most {left:.0f} s left"
            )

        return train.learn_weights(separator, config, self.start(), show, checkpoint)

    def checkpoint(self, name: str, what: str) -> Path:
        """Return the checkpoint of a problem, and say whether the run goes on from it or starts anew beside others."""
        folder = self.arguments.out / "work" / what
        folder.mkdir(parents=True, exist_ok=True)
        others = [path.name for path in folder.glob("*.npz") if path.name != name]
        if (folder / name).exists():
            _say(f"{what}: goes on from {folder / name}")
        elif others:
            _say(f"{what}: starts anew; {folder} has checkpoints of other examples or settings only")
        return folder / name

    def unusual(self) -> dict[str, str]:
        """Return the variant and the start of the weights for their card, empty where they are the usual ones."""
        variant, start = self.arguments.variant, self.arguments.start
        return {"variant": "" if variant == "full" else variant, "start": "" if start == "hand" else start}

    def start(self) -> ModelWeights:
        with_depth, with_scene = self.place.config.use_depth, self.place.networks is not None
        return STARTS[self.arguments.start]().used(self.arguments.variant, with_depth, with_scene)

    def halves(self, examples: list[ExampleRef], folds: int) -> list[tuple[list[ExampleRef], list[ExampleRef]]]:
        """Return (to learn from, to validate on) for each fold."""
        positions = folds_of([e.name for e in examples], folds)
        return [([examples[i] for i in learned], [examples[i] for i in held]) for learned, held in positions]

    def cross_validate(self, examples: list[ExampleRef]) -> list[dict[str, float]]:
        if not self.arguments.validate:
            return []
        rows = []
        for number, (learned, held) in enumerate(self.halves(examples, self.arguments.validate), 1):
            result = self.learn(learned, f"fold{number}", self.config)
            row = validate(ModelWeights(result.weights), held, self.place)
            before = validate(self.start(), held, self.place)
            rows.append({**row, "start_layout": before["layout"], "start_labelling": before["labelling"]})
            _say(f"fold {number}: {rows[-1]}")
        return rows

    def c_curve(self, examples: list[ExampleRef]) -> Path:
        """Learn on one half with every C, validate on the other, and write the table (Figure 4 b-d)."""
        learned, held = self.halves(examples, 2)[0]
        points = []
        for C in sorted(self.arguments.c_curve):
            config = dataclasses.replace(self.config, svm=dataclasses.replace(self.config.svm, C=C))
            result = self.learn(learned, f"C{C:g}", config)
            errors = validate(ModelWeights(result.weights), held, self.place)
            last = result.history[-1]
            known = math.isfinite(last.objective)  # not where a run went on with fewer passes than it had
            certain = (round(last.objective, 3), round(max(0.0, last.gap), 3)) if known else ()
            points.append(CPoint(C, errors["layout"], errors["labelling"], errors["mean_iou"], *certain))
            _say(str(points[-1]))
        made = origin()
        about = f"learned on {len(learned)} frames, validated on {len(held)} others; {made['date']}, {made['command']}"
        path: Path = self.arguments.out / C_CURVE_FILE
        update_c_curve(path, "rgbd" if self.place.config.use_depth else "rgb", points, about)
        return path

    def write(self, weights: ModelWeights, card: dict[str, Any], result: SvmResult) -> None:
        save_weights(dataclasses.replace(weights, card=card), self.path("joint"))
        rows = [dataclasses.asdict(row) for row in result.history]
        listing = self.path("training").with_suffix(".json")
        write_atomically(listing, json.dumps({**card, "history": rows}, indent=1).encode())


def _say(text: str) -> None:
    print(text, file=sys.stderr, flush=True)
