"""The import rules of pyproject.toml hold, and the algorithm runs where no ROS is."""

from __future__ import annotations

import ast
import os
import shutil
import subprocess
import sys
from pathlib import Path

import pytest

ROS = {"rclpy", "ament_index_python", "launch", "launch_ros", "tf2_ros"}
SHELL = {
    *("estimator_node", "shell", "stages", "subscriptions", "publications", "parameters", "transforms", "ros_process"),
    *("playback", "listening", "recording"),
}
"""Files right under room_layout_ros/ that may import ROS: those of the node, and those that speak with one."""

HEAVY = {"sklearn", "joblib", "dask", "distributed", "matplotlib", "h5py", "rosbags", "tqdm", "pytest", "PIL"}
BLOCK_ROS = """
import sys
class NoRos:
    def find_spec(self, name, path=None, target=None):
        top = name.partition(".")[0]
        if top in {"rclpy", "rosidl_runtime_py", "ament_index_python"} or top.endswith(("_msgs", "_interfaces")):
            raise ModuleNotFoundError(f"No module named {name!r}", name=name)
sys.meta_path.insert(0, NoRos())
"""


def _is_ros(module: str) -> bool:
    top = module.partition(".")[0]
    return top in ROS or top.endswith(("_msgs", "_interfaces"))


def _lint_imports(folder: Path) -> subprocess.CompletedProcess[str]:
    pytest.importorskip("importlinter", reason="import-linter is in the extra dev")
    program = "import sys; from importlinter.cli import lint_imports_command; lint_imports_command()"
    return subprocess.run(
        [sys.executable, "-c", f"import sys; sys.path.insert(0, '.'); {program}", "--no-cache"],
        cwd=folder,
        env={**os.environ, "PYTHONPATH": str(folder), "NO_COLOR": "1"},
        capture_output=True,
        text=True,
        timeout=120,
    )


def _imports(file: Path) -> set[str]:
    """Absolute modules that a file imports anywhere, inside functions too."""
    found = set()
    for node in ast.walk(ast.parse(file.read_text("utf-8"))):
        if isinstance(node, ast.Import):
            found |= {alias.name for alias in node.names}
        elif isinstance(node, ast.ImportFrom) and not node.level and node.module:
            found.add(node.module)
    return found


def test_import_contract_is_kept(repository: Path) -> None:
    result = _lint_imports(repository)
    assert result.returncode == 0, result.stdout + result.stderr


@pytest.mark.parametrize(
    ("file", "line", "contract"),
    [
        ("room_layout_ros/core/frame.py", "import room_layout_ros.datasets", "core knows nothing of ours"),
        ("room_layout_ros/runtime/__init__.py", "import room_layout_ros.cli", "core knows nothing of ours"),
        ("room_layout_ros/core/labels.py", "import sensor_msgs", "know no ROS"),
        ("msg_adapters/__init__.py", "import room_layout_ros.evaluation", "msg_adapters imports"),
    ],
)
def test_import_contract_finds_a_breach(repository: Path, tmp_path: Path, file: str, line: str, contract: str) -> None:
    for name in ("room_layout_ros", "msg_adapters"):
        shutil.copytree(repository / name, tmp_path / name, ignore=shutil.ignore_patterns("__pycache__"))
    shutil.copy(repository / "pyproject.toml", tmp_path)
    with (tmp_path / file).open("a", encoding="utf-8") as source:
        source.write(f"\n{line}\n")
    result = _lint_imports(tmp_path)
    assert result.returncode != 0
    broken = [text for text in result.stdout.splitlines() if text.endswith("BROKEN")]
    assert any(contract in text for text in broken), result.stdout + result.stderr


def test_ros_is_imported_in_the_shell_alone_and_message_classes_in_one_file(repository: Path) -> None:
    files = [*(repository / "room_layout_ros").rglob("*.py"), *(repository / "msg_adapters").rglob("*.py")]
    importing = {str(f.relative_to(repository)) for f in files if any(map(_is_ros, _imports(f)))}
    assert importing == {"msg_adapters/messages.py", *(f"room_layout_ros/{name}.py" for name in SHELL)}


def test_core_runs_without_ros_and_loads_nothing_heavy() -> None:
    program = f"{BLOCK_ROS}\nimport room_layout_ros.core\nprint(*sorted({{m.partition('.')[0] for m in sys.modules}}))"
    result = subprocess.run([sys.executable, "-c", program], capture_output=True, text=True, timeout=120)
    assert result.returncode == 0, result.stderr
    loaded = set(result.stdout.split())
    assert {"numpy", "room_layout_ros"} <= loaded
    assert not loaded & HEAVY
    assert not {module for module in loaded if _is_ros(module)}


@pytest.mark.parametrize("arguments", [("--help",), ("--version",), ("estimate", "--help")])
def test_command_line_runs_without_ros(arguments: tuple[str, ...]) -> None:
    program = f"{BLOCK_ROS}\nfrom room_layout_ros.cli import main\nsys.exit(main())"
    result = subprocess.run([sys.executable, "-c", program, *arguments], capture_output=True, text=True, timeout=120)
    assert result.returncode == 0, result.stderr
    assert "room" in result.stdout


def test_the_block_blocks() -> None:
    program = f"{BLOCK_ROS}\nimport rclpy"
    result = subprocess.run([sys.executable, "-c", program], capture_output=True, text=True, timeout=60)
    assert "No module named 'rclpy'" in result.stderr


def test_parameters_know_only_the_settings(repository: Path) -> None:
    file = repository / "room_layout_ros" / "parameters.py"
    tree = ast.parse(file.read_text("utf-8"))
    relative = {node.module for node in ast.walk(tree) if isinstance(node, ast.ImportFrom) and node.level}
    own = {module for module in _imports(file) if module.startswith("room_layout_ros")}
    assert relative <= {"core.config", "node_config"}
    assert own <= {"room_layout_ros.core.config", "room_layout_ros.node_config"}
