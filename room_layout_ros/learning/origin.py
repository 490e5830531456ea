"""Where a model comes from, for its card: the date and the command that made it."""

from __future__ import annotations

import datetime
import os
import shlex
import sys


def origin() -> dict[str, str]:
    """Return the date (UTC) and the command line of this process.

    SOURCE_DATE_EPOCH, seconds since 1970, stands in for the clock where a file has to come out the same another day
    (reproducible-builds.org).
    """
    epoch = os.environ.get("SOURCE_DATE_EPOCH")
    utc = datetime.timezone.utc
    now = datetime.datetime.now(utc) if epoch is None else datetime.datetime.fromtimestamp(int(epoch), utc)
    return {"date": now.date().isoformat(), "command": f"room-layout {shlex.join(sys.argv[1:])}"}
