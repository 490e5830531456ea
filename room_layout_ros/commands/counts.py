"""Numbers on the command line: argparse refuses what is out of bounds, with the option's name and what is allowed."""

from __future__ import annotations

import argparse
import math
from collections.abc import Callable


def whole(low: int, high: int | None = None) -> Callable[[str], int]:
    """Return the `type` of an argparse option for whole numbers from `low` to `high` (None: any)."""
    allowed = f"{low} or more" if high is None else f"{low} to {high}"

    def parse(text: str) -> int:
        try:
            value = int(text)
        except ValueError:
            value = low - 1
        if value < low or (high is not None and value > high):
            raise argparse.ArgumentTypeError(f"{text!r} is given; it must be a whole number, {allowed}")
        return value

    return parse


def real(low: float, high: float = math.inf) -> Callable[[str], float]:
    """Return the `type` of an argparse option for finite numbers from `low` to `high` (inf: any)."""
    allowed = f"{low:g} or more" if math.isinf(high) else f"{low:g} to {high:g}"

    def parse(text: str) -> float:
        try:
            value = float(text)
        except ValueError:
            value = math.nan
        if not (low <= value <= high and math.isfinite(value)):
            raise argparse.ArgumentTypeError(f"{text!r} is given; it must be a number, {allowed}")
        return value

    return parse


count = whole(1)
"""Of an option that counts something."""

seed = whole(0)
"""Of an option that seeds a generator."""


def add_jobs_argument(parser: argparse.ArgumentParser) -> None:
    """Add the option that says how many processes of this machine work."""
    parser.add_argument("--jobs", type=count, default=1, metavar="N", help="local processes (default %(default)s)")


def add_work_arguments(parser: argparse.ArgumentParser) -> None:
    """Add the options that say where the work is done."""
    add_jobs_argument(parser)
    parser.add_argument("--scheduler", metavar="ADDRESS", help="Dask scheduler, tcp://host:port, instead of --jobs")
