"""The file of errors over C: what is written reads back, both kinds side by side; anything else is refused."""

from __future__ import annotations

import json
from pathlib import Path

import pytest

from room_layout_ros.datasets import DataError
from room_layout_ros.evaluation.c_curve import CCurve, CPoint, read_c_curve, update_c_curve

RGBD = (CPoint(100, 8.5, 13.0, 77.0), CPoint(1000, 8.25, 12.75, 77.5))
RGB = (CPoint(1000, 14.0, 24.0, 60.0),)


def test_training_with_and_without_depth_write_into_one_file(tmp_path: Path) -> None:
    path = tmp_path / "c_curve.json"
    update_c_curve(path, "rgbd", reversed(RGBD), "400 frames")
    assert read_c_curve(path) == CCurve(RGBD, (), (("rgbd", "400 frames"),))
    update_c_curve(path, "rgb", RGB, "300 frames")
    assert read_c_curve(path) == CCurve(RGBD, RGB, (("rgb", "300 frames"), ("rgbd", "400 frames")))
    update_c_curve(path, "rgbd", RGBD[:1], "again")
    assert read_c_curve(path) == CCurve(RGBD[:1], RGB, (("rgb", "300 frames"), ("rgbd", "again")))


def test_the_file_is_as_documented(tmp_path: Path) -> None:
    update_c_curve(tmp_path / "c.json", "rgb", RGB, "300 frames")
    content = json.loads((tmp_path / "c.json").read_text())
    row = {"C": 1000, "layout": 14.0, "labelling": 24.0, "mean_iou": 60.0}
    assert content == {"rgb": [row], "about": {"rgb": "300 frames"}}


def test_how_far_a_point_was_learned_is_kept_beside_it(tmp_path: Path) -> None:
    points = (CPoint(100, 8.5, 13.0, 77.0, 81.4, 0.9), CPoint(1000, 8.25, 12.75, 77.5))
    update_c_curve(tmp_path / "c.json", "rgbd", points, "")
    assert read_c_curve(tmp_path / "c.json").rgbd == points
    first, second = json.loads((tmp_path / "c.json").read_text())["rgbd"]
    assert (first["objective"], first["gap"]) == (81.4, 0.9)
    assert "gap" not in second


@pytest.mark.parametrize(
    ("text", "words"),
    (
        ("{", "no curve"),
        ("[]", "no curve"),
        ("{}", "no points"),
        ('{"rgbd": [{"C": 100, "layout": 8}]}', "labelling"),
        ('{"rgbd": [{"C": 0, "layout": 8, "labelling": 13, "mean_iou": 77}]}', "above 0"),
        ('{"rgbd": [{"C": 1, "layout": 8, "labelling": 130, "mean_iou": 77}]}', "0 to 100"),
        ('{"rgb": [{"C": 1, "layout": NaN, "labelling": 13, "mean_iou": 77}]}', "0 to 100"),
        ('{"rgb": [{"C": 1, "layout": 8, "labelling": 13, "mean_iou": 77, "gap": -1}]}', "0 or more"),
        ('{"rgb": [{"C": 1, "layout": 8, "labelling": 13, "mean_iou": 77, "gap": NaN}]}', "0 or more"),
        ('{"rgb": {"100": {"layout": 8}}}', "no curve"),
    ),
)
def test_what_is_no_curve_is_refused_in_a_sentence(tmp_path: Path, text: str, words: str) -> None:
    (tmp_path / "c.json").write_text(text)
    with pytest.raises(DataError, match=words):
        read_c_curve(tmp_path / "c.json")
