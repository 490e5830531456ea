"""Names of frames as people type them."""

from __future__ import annotations

from collections.abc import Collection


def find_name(wanted: str, names: Collection[str]) -> str:
    """Return the name that is meant: itself, or the only one of the same number, "0059" for "59"; else as it came."""
    if wanted in names or not wanted.isdecimal():
        return wanted
    meant = [name for name in names if name.isdecimal() and int(name) == int(wanted)]
    return meant[0] if len(meant) == 1 else wanted
