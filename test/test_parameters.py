"""Parameters: one table for code, file, docs and `ros2 param describe`; changes are all or nothing (F33)."""

from __future__ import annotations

import re
from pathlib import Path
from typing import Any

import pytest
import yaml

from room_layout_ros import node_config
from room_layout_ros.core.config import EstimatorConfig, parameters
from room_layout_ros.node_config import NodeConfig, render_markdown, render_yaml

ROWS = [row for _, table in node_config.TABLES for row in parameters(table)]


def test_the_shipped_file_is_in_step_with_the_code(repository: Path) -> None:
    assert (repository / "config" / "estimator.yaml").read_text("utf-8") == render_yaml(), (
        "run: python -m room_layout_ros.node_config"
    )


def test_the_documented_tables_are_in_step_with_the_code(repository: Path) -> None:
    page = (repository / "docs" / "parameters.md").read_text("utf-8")
    assert page.partition(node_config.MARK)[2].strip() == render_markdown().strip(), (
        "run: python -m room_layout_ros.node_config"
    )


def test_nothing_is_written_but_by_a_call_without_mistakes(
    repository: Path, tmp_path: Path, capsys: pytest.CaptureFixture[str]
) -> None:
    (tmp_path / "config").mkdir()
    (tmp_path / "docs").mkdir()
    (tmp_path / "docs" / "parameters.md").write_text(f"The head.\n{node_config.MARK}\nold")
    before = {path: path.stat().st_mtime_ns for path in (repository / "config").iterdir()}
    for words, code in ((["--help"], 0), (["--hepl"], 2), (["x.yaml"], 2), (["--root", str(tmp_path / "docs")], 2)):
        with pytest.raises(SystemExit) as ended:
            node_config.main(words)
        assert ended.value.code == code
    assert "docs has no config/ or no docs/parameters.md; give a clone by --root" in capsys.readouterr().err
    assert {path: path.stat().st_mtime_ns for path in (repository / "config").iterdir()} == before
    node_config.main(["--root", str(tmp_path)])
    assert (tmp_path / "config" / "estimator.yaml").read_text("utf-8") == render_yaml()
    assert (tmp_path / "docs" / "parameters.md").read_text("utf-8").startswith(f"The head.\n{node_config.MARK}\n\n## ")


def test_the_file_holds_every_parameter_at_its_default_with_its_type() -> None:
    values = yaml.safe_load(render_yaml())["/**"]["ros__parameters"]
    assert list(values) == [row.name for row in ROWS]
    for row in ROWS:
        assert values[row.name] == row.default
        assert type(values[row.name]) is type(row.default)


def test_names_are_used_once_and_each_has_a_meaning() -> None:
    names = [row.name for row in ROWS]
    assert len(names) == len(set(names))
    assert all(row.meaning and re.fullmatch(r"[a-z][a-z0-9_]*", row.name) for row in ROWS)


def test_settings_at_odds_are_refused() -> None:
    with pytest.raises(ValueError, match=r"max_stamp_gap is 0\.6 s; it must be below reset_gap, which is 0\.5 s"):
        NodeConfig(max_stamp_gap=0.6)


@pytest.mark.parametrize("robot", ("base_footprint", "base_link"))
def test_the_floor_frame_is_not_the_robots(robot: str) -> None:
    """Else the robot's frame would get the camera as a second parent."""
    with pytest.raises(ValueError, match=f"^floor_frame is '{robot}', which is robot_frame too; the floor below the"):
        NodeConfig(floor_frame=robot, robot_frame=robot)
    assert NodeConfig(floor_frame="base_footprint", robot_frame="base_link").floor_frame == "base_footprint"
    assert NodeConfig(robot_frame="").floor_frame == "", "neither is given"


@pytest.mark.parametrize("name", ("floor_frame", "robot_frame"))
@pytest.mark.parametrize("frame", ("/a/b", "with space", "a\n", "/", "z\u00fcrich"))
def test_a_frame_that_tf_would_not_take_is_refused(name: str, frame: str) -> None:
    changes: dict[str, Any] = {name: frame}
    with pytest.raises(ValueError, match=f"^{name} is .*; a frame is named by letters"):
        NodeConfig(**changes)
    changes[name] = "left/base_footprint-2"
    assert getattr(NodeConfig(**changes), name) == "left/base_footprint-2"


class TestRos:
    """What rclpy sees."""

    @pytest.fixture(autouse=True)
    def _ros(self) -> None:
        pytest.importorskip("rclpy", reason="rclpy is not installed (pip: extra ros)")

    @pytest.mark.parametrize("row", ROWS, ids=lambda row: row.name)
    def test_descriptors_say_meaning_and_range(self, row: Any) -> None:
        from room_layout_ros.parameters import describe

        descriptor = describe(row)
        assert (descriptor.name, descriptor.description) == (row.name, row.meaning)
        assert descriptor.read_only is not row.runtime
        ranges = [*descriptor.floating_point_range, *descriptor.integer_range]
        if type(row.default) in (int, float) and row.low is not None and row.high is not None:
            assert [(r.from_value, r.to_value) for r in ranges] == [(row.low, row.high)]
        else:
            assert ranges == []

    def test_a_change_makes_a_new_value_and_leaves_the_rest(self) -> None:
        from room_layout_ros.parameters import changed

        old = EstimatorConfig()
        new = changed(old, {"superpixel_count": 300, "max_stamp_gap": 0.1, "use_sim_time": True})
        assert new == EstimatorConfig(superpixel_count=300)
        assert old == EstimatorConfig()
        assert changed(old, {"max_stamp_gap": 0.1}) is old

    @pytest.mark.parametrize(
        ("values", "reason"),
        (
            ({"max_stamp_gap": 2.0}, "allowed is 0.0 to 1.0"),
            ({"max_stamp_gap": float("nan")}, "nan"),
            ({"max_stamp_gap": "x"}, "must be of type float"),
            ({"queue_size": 3.5}, "must be of type int"),
            ({"queue_size": True}, "must be of type int"),
            ({"diagnostics_period": 2.0}, "fixed after the start"),
            ({"queue_size": 5, "max_stamp_gap": 0.9}, "below reset_gap"),
            ({"floor_frame": "base_footprint"}, "which is robot_frame too"),
        ),
    )
    def test_f33_what_is_wrong_is_refused_with_the_reason(self, values: dict[str, Any], reason: str) -> None:
        from room_layout_ros.parameters import changed

        with pytest.raises(ValueError, match=re.escape(reason)):
            changed(NodeConfig(), values)
