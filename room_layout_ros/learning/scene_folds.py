"""Honest looks at frames to learn from: each by a scene network that has seen neither it nor a neighbour."""

from __future__ import annotations

import json
from collections.abc import Sequence
from dataclasses import dataclass
from functools import lru_cache
from pathlib import Path

from ..core.frame import RgbdFrame
from ..core.models import SCENE_FILE
from ..core.network.scene_network import SceneNetwork, SceneScores, compute_scene_scores, load_network
from ..datasets import DataError
from .folds import SYNTHETIC_FIRST, frame_number, number_blocks

FOLDS_FILE = "scene_folds.json"


@dataclass(frozen=True, slots=True)
class SceneFold:
    """A network (file name) that may judge the frames numbered first..last."""

    file: str
    first: int
    last: int


@dataclass(frozen=True, slots=True)
class SceneFolds:
    """Networks in a folder that share out the frames of a data set; frames of no fold are for the one of all frames."""

    folder: Path
    folds: tuple[SceneFold, ...] = ()

    def network(self, name: str) -> SceneNetwork:
        """Return the network that is honest about a frame."""
        number = frame_number(name, -1)
        file = next((fold.file for fold in self.folds if fold.first <= number <= fold.last), SCENE_FILE)
        return _network(self.folder / file)

    def look(self, frame: RgbdFrame) -> SceneScores | None:
        """Look at a frame with the network that is honest about it; None without colour."""
        return compute_scene_scores(frame.color, self.network(frame.name))


@lru_cache(maxsize=8)
def _network(path: Path) -> SceneNetwork:
    return load_network(path)


def refuse_names(names: Sequence[str]) -> None:
    """Refuse frames that folds cannot tell apart: a fold knows its frames by the numbers that are their names.

    Raises
    ------
    DataError
        When a name is no number of a frame.
    """
    if strange := [name for name in names if frame_number(name, -1) < 0]:
        raise DataError(
            f"frame {strange[0]!r} is not named by a number below {SYNTHETIC_FIRST}, by which folds tell their frames; "
            "rename the frames, or train no folds (--folds 0)"
        )


def number_folds(numbers: Sequence[int], count: int) -> list[SceneFold]:
    """Cut frame numbers into `count` blocks of about as many frames each.

    Raises
    ------
    ValueError
        As `number_blocks`.
    """
    blocks = number_blocks(numbers, count)
    return [SceneFold(f"scene_fold{k}.npz", first, last) for k, (first, last) in enumerate(blocks)]


def write_folds(folder: Path, folds: Sequence[SceneFold]) -> None:
    """Write which network may judge which frames."""
    rows = [{"file": fold.file, "first": fold.first, "last": fold.last} for fold in folds]
    (folder / FOLDS_FILE).write_text(json.dumps(rows, indent=1) + "\n", "utf-8")


def read_folds(folder: Path) -> SceneFolds:
    """Read the output folder of `room-layout scene`.

    Raises
    ------
    DataError
        When the list of folds is missing or bad.
    """
    path = folder / FOLDS_FILE
    try:
        rows = json.loads(path.read_text("utf-8"))
        folds = tuple(SceneFold(Path(row["file"]).name, int(row["first"]), int(row["last"])) for row in rows)
    except OSError as error:
        raise DataError(f"{path} cannot be read ({error.strerror}); it is made by room-layout scene") from None
    except (ValueError, KeyError, TypeError):
        raise DataError(f"{path} is no list of folds; it is made by room-layout scene") from None
    return SceneFolds(folder, folds)
