"""Where a model comes from, for its card: the date and the command that made it."""

from __future__ import annotations

import datetime
import os
import shlex
import sys
from collections.abc import Iterable
from pathlib import PurePath


def origin() -> dict[str, str]:
    """Return the date (UTC) and the command line of this process, of paths in it the last part.

    SOURCE_DATE_EPOCH, seconds since 1970, stands in for the clock where a file has to come out the same another day
    (reproducible-builds.org).
    """
    epoch = os.environ.get("SOURCE_DATE_EPOCH")
    utc = datetime.timezone.utc
    now = datetime.datetime.now(utc) if epoch is None else datetime.datetime.fromtimestamp(int(epoch), utc)
    return {"date": now.date().isoformat(), "command": f"room-layout {shlex.join(without_folders(sys.argv[1:]))}"}


def without_folders(words: Iterable[str]) -> list[str]:
    """Return words of a command line, of each path its last part: where it lay is nobody else's business."""
    parts = (word.rpartition("=") for word in words)
    return [f"{option}{equals}{_last(value)}" for option, equals, value in parts]


def _last(word: str) -> str:
    return word if "://" in word else PurePath(word).name or word
