"""Text of unknown origin, made fit for a log line."""

from __future__ import annotations

MAX_SHOWN = 40
MAX_NAME = 120
"""Of a ROS name: a full topic name with its namespaces is shown whole."""
_MAX_READ = 4 * MAX_SHOWN


def clean_text(text: object, limit: int = MAX_SHOWN) -> str:
    """Return at most `limit` printable ASCII characters of `text`, in quotes.

    Everything else (control characters, escape sequences, other alphabets) becomes "?"; a cut is marked by "...".
    Only the start is read, so ten megabytes cost no more than ten characters.
    """
    if not isinstance(text, str):
        return f"a {type(text).__name__}"[:limit]
    shown = "".join(c if " " <= c <= "~" else "?" for c in text[:_MAX_READ])
    if len(shown) > limit:
        shown = shown[: limit - 3] + "..."
    return f"'{shown}'"
