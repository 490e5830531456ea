"""A fingerprint of values: what tells one learning problem from another on disk and in the memory of workers."""

from __future__ import annotations

import dataclasses
import hashlib
from collections.abc import Mapping
from typing import Any, Protocol

import numpy as np


class _Hash(Protocol):
    def update(self, content: bytes, /) -> None:
        """Take in more bytes."""


def fingerprint(*values: object) -> str:
    """Return the SHA-256 of what the values hold, as 64 hexadecimal digits.

    The same on every machine and in every process: only contents count, not identities or how a pickle is laid out.

    Parameters
    ----------
    values : numbers, texts, None, arrays, functions (by their name), dataclasses, tuples, lists and mappings of such.

    Raises
    ------
    TypeError
        When a value is of another kind.
    """
    digest = hashlib.sha256()
    _take(digest, values)
    return digest.hexdigest()


def _take(digest: _Hash, value: Any) -> None:
    # Every value starts with its kind and, where it may vary, its length: nothing can pass for something else.
    if isinstance(value, np.ndarray | np.generic):
        digest.update(f"array {value.dtype.str} {value.shape}:".encode())
        digest.update(np.ascontiguousarray(value).tobytes())
    elif value is None or isinstance(value, bool | int | float | str | bytes):
        text = repr(value)
        digest.update(f"{type(value).__name__} {len(text)}:{text}".encode())
    elif isinstance(value, tuple | list):
        digest.update(f"sequence {len(value)}:".encode())
        for one in value:
            _take(digest, one)
    elif isinstance(value, Mapping):
        _take(digest, sorted(value.items()))
    elif dataclasses.is_dataclass(value) and not isinstance(value, type):
        _take(digest, (type(value).__qualname__, [getattr(value, f.name) for f in dataclasses.fields(value)]))
    elif hasattr(value, "__qualname__"):
        _take(digest, f"{value.__module__}.{value.__qualname__}")
    else:
        raise TypeError(f"a {type(value).__name__} has no fingerprint; arrays, dataclasses and plain values have")
