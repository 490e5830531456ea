"""Small files in the forms in which NYU v2, its layouts and its mapping of classes were published."""

from __future__ import annotations

from pathlib import Path
from typing import Any

import numpy as np
from numpy.typing import NDArray

from room_layout_ros.core.layout import RoomCuboid
from room_layout_ros.datasets.nyu import NYU_CAMERA

SIZE = (NYU_CAMERA.height, NYU_CAMERA.width)

ROOMS = tuple(
    RoomCuboid(np.eye(3), np.array(distances))
    for distances in ([1.3, 1.2, 1.5, 3.0, 1.4], [1.1, 1.4, 2.0, 4.0, 1.2], [1.2, 1.2, 1.0, 2.5, 2.0])
)
"""All five faces of each are in view."""


def true_layouts() -> NDArray[np.uint8]:
    """Return (3, 480, 640), the layouts of `ROOMS`."""
    return np.stack([room.raster(NYU_CAMERA) for room in ROOMS])


def write_mat(path: Path, fields: dict[str, NDArray[Any]], version: str) -> Path:
    """Write fields, in MATLAB's order of dimensions, as "5", "7.3" or "npz"."""
    if version == "npz":
        np.savez_compressed(path, allow_pickle=False, **fields)
    elif version == "5":
        from scipy.io import savemat

        savemat(path, fields, do_compression=True)
    else:
        import h5py

        with h5py.File(path, "w", userblock_size=512) as file:
            for name, field in fields.items():
                file[name] = np.ascontiguousarray(field.T)
        with path.open("r+b") as raw:
            raw.write(b"MATLAB 7.3 MAT-file, Platform: GLNXA64")
    return path


def write_nyu(path: Path, rng: np.random.Generator, count: int, **fields: NDArray[Any]) -> dict[str, NDArray[Any]]:
    """Write a labelled file of `count` frames in HDF5; further fields are (count, H, W). Returns what is in it."""
    truth: dict[str, NDArray[Any]] = {
        "images": rng.integers(0, 256, (count, *SIZE, 3)).astype(np.uint8),
        "depths": rng.uniform(0.7, 9.9, (count, *SIZE)).astype(np.float32),
        "labels": rng.integers(0, 895, (count, *SIZE)).astype(np.uint16),
        **fields,
    }
    raw = truth["depths"].copy()
    raw[:, :50] = 0
    by_columns = {name: np.moveaxis(field, 0, -1) for name, field in (*truth.items(), ("rawDepths", raw))}
    write_mat(path, by_columns, "7.3")
    return truth
