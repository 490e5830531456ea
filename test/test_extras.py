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
