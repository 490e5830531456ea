"""The tables of the evaluation: our rows beside the published ones, as text and as plain values."""

from __future__ import annotations

import csv
import io
import json
from collections.abc import Sequence
from typing import Any

import numpy as np

from room_layout_ros.core.labels import LABEL_NAMES

from .published import TABLE_2
from .scores import FURNITURE_IDS, SetScore

BOOTSTRAP_SEED = 2013
LABELS = LABEL_NAMES[1:]


def text_table(scores: Sequence[SetScore]) -> str:
    """Return the table for the terminal: percent, with 95 % bootstrap intervals over the frames.

    "fixed" is the layout error with the wall names as they are, "none" counts frames without an estimate (each is
    100 % wrong), "ms" is the median per frame.
    """
    lines = [
        f"{'':<36}{'layout %':>18}{'fixed':>7}{'labelling %':>19}{'mean IoU':>19}{'corner %':>9}{'ms':>7}{'none':>6}",
    ]
    for score in scores:
        spans = score.intervals(np.random.default_rng(BOOTSTRAP_SEED))
        lines.append(
            f"{score.title:<36}"
            f"{with_span(_mean(score.layout_errors), spans['layout']):>18}"
            f"{percent(_mean(score.layout_errors_fixed)):>7}"
            f"{with_span(_mean(score.labelling_errors), spans['labelling']):>19}"
            f"{with_span(score.mean_iou, spans['iou']):>19}"
            f"{percent(_mean(score.corner_errors)):>9}"
            f"{np.nanmedian([f.milliseconds for f in score.frames]):>7.1f}"
            f"{score.without_estimate:>6}"
        )
    lines.append("published, on other images of the same data set:")
    lines += [
        f"{row.title:<36}{number(row.layout):>18}{'':>7}{number(row.labelling):>19}{number(row.mean_iou):>19}"
        for row in TABLE_2
    ]
    return "\n".join([*lines, "", iou_table(scores)])


def iou_table(scores: Sequence[SetScore]) -> str:
    """Return IoU per class, as PASCAL (paper Table 4)."""
    lines = [f"{'IoU %':<36}" + "".join(f"{name:>12}" for name in LABELS)]
    lines += [f"{s.title:<36}" + "".join(f"{percent(v):>12}" for v in s.iou) for s in scores]
    lines += [f"{r.title:<36}" + "".join(f"{v:>12.2f}" for v in r.iou) for r in TABLE_2 if r.iou]
    return "\n".join(lines)


def summary(scores: Sequence[SetScore]) -> dict[str, Any]:
    """Return every number of the set for summary.json; shares 0..1, null where there is none."""
    return {score.title: _summary(score) for score in scores}


def _summary(score: SetScore) -> dict[str, Any]:
    spans = score.intervals(np.random.default_rng(BOOTSTRAP_SEED))
    return {
        "frames": len(score.frames),
        "frames_without_estimate": score.without_estimate,
        "layout_error": _json(_mean(score.layout_errors)),
        "layout_error_fixed_names": _json(_mean(score.layout_errors_fixed)),
        "labelling_error": _json(_mean(score.labelling_errors)),
        "mean_iou": _json(score.mean_iou),
        "corner_error": _json(_mean(score.corner_errors)),
        "iou": {name: _json(v) for name, v in zip(LABELS, score.iou, strict=True)},
        "furniture_iou": {str(k): _json(v) for k, v in zip(FURNITURE_IDS, score.furniture_iou, strict=True)},
        "interval_95": {name: [_json(low), _json(high)] for name, (low, high) in spans.items()},
        "milliseconds_median": _json(float(np.nanmedian([f.milliseconds for f in score.frames]))),
    }


def summary_json(scores: Sequence[SetScore], **facts: object) -> str:
    """Return summary.json: the facts of the run, then the numbers by method."""
    return json.dumps({**facts, "methods": summary(scores)}, indent=1, allow_nan=False) + "\n"


def frames_csv(scores: Sequence[SetScore]) -> str:
    """Return one line per frame and method."""
    out = io.StringIO()
    writer = csv.writer(out, lineterminator="\n")
    writer.writerow(
        ["frame", "method", "status", "layout_error", "layout_error_fixed_names", "labelling_error", "corner_error"]
        + ["confidence", "milliseconds"]
    )
    for score in scores:
        for frame in score.frames:
            p = frame.pixels
            values = (p.layout_error, p.layout_error_fixed, p.labelling_error, frame.corner_error, frame.confidence)
            writer.writerow(
                [frame.name, score.title, frame.status, *(f"{v:.5f}" for v in values), f"{frame.milliseconds:.2f}"]
            )
    return out.getvalue()


def _mean(values: np.ndarray[Any, np.dtype[np.float64]]) -> float:
    return float(np.nanmean(values)) if np.isfinite(values).any() else float("nan")


def percent(share: float) -> str:
    """Return a share as percent with two digits, "-" for NaN."""
    return number(100 * share)


def number(value: float) -> str:
    """Return a number with two digits, "-" for NaN."""
    return f"{value:.2f}" if np.isfinite(value) else "-"


def with_span(share: float, span: tuple[float, float]) -> str:
    """Return percent with the interval."""
    if not np.isfinite(share):
        return "-"
    return f"{100 * share:.2f} ({100 * span[0]:.1f}-{100 * span[1]:.1f})"


def _json(value: float) -> float | None:
    return round(float(value), 6) if np.isfinite(value) else None
