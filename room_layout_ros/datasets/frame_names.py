"""Names of frames as people type them."""

from __future__ import annotations

from collections.abc import Collection, Sequence


def there_are(names: Sequence[str]) -> str:
    """Return which names there are, to stand behind one that is none."""
    if len(names) < 2:
        return f"its only frame is {names[0]}" if names else "it has none"
    return f"it has {len(names)}, {names[0]} to {names[-1]}"


def find_name(wanted: str, names: Collection[str]) -> str:
    """Return the name that is meant: itself, or the only one of the same number, "0059" for "59"; else as it came."""
    if wanted in names or not wanted.isdecimal():
        return wanted
    meant = [name for name in names if name.isdecimal() and int(name) == int(wanted)]
    return meant[0] if len(meant) == 1 else wanted
