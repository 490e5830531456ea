"""What was published apart from the NYU v2 file: true layouts of some frames, and the 40 classes of its 894.

The layouts of Zhang, Kan, Schwing and Urtasun (ICCV 2013) are an array of face ids with the images' numbers. Programs
that read them (PlaneNet, NonCuboidRoom) show two forms: `index` as image numbers from 1 with `layout`, and `index` as a
mask over all images with `layout_GT`, each field in a file of its own, `train` and `test` counting the layouts from 1.
Both have 1 ceiling, 2 floor, 3 left, 4 front, 5 right.
"""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from dataclasses import dataclass
from pathlib import Path
from typing import Any

import numpy as np
from numpy.typing import NDArray

from room_layout_ros.core.labels import CEILING, FACES, FLOOR, FRONT_WALL, LABEL_NAMES, LEFT_WALL, N_FACES, RIGHT_WALL

from .errors import DataError
from .mat_fields import Fields, read_fields
from .sample import MAX_NYU40

LAYOUT_FIELDS = ("layout", "layout_GT")
SPLIT_FIELDS = ("train", "test")
CLASS_FIELD = "mapClass"
NOT_ANNOTATED = (-1, 0)
"""Ids of pixels without a face."""

_STRIDE = 8
"""Where faces lie is judged on every eighth row and column."""

_ABOVE = tuple((CEILING, wall) for wall in (LEFT_WALL, FRONT_WALL, RIGHT_WALL)) + tuple(
    (wall, FLOOR) for wall in (LEFT_WALL, FRONT_WALL, RIGHT_WALL)
)
_LEFT_OF = ((LEFT_WALL, FRONT_WALL), (FRONT_WALL, RIGHT_WALL), (LEFT_WALL, RIGHT_WALL))


@dataclass(frozen=True, slots=True)
class NyuLayouts:
    """True layouts of some frames.

    Attributes
    ----------
    numbers : (N,) numbers of the frames from 1, ascending.
    faces : (N, H, W) uint8 ids 1..5, 0 where not annotated.
    splits : numbers of the frames of a published list (train, test) by its name.
    """

    numbers: tuple[int, ...]
    faces: NDArray[np.uint8]
    splits: Mapping[str, tuple[int, ...]]

    def of(self, number: int) -> NDArray[np.uint8] | None:
        """Return the layout (H, W) of a frame, None where it has none."""
        return self.faces[self.numbers.index(number)] if number in self.numbers else None


def read_layouts(paths: Sequence[Path], face_ids: Sequence[int] = FACES) -> NyuLayouts:
    """Read published layouts from one file, or from several that hold a field each.

    Parameters
    ----------
    paths : sequence of Path
        MATLAB files of version 5 or 7.3, or .npz. Fields: `index` (N numbers from 1, or a mask over all frames with N
        set) and `layout` or `layout_GT` (H x W x N), perhaps `train` and `test` (positions among the N, from 1).
    face_ids : sequence of 5 int
        The files' ids of ceiling, floor, left, front and right wall; -1 and 0 are "not annotated".

    Raises
    ------
    DataError
        When a field is missing or does not fit the others, an id is unknown, or the faces do not lie in the images as
        their names say.
    """
    if len(set(face_ids)) != N_FACES or set(face_ids) & set(NOT_ANNOTATED) or min(face_ids) < 0 or max(face_ids) > 254:
        raise DataError(f"face ids are {list(face_ids)}; five different ones of 1 to 254 are needed")
    where = ", ".join(map(str, paths))
    fields: Fields = {}
    for path in paths:
        fields |= read_fields(path, ("index", *LAYOUT_FIELDS, *SPLIT_FIELDS))
    layout = next((fields[name] for name in LAYOUT_FIELDS if name in fields), None)
    if layout is None or "index" not in fields:
        raise DataError(f"{where}: the fields index and layout are needed; found are {sorted(fields) or 'none'}")
    if layout.ndim == 2:  # MATLAB drops a last dimension of one
        layout = layout[..., None]
    if layout.ndim != 3:
        raise DataError(f"{where}: layout has shape {layout.shape}; H x W x N is needed")
    numbers = _numbers(fields["index"], layout.shape[2], where)
    faces = np.stack([_faces(layout[..., i], face_ids, f"{where}, image {n}") for i, n in enumerate(numbers)])
    _check_places(faces, where)
    splits = {name: _split(fields[name], name, numbers, where) for name in SPLIT_FIELDS if name in fields}
    order = np.argsort(numbers)
    return NyuLayouts(tuple(numbers[i] for i in order), faces[order], splits)


def read_class_map(path: Path) -> NDArray[np.uint8]:
    """Return (K + 1,) uint8: the NYU40 class of each of the file's K classes (894); entry 0, unlabelled, is 0.

    Raises
    ------
    DataError
        When the file has no field `mapClass`, or an entry is no NYU40 class.
    """
    fields = read_fields(path, (CLASS_FIELD,))
    if CLASS_FIELD not in fields:
        raise DataError(f"{path} has no field {CLASS_FIELD}; the published table of 894 classes to 40 is needed")
    classes = _integers(fields[CLASS_FIELD], f"{path}: {CLASS_FIELD}")
    if not len(classes) or classes.min() < 0 or classes.max() > MAX_NYU40:
        raise DataError(f"{path}: {CLASS_FIELD} must hold NYU40 classes, 0 to {MAX_NYU40}")
    return np.concatenate([[0], classes]).astype(np.uint8)


def _integers(field: NDArray[Any], what: str) -> NDArray[np.int64]:
    values = field.ravel()
    if not (np.isfinite(values) & (values == np.floor(values))).all():
        raise DataError(f"{what} must hold whole numbers")
    return values.astype(np.int64)


def _numbers(index: NDArray[Any], count: int, where: str) -> list[int]:
    """Return the number of each of `count` layouts, in their order."""
    values = _integers(index, f"{where}: index")
    if len(values) != count and np.isin(values, (0, 1)).all() and values.sum() == count:
        values = np.flatnonzero(values) + 1
    if len(values) != count:
        raise DataError(f"{where}: index names {len(values)} images and layout holds {count}; they must agree")
    if values.min() < 1 or len(set(values.tolist())) != count:
        raise DataError(f"{where}: index must hold different image numbers, counted from 1")
    return values.tolist()


def _faces(image: NDArray[Any], face_ids: Sequence[int], where: str) -> NDArray[np.uint8]:
    ids = _integers(image, where).reshape(image.shape)
    table = np.full(257, 255, np.uint8)
    table[1 + np.array(NOT_ANNOTATED)] = 0
    table[1 + np.array(face_ids)] = FACES
    faces = table[1 + np.clip(ids, -1, 255)]
    if (faces == 255).any() or ids.min() < -1:
        wrong = int(ids[(faces == 255) | (ids < -1)][0])
        named = ", ".join(map(str, face_ids))
        raise DataError(f"{where}: layout holds id {wrong}; faces are {named} and 0 is not annotated (see --face-ids)")
    return faces


def _check_places(faces: NDArray[np.uint8], where: str) -> None:
    """Refuse layouts whose faces, on average, lie elsewhere than their names say: ids of another order."""
    coarse = faces[:, ::_STRIDE, ::_STRIDE]
    rows, columns = np.full(N_FACES + 1, np.nan), np.full(N_FACES + 1, np.nan)
    for face in FACES:
        _, y, x = np.nonzero(coarse == face)
        if len(y):
            rows[face], columns[face] = y.mean(), x.mean()
    for pairs, place, words in ((_ABOVE, rows, "below"), (_LEFT_OF, columns, "right of")):
        for first, second in pairs:
            if place[first] > place[second]:
                raise DataError(
                    f"{where}: what the ids call {LABEL_NAMES[first]} lies {words} what they call "
                    f"{LABEL_NAMES[second]}; give the ids of ceiling, floor, left, front, right by --face-ids"
                )


def _split(field: NDArray[Any], name: str, numbers: Sequence[int], where: str) -> tuple[int, ...]:
    positions = _integers(field, f"{where}: {name}")
    if len(positions) and (positions.min() < 1 or positions.max() > len(numbers)):
        raise DataError(f"{where}: {name} must count the {len(numbers)} layouts from 1")
    return tuple(sorted(numbers[p - 1] for p in positions.tolist()))
