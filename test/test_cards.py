"""Every model that ships says what it was learned from, when, by which command, and how good it was on other frames."""

from __future__ import annotations

import json
import re
import zipfile
from pathlib import Path
from typing import Any

import pytest

from room_layout_ros.learning.origin import without_folders

MODELS = sorted((Path(__file__).resolve().parent.parent / "config").glob("*.npz"))
TRAINED = ("context", "joint")
"""Kinds whose training cross-validates."""
OLDER = {
    "context_rgb_plain": {"command", "cross_validation"},
    "context_rgbd_plain": {"command", "cross_validation"},
    "furniture_rgb_plain": {"command"},
    "furniture_rgbd_plain": {"command"},
    "joint_rgb_plain": {"date"},
    "joint_rgbd_plain": {"date"},
}
"""What cards of models lack that were made before the commands wrote it down; training them anew fills it in."""


def card_of(path: Path) -> dict[str, Any]:
    with zipfile.ZipFile(path) as archive:
        card = json.loads(archive.read("card.json"))
    assert isinstance(card, dict)
    return card


def missing(kind: str, card: dict[str, Any]) -> set[str]:
    """Return what a card does not tell."""
    told = {
        "data": bool(card.get("data") or card.get("source")),
        "date": re.fullmatch(r"\d{4}-\d\d-\d\d", str(card.get("date"))) is not None,
        "command": str(card.get("command")).startswith("room-layout "),
        "frames": isinstance(card.get("frames"), int) and card["frames"] > 0,
        "sha256": re.fullmatch(r"[0-9a-f]{64}", str(card.get("sha256"))) is not None,
        "cross_validation": kind not in TRAINED or bool(card.get("cross_validation")),
    }
    return {name for name, there in told.items() if not there}


@pytest.mark.parametrize("path", MODELS, ids=lambda path: path.stem)
def test_a_shipped_model_says_where_it_comes_from(path: Path) -> None:
    lacks = missing(path.stem.split("_")[0], card_of(path))
    if lacks and lacks == OLDER.get(path.stem):
        pytest.skip(f"{path.name} is older than this rule; its card lacks {', '.join(sorted(lacks))}")
    assert lacks == set()


@pytest.mark.parametrize("path", MODELS, ids=lambda path: path.stem)
def test_a_card_names_no_folder_of_the_machine_it_was_made_on(path: Path) -> None:
    assert not re.search(r"(/tmp|/work|/home|\.\./)", json.dumps(card_of(path)))


def test_the_curve_names_no_folder_of_the_machine_it_was_made_on() -> None:
    about = json.loads((MODELS[0].parent / "c_curve.json").read_text("utf-8"))["about"]
    assert about
    assert not re.search(r"(/tmp|/work|/home|\.\./)", json.dumps(about))


def test_paths_in_a_command_are_written_by_their_last_part() -> None:
    words = ["train", "/work/shared/nyuv2/", "--fits=../w/fits", "--set", "a=0.5", "--scheduler", "tcp://h:1", "/"]
    short = ["train", "nyuv2", "--fits=fits", "--set", "a=0.5", "--scheduler", "tcp://h:1", "/"]
    assert without_folders(words) == short


def test_models_are_there_to_look_at() -> None:
    assert len(MODELS) >= 8


def test_each_thing_a_card_can_lack_is_found() -> None:
    whole = {
        "data": "nyuv2", "date": "2026-11-27", "command": "room-layout train x", "frames": 3, "sha256": 64 * "a",
        "cross_validation": [{"layout": 8.0}],
    }  # fmt: skip
    assert missing("joint", whole) == set()
    for name in whole:
        assert missing("joint", {key: value for key, value in whole.items() if key != name}) == {name}
    assert missing("joint", {**whole, "cross_validation": []}) == {"cross_validation"}
    assert missing("context", {**whole, "command": "train_context()"}) == {"command"}
    assert missing("furniture", {key: value for key, value in whole.items() if key != "cross_validation"}) == set()
