"""Rooms drawn by somebody else: round and hanging things, stairs, ramps, glass and mirrors.

Ray caster and scenes (`_ray_caster`, `_foreign_things`, `_foreign_rooms`) share nothing with `datasets/synthetic`; an
examiner wrote the first of them. Only what a sensor does to depth, and where cameras hang, are the repository's.

True is (`_foreign_truth`; cells are laid on the floor by the true pose):

* layout: the faces of the empty room's box; none where the room is no box (L-shaped, an oblique wall, other levels);
* labels: ceiling, floor, wall or thing, by the first surface that a ray meets; glass and mirrors are wall;
* occupied: a thing or a wall takes three of 25 places of the cell at any height below the robot's, or the floor there
  is 5 cm higher or lower than under the camera, or there is none (behind walls and mirrors);
* free: half of the cell's floor is in sight and measured, and neither the cell nor what is within 10 cm behind its
  middle is occupied;
* not known: all other cells. To call one free counts against the IoU, but for those in sight that have no depth.

Ramps and the floor behind open or glass doors are not judged.
"""

from __future__ import annotations

import sys
from collections.abc import Iterator
from dataclasses import dataclass, field

import cv2
import numpy as np
from numpy.typing import NDArray

from benchmarks._foreign_rooms import KINDS
from benchmarks._foreign_truth import Cells, View, take, true_cells, true_labels, true_layout
from benchmarks._free_space import ratio
from benchmarks._ray_caster import THING
from room_layout_ros.core.estimator import LayoutEstimator
from room_layout_ros.core.freespace import FREE_CELL, OCCUPIED_CELL, free_space_of_frame
from room_layout_ros.core.labels import FRONT_WALL, LEFT_WALL, RIGHT_WALL
from room_layout_ros.evaluation.measures import confusion, error, score_pixels

SEEDS = 4
THINGS_M = (0.3, 3.0)
THING_PX = 40

HEAD = (
    f"{'':<18}{'frames':>7}{'layout %':>10}{'labels %':>10}{'IoU':>8}{'free':>8}"
    f"{'near':>6}{'on':>6}{'unseen':>8}{'off':>6}{'things':>8}{'missed':>8}"
)
LEGEND = f"""layout %, labels %: mean share of wrong pixels; IoU: of free cells within 4 m, pooled; free: cells called
free, of which near: at 1-3 m within 10 cm before a thing or wall, or on one; on: something is in them or over them;
unseen: the same, of a thing of which no pixel is in the picture; off: floor of another level, or none at all;
things: those in the picture ({THING_PX} pixels with depth) at {THINGS_M[0]}-{THINGS_M[1]} m; missed: none occupied"""


@dataclass
class Row:
    """Sums over frames. `pool` : cells in the intersection and in the union; `wrong` : near, on, unseen, off."""

    layout: list[float] = field(default_factory=list)
    labels: list[float] = field(default_factory=list)
    pool: NDArray[np.int64] = field(default_factory=lambda: np.zeros(2, np.int64))
    free: int = 0
    wrong: NDArray[np.int64] = field(default_factory=lambda: np.zeros(4, np.int64))
    things: int = 0
    missed: list[str] = field(default_factory=list)

    @property
    def iou(self) -> float:
        return ratio(self.pool)

    def add(self, other: Row) -> None:
        for name in ("layout", "labels", "pool", "free", "wrong", "things", "missed"):
            setattr(self, name, getattr(self, name) + getattr(other, name))

    def line(self, title: str) -> str:
        layout = f"{100 * np.mean(self.layout):>10.2f}" if self.layout else f"{'-':>10}"
        near, on, unseen, off = self.wrong
        return (
            f"{title:<18}{len(self.labels):>7}{layout}{100 * np.mean(self.labels):>10.2f}{self.iou:>8.3f}{self.free:>8}"
            f"{near:>6}{on:>6}{unseen:>8}{off:>6}{self.things:>8}{len(self.missed):>8}"
        )


def score(estimator: LayoutEstimator, view: View) -> Row:
    """Estimate one frame and compare it with the truth; no free space counts as nothing free and nothing occupied."""
    row, config = Row(), estimator.config
    estimate = estimator.estimate(view.frame)
    if view.scene.is_cuboid:
        row.layout.append(score_pixels(true_layout(view), estimate.layout).layout_error)
    walls = np.isin(estimate.labels, (LEFT_WALL, RIGHT_WALL))
    one_wall = np.where(walls, FRONT_WALL, estimate.labels).astype(np.uint8)
    row.labels.append(error(confusion(true_labels(view), one_wall)))
    space = free_space_of_frame(view.frame, estimate, config)
    cells = true_cells(view, config)
    grid = np.full(cells.grid_shape, -1, np.int8) if space is None else space.grid
    called = (grid.ravel()[cells.index] == FREE_CELL) & cells.judged
    asked = cells.measured | ~cells.free
    row.pool += [(called & cells.measured).sum(), ((called | cells.measured) & asked).sum()]
    near = (cells.before_thing | cells.on_thing) & (cells.range_m >= 1.0) & (cells.range_m <= 3.0)
    row.free = int(called.sum())
    row.wrong += [(called & m).sum() for m in (near, cells.on_thing, cells.on_unseen, cells.off_floor)]
    for thing, found in things_found(view, cells, grid):
        row.things += 1
        row.missed += [] if found else [view.scene.names[thing]]
    return row


def things_found(view: View, cells: Cells, grid: NDArray[np.int8]) -> Iterator[tuple[int, bool]]:
    """Yield each thing in the picture, and whether a cell in or beside its own is occupied."""
    beside = cv2.dilate((grid == OCCUPIED_CELL).astype(np.uint8), np.ones((3, 3), np.uint8)).ravel()[cells.index]
    measured = view.thing_of[np.isfinite(view.frame.depth_m)]  # type: ignore[arg-type]
    for thing in np.unique(view.solids.thing[view.solids.role == THING]):
        own = (cells.things == thing).any(axis=1)
        nearest_m = cells.range_m[own].min(initial=np.inf)
        if (measured == thing).sum() >= THING_PX and THINGS_M[0] <= nearest_m <= THINGS_M[1]:
            yield int(thing), bool(beside[own].any())


def main(seeds: int = SEEDS, first: int = 0) -> int:
    """Print the table; `first` is the first seed, another one gives other rooms."""
    estimator, total = LayoutEstimator(), Row()
    print(f"{seeds} rooms of each kind, noises and cameras in turn")
    print(LEGEND)
    print(HEAD)
    for kind in KINDS:
        row = Row()
        for seed in range(first, first + seeds):
            row.add(score(estimator, take(kind, seed)))
        print(f"{row.line(kind)}  {', '.join(row.missed)}".rstrip(), flush=True)
        total.add(row)
    print(total.line("all"))
    return 0


if __name__ == "__main__":
    sys.exit(main())
