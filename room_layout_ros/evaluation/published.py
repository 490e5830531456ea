"""Numbers that others published, for the columns beside ours. Percent, but for the variation of information.

Zhang, Kan, Schwing, Urtasun, ICCV 2013 ("the paper"): 101 test images of 303 of NYU v2. Unless `evaluate` is given
its layouts and its list of test images, its numbers and ours are of the same kind of image, not of the same images.
"""

from __future__ import annotations

from dataclasses import dataclass


@dataclass(frozen=True, slots=True)
class Published:
    """One row of Table 2 and 4. NaN where nothing was published; `iou` in label order.

    `fixed_names` : faces count by the names that they have; else they were matched to the true ones first.
    """

    title: str
    layout: float
    labelling: float = float("nan")
    mean_iou: float = float("nan")
    iou: tuple[float, ...] = ()
    fixed_names: bool = True


PAPER_RGBD = Published("paper, RGB-D", 8.04, 13.65, 76.67, (80.36, 85.84, 68.93, 77.27, 75.15, 72.47))
PAPER_RGB = Published("paper, RGB", 13.94, 23.68, 59.60, (53.57, 51.48, 61.71, 69.21, 63.37, 58.26))
TABLE_2 = (
    Published("geometric context (2007), RGB", float("nan"), 26.38),
    Published("Schwing et al. 2012, RGB", 13.66),
    PAPER_RGB,
    Published("NonCuboidRoom 2022, deep, RGB, GPU", 10.6, fixed_names=False),
    PAPER_RGBD,
)

TABLE_3 = {
    # (lambda_a, lambda_d): (ME %, covering %, variation of information)
    (1, 0): (2.51, 88.76, 0.63),
    (5, 1): (2.28, 89.17, 0.60),
    (2, 1): (2.19, 89.32, 0.59),
    (1, 1): (2.15, 89.36, 0.58),
    (1, 2): (2.16, 89.35, 0.58),
    (1, 5): (2.26, 89.15, 0.59),
    (0, 1): (2.81, 88.18, 0.66),
}
"""Superpixels at 200 per image; the printed weights of colour and of the gradient of depth, the paper's depth term."""

TABLE_5 = {"toilet": 36.03, "bed": 43.46, "table": 21.21, "cabinet": 21.26, "sofa": 32.88, "chair": 36.13}
"""Furniture IoU at C = 1000."""

FIGURE_4_C = (100, 300, 500, 1000, 3000, 5000, 10000)
"""The C of Figure 4 b-d and Table 5."""
