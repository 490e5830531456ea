"""Progress bars where there is a person to look at them."""

from __future__ import annotations

import sys
from collections.abc import Callable, Iterator
from contextlib import contextmanager


@contextmanager
def progress_bar(what: str, total: int | None, unit: str = "frame") -> Iterator[Callable[[int], object]]:
    """Give a function that takes the count so far; it draws on a terminal and is silent elsewhere."""
    if not sys.stderr.isatty():
        yield lambda _count: None
        return
    try:
        from tqdm import tqdm
    except ImportError:
        yield lambda _count: None
        return
    with tqdm(total=total, desc=what, unit=unit, dynamic_ncols=True) as bar:
        yield lambda count: bar.update(count - bar.n)
