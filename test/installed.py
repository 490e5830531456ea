"""Copies of the sources and environments that tests install the package into."""

from __future__ import annotations

import os
import shutil
import signal
import subprocess
import sys
import sysconfig
import time
import uuid
from pathlib import Path

NOT_SOURCE = shutil.ignore_patterns(
    ".git", ".venv*", "__pycache__", "build", "install", "log", "out", "*.egg-info", ".*_cache"
)
NODE_READY_S = 60.0
NODE_EXIT_S = 5.0


def copy_sources(repository: Path, target: Path) -> Path:
    """Copy what a checkout has, so that building leaves nothing behind in the real one."""
    return shutil.copytree(repository, target, ignore=NOT_SOURCE)


def make_environment(folder: Path) -> Path:
    """Make a virtual environment that sees the dependencies installed here, but not this package; return its bin.

    A path in a .pth file is not searched for further .pth files, so an editable install stays behind.
    """
    subprocess.run([sys.executable, "-m", "venv", "--without-pip", str(folder)], check=True, timeout=60)
    site = Path(sysconfig.get_path("purelib", vars={"base": str(folder)}))
    site.joinpath("dependencies.pth").write_text(sysconfig.get_path("purelib") + "\n", "utf-8")
    return folder / "bin"


def environment(prefix: Path, *, path: Path) -> dict[str, str]:
    """Return the variables for a process of that environment; ROS finds the package in `prefix`, the rest here."""
    kept = {k: v for k, v in os.environ.items() if k not in ("PYTHONPATH", "VIRTUAL_ENV")}
    return {**kept, "PATH": f"{path}:{os.environ['PATH']}", "AMENT_PREFIX_PATH": f"{prefix}:{sys.prefix}"}


def run_node_until_seen(command: list[str], env: dict[str, str], cwd: Path, name: str = "estimator") -> tuple[int, str]:
    """Start a node, wait until it shows in the ROS graph, end it with SIGINT; return its exit code and output.

    It gets a namespace of its own: a node that another test killed stays in the graph for some seconds.

    Raises
    ------
    AssertionError
        When it ends before it is seen, is not seen within a minute, or does not end within seconds.
    """
    log, namespace = cwd / "node.log", f"/run_{uuid.uuid4().hex}"
    with log.open("wb") as output:
        alone = [*command, "--ros-args", "-r", f"__ns:={namespace}"]
        node = subprocess.Popen(alone, env=env, cwd=cwd, stdout=output, stderr=subprocess.STDOUT)
    try:
        _wait_until_seen(node, (name, namespace), log)
        node.send_signal(signal.SIGINT)
        code = node.wait(NODE_EXIT_S)
    except subprocess.TimeoutExpired:
        raise AssertionError(f"{command} still runs {NODE_EXIT_S} s after SIGINT:\n{log.read_text()}") from None
    finally:
        node.kill()
        node.wait()
    return code, log.read_text("utf-8")


def _wait_until_seen(node: subprocess.Popen[bytes], name: tuple[str, str], log: Path) -> None:
    import rclpy
    from rclpy.context import Context

    context = Context()
    rclpy.init(context=context)
    try:
        watcher = rclpy.create_node("watcher", context=context)
        deadline = time.monotonic() + NODE_READY_S
        while name not in watcher.get_node_names_and_namespaces():
            assert node.poll() is None, f"ended with {node.returncode}:\n{log.read_text()}"
            assert time.monotonic() < deadline, f"no node {'/'.join(name)} within {NODE_READY_S} s:\n{log.read_text()}"
            time.sleep(0.1)
        watcher.destroy_node()
    finally:
        context.try_shutdown()
