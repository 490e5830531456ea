"""The file of any learned model: .npz, never pickle, checked before anything is believed.

A model file is a zip of .npy arrays and one member `card.json` with kind, schema version, SHA-256 of the arrays and
whatever the trainer wrote about data, date and command. The same arrays give the same bytes.
"""

from __future__ import annotations

import hashlib
import io
import json
import zipfile
import zlib
from collections.abc import Mapping
from pathlib import Path
from typing import Any

import numpy as np
from numpy.typing import NDArray

SCHEMA_VERSION = 1
MAX_FILE_BYTES = 64 << 20
MAX_ARRAY_BYTES = 128 << 20
"""All arrays unpacked; a zip bomb is refused by its table of contents."""
MAX_MEMBERS = 256
_CARD = "card.json"


class WeightsError(ValueError):
    """A model file that cannot be used; the message says why in one sentence."""


def write_arrays(path: Path, kind: str, arrays: Mapping[str, NDArray[Any]], card: Mapping[str, Any]) -> None:
    """Write named arrays with a card; the same content gives the same bytes.

    Parameters
    ----------
    path : Path
    kind : str
        What the file is, checked on reading.
    arrays : name to array; numbers or booleans without NaN.
    card : JSON values about the arrays.

    Raises
    ------
    WeightsError
        When an array holds a value that is not finite: `read_arrays` would refuse the file.
    """
    for name, array in arrays.items():
        if array.dtype.kind == "f" and not np.isfinite(array).all():
            raise WeightsError(f"array {name!r} for {path} holds a value that is not finite; nothing is written")
    members = {name: _npy(arrays[name]) for name in sorted(arrays)}
    whole = {**card, "kind": kind, "schema": SCHEMA_VERSION, "sha256": _digest(members)}
    text = json.dumps(whole, sort_keys=True, indent=1, allow_nan=False).encode()
    with zipfile.ZipFile(path, "w", zipfile.ZIP_DEFLATED) as archive:
        for name, content in [(_CARD, text), *((f"{name}.npy", content) for name, content in members.items())]:
            info = zipfile.ZipInfo(name, date_time=(1980, 1, 1, 0, 0, 0))
            info.compress_type = zipfile.ZIP_DEFLATED
            archive.writestr(info, content)


def read_arrays(path: Path, kind: str) -> tuple[dict[str, NDArray[Any]], dict[str, Any]]:
    """Read named arrays and their card, checking sizes before anything is unpacked.

    Raises
    ------
    WeightsError
        When the file is missing, cut, too large, of another kind or version, changed, or holds a non-finite array.
    """
    members = _read_members(path)
    try:
        card = json.loads(members.pop(_CARD))
    except (KeyError, ValueError, RecursionError):
        raise WeightsError(f"{path} has no readable {_CARD}; it is no model file of this package") from None
    if not isinstance(card, dict) or card.get("kind") != kind:
        found = card.get("kind") if isinstance(card, dict) else None
        raise WeightsError(f"{path} is of kind {str(found)[:80]!r}; {kind!r} is needed")
    if card.get("schema") != SCHEMA_VERSION:
        raise WeightsError(
            f"{path} has schema version {str(card.get('schema'))[:20]}; version {SCHEMA_VERSION} is needed"
        )
    contents = {name.removesuffix(".npy"): content for name, content in members.items()}
    if card.get("sha256") != _digest(contents):
        raise WeightsError(f"the arrays of {path} do not match their SHA-256; the file was changed or damaged")
    arrays = {name: _parse(path, name, content) for name, content in contents.items()}
    card = {key: value for key, value in card.items() if key not in ("kind", "schema", "sha256")}
    return arrays, card


def _read_members(path: Path) -> dict[str, bytes]:
    try:
        size = path.stat().st_size
        if size > MAX_FILE_BYTES:
            raise WeightsError(f"{path} has {size} bytes; at most {MAX_FILE_BYTES} are read")
        with zipfile.ZipFile(path) as archive:
            entries = archive.infolist()
            total = sum(entry.file_size for entry in entries)
            if len(entries) > MAX_MEMBERS or total > MAX_ARRAY_BYTES:
                raise WeightsError(
                    f"{path} unpacks to {len(entries)} members of {total} bytes; "
                    f"allowed are {MAX_MEMBERS} of {MAX_ARRAY_BYTES}"
                )
            members: dict[str, bytes] = {}
            for entry in entries:
                with archive.open(entry) as stream:
                    members[entry.filename] = stream.read(entry.file_size + 1)
                if len(members[entry.filename]) != entry.file_size:
                    raise WeightsError(f"member {entry.filename[:80]!r} of {path} is not as long as it says")
            return members
    except OSError as error:
        raise WeightsError(f"{path} cannot be read: {error.strerror or error}") from None
    except (
        zipfile.BadZipFile,
        zipfile.LargeZipFile,
        NotImplementedError,
        RuntimeError,
        EOFError,
        ValueError,
        zlib.error,
    ) as error:
        if isinstance(error, WeightsError):
            raise
        raise WeightsError(f"{path} is cut or no .npz file: {str(error)[:80]}") from None


def _parse(path: Path, name: str, content: bytes) -> NDArray[Any]:
    try:
        array: NDArray[Any] = np.load(io.BytesIO(content), allow_pickle=False)
    except (ValueError, OSError, EOFError, SyntaxError, MemoryError):
        raise WeightsError(
            f"array {name[:80]!r} of {path} is no plain .npy array (pickled objects are refused)"
        ) from None
    if not isinstance(array, np.ndarray) or array.dtype.kind not in "fiub":
        raise WeightsError(
            f"array {name[:80]!r} of {path} has type {getattr(array, 'dtype', type(array))}; numbers are needed"
        )
    if array.dtype.kind == "f" and not np.isfinite(array).all():
        raise WeightsError(f"array {name[:80]!r} of {path} holds a value that is not finite")
    return array


def _npy(array: NDArray[Any]) -> bytes:
    stream = io.BytesIO()
    np.lib.format.write_array(stream, np.ascontiguousarray(array), allow_pickle=False)
    return stream.getvalue()


def _digest(members: Mapping[str, bytes]) -> str:
    digest = hashlib.sha256()
    for name in sorted(members):
        digest.update(name.encode() + b"\0" + len(members[name]).to_bytes(8, "little") + members[name])
    return digest.hexdigest()
