"""The recorder: whatever hinders it is one sentence and exit code 2; nothing piles up in memory."""

from __future__ import annotations

import json
import os
import resource
import time
from collections.abc import Iterator
from pathlib import Path
from typing import Any

import numpy as np
import pytest

pytest.importorskip("rclpy", reason="rclpy is not installed (pip: extra ros)")
pytest.importorskip("rosbags", reason="rosbags is not installed (pip: extra playback)")

import rclpy
from processes import python, rest, slack

from msg_adapters import messages
from msg_adapters.encode_image import encode_image

pytestmark = pytest.mark.dds

RECORDING = ("-m", "room_layout_ros.recording")


@pytest.fixture
def node() -> Iterator[Any]:
    context = rclpy.Context()
    rclpy.init(context=context)
    node = rclpy.create_node("camera", context=context)
    yield node
    node.destroy_node()
    context.try_shutdown()


def refused(repository: Path, *arguments: str, **variables: str) -> str:
    """Return the sentence of a recorder that ends by itself."""
    with python(repository, *RECORDING, *arguments, **variables) as recorder:
        said = rest(recorder, 30)
    assert recorder.returncode == 2, said
    assert said.count("\n") == 1, said
    return said


def recorded(repository: Path, *arguments: str) -> tuple[list[str], dict[str, list[int]]]:
    """Return what a recorder that ends by itself says, and its counts, the last line."""
    with python(repository, *RECORDING, *arguments) as recorder:
        said = rest(recorder, 30 * slack())
    assert recorder.returncode == 0, said
    *lines, counts = said.splitlines()
    return lines, json.loads(counts)


def test_topics_that_brought_nothing_are_counted_and_those_that_nobody_publishes_named(
    repository: Path, tmp_path: Path, node: Any
) -> None:
    quiet, misspelt = f"/quiet{os.getpid()}", f"/misspelt{os.getpid()}"
    node.create_publisher(messages.Image, quiet, 10)
    out = ("--seconds", f"{3 * slack():g}", "--out", str(tmp_path / "bag"))
    lines, counts = recorded(repository, quiet, misspelt, misspelt, *out)
    assert counts == {quiet: [0, 0], misspelt: [0, 0]}
    assert lines == [f"recording: nobody publishes {misspelt}"]


def test_it_does_not_overwrite(repository: Path, tmp_path: Path) -> None:
    assert "exists" in refused(repository, "--out", str(tmp_path), "/x")


def test_a_name_that_is_no_topic_is_refused(repository: Path, tmp_path: Path) -> None:
    assert "topic name must not" in refused(repository, "bad topic", "--out", str(tmp_path / "bag"))


@pytest.mark.parametrize("domain", ("9999", "-1", "home"))
def test_a_domain_that_is_none_is_refused(repository: Path, tmp_path: Path, domain: str) -> None:
    said = refused(repository, "/x", "--out", str(tmp_path / "bag"), ROS_DOMAIN_ID=domain)
    assert f"ROS_DOMAIN_ID is '{domain}'; it must be a whole number of 0 to 232" in said


def test_a_folder_that_cannot_be_made_is_refused(repository: Path, tmp_path: Path) -> None:
    (tmp_path / "file").touch()
    assert "cannot be written: Not a directory" in refused(repository, "/x", "--out", str(tmp_path / "file" / "bag"))


def test_f42_a_full_disk_ends_it(repository: Path, tmp_path: Path, node: Any) -> None:
    """The kernel refuses to let its files grow any further, as a full disk does."""
    topic = f"/recording{os.getpid()}"
    publisher = node.create_publisher(messages.Image, topic, 10)
    picture = encode_image(np.random.default_rng(1).integers(0, 255, (480, 640, 3), np.uint8), 1, "camera")
    with python(repository, *RECORDING, topic, "--out", str(tmp_path / "bag")) as recorder:
        end = time.monotonic() + 30.0
        while publisher.get_subscription_count() == 0:
            assert time.monotonic() < end
            assert recorder.poll() is None
            time.sleep(0.05)
        resource.prlimit(recorder.pid, resource.RLIMIT_FSIZE, (500_000, resource.RLIM_INFINITY))
        while recorder.poll() is None:
            assert time.monotonic() < end
            publisher.publish(picture)
            time.sleep(0.1)
        said = rest(recorder, 5)
    assert recorder.returncode == 2, said
    assert said.splitlines() == [f"recording: {tmp_path / 'bag'} cannot be written: File too large"]
