"""Furniture classes on clutter superpixels: painted by id, kept in a file, refused when wrong."""

from __future__ import annotations

from pathlib import Path

import numpy as np
import pytest

from room_layout_ros.core.config import EstimatorConfig
from room_layout_ros.core.evidence.features import SuperpixelFeatures
from room_layout_ros.core.forest import Forest
from room_layout_ros.core.furniture import (
    FurnitureModel,
    classify_furniture,
    group_furniture,
    load_furniture,
    paint_furniture,
    save_furniture,
)
from room_layout_ros.core.labels import FURNITURE_IDS
from room_layout_ros.core.model_file import WeightsError
from room_layout_ros.core.superpixels import compute_superpixels


def _stump(outputs: int = 7) -> Forest:
    """Rows with feature 0 above 0.5 are beds (output 1), the others anything else."""
    return Forest(
        np.array([0, -1, -1], np.int16),
        np.array([0.5, 0.0, 9.0], np.float32),
        np.array([True, False, False]),
        np.array([1, 0, 0], np.int16),
        np.array([2, 0, 0], np.int16),
        np.array([0], np.int32),
        np.array([1], np.int16),
        np.append(np.zeros(outputs - 1), 4.0).astype(np.float32),
    )


def test_classes_are_painted_on_clutter_only() -> None:
    color = np.random.default_rng(0).integers(0, 255, (60, 80, 3), dtype=np.uint8)
    superpixels = compute_superpixels(color, None, EstimatorConfig(superpixel_count=16))
    values = (np.arange(superpixels.count) % 2).astype(np.float32)[:, None]
    probability = classify_furniture(SuperpixelFeatures(values, ("a",)), FurnitureModel(("a",), _stump()))
    assert np.allclose(probability.sum(axis=1), 1.0)
    labels = np.full(superpixels.count, 6, np.uint8)
    labels[1] = 4
    image = paint_furniture(superpixels, labels, probability)
    painted = np.array([image[superpixels.index == i][0] for i in range(superpixels.count)])
    assert painted[0] == 0
    assert painted[1] == 0
    assert (painted[3::2] == FURNITURE_IDS[1]).all()
    assert FURNITURE_IDS[1] == 4


def test_one_odd_piece_of_a_thing_follows_the_rest_and_structure_does_not() -> None:
    color = np.full((60, 80, 3), 120, np.uint8)
    color[:, 40:] = (20, 30, 200)  # another thing
    superpixels = compute_superpixels(color, None, EstimatorConfig(superpixel_count=24))
    left = superpixels.center_px[:, 0] < 40
    probability = np.where(left[:, None], np.eye(7)[1] * 0.5, np.eye(7)[4] * 0.5) + 0.5 / 7
    odd = int(np.argmin(np.abs(superpixels.center_px - [20, 30]).sum(axis=1)))
    probability[odd] = np.eye(7)[2] * 0.3 + 0.1
    clutter = np.ones(superpixels.count, bool)
    grouped = group_furniture(superpixels, clutter, probability)
    assert np.allclose(grouped.sum(axis=1), 1.0, atol=1e-6)
    assert grouped[odd].argmax() == 1
    assert (grouped[left].argmax(axis=1) == 1).all()
    assert (grouped[~left].argmax(axis=1) == 4).all()
    clutter[odd] = False
    alone = group_furniture(superpixels, clutter, probability)
    assert alone[odd].argmax() == 2
    ratio = alone[odd, :6] / probability[odd, :6]  # nobody changed its mind; only "anything else" is less likely
    assert np.allclose(ratio, ratio[0])
    assert alone[odd, 6] / probability[odd, 6] < ratio[0]


def test_model_survives_its_file_and_damage_is_refused(tmp_path: Path) -> None:
    path = tmp_path / "f.npz"
    save_furniture(FurnitureModel(("a",), _stump(), {"note": "stump"}), path)
    assert load_furniture(path).card["note"] == "stump"
    assert load_furniture(path).names == ("a",)
    path.write_bytes(path.read_bytes()[:-40])
    with pytest.raises(WeightsError):
        load_furniture(path)


def test_wrong_number_of_outputs_is_refused() -> None:
    with pytest.raises(ValueError, match="5 outputs"):
        FurnitureModel(("a",), _stump(5))
