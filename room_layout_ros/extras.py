"""The sentence for what comes with an extra of setup.py and is not installed."""

from __future__ import annotations


def install_hint(extra: str) -> str:
    """Return how to install an extra; the package is on no index, so it is from the clone."""
    return f"pip install '.[{extra}]' in the clone of room_layout_ros"
