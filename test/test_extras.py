"""What a hint tells to install can be installed: from the clone, by extras that setup.py has."""

from __future__ import annotations

import re
from pathlib import Path

from room_layout_ros.extras import install_hint


def test_every_hint_names_an_extra_that_there_is_and_no_package_of_an_index(repository: Path) -> None:
    extras = set(re.findall(r'^ *"?(\w+)"?\s*[:=]', (repository / "setup.py").read_text("utf-8"), re.MULTILINE))
    named: set[str] = set()
    for path in (repository / "room_layout_ros").rglob("*.py"):
        text = path.read_text("utf-8")
        assert "room_layout_ros[" not in text, f"{path} names a package that is on no index"
        named |= set(re.findall(r"install_hint\('(\w+)'\)", text))
    assert named >= {"viz", "ros", "train", "playback", "datasets"}
    assert named <= extras
    assert install_hint("viz") == "pip install '.[viz]' in the clone of room_layout_ros"


NEEDS = {"estimator": {"ros"}, "play": {"ros", "playback"}, "dashboard": {"ros", "viz"}}
"""Extras of the commands that a robot's developer is told to start."""


def test_what_readme_installs_for_a_robot_is_enough_to_run_play_and_look(repository: Path) -> None:
    section = (repository / "README.md").read_text("utf-8").partition("## Robot")[2].partition("\n## ")[0]
    (installed,) = re.findall(r"pip install '\.\[([\w,]+)\]'", section)
    named = {"estimator", *re.findall(r"`room-layout (\w+)", section)}
    assert named == set(NEEDS), "it is started, fed and looked at"
    assert set().union(*(NEEDS[command] for command in named)) == set(installed.split(","))
