"""What every source raises when its input cannot be used."""

from __future__ import annotations


class DataError(ValueError):
    """Input that cannot be used; the message is one sentence for people: what, where, and what is allowed."""
