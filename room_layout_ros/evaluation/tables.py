"""The tables of the evaluation: our rows beside the published ones, as text and as plain values."""

from __future__ import annotations

import csv
import io
import json
from collections.abc import Callable, Mapping, Sequence
from typing import Any

import numpy as np

from room_layout_ros.core.labels import FURNITURE_IDS

from .measures import mean_iou
from .published import TABLE_2, Published
from .scores import FIXED, LABELS, PER_FRAME, ROOM_FIGURES, Figure, FrameScore, SetScore

GROUPS = {"iou": LABELS, f"iou{FIXED}": LABELS, "furniture_iou": tuple(map(str, FURNITURE_IDS))}
"""Figures by class, and the names of the classes in summary.json."""

PUBLISHED_ON = "published, on their authors' own images of NYU v2"

SINGLE = (*PER_FRAME, "mean_iou", f"mean_iou{FIXED}", "mean_furniture_iou", "frame_ece", "face_ece")

NAMES_AS_THEY_ARE = "wall names as they are"

COMPARED = {"layout_error": "layout", "labelling_error": "labelling", "mean_iou": "mean_iou"}
"""Figures that others published, and what they are called in `Published`."""

OF_ONE_FRAME: Mapping[str, Callable[[FrameScore], float]] = {
    "frame_mean_iou": lambda frame: mean_iou(frame.pixels.labels_confusion),
    f"frame_mean_iou{FIXED}": lambda frame: mean_iou(frame.pixels.labels_confusion_fixed),
}
"""Of frames.csv alone: the set's mean IoU is of pixels summed over the frames, not the mean of these."""

ROOM_COLUMNS = {
    "planes_found": ("planes found %", 100.0, 1),
    "plane_offset_m": ("offset cm", 100.0, 1),
    "plane_angle_deg": ("angle deg", 1.0, 2),
    "axes_error_deg": ("axes deg", 1.0, 2),
    "room_iou": ("room IoU %", 100.0, 1),
    "free_space_iou": ("free floor IoU %", 100.0, 1),
}
"""Heading, factor and digits of the figures in three dimensions."""


def text_table(scores: Sequence[SetScore]) -> str:
    """Return the tables for the terminal: percent, with 95 % bootstrap intervals over the frames.

    "fixed" is the measure before it with the wall names as they are, which is how the paper's numbers are meant; "none"
    counts frames without an estimate (each is 100 % wrong), "ms" is the median per frame.
    """
    heads = ("layout %", "fixed", "labelling %", "fixed", "mean IoU", "fixed", "corner %", "ms", "none")
    ours = [[score.title, *_cells(score)] for score in scores]
    theirs = [
        [row.title, *(cell for name in COMPARED for cell in published_cells(row, name)), "", "", ""] for row in TABLE_2
    ]
    lines = _aligned([["", *heads], *ours, *theirs])
    lines.insert(1 + len(ours), PUBLISHED_ON + ":")
    return "\n".join([*lines, "", iou_table(scores), *room_table(scores)])


def published_cells(row: Published, name: str) -> tuple[str, str]:
    """Return a published number in the column of the names that it is of: permuted, or as they are."""
    text = number(getattr(row, COMPARED[name]))
    return ("", text) if row.fixed_names else (text, "")


def _cells(score: SetScore) -> list[str]:
    figures = score.figures
    pairs = ((with_span(figures[name]), percent(figures[f"{name}{FIXED}"].value)) for name in COMPARED)
    return [
        *(cell for pair in pairs for cell in pair),
        percent(figures["corner_error"].value),
        number(score.milliseconds, 1),
        str(score.without_estimate),
    ]


def _aligned(rows: Sequence[Sequence[str]]) -> list[str]:
    """Return rows of cells as lines, as wide as the longest cell of each column needs."""
    widths = [max(map(len, column)) for column in zip(*rows, strict=True)]
    return [
        "  ".join([row[0].ljust(widths[0]), *(c.rjust(w) for c, w in zip(row[1:], widths[1:], strict=True))]).rstrip()
        for row in rows
    ]


def iou_table(scores: Sequence[SetScore]) -> str:
    """Return IoU per class, as PASCAL (paper Table 4): walls permuted, then with the names as they are."""
    permuted = [[s.title, *(percent(s.figures[f"iou.{name}"].value) for name in LABELS)] for s in scores]
    fixed = [[s.title, *(percent(s.figures[f"iou{FIXED}.{name}"].value) for name in LABELS)] for s in scores]
    theirs = [[r.title, *map(number, r.iou)] for r in TABLE_2 if r.iou]
    lines = _aligned([["IoU %", *LABELS], *permuted, *fixed, *theirs])
    lines.insert(1 + len(permuted), NAMES_AS_THEY_ARE + ":")
    return "\n".join(lines)


def room_table(scores: Sequence[SetScore]) -> list[str]:
    """Return the lines of the figures in three dimensions; none where no frame has a true room."""
    if not (shown := with_rooms(scores)):
        return []
    heads = [head for head, _, _ in ROOM_COLUMNS.values()]
    return ["", *_aligned([["room in 3-D", *heads], *([s.title, *room_cells(s)] for s in shown)])]


def with_rooms(scores: Sequence[SetScore]) -> list[SetScore]:
    """Return the methods that have a figure in three dimensions."""
    return [s for s in scores if any(np.isfinite(s.figures[name].value) for name in ROOM_FIGURES)]


def room_cells(score: SetScore) -> list[str]:
    """Return the row of `ROOM_COLUMNS`."""
    return [with_span(score.figures[name], factor, digits) for name, (_, factor, digits) in ROOM_COLUMNS.items()]


def summary(scores: Sequence[SetScore]) -> dict[str, Any]:
    """Return every number of the set for summary.json; shares 0..1, null where there is none."""
    return {score.title: _summary(score) for score in scores}


def _summary(score: SetScore) -> dict[str, Any]:
    def collect(pick: Callable[[Figure], Any]) -> dict[str, Any]:
        single = {name: pick(score.figures[name]) for name in SINGLE}
        return single | {g: {c: pick(score.figures[f"{g}.{c}"]) for c in classes} for g, classes in GROUPS.items()}

    return {
        "frames": len(score.frames),
        "frames_without_estimate": score.without_estimate,
        "milliseconds_median": _json(score.milliseconds),
        **collect(lambda figure: _json(figure.value)),
        "interval_95": collect(lambda figure: [_json(figure.low), _json(figure.high)]),
    }


def summary_json(scores: Sequence[SetScore], superpixels: Mapping[str, Mapping[str, Figure]], **facts: object) -> str:
    """Return summary.json: the facts of the run, the numbers by method, and those of the superpixels by setting."""
    segmentation = {
        setting: {
            **{name: _json(figure.value) for name, figure in row.items()},
            "interval_95": {name: [_json(figure.low), _json(figure.high)] for name, figure in row.items()},
        }
        for setting, row in superpixels.items()
    }
    content = {**facts, "methods": summary(scores), "superpixels": segmentation}
    return json.dumps(content, indent=1, allow_nan=False) + "\n"


def frames_csv(scores: Sequence[SetScore]) -> str:
    """Return one line per frame and method, the worst layouts of each method first."""
    out = io.StringIO()
    writer = csv.writer(out, lineterminator="\n")
    measures = {**PER_FRAME, **OF_ONE_FRAME}
    writer.writerow(["frame", "method", "status", *measures, "confidence", "milliseconds"])
    for score in scores:
        for frame in worst_first(score):
            values = [*(measure(frame) for measure in measures.values()), frame.confidence]
            writer.writerow(
                [frame.name, score.title, frame.status, *(f"{v:.5f}" for v in values), f"{frame.milliseconds:.2f}"]
            )
    return out.getvalue()


def worst_first(score: SetScore) -> list[FrameScore]:
    """Return the frames by falling layout error."""
    return sorted(score.frames, key=lambda frame: -np.nan_to_num(frame.pixels.layout_error, nan=2.0))


def percent(share: float) -> str:
    """Return a share as percent with two digits, "-" for NaN."""
    return number(100 * share)


def number(value: float, digits: int = 2) -> str:
    """Return a number with some digits behind the point, "-" for NaN."""
    return f"{value:.{digits}f}" if np.isfinite(value) else "-"


def with_span(figure: Figure, factor: float = 100.0, digits: int = 2) -> str:
    """Return a figure, as percent by default, with its interval.

    That of a percent has a digit less, unless the value would lie outside then.
    """
    if not np.isfinite(figure.value):
        return "-"
    value = f"{factor * figure.value:.{digits}f}"
    for few in (digits if factor == 1.0 else max(1, digits - 1), digits):
        low, high = (f"{factor * v:.{few}f}" for v in (figure.low, figure.high))
        if float(low) <= float(value) <= float(high):
            break
    return f"{value} ({low}-{high})"


def _json(value: float) -> float | None:
    return round(float(value), 6) if np.isfinite(value) else None
