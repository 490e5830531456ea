"""A word before the first frame where the estimator has yet to be compiled on this machine."""

from __future__ import annotations

import sys
from collections.abc import Iterable, Iterator
from typing import Any, TypeVar

from room_layout_ros.core import conclusion, depth
from room_layout_ros.core.config import JOINT, EstimatorConfig
from room_layout_ros.core.kernel_cache import is_compiled
from room_layout_ros.datasets import BadFrame

_Item = TypeVar("_Item")


def tell_if_compiling(config: EstimatorConfig, rgb_only: bool = False) -> None:
    """Say on stderr that the first frame takes long where its kernels are not kept on disk.

    Two stand for all: that of the end, and one that is there for depth.
    """
    needed: list[Any] = [conclusion._paint_labels] if config.method == JOINT else []
    if config.use_depth and not rgb_only:
        needed.append(depth._cell_moments)
    if not all(map(is_compiled, needed)):
        told = "compiling the estimator, which takes one to four minutes the first time; the next start is fast"
        print(told, file=sys.stderr, flush=True)


def told_first(items: Iterable[_Item], config: EstimatorConfig, rgb_only: bool = False) -> Iterator[_Item]:
    """Yield the items; before the first that will be estimated, `tell_if_compiling`."""
    told = False
    for item in items:
        if not told and not isinstance(item, BadFrame):
            tell_if_compiling(config, rgb_only)
            told = True
        yield item
