"""A folder given by --models: whether what the settings use of it is one's own at all."""

from __future__ import annotations

from pathlib import Path

import pytest

from room_layout_ros.commands.models_folder import usable_models
from room_layout_ros.core.config import EstimatorConfig
from room_layout_ros.core.models import config_folder
from room_layout_ros.core.weights import save_weights, start_weights


def copied(folder: Path, own: tuple[str, ...]) -> Path:
    """A copy of the shipped models in which the weights of these names are those set by hand."""
    folder.mkdir()
    for path in config_folder().glob("*.npz"):
        (folder / path.name).symlink_to(path.resolve())
    for name in own:
        (folder / name).unlink()
        save_weights(start_weights().variant("no_scene" if "plain" in name else "full"), folder / name)
    return folder


PLAIN = EstimatorConfig(scene_network=False)
RGB = EstimatorConfig(use_depth=False)


@pytest.mark.parametrize(
    ("own", "config", "words"),
    (
        (
            ("joint_rgbd_plain.npz",),
            EstimatorConfig(),
            "_plain.npz of your own need other settings, --set scene_network=false\n",
        ),
        (("joint_rgb_plain.npz", "joint_rgbd_plain.npz"), RGB, "joint_rgb_plain.npz and 1 more of your own"),
        (("joint_rgbd.npz",), PLAIN, "joint_rgbd.npz of your own need other settings\n"),
        (("joint_rgb.npz",), EstimatorConfig(), "joint_rgb.npz of your own need other settings\n"),
    ),
)
def test_models_of_ones_own_that_no_setting_uses_are_told_in_one_line(
    own: tuple[str, ...],
    config: EstimatorConfig,
    words: str,
    tmp_path: Path,
    capsys: pytest.CaptureFixture[str],
) -> None:
    folder = copied(tmp_path / "models", own)
    assert usable_models(folder, config) == folder
    said = capsys.readouterr().err
    assert said.startswith(f"--models {folder}: with these settings all models used are those that ship; ")
    assert words in said
    assert said.count("\n") == 1


@pytest.mark.parametrize(
    ("own", "config", "also_rgb"),
    (
        ((), EstimatorConfig(), False),
        (("joint_rgbd.npz", "joint_rgb_plain.npz"), EstimatorConfig(), False),
        (("joint_rgbd_plain.npz",), PLAIN, False),
        (("joint_rgbd_plain.npz",), EstimatorConfig(use_color=False), False),
        (("joint_rgb.npz",), RGB, False),
        (("joint_rgb.npz",), EstimatorConfig(), True),
    ),
)
def test_nothing_is_told_where_a_model_of_ones_own_is_used_or_there_is_none(
    own: tuple[str, ...], config: EstimatorConfig, also_rgb: bool, tmp_path: Path, capsys: pytest.CaptureFixture[str]
) -> None:
    usable_models(copied(tmp_path / "models", own), config, also_rgb)
    assert capsys.readouterr().err == ""


def test_what_calibrate_is_told_names_its_own_option(tmp_path: Path, capsys: pytest.CaptureFixture[str]) -> None:
    usable_models(copied(tmp_path / "models", ("joint_rgbd_plain.npz",)), EstimatorConfig(), plain_by="--plain")
    assert capsys.readouterr().err.endswith("need other settings, --plain\n")
