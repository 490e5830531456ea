"""The evaluation as one HTML page: the paper's tables and figures with our numbers beside, every frame worst first."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from html import escape

import numpy as np

from room_layout_ros.core.labels import FURNITURE_IDS, FURNITURE_NYU40, LABEL_COLORS, LABEL_NAMES

from . import figures, page, pictures
from .c_curve import CCurve
from .calibration import face_reliability, frame_reliability
from .compare import ComparedFrame
from .published import PAPER_RGB, PAPER_RGBD, TABLE_2, TABLE_3, TABLE_5
from .room_scores import RoomScore
from .scores import FIXED, LABELS, Figure, SetScore
from .superpixel_table import MEASURES, SETTINGS, TRUTHS, Setting, row_name, superpixel_figures
from .tables import (
    NAMES_AS_THEY_ARE,
    ROOM_COLUMNS,
    number,
    percent,
    published_cells,
    room_cells,
    with_rooms,
    with_span,
    worst_first,
)

MAX_PICTURES = 120
"""Frames shown with their picture; more would make the page too heavy to open."""

_EXPLANATION = """Intervals are 95 % bootstrap over the frames. Wall names are permuted to the best fit, because which
of two visible walls is “front” is a guess of the annotators; “fixed” is with the names as they are, as the paper's
numbers are. The published numbers are of their authors' own images of NYU v2, not of these frames. Corner errors are in
percent of the image diagonal; “none” counts frames without an estimate, each of them 100 % wrong."""

_SUPERPIXELS = """200 per image. Depth has two terms: “plane”, our default, is the residual to a superpixel's plane;
“gradient” is the paper's own. All terms are normalised by their noise, so the paper's weights are taken as factors on
our defaults, the gradient's on the plane's. Depth × 0 leaves depth out; it is plain SLIC only without our merging of
neighbours (superpixel_oversegmentation=1). Unlabelled pixels are ignored; how the paper treats them is not known to us,
so compare the rows with each other rather than with its numbers."""

_CURVE = """Learned on one half of the frames and judged on the other, no cross-validation: errors of the discrete
solution, before its refinement, and without the scene network unless the command names --scene."""

_ROOM = """Planes that truth and estimate both have: mean distance between them at the camera, and mean angle; axes
modulo the cube's 24 rotations; volume of the room in view up to 10 m; free floor in sight up to 4 m. Metres are left
out where the scale is unknown (RGB)."""


def report_html(
    scores: Sequence[SetScore], frames: Sequence[ComparedFrame], source: str, curve: CCurve | None = None
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
    curve : CCurve, optional
        Our percentages by the C of learning (Figure 4 b-d).
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
        *_rooms(scores),
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
    paper = PAPER_RGB if ours.title.endswith("RGB") else PAPER_RGBD
    rows = (
        ("layout_error", "layout error", paper.layout),
        ("labelling_error", "labelling error", paper.labelling),
        ("mean_iou", "mean IoU of six labels", paper.mean_iou),
    )
    items = []
    for name, what, published in rows:
        figure = ours.figures[name]
        if np.isfinite(figure.value):
            fixed = percent(ours.figures[f"{name}{FIXED}"].value)
            beside = (
                f"{100 * figure.low:.1f} to {100 * figure.high:.1f}, walls permuted; {NAMES_AS_THEY_ARE} {fixed}; "
                f"{paper.title} {published:.2f}"
            )
            items.append((f"{percent(figure.value)} %", what, beside))
    if np.isfinite(ours.milliseconds):
        items.append((f"{ours.milliseconds:.0f} ms", "a frame, median", f"{ours.title}, on its machine"))
    return page.cards(items)


def _table_2(scores: Sequence[SetScore]) -> str:
    errors = ("layout_error", "labelling_error")
    shown = (*(f"{name}{names}" for name in errors for names in ("", FIXED)), "corner_error")
    rows = [[s.title, *(with_span(s.figures[name]) for name in shown), str(s.without_estimate)] for s in scores]
    published = [
        [row.title, *(cell for name in errors for cell in published_cells(row, name)), "", ""] for row in TABLE_2
    ]
    head = ["", "layout %", "fixed names", "labelling %", "fixed names", "corners %", "none"]
    return page.table(head, rows + published, _ours(scores))


def _table_4(scores: Sequence[SetScore]) -> str:
    def rows(names: str) -> list[list[str]]:
        shown = [*(f"iou{names}.{label}" for label in LABELS), f"mean_iou{names}"]
        return [[s.title, *(with_span(s.figures[name]) for name in shown)] for s in scores]

    published = [[r.title, *(number(v) for v in r.iou), number(r.mean_iou)] for r in TABLE_2 if r.iou]
    permuted = page.table(["IoU %", *LABELS, "mean"], rows(""), _ours(scores))
    fixed = page.table(["IoU %, fixed names", *LABELS, "mean"], rows(FIXED) + published, _ours(scores))
    return permuted + fixed


def _table_5(ours: SetScore) -> list[str]:
    if not np.isfinite(ours.figures["mean_furniture_iou"].value):
        return []
    classes = list(FURNITURE_NYU40.values())
    paper = [TABLE_5[name] for name in classes]
    figures = [*(ours.figures[f"furniture_iou.{k}"] for k in FURNITURE_IDS), ours.figures["mean_furniture_iou"]]
    rows = [
        [ours.title, *map(with_span, figures)],
        ["paper, C = 1000", *(number(v) for v in paper), number(float(np.mean(paper)))],
    ]
    return ["<h2>Furniture (Table 5)</h2>", page.table(["IoU %", *classes, "mean"], rows, frozenset({0}))]


def _table_3(frames: Sequence[ComparedFrame]) -> list[str]:
    figures = superpixel_figures(frame.superpixels for frame in frames)
    if not figures:
        return []
    parts = ["<h2>Superpixels (Table 3)</h2>", f"<p>{_SUPERPIXELS}</p>"]
    for truth in TRUTHS:
        head = [f"against the {truth}, ours / paper", "mean error %", "covering %", "variation of information"]
        parts.append(page.table(head, [_table_3_row(figures, setting, truth) for setting in SETTINGS]))
    return parts


def _table_3_row(figures: Mapping[str, Mapping[str, Figure]], setting: Setting, truth: str) -> list[str]:
    row, paper = figures[row_name(setting, truth)], TABLE_3[setting.factor_color, setting.factor_depth]
    columns = zip(MEASURES, (100.0, 100.0, 1.0), paper, strict=True)
    return [setting.name, *(f"{with_span(row[measure], factor)} / {p:.2f}" for measure, factor, p in columns)]


def _rooms(scores: Sequence[SetScore]) -> list[str]:
    if not (shown := with_rooms(scores)):
        return []
    head = ["", *(heading for heading, _, _ in ROOM_COLUMNS.values())]
    rows = [[score.title, *room_cells(score)] for score in shown]
    return ["<h2>The room in 3-D</h2>", f"<p>{_ROOM}</p>", page.table(head, rows, _ours(shown))]


def _rgb_section(ours: SetScore, rgb: SetScore | None) -> list[str]:
    if rgb is None or rgb.without_estimate == len(rgb.frames):
        return []
    return ["<h2>With and without depth (Figure 4 a)</h2>", figures.scatter_rgb_against_rgbd(ours, rgb)]


def _curve_section(curve: CCurve | None) -> list[str]:
    if curve is None:
        return []
    about = "; ".join(f"{kind}: {text}" for kind, text in curve.about)
    note = f"<p class='soft'>{_CURVE} {escape(about)}</p>"
    return ["<h2>Robustness to C (Figure 4 b-d)</h2>", note, figures.robustness_to_c(curve)]


def _frame_list(ours: SetScore, frames: Sequence[ComparedFrame]) -> list[str]:
    by_name = {frame.name: frame for frame in frames}
    names = [(name, tuple(color)) for name, color in zip(LABEL_NAMES, LABEL_COLORS.tolist(), strict=True)]
    parts = [f"<h2>Every frame, worst layout first (Figure 5)</h2><p>{escape(ours.title)}.</p>", page.legend(names[1:])]
    if np.isfinite(ours.figures["mean_furniture_iou"].value):
        parts.append(page.legend(pictures.furniture_legend()))
    for rank, score in enumerate(worst_first(ours)):
        text = (
            f"<b>{escape(score.name)}</b> &nbsp; layout {percent(score.pixels.layout_error)} % "
            f"<small>(fixed names {percent(score.pixels.layout_error_fixed)} %)</small> &nbsp; "
            f"labelling {percent(score.pixels.labelling_error)} % &nbsp; <small>confidence {number(score.confidence)}, "
            f"{escape(score.status)}</small>{_room_text(score.room)}"
        )
        content = by_name[score.name].picture if rank < MAX_PICTURES else None
        image = "" if content is None else page.picture(content, "jpeg", f"frame {score.name}")
        parts.append(f"<div class='frame'>{text}{image}</div>")
    return parts


def _room_text(room: RoomScore) -> str:
    if not np.isfinite(room.axes_error_deg):
        return ""
    offset = f", planes {100 * room.plane_offset_m:.1f} cm" if np.isfinite(room.plane_offset_m) else ""
    return f" &nbsp; <small>axes {number(room.axes_error_deg)} deg{offset}</small>"


def _ours(scores: Sequence[SetScore]) -> frozenset[int]:
    return frozenset(i for i, score in enumerate(scores) if score.title.startswith("ours"))
