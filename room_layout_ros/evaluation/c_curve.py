"""Our errors by the C of learning (the paper's Figure 4 b-d): the file that training writes and the report draws.

    {"rgbd": [{"C": 100, "layout": 8.3, "labelling": 12.7, "mean_iou": 78.1}, ...],
     "rgb":  [{"C": 100, "layout": 21.0, "labelling": 22.4, "mean_iou": 57.0}, ...],
     "about": {"rgbd": "...", "rgb": "..."}}

Percent, of the discrete solution: learned on one half of the frames, judged on the other, where it has seen no frame.
Either list may be missing: both kinds are learned apart. A point may have the `objective` of its learning and the `gap`
above the lower bound: where that is wide, the learning was ended long before the weights of that C were found.
"""

from __future__ import annotations

import json
import math
from collections.abc import Iterable
from dataclasses import dataclass, replace
from pathlib import Path
from typing import Any

from room_layout_ros.datasets import DataError
from room_layout_ros.datasets.images import write_atomically

C_CURVE_FILE = "c_curve.json"
KINDS = ("rgbd", "rgb")


@dataclass(frozen=True, slots=True)
class CPoint:
    """Percentages at one C; `objective` and `gap` of its learning, None where they were not written down.

    Raises
    ------
    ValueError
        When C is not above 0, a percentage is not in 0 to 100, or objective or gap is below 0.
    """

    C: float
    layout: float
    labelling: float
    mean_iou: float
    objective: float | None = None
    gap: float | None = None

    def __post_init__(self) -> None:
        if not (self.C > 0 and math.isfinite(self.C)):
            raise ValueError(f"C is {self.C}; it must be above 0")
        for name in ("layout", "labelling", "mean_iou"):
            if not 0 <= (value := getattr(self, name)) <= 100:
                raise ValueError(f"{name} is {value}; percent, 0 to 100, is needed")
        for name in ("objective", "gap"):
            if not 0 <= (getattr(self, name) or 0.0) < math.inf:
                raise ValueError(f"{name} is {getattr(self, name)}; it must be a finite number, 0 or more")


@dataclass(frozen=True, slots=True)
class CCurve:
    """Points by ascending C with depth and without; `about` says by kind how they were measured."""

    rgbd: tuple[CPoint, ...] = ()
    rgb: tuple[CPoint, ...] = ()
    about: tuple[tuple[str, str], ...] = ()


def read_c_curve(path: Path) -> CCurve:
    """Read the file.

    Raises
    ------
    DataError
        When it is missing or no curve.
    """
    try:
        content = json.loads(path.read_text("utf-8"))
        kinds = {kind: _sorted(CPoint(**_numbers(row)) for row in content.get(kind, [])) for kind in KINDS}
        about = tuple((str(kind), str(text)) for kind, text in content.get("about", {}).items())
    except OSError:
        raise DataError(f"{path} cannot be read; room-layout train writes such a file") from None
    except (ValueError, TypeError, AttributeError) as error:
        raise DataError(
            f"{path} is no curve ({error}); rgbd and rgb must list C, layout, labelling and mean_iou"
        ) from None
    if not any(kinds.values()):
        raise DataError(f"{path} is no curve (no points); rgbd and rgb must list C, layout, labelling and mean_iou")
    return CCurve(kinds["rgbd"], kinds["rgb"], about)


def update_c_curve(path: Path, kind: str, points: Iterable[CPoint], about: str) -> None:
    """Write the points of one kind ("rgbd" or "rgb"); those of the other stay as they are in the file.

    Raises
    ------
    DataError
        When the file that is there is no curve.
    """
    curve = read_c_curve(path) if path.exists() else CCurve()
    notes = tuple(sorted((dict(curve.about) | {kind: about}).items()))
    curve = replace(curve, **{kind: _sorted(points)}, about=notes)
    rows = {k: [_row(point) for point in getattr(curve, k)] for k in KINDS}
    content = {**{k: r for k, r in rows.items() if r}, "about": dict(curve.about)}
    write_atomically(path, (json.dumps(content, indent=1) + "\n").encode())


def _sorted(points: Iterable[CPoint]) -> tuple[CPoint, ...]:
    return tuple(sorted(points, key=lambda point: point.C))


def _row(point: CPoint) -> dict[str, float]:
    return {name: value for name in CPoint.__slots__ if (value := getattr(point, name)) is not None}


def _numbers(row: dict[str, Any]) -> dict[str, float]:
    return {str(name): float(value) for name, value in row.items()}
