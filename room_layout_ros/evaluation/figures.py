"""The paper's figures 4 a-d with our numbers, and those it lacks: error curves, calibration (matplotlib, SVG)."""

from __future__ import annotations

import io
from collections.abc import Sequence
from typing import TYPE_CHECKING

import numpy as np
from numpy.typing import NDArray

from . import measures, page
from .c_curve import CCurve
from .published import FIGURE_4_C, PAPER_RGB, PAPER_RGBD
from .scores import SetScore

if TYPE_CHECKING:
    from matplotlib.axes import Axes
    from matplotlib.figure import Figure

COLORS = ("#1668c9", "#e0763a", "#8b95a3", "#45a06f", "#9b5fc0")


def scatter_rgb_against_rgbd(rgbd: SetScore, rgb: SetScore) -> str:
    """Paper's Figure 4 a for both tasks: a point a frame; above the line depth helps."""
    figure, axes = _figure(2)
    pairs = (
        ("layout error", rgbd.layout_errors, rgb.layout_errors),
        ("labelling error", rgbd.labelling_errors, rgb.labelling_errors),
    )
    for ax, (what, with_depth, without) in zip(axes, pairs, strict=True):
        top = 105 * float(np.nanmax([*with_depth, *without, 0.1]))
        ax.plot([0, top], [0, top], color="#d03030", lw=1.2)
        ax.plot(100 * with_depth, 100 * without, "o", ms=5, alpha=0.7, color=COLORS[0], clip_on=False)
        known = np.isfinite(with_depth) & np.isfinite(without)
        above = (without > with_depth)[known].mean() if known.any() else float("nan")
        ax.set(xlabel="RGB-D, %", ylabel="RGB, %", xlim=(0, top), ylim=(0, top))
        ax.set_title(f"{what}: {100 * above:.0f} % of the frames better with depth", fontsize=10)
    return _svg(figure)


def error_curves(scores: Sequence[SetScore]) -> str:
    """Share of frames below an error: the whole distribution, not the mean alone."""
    figure, axes = _figure(2)
    for ax, what in zip(axes, ("layout", "labelling"), strict=True):
        for color, score in zip(COLORS, scores, strict=False):
            errors = score.layout_errors if what == "layout" else score.labelling_errors
            errors = np.sort(100 * errors[np.isfinite(errors)])
            ax.step(np.append(0, errors), np.arange(len(errors) + 1) / max(len(errors), 1), where="post", color=color)
        ax.set(xlabel=f"{what} error, %", ylabel="share of frames", xlim=(0, 60), ylim=(0, 1.01))
    names = [(score.title, _rgb(color)) for color, score in zip(COLORS, scores, strict=False)]
    return page.legend(names) + _svg(figure)  # beside the curves: within the axes some curve would cross it


def calibration(frames: measures.Reliability | None, faces: measures.Reliability | None) -> str:
    """Stated confidence against what came true, with the number of cases as bars."""
    figure, axes = _figure(2)
    named = (
        ("frame: confidence / share of pixels right", frames),
        ("face: confidence / IoU of the face in the layout", faces),
    )
    for ax, (what, bins) in zip(axes, named, strict=True):
        ax.plot([0, 1], [0, 1], color="#b8bfc9", lw=1)
        ax.set(xlim=(0, 1), ylim=(0, 1), xlabel="stated confidence", ylabel="measured")
        ax.set_title(f"{what}" + ("" if bins is None else f"; ECE {bins.ece:.3f}"), fontsize=9)
        if bins is not None:
            centres = (bins.edges[:-1] + bins.edges[1:]) / 2
            ax.bar(centres, bins.count / bins.count.sum(), width=0.09, color="#dfe6ee")
            ax.plot(bins.confidence, bins.accuracy, "o-", color=COLORS[0], ms=5, clip_on=False)  # 0 and 1 are whole
    return _svg(figure)


def robustness_to_c(curve: CCurve) -> str:
    """Paper's Figure 4 b-d: our percentages against C, with depth and without."""
    figure, axes = _figure(3)
    names = {"layout": "layout error, %", "labelling": "labelling error, %", "mean_iou": "mean IoU, %"}
    kinds = (("RGB-D", curve.rgbd, PAPER_RGBD), ("RGB", curve.rgb, PAPER_RGB))
    shown = [kind for kind in kinds if kind[1]]
    reach = sorted({*FIGURE_4_C, *(point.C for _, points, _ in shown for point in points)})
    for ax, key in zip(axes, names, strict=True):
        for color, (title, points, paper) in zip(COLORS, shown, strict=False):
            values = [getattr(point, key) for point in points]
            ax.semilogx([point.C for point in points], values, "o-", color=color, label=f"ours, {title}")
            ax.plot([1000], [getattr(paper, key)], "s", mfc="none", ms=8, color=color, label=f"{paper.title}, C = 1000")
        ax.set(xlabel="C", ylabel=names[key], xlim=(reach[0] / 1.5, reach[-1] * 1.5))
    axes[0].legend(frameon=False, fontsize=8)
    return _svg(figure)


def confusion(counts: NDArray[np.int64], names: Sequence[str]) -> str:
    """Where labelled pixels go: rows are the truth, percent of the row."""
    figure, axes = _figure(1)
    rows = counts[1:].astype(np.float64)
    share = np.divide(
        rows, rows.sum(axis=1, keepdims=True), out=np.zeros_like(rows), where=rows.sum(1, keepdims=True) > 0
    )
    ax = axes[0]
    ax.grid(visible=False)
    ax.imshow(share, cmap="Blues", vmin=0, vmax=1)
    for y, x in np.ndindex(*share.shape):
        ink = "white" if share[y, x] > 0.6 else "#1d2430"
        ax.text(x, y, f"{100 * share[y, x]:.0f}", ha="center", va="center", fontsize=8, color=ink)
    ax.set_xticks(range(len(names)), names, rotation=35, ha="right", fontsize=8)
    ax.set_yticks(range(len(names) - 1), names[1:], fontsize=8)
    ax.set(xlabel="estimate", ylabel="truth")
    return _svg(figure)


def _rgb(color: str) -> tuple[int, int, int]:
    """Return the numbers of a colour like #1668c9."""
    red, green, blue = bytes.fromhex(color[1:])
    return red, green, blue


def _figure(columns: int) -> tuple[Figure, list[Axes]]:
    # The object interface, not pyplot: no global state, no window system.
    from matplotlib.figure import Figure

    figure = Figure(figsize=(4.7 * columns, 3.9), layout="constrained")
    axes = [figure.add_subplot(1, columns, k + 1) for k in range(columns)]
    for ax in axes:
        ax.spines[["top", "right"]].set_visible(False)
        ax.grid(color="#eceff3", lw=0.8)
        ax.set_axisbelow(True)
    return figure, axes


def _svg(figure: Figure) -> str:
    import matplotlib as mpl

    out = io.StringIO()
    # Letters stay letters: a smaller page that can be searched. The salt makes the same figure the same bytes.
    with mpl.rc_context({"svg.fonttype": "none", "svg.hashsalt": "room_layout"}):
        figure.savefig(out, format="svg", metadata={"Date": None})
    text = out.getvalue()
    return f"<div class='figure'>{text[text.index('<svg') :]}</div>"
