"""Names of frames as people type them."""

from __future__ import annotations

from collections.abc import Iterable


def did_you_mean(wanted: str, names: Iterable[str]) -> str:
    """Return "; did you mean '0059'?" for a wanted "59" where there is such a name, else nothing."""
    meant = next((name for name in names if _without_zeros(name) == _without_zeros(wanted)), None)
    return "" if meant is None else f"; did you mean {meant!r}?"


def _without_zeros(name: str) -> str:
    return name.strip().lstrip("0") or "0"
