"""Learn the models of the estimator from a frames folder with depth and NYU40 classes (labels40/).

DIR gets:
  context_rgbd.npz    classifier of superpixels (geometric context), of all frames
  furniture_rgbd.npz  classifier of clutter superpixels, likewise
  joint_rgbd.npz      weights of the joint energy, by a structured SVM on out-of-fold context
  training.json       settings, progress and cross-validated losses
  work/               checkpoints (a stopped run goes on where it was) and cached examples; may be deleted afterwards
With --rgb-only the files end in _rgb, without --scene in _plain. Copy them into config/ to make them the default.
"""

from __future__ import annotations

import argparse
import dataclasses
import json
import sys
from pathlib import Path
from typing import Any

from room_layout_ros.commands.evaluate import subset_names
from room_layout_ros.commands.progress import progress_bar
from room_layout_ros.core.config import EstimatorConfig
from room_layout_ros.core.layout import RoomCuboid
from room_layout_ros.core.models import model_file
from room_layout_ros.core.weights import ModelWeights, save_weights, start_weights
from room_layout_ros.datasets import DataError, FramesFolder, open_source
from room_layout_ros.datasets.images import write_atomically
from room_layout_ros.learning import train
from room_layout_ros.learning.context import train_context, train_furniture
from room_layout_ros.learning.fit_frame import read_fits
from room_layout_ros.learning.joint_examples import JointExample
from room_layout_ros.learning.scene_folds import SceneFolds, read_folds
from room_layout_ros.learning.structured_svm import SvmConfig, SvmProgress, SvmResult
from room_layout_ros.learning.train_run import (
    RunStages,
    choose_names,
    describe_frames,
    fit_rooms,
    make_separator,
    split_by_name,
)
from room_layout_ros.parallel import Spread, open_workers


def add_arguments(parser: argparse.ArgumentParser) -> None:
    """Add the options of `train`."""
    add = parser.add_argument
    add("input", type=Path, metavar="FOLDER", help="frames folder with depth/ and labels40/")
    add("--out", type=Path, required=True, metavar="DIR", help="folder for the models, made if missing")
    add("--fits", type=Path, metavar="DIR", help="output of room-layout fit (default: fit now)")
    add("--scene", type=Path, metavar="DIR", help="output of room-layout scene (default: learn without the network)")
    add("--rgb-only", action="store_true", help="learn the models for use without depth")
    add("--hold-out", metavar="SUBSET", help="list of splits.json, file or names of frames never to learn from")
    add("--frames", type=int, metavar="N", help="learn from at most so many frames, evenly spread")
    add("--c", type=float, default=200.0, metavar="C", help="weight of the slack (default 200)")
    add("--epsilon", type=float, default=0.01, help="end when no constraint is violated by more (default 0.01)")
    add("--rounds", type=int, default=15, metavar="N", help="passes over the examples, or rounds, at most (default 15)")
    add("--algorithm", choices=("one-slack", "frank-wolfe"), default="frank-wolfe", help="(default frank-wolfe)")
    add("--folds", type=int, default=4, help="folds of the out-of-fold context (default 4)")
    add("--validate", type=int, default=2, metavar="K", help="folds of cross-validation of the weights, 0: none")
    add("--jobs", type=int, default=1, metavar="N", help="local processes (default 1)")
    add("--scheduler", metavar="ADDRESS", help="Dask scheduler, tcp://host:port, instead of --jobs")


def run(arguments: argparse.Namespace) -> int:
    """Train and write the models."""
    try:
        svm = SvmConfig(arguments.c, arguments.epsilon, arguments.rounds)
    except ValueError as error:
        raise DataError(str(error)) from None
    source = open_source(arguments.input)
    if not isinstance(source, FramesFolder):
        raise DataError(f"{source.title} is no frames folder; training needs one with labels40/")
    held_out = subset_names(source, arguments.hold_out)
    arguments.out.mkdir(parents=True, exist_ok=True)
    config = train.TrainConfig(svm=svm, folds=arguments.folds, algorithm=arguments.algorithm)
    estimator = EstimatorConfig(use_depth=not arguments.rgb_only, scene_network=arguments.scene is not None)
    networks = None if arguments.scene is None else read_folds(arguments.scene)
    with open_workers(arguments.jobs, arguments.scheduler) as spread:
        _Run(arguments, source, config, estimator, networks, spread).go(held_out)
    return 0


@dataclasses.dataclass(frozen=True, slots=True)
class _Run:
    arguments: argparse.Namespace
    source: FramesFolder
    config: train.TrainConfig
    estimator: EstimatorConfig
    networks: SceneFolds | None
    spread: Spread

    def go(self, held_out: tuple[str, ...]) -> None:
        """Fit, describe, classify, learn, validate, write."""
        rooms = self.rooms()
        names = set(choose_names([n for n in self.source.names if n in rooms], held_out, self.arguments.frames))
        with progress_bar("describe", len(names)) as progress:
            chosen = {n: r for n, r in rooms.items() if n in names}
            descriptions = describe_frames(self.source, chosen, self.estimator, self.spread, progress, self.networks)
        contexts = train.out_of_fold_context(descriptions, self.config, _say)
        examples = train.build_examples(descriptions, contexts, self.estimator)
        _say(f"{len(examples)} of {len(descriptions)} frames can be stated under the axes found")
        facts = {
            "data": self.source.path.name,
            "frames": len(examples),
            "first": examples[0].name if examples else "",
            "last": examples[-1].name if examples else "",
            "held_out": list(held_out),
            "depth": self.estimator.use_depth,
            "command": "room-layout train " + " ".join(sys.argv[2:]),
        }
        facts["cross_validation"] = self.cross_validate(examples)
        result = self.learn(examples, "all")
        self.write(ModelWeights(result.weights), train.card_of(self.config, result, facts), result)
        paths = self.classify(rooms, held_out, facts)
        print("\n".join(str(path) for path in (*paths, self.path("joint"))))

    def path(self, kind: str) -> Path:
        return self.arguments.out / model_file(kind, self.estimator.use_depth, self.networks is not None)

    def classify(self, rooms: dict[str, RoomCuboid], held_out: tuple[str, ...], facts: dict[str, Any]) -> list[Path]:
        """Grow the forests that ship: of all frames, degraded ones and rendered rooms."""
        paths = [self.path("context"), self.path("furniture")]
        numbers = tuple(train.frame_numbers(held_out))
        about = {key: facts[key] for key in ("command",)}
        _, table = train_context(
            self.source, rooms, paths[0], self.estimator, numbers, facts=about, progress=_say, networks=self.networks
        )
        train_furniture(table, paths[1], facts=about)
        return paths

    def rooms(self) -> dict[str, RoomCuboid]:
        if self.arguments.fits is not None:
            return dict(read_fits(self.arguments.fits))
        with progress_bar("fit", self.source.length) as progress:
            return fit_rooms(self.source, self.spread, progress)

    def learn(self, examples: list[JointExample], what: str) -> SvmResult:
        stages = RunStages(self.arguments.out / "work" / what)
        stages.folder.mkdir(parents=True, exist_ok=True)
        alone = self.arguments.jobs == 1 and self.arguments.scheduler is None
        separator = make_separator(examples, self.estimator, stages, None if alone else self.spread)
        limit = self.config.svm.max_rounds

        def show(row: SvmProgress) -> None:
            left = row.seconds / row.round * (limit - row.round)
            _say(
                f"{what}: round {row.round}/{limit}  objective {row.objective:.4f}  gap {row.gap:.4f}  "
                f"constraints {row.constraints}  {row.seconds:.0f} s, at most {left:.0f} s left"
            )

        start = self.start()
        return train.learn_weights(separator, self.config, start, show, stages.folder / "checkpoint.npz")

    def start(self) -> ModelWeights:
        weights = start_weights().variant("full" if self.estimator.use_depth else "rgb")
        return weights if self.networks is not None else weights.variant("no_scene")

    def cross_validate(self, examples: list[JointExample]) -> list[dict[str, float]]:
        if not self.arguments.validate:
            return []
        positions = list(train.folds_of([e.name for e in examples], self.arguments.validate))
        rows = []
        for number, (learned, held) in enumerate(split_by_name(examples, positions), 1):
            result = self.learn(learned, f"fold{number}")
            row = train.validate(ModelWeights(result.weights), held, self.estimator)
            before = train.validate(self.start(), held, self.estimator)
            rows.append({**row, "start_layout": before["layout"], "start_labelling": before["labelling"]})
            _say(f"fold {number}: {rows[-1]}")
        return rows

    def write(self, weights: ModelWeights, card: dict[str, Any], result: SvmResult) -> None:
        out = self.arguments.out
        save_weights(dataclasses.replace(weights, card=card), self.path("joint"))
        rows = [dataclasses.asdict(row) for row in result.history]
        write_atomically(out / "training.json", json.dumps({**card, "history": rows}, indent=1).encode())


def _say(text: str) -> None:
    print(text, file=sys.stderr, flush=True)
