"""Label ids, the same everywhere: images, files, topics (docs/method.md, section 1)."""

from __future__ import annotations

import numpy as np

UNKNOWN, CEILING, FLOOR, LEFT_WALL, FRONT_WALL, RIGHT_WALL, CLUTTER = range(7)

LABEL_NAMES = ("unknown", "ceiling", "floor", "left wall", "front wall", "right wall", "clutter")
FACES = (CEILING, FLOOR, LEFT_WALL, FRONT_WALL, RIGHT_WALL)
"""The five faces of the room; index k in arrays over faces is label id k + 1."""

N_FACES = 5
N_LABELS = 6
"""Five faces and clutter; index k in arrays over labels is label id k + 1."""

LABEL_COLORS = np.array(
    [
        [0, 0, 0],
        [90, 200, 250],
        [90, 200, 90],
        [250, 110, 100],
        [250, 215, 90],
        [200, 110, 240],
        [150, 150, 150],
    ],
    dtype=np.uint8,
)
"""(7, 3) RGB colour per label id, for pictures."""

STRUCTURE_NYU40 = (1, 2, 8, 9, 11, 13, 16, 19, 20, 22, 28, 30)
"""NYU40 ids that belong to the room itself: wall, floor, door, window, picture, blinds, ..."""

FURNITURE_NYU40 = {33: "toilet", 4: "bed", 7: "table", 3: "cabinet", 6: "sofa", 5: "chair"}
"""The six furniture classes of the paper (Table 5) by NYU40 id."""
