"""Numbers on the command line that count something."""

from __future__ import annotations

import argparse


def count(text: str) -> int:
    """Return a whole number of 1 or more: the `type` of an argparse option."""
    try:
        value = int(text)
    except ValueError:
        value = 0
    if value < 1:
        raise argparse.ArgumentTypeError(f"{text!r} is given; it must be a whole number, 1 or more")
    return value


def add_work_arguments(parser: argparse.ArgumentParser) -> None:
    """Add the options that say where the work is done."""
    parser.add_argument("--jobs", type=count, default=1, metavar="N", help="local processes (default %(default)s)")
    parser.add_argument("--scheduler", metavar="ADDRESS", help="Dask scheduler, tcp://host:port, instead of --jobs")
