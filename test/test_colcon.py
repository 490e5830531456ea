"""colcon builds the package in a workspace, and what it installs starts, as `ros2 run` would start it."""

from __future__ import annotations

import importlib.util
import os
import subprocess
import sys
from pathlib import Path

import pytest
from installed import copy_sources, environment, run_node_until_seen

pytestmark = pytest.mark.skipif(
    importlib.util.find_spec("colcon_core") is None, reason="colcon is not installed (extra dev)"
)

COLCON = [sys.executable, "-m", "colcon", "--log-base", "log"]


def _run(command: list[str], cwd: Path, env: dict[str, str]) -> str:
    result = subprocess.run(command, cwd=cwd, env=env, capture_output=True, text=True, timeout=300)
    assert result.returncode == 0, result.stdout + result.stderr
    return result.stdout


@pytest.fixture(scope="module")
def workspace(repository: Path, tmp_path_factory: pytest.TempPathFactory) -> Path:
    """A colcon workspace with the package in src/ and built into install/."""
    folder = tmp_path_factory.mktemp("workspace")
    (folder / "src").mkdir()
    copy_sources(repository, folder / "src" / "room_layout_ros")
    _run([*COLCON, "build"], folder, environment(folder, path=Path(sys.executable).parent))
    return folder


@pytest.fixture(scope="module")
def sourced(workspace: Path) -> dict[str, str]:
    """The variables after `source install/local_setup.bash`."""
    plain = {
        "PATH": f"{Path(sys.executable).parent}:/usr/bin:/bin",
        "HOME": str(workspace),
        "AMENT_PREFIX_PATH": sys.prefix,
    }
    kept = {k: v for k, v in os.environ.items() if k.startswith(("ROS_", "FASTRTPS_", "NUMBA_"))}
    script = "source install/local_setup.bash && env -0"
    printed = _run(["/bin/bash", "-c", script], workspace, {**kept, **plain})
    return dict(line.split("=", 1) for line in printed.split("\0") if "=" in line)


@pytest.mark.parametrize("executable", ["estimator", "lifecycle_estimator", "room-layout"])
def test_executables_lie_where_ros2_run_looks(workspace: Path, executable: str) -> None:
    file = workspace / "install" / "room_layout_ros" / "lib" / "room_layout_ros" / executable
    assert os.access(file, os.X_OK)
    assert file.read_text("utf-8").splitlines()[0] == f"#!{sys.executable}"  # the interpreter that colcon ran with


def test_share_holds_what_the_source_has(workspace: Path, repository: Path) -> None:
    share = workspace / "install" / "room_layout_ros" / "share"
    assert (share / "ament_index" / "resource_index" / "packages" / "room_layout_ros").is_file()
    for folder in ("config", "launch"):
        shipped = {p.name for p in (repository / folder).iterdir() if p.is_file()}
        assert {p.name for p in (share / "room_layout_ros" / folder).iterdir() if p.is_file()} == shipped


def test_ament_index_finds_the_workspace(workspace: Path, sourced: dict[str, str]) -> None:
    pytest.importorskip("ament_index_python", reason="ROS is not installed")
    program = (
        "from ament_index_python import get_package_prefix; import room_layout_ros;"
        "print(get_package_prefix('room_layout_ros')); print(room_layout_ros.__file__)"
    )
    prefix, module = _run([sys.executable, "-c", program], workspace, sourced).splitlines()
    assert prefix == str(workspace / "install" / "room_layout_ros")
    assert module.startswith(prefix)


@pytest.mark.dds
@pytest.mark.parametrize("executable", ["estimator", "lifecycle_estimator"])
def test_installed_node_starts_and_ends(workspace: Path, sourced: dict[str, str], executable: str) -> None:
    file = workspace / "install" / "room_layout_ros" / "lib" / "room_layout_ros" / executable
    code, output = run_node_until_seen([str(file)], sourced, workspace)
    assert code == 0, output
    assert "Traceback" not in output


def test_colcon_test_finds_the_tests(workspace: Path, sourced: dict[str, str]) -> None:
    """One quick file through `colcon test`: it runs pytest only if setup.py's extra `test` names it."""
    chosen = ["--pytest-args", "test/test_packaging.py", "-k", "test_setup_cfg_puts_scripts_where_ros2_run_looks"]
    _run([*COLCON, "test", *chosen], workspace, sourced)
    summary = _run([*COLCON, "test-result", "--all"], workspace, sourced)
    assert "Summary: 1 test, 0 errors, 0 failures, 0 skipped" in summary


def test_symlink_install_builds(workspace: Path) -> None:
    places = ["--build-base", "build_links", "--install-base", "install_links", "--symlink-install"]
    _run([*COLCON, "build", *places], workspace, environment(workspace, path=Path(sys.executable).parent))
    assert os.access(workspace / "install_links/room_layout_ros/lib/room_layout_ros/estimator", os.X_OK)
