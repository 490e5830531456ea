"""The distance of a face reads the same wherever a person reads it, and says its unit only where it has one."""

from __future__ import annotations

from dataclasses import replace
from types import SimpleNamespace
from typing import Any

import numpy as np
import pytest

from room_layout_ros.commands.dashboard import room_of
from room_layout_ros.core.estimate import RoomEstimate
from room_layout_ros.core.estimator import LayoutEstimator
from room_layout_ros.core.frame import RgbdFrame
from room_layout_ros.core.labels import LABEL_NAMES
from room_layout_ros.datasets import good_samples
from room_layout_ros.datasets.synthetic import SyntheticSource
from room_layout_ros.evaluation.face_text import face_text, says_metres
from room_layout_ros.evaluation.rerun_log import RerunLog


@pytest.fixture(scope="module", params=[True, False], ids=["depth", "color"])
def seen(request: pytest.FixtureRequest) -> tuple[RgbdFrame, RoomEstimate]:
    (sample,) = good_samples(SyntheticSource(frames=1, seed=4))
    frame = sample.frame if request.param else sample.frame.without_depth()
    estimate = LayoutEstimator().estimate(frame)
    assert estimate.polygons
    assert estimate.metric is request.param
    return frame, estimate


def texts(estimate: RoomEstimate) -> list[str]:
    return [face_text(p.face, p.distance, estimate.metric) for p in estimate.polygons]


class Rerun:
    """Keeps what is logged, by entity; every archetype is its arguments."""

    def __init__(self) -> None:
        self.entities: dict[str, Any] = {}

    def log(self, entity: str, value: Any, static: bool = False) -> None:
        self.entities[entity] = value

    def set_time(self, timeline: str, duration: float) -> None:
        pass

    def __getattr__(self, archetype: str) -> Any:
        if archetype == "ViewCoordinates":
            return SimpleNamespace(RDF=None)
        if archetype == "Image":
            return lambda image: SimpleNamespace(compress=lambda jpeg_quality: image)
        return lambda *args, **kwargs: SimpleNamespace(args=args, **kwargs)


def test_rerun_names_the_unit_only_where_there_is_one_and_gets_the_wall_time(
    seen: tuple[RgbdFrame, RoomEstimate],
) -> None:
    frame, estimate = seen
    rerun = Rerun()
    RerunLog(rerun, rerun).add(frame, estimate, 12.5)
    assert rerun.entities["room/faces"].labels == texts(estimate)
    assert all(label.endswith(" m") is estimate.metric for label in rerun.entities["room/faces"].labels)
    assert rerun.entities["milliseconds"].args == (12.5,)


def test_markers_and_dashboard_have_the_same_text(seen: tuple[RgbdFrame, RoomEstimate]) -> None:
    pytest.importorskip("visualization_msgs", reason="ROS is not installed (extra ros)")
    from msg_adapters.encode_room import encode_markers

    frame, estimate = seen
    names = [
        marker.text for marker in encode_markers(replace(estimate, stamp_ns=1), 1.0).markers if marker.ns == "names"
    ]
    numbers = room_of(frame, estimate, LayoutEstimator().config).numbers
    table = [f"{name} {numbers[name]}" for name in (LABEL_NAMES[p.face] for p in estimate.polygons)]
    assert names == table == texts(estimate)


@pytest.mark.parametrize("metric", [True, False])
@pytest.mark.parametrize("face", [1, 2, 3, 4, 5])
def test_the_unit_is_read_back(face: int, metric: bool) -> None:
    assert says_metres(face_text(face, float(np.pi), metric)) is metric


@pytest.mark.parametrize("text", ["", "room", "a table of 2 m", "front wall", "front wall 2 m", "front wall 2.31 km"])
def test_other_texts_tell_nothing_of_the_unit(text: str) -> None:
    assert says_metres(text) is None
