"""Every layout, one by one: the slow twin of core/layout_search.py."""

from __future__ import annotations

import itertools

from room_layout_ros.core.integral_geometry import PairTables
from room_layout_ros.core.layout_search import Layout


def naive_energies(tables: PairTables) -> dict[Layout, float]:
    """Cost of each layout by adding its four table entries."""
    p13, p14, p23, p24 = tables
    sizes = (p13.shape[0], p23.shape[0], p13.shape[1], p14.shape[1])
    return {
        (a, b, c, d): float(p13[a, c] + p14[a, d] + p23[b, c] + p24[b, d])
        for a, b, c, d in itertools.product(*(range(n) for n in sizes))
    }
