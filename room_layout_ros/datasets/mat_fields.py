"""Named fields of a MATLAB file (version 5, or 7.3, which is HDF5) or of an .npz, with MATLAB's order of dimensions."""

from __future__ import annotations

import zipfile
import zlib
from collections.abc import Collection
from pathlib import Path
from typing import Any

import numpy as np
from numpy.typing import NDArray

from room_layout_ros.extras import install_hint

from .errors import DataError

_HDF5_SIGNATURE = b"\x89HDF\r\n\x1a\n"
_SIGNATURE_OFFSETS = (0, 512)
"""MATLAB 7.3 writes 512 bytes of its own before the HDF5 file."""

_DAMAGE = (
    OSError, EOFError, ValueError, TypeError, KeyError, RuntimeError, MemoryError, zlib.error, zipfile.BadZipFile,
)  # fmt: skip
"""What readers raise at a file that is not theirs."""

Fields = dict[str, NDArray[Any]]


def is_hdf5(path: Path) -> bool:
    """Whether a file starts as HDF5, alone or behind MATLAB's header."""
    with path.open("rb") as file:
        head = file.read(_SIGNATURE_OFFSETS[-1] + len(_HDF5_SIGNATURE))
    return any(head[at : at + len(_HDF5_SIGNATURE)] == _HDF5_SIGNATURE for at in _SIGNATURE_OFFSETS)


def open_hdf5(path: Path) -> Any:
    """Open an HDF5 file for reading.

    Raises
    ------
    DataError
        When it is none, or cut.
    ModuleNotFoundError
        When h5py is not installed.
    """
    try:
        import h5py
    except ImportError:
        raise ModuleNotFoundError(f".mat files need h5py: {install_hint('datasets')}", name="h5py") from None
    try:
        return h5py.File(path, "r")
    except OSError:
        raise DataError(f"{path} is no HDF5 file (a MATLAB file of version 7.3 is needed), or it is cut") from None


def read_fields(path: Path, names: Collection[str]) -> Fields:
    """Return those of the named numeric fields that a file holds.

    Raises
    ------
    DataError
        When the file is missing, of no known format, or damaged, or a field is not numeric.
    """
    if not path.is_file():
        raise DataError(f"{path} is missing; a .mat or .npz file is needed")
    try:
        if path.suffix.lower() == ".npz":
            fields = _from_npz(path, names)
        else:
            fields = _from_hdf5(path, names) if is_hdf5(path) else _from_version_5(path, names)
    except _DAMAGE as error:
        if isinstance(error, DataError):
            raise
        raise DataError(f"{path} is neither a MATLAB file nor an .npz, or it is damaged: {error}") from None
    for name, field in fields.items():
        if field.dtype.kind not in "biuf":
            raise DataError(f"{path}: {name} is of type {field.dtype}; numbers are needed")
    return fields


def _from_npz(path: Path, names: Collection[str]) -> Fields:
    # NumPy leaves a damaged file open when it opened it itself.
    with path.open("rb") as raw, np.load(raw, allow_pickle=False) as file:
        return {name: file[name] for name in names if name in file}


def _from_hdf5(path: Path, names: Collection[str]) -> Fields:
    with open_hdf5(path) as file:
        return {name: file[name][()].T for name in names if name in file}  # HDF5 sees MATLAB's dimensions reversed


def _from_version_5(path: Path, names: Collection[str]) -> Fields:
    from scipy.io import loadmat
    from scipy.io.matlab import MatReadError

    try:
        content = loadmat(path, variable_names=list(names))
    except MatReadError as error:
        raise ValueError(str(error)) from None
    return {name: content[name] for name in names if name in content}
