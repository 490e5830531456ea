"""Label ids, the same everywhere: images, files, topics (docs/method.md, section 1)."""

from __future__ import annotations

import numpy as np

UNKNOWN, CEILING, FLOOR, LEFT_WALL, FRONT_WALL, RIGHT_WALL, CLUTTER = range(7)

LABEL_NAMES = ("unknown", "ceiling", "floor", "left wall", "front wall", "right wall", "clutter")
FACES = (CEILING, FLOOR, LEFT_WALL, FRONT_WALL, RIGHT_WALL)
"""The five faces of the room; index k in arrays over faces is label id k + 1."""

WALL_IDS = (LEFT_WALL, FRONT_WALL, RIGHT_WALL)
"""Label ids of the walls."""

N_FACES = 5
N_LABELS = 6
"""Five faces and clutter; index k in arrays over labels is label id k + 1."""

CEILING_FACE, FLOOR_FACE, LEFT_FACE, FRONT_FACE, RIGHT_FACE = range(N_FACES)
"""Indices in arrays over faces."""

WALL_FACES = (LEFT_FACE, FRONT_FACE, RIGHT_FACE)
"""Indices of the walls, the faces that stand upright."""

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

WALL_NYU40 = (1, 11, 16, 28, 30)
"""NYU40 ids of wall and of what hangs on it: picture, curtain, shower curtain, whiteboard."""

OPENING_NYU40 = (8, 9, 13, 19)
"""Door, window, blinds, mirror: wall through which farther points may be seen."""

FLOOR_NYU40 = (2, 20)
"""Floor and floor mat."""

CEILING_NYU40 = (22,)

STRUCTURE_NYU40 = tuple(sorted(WALL_NYU40 + OPENING_NYU40 + FLOOR_NYU40 + CEILING_NYU40))
"""NYU40 ids that belong to the room itself."""

FURNITURE_NYU40 = {33: "toilet", 4: "bed", 7: "table", 3: "cabinet", 6: "sofa", 5: "chair"}
"""The six furniture classes of the paper (Table 5) by NYU40 id."""

FURNITURE_IDS = tuple(FURNITURE_NYU40)
"""NYU40 id of each class, in the order of arrays over them."""

N_FURNITURE = len(FURNITURE_IDS)
N_CLUTTER_CLASSES = N_FURNITURE + 1
"""The classes of furniture and anything else, the last."""
