"""The evaluation as one HTML page: the paper's tables and figures with our numbers beside, every frame worst first."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from html import escape

import numpy as np

from room_layout_ros.core.labels import FURNITURE_NYU40, LABEL_COLORS, LABEL_NAMES

from . import figures, page
from .calibration import face_reliability, frame_reliability
from .compare import ComparedFrame
from .published import PAPER_RGBD, TABLE_2, TABLE_3, TABLE_5
from .scores import SetScore
from .superpixel_table import mean_rows, row_name
from .tables import BOOTSTRAP_SEED, LABELS, number, percent, with_span

MAX_PICTURES = 120
"""Frames shown with their picture; more would make the page too heavy to open."""

_EXPLANATION = """Intervals are 95 % bootstrap over the frames. Wall names are permuted to the best fit, because which
of two visible walls is “front” is a guess of the annotators; “fixed” is with the names as they are. The published
numbers are of other images of the same data set: the paper's split is not public. Corner errors are in percent of the
image diagonal; “none” counts frames without an estimate, each of them 100 % wrong."""

_SUPERPIXELS = """200 per image, against the semantic classes. Our terms are normalised by their noise, so the paper's
weights are taken as factors on our defaults; λd = 0 is plain SLIC."""

Curve = Mapping[float, Mapping[str, float]]


def report_html(
    scores: Sequence[SetScore], frames: Sequence[ComparedFrame], source: str, curve: Curve | None = None
) -> str:
    """Return the page.

    Parameters
    ----------
    scores : sequence of SetScore
        Ours first, baselines after it.
    frames : sequence of ComparedFrame
        With the pictures of the first method.
    source : str
        What was measured.
    curve : mapping, optional
        Our percentages by the C of learning: layout, labelling, mean_iou (Figure 4 b-d).
    """
    ours = scores[0]
    rgb = next((s for s in scores if s.title == "ours, RGB" and s is not ours), None)
    body = [
        "<h1>Room layout: measured against ground truth</h1>",
        f"<p class='soft'>{escape(source)}, {len(frames)} frames with a true layout. {_EXPLANATION}</p>",
        _cards(ours),
        "<h2>Layout and labelling error (paper, Table 2)</h2>",
        _table_2(scores),
        "<h2>Intersection over union per class (Table 4)</h2>",
        _table_4(scores),
        *_table_5(ours),
        *_table_3(frames),
        "<h2>How the errors are spread</h2>",
        figures.error_curves(scores),
        *_rgb_section(ours, rgb),
        *_curve_section(curve),
        "<h2>Where pixels go</h2><p>Labelling of the first method; rows are the truth, in percent of the row.</p>",
        f"<div style='max-width:520px'>{figures.confusion(ours.confusions.sum(axis=0), LABEL_NAMES)}</div>",
        "<h2>Is its confidence honest?</h2>",
        figures.calibration(frame_reliability(ours), face_reliability(ours)),
        *_frame_list(ours, frames),
    ]
    return page.page("Room layout: evaluation", body)


def _cards(ours: SetScore) -> str:
    spans = ours.intervals(np.random.default_rng(BOOTSTRAP_SEED))
    rows = (
        (float(np.nanmean(ours.layout_errors)), "layout error", "layout", PAPER_RGBD.layout),
        (float(np.nanmean(ours.labelling_errors)), "labelling error", "labelling", PAPER_RGBD.labelling),
        (ours.mean_iou, "mean IoU of six labels", "iou", PAPER_RGBD.mean_iou),
    )
    items = [
        (f"{percent(v)} %", what, f"{100 * spans[key][0]:.1f} to {100 * spans[key][1]:.1f}; paper {paper:.2f}")
        for v, what, key, paper in rows
        if np.isfinite(v)
    ]
    median = float(np.nanmedian([f.milliseconds for f in ours.frames]))
    items.append((f"{median:.0f} ms", "a frame, median", f"{ours.title}, on this machine"))
    return page.cards(items)


def _table_2(scores: Sequence[SetScore]) -> str:
    rows = []
    for score in scores:
        spans = score.intervals(np.random.default_rng(BOOTSTRAP_SEED))
        rows.append(
            [
                score.title,
                with_span(float(np.nanmean(score.layout_errors)), spans["layout"]),
                percent(float(np.nanmean(score.layout_errors_fixed))),
                with_span(float(np.nanmean(score.labelling_errors)), spans["labelling"]),
                percent(float(np.nanmean(score.corner_errors))),
                str(score.without_estimate),
            ]
        )
    published = [[row.title, number(row.layout), "", number(row.labelling), "", ""] for row in TABLE_2]
    head = ["", "layout %", "fixed names", "labelling %", "corners %", "none"]
    return page.table(head, rows + published, _ours(scores))


def _table_4(scores: Sequence[SetScore]) -> str:
    rows = [[s.title, *(percent(v) for v in s.iou), percent(s.mean_iou)] for s in scores]
    published = [[r.title, *(number(v) for v in r.iou), number(r.mean_iou)] for r in TABLE_2 if r.iou]
    return page.table(["IoU %", *LABELS, "mean"], rows + published, _ours(scores))


def _table_5(ours: SetScore) -> list[str]:
    values = ours.furniture_iou
    if not np.isfinite(values).any() or not np.nansum(values):
        return []
    names = list(FURNITURE_NYU40.values())
    paper = [TABLE_5[name] for name in names]
    rows = [
        [ours.title, *(percent(v) for v in values), percent(float(np.nanmean(values)))],
        ["paper, C = 1000", *(number(v) for v in paper), number(float(np.mean(paper)))],
    ]
    return ["<h2>Furniture (Table 5)</h2>", page.table(["IoU %", *names, "mean"], rows, frozenset({0}))]


def _table_3(frames: Sequence[ComparedFrame]) -> list[str]:
    rows = mean_rows(frame.superpixels for frame in frames)
    if not rows:
        return []
    cells = []
    for (factor_color, factor_depth), paper in TABLE_3.items():
        ours = rows[row_name(factor_color, factor_depth)]
        columns = [f"{o:.2f} / {p:.2f}" for o, p in zip(ours, paper, strict=True)]
        cells.append([f"λa × {factor_color}, λd × {factor_depth}", *columns])
    head = ["ours / paper", "mean error %", "covering %", "variation of information"]
    return [
        "<h2>Superpixels (Table 3)</h2>",
        f"<p>{_SUPERPIXELS}</p>",
        page.table(head, cells),
    ]


def _rgb_section(ours: SetScore, rgb: SetScore | None) -> list[str]:
    if rgb is None or rgb.without_estimate == len(rgb.frames):
        return []
    return ["<h2>With and without depth (Figure 4 a)</h2>", figures.scatter_rgb_against_rgbd(ours, rgb)]


def _curve_section(curve: Curve | None) -> list[str]:
    return ["<h2>Robustness to C (Figure 4 b-d)</h2>", figures.robustness_to_c(curve)] if curve else []


def _frame_list(ours: SetScore, frames: Sequence[ComparedFrame]) -> list[str]:
    by_name = {frame.name: frame for frame in frames}
    worst_first = sorted(ours.frames, key=lambda f: -np.nan_to_num(f.pixels.layout_error, nan=2.0))
    names = [(name, tuple(color)) for name, color in zip(LABEL_NAMES, LABEL_COLORS.tolist(), strict=True)]
    parts = [f"<h2>Every frame, worst layout first</h2><p>{escape(ours.title)}.</p>", page.legend(names[1:])]
    for rank, score in enumerate(worst_first):
        text = (
            f"<b>{escape(score.name)}</b> &nbsp; layout {percent(score.pixels.layout_error)} % "
            f"<small>(fixed names {percent(score.pixels.layout_error_fixed)} %)</small> &nbsp; "
            f"labelling {percent(score.pixels.labelling_error)} % &nbsp; <small>confidence {number(score.confidence)}, "
            f"{escape(score.status)}</small>"
        )
        image = page.picture(by_name[score.name].picture, "jpeg", f"frame {score.name}") if rank < MAX_PICTURES else ""
        parts.append(f"<div class='frame'>{text}{image}</div>")
    return parts


def _ours(scores: Sequence[SetScore]) -> frozenset[int]:
    return frozenset(i for i, score in enumerate(scores) if score.title.startswith("ours"))
